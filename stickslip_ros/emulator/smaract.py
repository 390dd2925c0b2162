# SPDX-License-Identifier: Apache-2.0
"""The ASCII interfaces of SmarAct's MCS and SCU, as public drivers speak them.

MCS: the EPICS driver motorSmarAct (smarActMCSMotorDriver.cpp) and ALBA's smaract (axis.py,
controller.py). Positions in nm, amplitudes in 4095 levels of 100 V; each command is answered.

SCU: PyMeasure (instruments/smaract/scu_ascii.py) and motorSmarAct (smarActSCUMotorDriver.cpp).
Positions in um, amplitudes in tenths of a volt; a query is answered, a command that is carried out
is not.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from enum import IntEnum
from functools import partial
from typing import Any, ClassVar, NamedTuple

from stickslip_ros.axis import CommandRefused
from stickslip_ros.axis.command import DISABLED, FAULT, HOLDING, JOGGING, SCANNING, TARGETING
from stickslip_ros.emulator import controller
from stickslip_ros.emulator.controller import (
    Controller,
    Dialogue,
    Reasons,
    Refused,
    Request,
    require,
    stored,
)

FULL_SCALE_V = 100.0  #: voltage of the highest level of amplitudes and scans
LEAST_HERTZ = 1
#: Of the two ASCII interfaces: the highest frequency, and the hold time that has no end (ms)
MOST_HERTZ, FOR_EVER_MS = 18500, 60000


class Code(IntEnum):
    """The errors of the two ASCII interfaces."""

    SYNTAX, UNKNOWN, TOO_FEW, TOO_MANY, INVALID = 1, 2, 5, 6, 7
    NO_REFERENCE_MARK, LOCKED = 144, 146


#: What both answer to bad commands
_REASONS = Reasons(
    Code.UNKNOWN, Code.INVALID, Code.TOO_FEW, Code.TOO_MANY, Code.LOCKED, Code.INVALID
)


class Channel(controller.Channel):
    """One channel of a SmarAct."""

    most_volts: ClassVar = FULL_SCALE_V

    def go_to_for(self, x: float, hold_ms: float) -> None:
        """Go to a position (m) and hold it for a time (ms), as the ASCII interfaces count it."""
        _check(0 <= hold_ms <= FOR_EVER_MS)
        self.go_to(x, math.inf if hold_ms == FOR_EVER_MS else 1e-3 * hold_ms)


def _check(condition: bool) -> None:
    require(condition, Code.INVALID)


def _refuse_reference(*_: object, **__: object) -> None:
    """Refuse to look for a reference mark: the simulated sensor has none."""
    require(False, Code.NO_REFERENCE_MARK)


def _reset(controller: Controller) -> None:
    for one in controller.channels:
        one.axis.stop()
        one.axis.reset()


# -- MCS

_LEVELS = 4095
_ENDLESS = 30000  # as many steps stand for a motion without end
_MCS_LINE = re.compile(r":([A-Z]+)(-?\d{1,12}(?:,-?\d{1,12})*)?")
_NM = 1e-9
#: Code of what the channel does in a state; in others 1 while it steps and 0 at rest
_MCS_STATUS = {FAULT: 9, DISABLED: 9, TARGETING: 4, HOLDING: 3, SCANNING: 2, JOGGING: 1}
#: Settings that are stored and reported, without an effect on the motion
_SETTINGS = {"CLS": "0", "CLA": "0", "SD": "0", "SC": "0,0", "CLF": str(MOST_HERTZ)}
#: Lowest and highest number of each
_RANGES: dict[str, list[tuple[float, float]]] = {
    "CLS": [(0, 1e8)], "CLA": [(0, 1e7)], "SD": [(0, 1)], "SC": [(-math.inf, math.inf), (0, 1)],
    "CLF": [(50, MOST_HERTZ)],
}  # fmt: skip


class McsChannel(Channel):
    """A channel with its settings."""

    first_settings = _SETTINGS

    @property
    def level(self) -> int:
        """Level of the actuator, of 4095."""
        return min(max(round(self.axis.status.scan_level * _LEVELS / FULL_SCALE_V), 0), _LEVELS)


class McsDialogue(Dialogue):
    """Commands of one client; each is answered with a line."""

    reasons = _REASONS

    def answer(self, line: bytes | None) -> bytes:
        """Return the answer to a line, `:E<channel>,<code>` if there is nothing else to say."""
        text = None if line is None else line.decode("ascii", "replace").strip()
        if text == "":
            return b""
        found = _MCS_LINE.fullmatch(text or "")
        if not found:
            return _mcs_error(-1, Code.SYNTAX)
        numbers = [int(word) for word in found[2].split(",")] if found[2] else []
        channel = numbers[0] if found[1] in MCS_CHANNEL and numbers else -1
        try:
            answer = self._answer(found[1], numbers)
        except Refused as refused:
            return _mcs_error(channel, refused.reason)
        if answer is not None:
            return f":{answer}\n".encode()
        return b"" if self.controller.communication else _mcs_error(channel, 0)

    def _answer(self, name: str, numbers: list[int]) -> str | None:
        if name in MCS_CONTROLLER:
            return self.carry_out(MCS_CONTROLLER[name], self.controller, numbers)
        require(numbers or name not in MCS_CHANNEL, Code.TOO_FEW)
        channel = self.channel(numbers[0]) if name in MCS_CHANNEL else None
        answer = self.carry_out(MCS_CHANNEL.get(name), channel, numbers[1:])
        # An answer repeats the number of the channel behind its name.
        return answer.replace("#", str(numbers[0])) if answer else None


class Mcs(Controller):
    """The controller: channels numbered from 0 on."""

    channel = McsChannel
    dialogue = McsDialogue
    communication = 0  #: 0: every command is acknowledged
    sensors = 1


def _mcs_error(channel: int, code: int) -> bytes:
    return f":E{channel},{code:d}\n".encode()


def _mcs_step(channel: McsChannel, steps: int, level: int, hertz: int) -> None:
    _check(abs(steps) <= _ENDLESS and 0 <= level <= _LEVELS)
    _check(LEAST_HERTZ <= hertz <= MOST_HERTZ)
    volts = level * FULL_SCALE_V / _LEVELS
    channel.step(steps, volts, float(hertz), endless=abs(steps) == _ENDLESS)


def _scan(channel: McsChannel, level: float, speed: int) -> None:
    _check(0 <= level <= _LEVELS and speed >= 0)
    channel.axis.command_scan(level * FULL_SCALE_V / _LEVELS)


def _joined(name: str, *numbers: int) -> str:
    """Return the numbers of a setting as they are stored. Raises Refused."""
    _check(all(low <= n <= high for n, (low, high) in zip(numbers, _RANGES[name], strict=True)))
    return ",".join(map(str, numbers))


def _set_mode(name: str, modes: int) -> Request:
    """Return the command that sets an attribute of the controller to a mode below ``modes``."""

    def run(controller: Mcs, mode: int) -> None:
        _check(0 <= mode < modes)
        setattr(controller, name, mode)

    return Request(run, 1)


MCS_CONTROLLER: dict[str, Request] = {
    "GSI": Request(lambda c: "ID1"),
    "GIV": Request(lambda c: "IV1,2,0"),
    "GNC": Request(lambda c: f"N{len(c.channels)}"),
    "SCM": _set_mode("communication", 2),
    "GCM": Request(lambda c: f"CM{c.communication}"),
    "SSE": _set_mode("sensors", 3),
    "GSE": Request(lambda c: f"SE{c.sensors}"),
    "R": Request(_reset),
    "K": Request(lambda c, ms: _check(ms == 0 or 100 <= ms <= 60000), 1),
}

MCS_CHANNEL: dict[str, Request] = {
    "MST": Request(_mcs_step, 3, moves=True),
    "MPA": Request(lambda c, x, hold: c.go_to_for(_NM * x, hold), 2, moves=True),
    "MPR": Request(lambda c, x, hold: c.go_to_for(c.target + _NM * x, hold), 2, moves=True),
    "MSCA": Request(_scan, 2, moves=True),
    "MSCR": Request(lambda c, distance, speed: _scan(c, c.level + distance, speed), 2, moves=True),
    "S": Request(lambda c: c.axis.stop()),
    "CS": Request(lambda c: None, moves=True),
    "FRM": Request(_refuse_reference, 3, moves=True),
    "SP": Request(lambda c, x: c.set_position(_NM * x), 1),
    "GP": Request(lambda c: f"P#,{round(c.position / _NM)}"),
    "GS": Request(lambda c: f"S#,{_MCS_STATUS.get(c.axis.mode, int(c.axis.moving))}"),
    "GVL": Request(lambda c: f"VL#,{c.level}"),
    "SPL": Request(lambda c, low, high: c.set_limits(soft_low=_NM * low, soft_high=_NM * high), 2),
    "GPL": Request(
        lambda c: f"PL#,{round(c.limit('soft_low') / _NM)},{round(c.limit('soft_high') / _NM)}"
    ),
    "GPPK": Request(lambda c: "PPK#,0"),
    "GST": Request(lambda c: "ST#,1"),  # a linear positioner with a nanosensor
    "SST": Request(lambda c, kind: _check(kind == 1), 1),
    "GCT": Request(lambda c: "CT#,0"),  # a positioner
    "GSN": Request(lambda c: "SN#,1"),
    "GFV": Request(lambda c: "FV#,1,0,0"),
}
for _name, _ranges in _RANGES.items():
    MCS_CHANNEL[f"S{_name}"], MCS_CHANNEL[f"G{_name}"] = stored(
        _name, partial(_joined, _name), len(_ranges), partial("{}#,{}".format, _name)
    )


# -- SCU

_MOST_STEPS, _LEAST_VOLTS = 30000, 15.0
_UM = 1e-6
#: A command, the number of its channel, and letters with a number or a direction each.
_SCU_COMMAND = re.compile(r"([A-Z]+)(\d?)((?:[A-Z](?:-?\d{1,12}(?:\.\d{1,9})?|[UD]))*)")
_VALUE = re.compile(r"([A-Z])(-?\d+(?:\.\d+)?|[UD])")
_BAUD = re.compile(r"CB\d{4,6}")
#: Letter of what a channel does in a state; in others M while it moves and S at rest
_SCU_STATUS = {TARGETING: "T", HOLDING: "H", SCANNING: "A", FAULT: "S", DISABLED: "S"}


#: Settings that are stored and reported, without an effect on the motion: letter and range
_SCU_SETTINGS = {"CLF": ("F", LEAST_HERTZ, MOST_HERTZ), "SD": ("D", 0, 1), "ST": ("T", 1, 40)}


class ScuChannel(Channel):
    """A channel with its settings; the positioner is a linear one."""

    first_settings: ClassVar = {"CLF": MOST_HERTZ, "SD": 0, "ST": 1}


class ScuCommand(NamedTuple):
    """A command of a channel."""

    run: Callable[..., Any]  #: gets the channel and the values by letter; returns the answer
    required: str = ""  #: letters of values that have to follow
    optional: str = ""  #: letters of values that may follow
    moves: bool = False  #: refused while the channel may not move


class ScuDialogue(Dialogue):
    """One client; a line may hold several commands."""

    reasons = _REASONS

    def answer(self, line: bytes | None) -> bytes:
        """Return the answers to the commands of a line, `:E<channel>C<code>` for a bad one."""
        text = None if line is None else line.decode("ascii", "replace").strip()
        if text == "":
            return b""
        if text is None or not text.startswith(":"):
            return _scu_error("", Code.SYNTAX)
        return b"".join(self._answer_command(part) for part in text[1:].split(":"))

    def _answer_command(self, text: str) -> bytes:
        found = _SCU_COMMAND.fullmatch(text)
        if text in SCU_CONTROLLER:
            try:
                return _line(SCU_CONTROLLER[text](self.controller))
            except CommandRefused:
                return _scu_error("", self.reasons.impossible)
        if _BAUD.fullmatch(text):
            return b""  # TCP has no rate
        if not found:
            return _scu_error("", Code.SYNTAX)
        name, number, values = found.groups()
        try:
            return _line(self._answer_channel(name, number, dict(_VALUE.findall(values))))
        except Refused as refused:
            return _scu_error(number, refused.reason)

    def _answer_channel(self, name: str, number: str, values: dict[str, str]) -> str | None:
        require(name in SCU_CHANNEL, Code.UNKNOWN)
        command = SCU_CHANNEL[name]
        require(number and set(command.required) <= set(values), Code.TOO_FEW)
        channel = self.channel(int(number))
        _check(set(values) <= set(command.required + command.optional))
        request = Request(lambda c: command.run(c, **values), moves=command.moves)
        answer: str | None = self.carry_out(request, channel, ())
        # An answer repeats the number of the channel behind its name.
        return answer.replace("#", number) if answer else None


class Scu(Controller):
    """The controller: up to three channels, numbered from 0 on."""

    channel = ScuChannel
    dialogue = ScuDialogue


def _line(answer: str | None) -> bytes:
    return f":{answer}\n".encode() if answer else b""


def _scu_error(channel: str, code: int) -> bytes:
    return f":E{channel or -1}C{code:d}\n".encode()


def _number(text: str) -> float:
    """Return a value that must be no direction."""
    _check(text not in ("U", "D"))
    return float(text)


def _scu_step(sign: int) -> Callable[..., None]:
    """Return the command that steps up or down: F frequency (Hz), A amplitude (0.1 V), S steps."""

    def run(channel: ScuChannel, F: str, A: str, S: str) -> None:
        hertz, volts, steps = _number(F), 0.1 * _number(A), int(_number(S))
        _check(LEAST_HERTZ <= hertz <= MOST_HERTZ and 1 <= steps <= _MOST_STEPS)
        _check(_LEAST_VOLTS <= volts <= FULL_SCALE_V)
        channel.step(sign * steps, volts, hertz, endless=False)

    return run


def _go_to_end(channel: ScuChannel, D: str) -> None:
    _check(D in ("U", "D"))
    channel.axis.command_jog(math.copysign(channel.axis.status.frequency, 1 if D == "U" else -1))


def _scu_setting(name: str) -> tuple[ScuCommand, ScuCommand]:
    """Return the commands that set and get a setting, a whole number."""
    letter, low, high = _SCU_SETTINGS[name]

    def keep(channel: ScuChannel, **values: str) -> None:
        _check(low <= _number(values[letter]) <= high)
        channel.settings[name] = int(_number(values[letter]))

    show = ScuCommand(lambda c: f"{name}#{letter}{c.settings[name]}")
    return ScuCommand(keep, letter), show


SCU_CONTROLLER: dict[str, Callable[[Scu], str | None]] = {
    "I": lambda c: f"ISmarAct CU-{len(c.channels)}D",
    "GID": lambda c: "ID1",
    "R": _reset,
}

SCU_CHANNEL: dict[str, ScuCommand] = {
    "U": ScuCommand(_scu_step(1), "FAS", moves=True),
    "D": ScuCommand(_scu_step(-1), "FAS", moves=True),
    "MPA": ScuCommand(
        lambda c, P, H="0": c.go_to_for(_UM * _number(P), _number(H)), "P", "H", moves=True
    ),
    "MPR": ScuCommand(
        lambda c, P, H="0": c.go_to_for(c.target + _UM * _number(P), _number(H)),
        "P",
        "H",
        moves=True,
    ),
    "MES": ScuCommand(_go_to_end, "D", moves=True),
    "MTR": ScuCommand(_refuse_reference, "", "HZ", moves=True),
    "S": ScuCommand(lambda c: c.axis.stop()),
    "CS": ScuCommand(lambda c: None, moves=True),
    "SZ": ScuCommand(lambda c: c.set_position(0.0)),
    "GP": ScuCommand(lambda c: f"P#P{c.position / _UM:.4f}"),
    "GPPK": ScuCommand(lambda c: "PPK#P0"),
    "M": ScuCommand(lambda c: f"M#{_SCU_STATUS.get(c.axis.mode, 'SM'[c.axis.moving])}"),
    "GSP": ScuCommand(lambda c: "SP#P"),
}
for _name in _SCU_SETTINGS:
    SCU_CHANNEL[f"S{_name}"], SCU_CHANNEL[f"G{_name}"] = _scu_setting(_name)
