# SPDX-License-Identifier: Apache-2.0
"""The ASCII interface of a SmarAct MCS, as two public drivers speak it.

Commands, answers and codes: the EPICS driver motorSmarAct (smarActMCSMotorDriver.cpp) and ALBA's
smaract (axis.py, controller.py). Positions in nm, amplitudes in 4095 levels of 100 V.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from typing import NamedTuple

from stickslip_ros.axis import Axis, CommandRefused
from stickslip_ros.emulator.dialogue import Waiting
from stickslip_ros.emulator.smaract import FULL_SCALE_V, LEAST_HERTZ, Channel

SYNTAX, UNKNOWN, TOO_FEW, TOO_MANY, INVALID = 1, 2, 5, 6, 7
NO_REFERENCE_MARK, LOCKED, NOT_POSSIBLE = 144, 146, 150
_LEVELS, _MOST_HERTZ = 4095, 18500
_ENDLESS = 30000  # as many steps stand for a motion without end
_FOR_EVER_MS = 60000
_COMMAND = re.compile(r":([A-Z]+)(-?\d{1,12}(?:,-?\d{1,12})*)?")
_NM = 1e-9


class Refused(Exception):
    """A command that is answered with an error code."""

    def __init__(self, code: int) -> None:
        """Keep the error code of the answer."""
        super().__init__(code)
        self.code = code


class McsChannel(Channel):
    """A channel with its settings."""

    def __init__(self, axis: Axis) -> None:
        """Start with the controller's defaults; all settings are numbers."""
        super().__init__(axis)
        self.settings = {"CLS": [0], "CLA": [0], "SD": [0], "SC": [0, 0], "CLF": [18500]}

    @property
    def status(self) -> int:
        """The code of what the channel does."""
        codes = ((self.locked, 9), (self.targeting, 4), (self.at_target, 3), (self.scanning, 2))
        return next((code for true, code in codes if true), 1 if self.stepping else 0)


class Mcs:
    """The controller: channels numbered from 0 on."""

    name = "mcs"

    def __init__(self, axes: Sequence[Axis]) -> None:
        """Number the axes from 0 on."""
        self.channels = [McsChannel(axis) for axis in axes]
        self.communication = 0  # 0: every command is acknowledged
        self.sensors = 1

    def connect(self) -> McsDialogue:
        """Return the dialogue with a new client."""
        return McsDialogue(self)

    def tick(self) -> None:
        """End the holds that are over."""
        for channel in self.channels:
            channel.tick()


class McsDialogue:
    """Commands of one client; each is answered with a line."""

    greeting = b""
    patience: float | None = None

    def __init__(self, controller: Mcs) -> None:
        """Begin the dialogue of one client with a controller."""
        self._controller = controller

    def answer(self, line: bytes | None) -> bytes | Waiting:
        """Return the answer to a line, `:E<channel>,<code>` if there is nothing else to say."""
        text = None if line is None else line.decode("ascii", "replace").strip()
        if text == "":
            return b""
        found = _COMMAND.fullmatch(text or "")
        if not found:
            return _error(-1, SYNTAX)
        numbers = [int(word) for word in found[2].split(",")] if found[2] else []
        channel = numbers[0] if found[1] in OF_CHANNEL and numbers else -1
        try:
            answer = self._carry_out(found[1], numbers)
        except Refused as refused:
            return _error(channel, refused.code)
        except CommandRefused:
            return _error(channel, INVALID)
        if answer is not None:
            return f":{answer}\n".encode()
        return b"" if self._controller.communication else _error(channel, 0)

    def over(self) -> bool:
        """Whether the server should hang up; it never should."""
        return False

    def _carry_out(self, name: str, numbers: list[int]) -> str | None:
        if name in OF_CONTROLLER:
            _check_count(OF_CONTROLLER[name], len(numbers))
            return OF_CONTROLLER[name].run(self._controller, *numbers)
        if name not in OF_CHANNEL:
            raise Refused(UNKNOWN)
        command = OF_CHANNEL[name]
        if not numbers:
            raise Refused(TOO_FEW)
        if not 0 <= numbers[0] < len(self._controller.channels):
            raise Refused(INVALID)
        channel = self._controller.channels[numbers[0]]
        _check_count(command, len(numbers) - 1)
        if command.moves and channel.locked:
            raise Refused(LOCKED)
        answer = command.run(channel, *numbers[1:])
        # An answer repeats the number of the channel behind its name.
        return answer.replace("#", str(numbers[0])) if answer else None


class Command(NamedTuple):
    """A command of the interface."""

    fewest: int  #: numbers that have to follow, after the channel
    most: int
    run: Callable[..., str | None]
    moves: bool = False


def _check_count(command: Command, count: int) -> None:
    if count < command.fewest:
        raise Refused(TOO_FEW)
    if count > command.most:
        raise Refused(TOO_MANY)


def _error(channel: int, code: int) -> bytes:
    return f":E{channel},{code}\n".encode()


def _check(condition: bool) -> None:
    if not condition:
        raise Refused(INVALID)


