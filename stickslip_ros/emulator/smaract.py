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

from stickslip_ros.axis import Axis, CommandRefused
from stickslip_ros.axis.command import DISABLED, FAULT, HOLDING, JOGGING, SCANNING, TARGETING
from stickslip_ros.emulator import controller
from stickslip_ros.emulator.controller import (
    Controller,
    Dialogue,
    Reasons,
    Refused,
    Request,
    lacking,
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
    END_STOP, WRONG_SENSOR, NO_MARK, WRONG_END_EFFECTOR = 142, 143, 144, 145
    LOCKED, RANGE_LIMIT, POSITION_UNKNOWN = 146, 147, 148


#: What both answer to bad commands
_REASONS = Reasons(
    Code.UNKNOWN, Code.INVALID, Code.TOO_FEW, Code.TOO_MANY, Code.LOCKED, Code.INVALID
)


class Channel(controller.Channel):
    """One channel of a SmarAct."""

    most_volts: ClassVar = FULL_SCALE_V

    def __init__(self, axis: Axis) -> None:
        """Start without a motion that a limit has ended."""
        super().__init__(axis)
        self._hits = axis.status.limits_hit  # when the last motion began
        self._short: Code | None = None  # the limit that its target lay beyond

    def step(self, steps: int, volts: float, hertz: float, endless: bool) -> None:
        """Run steps, as every channel does."""
        self.begin()
        super().step(steps, volts, hertz, endless)

    def approach(self, x: float, hold_s: float) -> None:
        """Go to a position (m) and hold it; to a limit, if it lies beyond one, and stop there."""
        target, (low, high) = x + self._origin, self.axis.config.reach
        nearest, limits = min(max(target, low), high), self.axis.parameters.limits
        self.begin()
        self._go(nearest, hold_s if nearest == target else 0.0)
        if nearest != target:
            soft = nearest in (limits.soft_low, limits.soft_high)
            self._short = Code.RANGE_LIMIT if soft else Code.END_STOP

    def seek(self, hold_s: float, zero: bool) -> None:
        """Go to the reference mark, as every channel does. Raises Refused: it is out of reach."""
        self.begin()
        try:
            self.find_reference(hold_s, zero)
        except CommandRefused as refusal:
            raise Refused(Code.NO_MARK) from refusal

    def halt(self) -> None:
        """Stop."""
        self.begin()
        self.axis.command("stop")

    @property
    def stopped_by(self) -> Code | None:
        """What ended the last motion too early: an end of the travel, a range limit, or nothing."""
        status = self.axis.status
        if self.moving:
            return None
        if status.limits_hit > self._hits:
            return Code.END_STOP if status.held_at else Code.RANGE_LIMIT
        return self._short

    def begin(self) -> None:
        """Forget how the last motion ended, as another begins."""
        self._hits, self._short = self.axis.status.limits_hit, None


def _hold(ms: float) -> float:
    """Return the time (s) of a hold as the ASCII interfaces count it. Raises Refused."""
    _check(0 <= ms <= FOR_EVER_MS)
    return math.inf if ms == FOR_EVER_MS else 1e-3 * ms


def _check(condition: bool) -> None:
    require(condition, Code.INVALID)


def _reset(controller: Controller) -> None:
    for one in controller.channels:
        one.halt()
        one.axis.command("reset")


# -- MCS

_LEVELS = 4095
_ENDLESS = 30000  # as many steps stand for a motion without end
_MCS_LINE = re.compile(r":([A-Z]+)(-?\d{1,12}(?:,-?\d{1,12})*)?")
_NM = 1e-9
_NO_RANGE = (-1.0, 1.0)  #: soft limits (m) that limit nothing
#: Code of what the channel does in a state; in others 1 while it steps and 0 at rest
_REFERENCING = 7
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

    @property
    def status(self) -> int:
        """The code of what the channel does."""
        mode = self.axis.mode
        return _REFERENCING if self.referencing else _MCS_STATUS.get(mode, int(self.axis.moving))

    def tell_range(self) -> str:
        """Return the limits (nm). Raises Refused: there are none."""
        limits = self.axis.parameters.limits
        require((limits.soft_low, limits.soft_high) != _NO_RANGE, Code.POSITION_UNKNOWN)
        return ",".join(str(round(self.limit(name) / _NM)) for name in ("soft_low", "soft_high"))

    def set_range(self, low: float, high: float) -> None:
        """Limit the travel to positions (nm), which have to be known; equal ones remove that."""
        require(self.referenced, Code.POSITION_UNKNOWN)
        _check(low <= high)
        if low == high:
            self.axis.command(
                "parameters", dict(zip(("soft_low", "soft_high"), _NO_RANGE, strict=True))
            )
        else:
            self.set_limits(soft_low=_NM * low, soft_high=_NM * high)


class McsDialogue(Dialogue):
    """Commands of one client; each is answered with a line."""

    reasons = _REASONS

    def __init__(self, controller: Mcs) -> None:
        """Begin without an error that the client is to be told."""
        super().__init__(controller)
        self._stopped: list[Code | None] = [None] * len(controller.channels)

    def news(self) -> bytes:
        """Return the errors of moves that a limit has ended since, in asynchronous mode alone."""
        before, self._stopped = self._stopped, [c.stopped_by for c in self.controller.channels]
        return b"".join(
            _mcs_error(number, now)
            for number, (old, now) in enumerate(zip(before, self._stopped, strict=True))
            if now and now != old and self.controller.communication
        )

    def answer(self, line: bytes | None) -> bytes:
        """Return the answer to a line, `:E<channel>,<code>` if there is nothing else to say."""
        text = "" if line is None else line.decode("ascii", "replace").strip()
        before, colon, command = text.partition(":")
        if not command and line is not None and (colon or not before):
            return b""  # nothing; what stands before a colon does not count
        found = _MCS_LINE.fullmatch(f"{colon}{command}")
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
    hand_control = 1


def _mcs_error(channel: int, code: int) -> bytes:
    return f":E{channel},{code:d}\n".encode()


def _mcs_step(channel: McsChannel, steps: int, level: int, hertz: int) -> None:
    _check(abs(steps) <= _ENDLESS and 0 <= level <= _LEVELS)
    _check(LEAST_HERTZ <= hertz <= MOST_HERTZ)
    volts = level * FULL_SCALE_V / _LEVELS
    channel.step(steps, volts, float(hertz), endless=abs(steps) == _ENDLESS)


def _scan(channel: McsChannel, level: float, speed: int) -> None:
    _check(0 <= level <= _LEVELS and speed >= 0)
    channel.begin()
    channel.axis.command("scan", level * FULL_SCALE_V / _LEVELS)


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


def _find_mark(channel: McsChannel, direction: int, hold: int, zero: int) -> None:
    _check(0 <= direction <= 7 and zero in (0, 1))
    channel.seek(_hold(hold), bool(zero))


MCS_CONTROLLER: dict[str, Request] = {
    "GSI": Request(lambda c: "ID1"),
    "GIV": Request(lambda c: "IV1,2,0"),
    "GNC": Request(lambda c: f"N{len(c.channels)}"),
    "SCM": _set_mode("communication", 2),
    "GCM": Request(lambda c: f"CM{c.communication}"),
    "SSE": _set_mode("sensors", 3),
    "GSE": Request(lambda c: f"SE{c.sensors}"),
    "SHE": _set_mode("hand_control", 3),
    "R": Request(_reset),
    "K": Request(lambda c, ms: _check(ms == 0 or 100 <= ms <= 60000), 1),
    **lacking(Code.UNKNOWN, "BR TC"),
}

MCS_CHANNEL: dict[str, Request] = {
    "MST": Request(_mcs_step, 3, moves=True),
    "MPA": Request(lambda c, x, hold: c.approach(_NM * x, _hold(hold)), 2, moves=True),
    "MPR": Request(lambda c, x, hold: c.approach(c.target + _NM * x, _hold(hold)), 2, moves=True),
    "MSCA": Request(_scan, 2, moves=True),
    "MSCR": Request(lambda c, distance, speed: _scan(c, c.level + distance, speed), 2, moves=True),
    "S": Request(McsChannel.halt),
    "CS": Request(lambda c: None, moves=True),
    "FRM": Request(_find_mark, 3, moves=True),
    "SP": Request(lambda c, x: c.set_position(_NM * x), 1),
    "GP": Request(lambda c: f"P#,{round(c.position / _NM)}"),
    "GS": Request(lambda c: f"S#,{c.status}"),
    "GVL": Request(lambda c: f"VL#,{c.level}"),
    "SPL": Request(McsChannel.set_range, 2),
    "GPL": Request(lambda c: f"PL#,{c.tell_range()}"),
    "GPPK": Request(lambda c: f"PPK#,{c.referenced:d}"),
    "GST": Request(lambda c: "ST#,1"),  # a linear positioner with a nanosensor
    "SST": Request(lambda c, kind: _check(kind == 1), 1),
    "GCT": Request(lambda c: "CT#,0"),  # a positioner
    "GSN": Request(lambda c: "SN#,1"),
    "GFV": Request(lambda c: "FV#,1,0,0"),
    **lacking(Code.WRONG_SENSOR, "GA GAL MAA MAR SAL"),  # of rotary positioners
    **lacking(Code.WRONG_END_EFFECTOR, "GF GGO MGFA MGOA MGOR SZF"),  # of grippers
    **lacking(
        Code.UNKNOWN, "ATC CTCQ FP GB GCP GEET GES GFP GTE GTP SARP SCP SEET SRC SRT SSW STE"
    ),
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
_BAUD = re.compile(r"^CB\d{4,6}$")
#: Letter of what a channel does in a state; in others M while it moves and S at rest
_SCU_STATUS = {TARGETING: "T", HOLDING: "H", SCANNING: "A", FAULT: "S", DISABLED: "S"}


#: Settings that are stored and reported, without an effect on the motion: letter and range
_SCU_SETTINGS = {"CLF": ("F", LEAST_HERTZ, MOST_HERTZ), "SD": ("D", 0, 1), "ST": ("T", 1, 40)}


class ScuChannel(Channel):
    """A channel with its settings; the positioner is a linear one."""

    first_settings: ClassVar = {"CLF": MOST_HERTZ, "SD": 0, "ST": 1}

    @property
    def status(self) -> str:
        """The letter of what the channel does."""
        axis = self.axis
        return "R" if self.referencing else _SCU_STATUS.get(axis.mode, "SM"[axis.moving])


class ScuCommand(NamedTuple):
    """A command of a channel."""

    run: Callable[..., Any]  #: gets the channel and the values by letter; returns the answer
    required: str = ""  #: letters of values that have to follow
    optional: str = ""  #: letters of values that may follow
    moves: bool = False  #: refused while the channel may not move
    lacking: str = ""  #: as of a `Request`


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
        if (name := _BAUD.sub("CB", text)) in SCU_CONTROLLER:
            try:
                return _line(SCU_CONTROLLER[name](self.controller))
            except CommandRefused:
                return _scu_error("", self.reasons.impossible)
        if not found:
            return _scu_error("", Code.SYNTAX)
        name, number, values = found.groups()
        try:
            pairs = _VALUE.findall(values)
            require(len(dict(pairs)) == len(pairs), Code.INVALID)  # each letter once
            return _line(self._answer_channel(name, number, dict(pairs)))
        except Refused as refused:
            return _scu_error(number, refused.reason)

    def _answer_channel(self, name: str, number: str, values: dict[str, str]) -> str | None:
        require(name in SCU_CHANNEL, Code.UNKNOWN)
        command = SCU_CHANNEL[name]
        require(number and set(command.required) <= set(values), Code.TOO_FEW)
        channel = self.channel(int(number))
        _check(bool(command.lacking) or set(values) <= set(command.required + command.optional))
        request = Request(
            lambda *c: command.run(*c, **values), moves=command.moves, lacking=command.lacking
        )
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
        hertz, volts, steps = _number(F), 0.1 * _number(A), _number(S)
        _check(steps.is_integer())
        _check(LEAST_HERTZ <= hertz <= MOST_HERTZ and 1 <= steps <= _MOST_STEPS)
        _check(_LEAST_VOLTS <= volts <= FULL_SCALE_V)
        channel.step(sign * int(steps), volts, hertz, endless=False)

    return run


def _scu_hold(text: str) -> float:
    return _hold(_number(text))


def _scu_find_mark(channel: ScuChannel, H: str = "0", Z: str = "0") -> None:
    _check(Z in ("0", "1"))
    channel.seek(_scu_hold(H), Z == "1")


def _go_to_end(channel: ScuChannel, D: str) -> None:
    _check(D in ("U", "D"))
    channel.axis.command("jog", math.copysign(channel.axis.status.frequency, 1 if D == "U" else -1))


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
    "CB": lambda c: None,  # TCP has no rate
}

SCU_CHANNEL: dict[str, ScuCommand] = {
    "U": ScuCommand(_scu_step(1), "FAS", moves=True),
    "D": ScuCommand(_scu_step(-1), "FAS", moves=True),
    "MPA": ScuCommand(
        lambda c, P, H="0": c.approach(_UM * _number(P), _scu_hold(H)), "P", "H", moves=True
    ),
    "MPR": ScuCommand(
        lambda c, P, H="0": c.approach(c.target + _UM * _number(P), _scu_hold(H)),
        "P",
        "H",
        moves=True,
    ),
    "MES": ScuCommand(_go_to_end, "D", moves=True),
    "MTR": ScuCommand(_scu_find_mark, "", "HZ", moves=True),
    "S": ScuCommand(ScuChannel.halt),
    "CS": ScuCommand(lambda c: None, moves=True),
    "SZ": ScuCommand(lambda c: c.set_position(0.0)),
    "GP": ScuCommand(lambda c: f"P#P{c.position / _UM:.4f}"),
    "GPPK": ScuCommand(lambda c: f"PPK#P{c.referenced:d}"),
    "M": ScuCommand(lambda c: f"M#{c.status}"),
    "GSP": ScuCommand(lambda c: "SP#P"),
    **{
        name: ScuCommand(lambda *_, **__: Code.WRONG_SENSOR, lacking=name)  # of rotary positioners
        for name in ("GA", "MAA", "MAR")
    },
}
for _name in _SCU_SETTINGS:
    SCU_CHANNEL[f"S{_name}"], SCU_CHANNEL[f"G{_name}"] = _scu_setting(_name)