def _step(channel: McsChannel, steps: int, level: int, hertz: int) -> None:
    _check(abs(steps) <= _ENDLESS and 0 <= level <= _LEVELS)
    _check(LEAST_HERTZ <= hertz <= _MOST_HERTZ)
    volts = level * FULL_SCALE_V / _LEVELS
    channel.step(steps, volts, float(hertz), endless=abs(steps) == _ENDLESS)


def _go(channel: McsChannel, x: float, hold_ms: int) -> None:
    _check(0 <= hold_ms <= _FOR_EVER_MS)
    channel.go_to(x, math.inf if hold_ms == _FOR_EVER_MS else 1e-3 * hold_ms)


def _scan(channel: McsChannel, level: float, speed: int) -> None:
    _check(0 <= level <= _LEVELS and speed >= 0)
    channel.scan_to(level * FULL_SCALE_V / _LEVELS)


def _limits(channel: McsChannel, low: int, high: int) -> None:
    channel.axis.set_parameters({"soft_low": _NM * low, "soft_high": _NM * high})


def _get_limits(channel: McsChannel) -> str:
    limits = channel.axis.parameters.limits
    return f"PL#,{round(limits.soft_low / _NM)},{round(limits.soft_high / _NM)}"


def _reference(_: McsChannel, *__: int) -> None:
    raise Refused(NO_REFERENCE_MARK)


def _reset(controller: Mcs) -> None:
    for channel in controller.channels:
        channel.axis.stop()
        channel.axis.reset()


def _level(channel: McsChannel) -> int:
    return min(max(round(channel.scan_volts * _LEVELS / FULL_SCALE_V), 0), _LEVELS)


def _set_mode(controller: Mcs, mode: int) -> None:
    _check(mode in (0, 1))
    controller.communication = mode


def _set_sensors(controller: Mcs, mode: int) -> None:
    _check(mode in (0, 1, 2))
    controller.sensors = mode


OF_CONTROLLER: dict[str, Command] = {
    "GSI": Command(0, 0, lambda c: "ID1"),
    "GIV": Command(0, 0, lambda c: "IV1,2,0"),
    "GNC": Command(0, 0, lambda c: f"N{len(c.channels)}"),
    "SCM": Command(1, 1, _set_mode),
    "GCM": Command(0, 0, lambda c: f"CM{c.communication}"),
    "SSE": Command(1, 1, _set_sensors),
    "GSE": Command(0, 0, lambda c: f"SE{c.sensors}"),
    "R": Command(0, 0, _reset),
    "K": Command(1, 1, lambda c, ms: _check(ms == 0 or 100 <= ms <= 60000)),
}

OF_CHANNEL: dict[str, Command] = {
    "MST": Command(3, 3, _step, moves=True),
    "MPA": Command(2, 2, lambda c, x, hold: _go(c, _NM * x, hold), moves=True),
    "MPR": Command(2, 2, lambda c, x, hold: _go(c, c.target + _NM * x, hold), moves=True),
    "MSCA": Command(2, 2, _scan, moves=True),
    "MSCR": Command(2, 2, lambda c, way, speed: _scan(c, _level(c) + way, speed), moves=True),
    "S": Command(0, 0, lambda c: c.stop()),
    "CS": Command(0, 0, lambda c: None, moves=True),
    "FRM": Command(3, 3, _reference, moves=True),
    "SP": Command(1, 1, lambda c, x: c.set_position(_NM * x)),
    "GP": Command(0, 0, lambda c: f"P#,{round(c.position / _NM)}"),
    "GS": Command(0, 0, lambda c: f"S#,{c.status}"),
    "GVL": Command(0, 0, lambda c: f"VL#,{_level(c)}"),
    "SPL": Command(2, 2, _limits),
    "GPL": Command(0, 0, _get_limits),
    "GPPK": Command(0, 0, lambda c: "PPK#,0"),
    "GST": Command(0, 0, lambda c: "ST#,1"),  # a linear positioner with a nanosensor
    "SST": Command(1, 1, lambda c, kind: _check(kind == 1)),
    "GCT": Command(0, 0, lambda c: "CT#,0"),  # a positioner
    "GSN": Command(0, 0, lambda c: "SN#,1"),
    "GFV": Command(0, 0, lambda c: "FV#,1,0,0"),
}


def _add_setting(name: str, count: int) -> None:
    """Add a setting that is stored and reported, without an effect on the motion."""

    def set_it(channel: McsChannel, *numbers: int) -> None:
        channel.settings[name] = list(numbers)

    def get_it(channel: McsChannel) -> str:
        return f"{name}#,{','.join(map(str, channel.settings[name]))}"

    OF_CHANNEL[f"S{name}"] = Command(count, count, set_it)
    OF_CHANNEL[f"G{name}"] = Command(0, 0, get_it)


for _name, _count in (("CLS", 1), ("CLA", 1), ("SD", 1), ("SC", 2), ("CLF", 1)):
    _add_setting(_name, _count)
