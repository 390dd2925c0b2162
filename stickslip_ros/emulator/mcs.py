# SPDX-License-Identifier: Apache-2.0
"""The ASCII interface of a SmarAct MCS, as two public drivers speak it.

Commands, answers and codes: the EPICS driver motorSmarAct (smarActMCSMotorDriver.cpp) and ALBA's
smaract (axis.py, controller.py). Positions in nm, amplitudes in 4095 levels of 100 V.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from stickslip_ros.axis import Axis, CommandRefused
from stickslip_ros.axis.state_machine import DISABLED, FAULT, HOLDING, JOGGING, SCANNING, TARGETING
from stickslip_ros.emulator.dialogue import Controller, Dialogue, Refused, Request
from stickslip_ros.emulator.smaract import (
    FULL_SCALE_V,
    LEAST_HERTZ,
    MOST_HERTZ,
    Channel,
    Code,
    check,
    refuse_reference,
    reset,
)

_LEVELS = 4095
_ENDLESS = 30000  # as many steps stand for a motion without end
_COMMAND = re.compile(r":([A-Z]+)(-?\d{1,12}(?:,-?\d{1,12})*)?")
_NM = 1e-9
#: Code of what the channel does in a state; in others 1 while it steps and 0 at rest
_STATUS = {FAULT: 9, DISABLED: 9, TARGETING: 4, HOLDING: 3, SCANNING: 2, JOGGING: 1}
#: Settings that are stored and reported, without an effect on the motion
_SETTINGS = {"CLS": [0], "CLA": [0], "SD": [0], "SC": [0, 0], "CLF": [MOST_HERTZ]}


class McsChannel(Channel):
    """A channel with its settings."""

    def __init__(self, axis: Axis) -> None:
        """Start with the controller's defaults."""
        super().__init__(axis)
        self.settings = dict(_SETTINGS)

    @property
    def level(self) -> int:
        """Level of the actuator, of 4095."""
        return min(max(round(self.axis.status.scan_level * _LEVELS / FULL_SCALE_V), 0), _LEVELS)


class McsDialogue(Dialogue):
    """Commands of one client; each is answered with a line."""

    def answer(self, line: bytes | None) -> bytes:
        """Return the answer to a line, `:E<channel>,<code>` if there is nothing else to say."""
        text = None if line is None else line.decode("ascii", "replace").strip()
        if text == "":
            return b""
        found = _COMMAND.fullmatch(text or "")
        if not found:
            return _error(-1, Code.SYNTAX)
        numbers = [int(word) for word in found[2].split(",")] if found[2] else []
        channel = numbers[0] if found[1] in OF_CHANNEL and numbers else -1
        try:
            answer = self._carry_out(found[1], numbers)
        except Refused as refused:
            return _error(channel, refused.reason)
        except CommandRefused:
            return _error(channel, Code.INVALID)
        if answer is not None:
            return f":{answer}\n".encode()
        return b"" if self.controller.communication else _error(channel, 0)

    def _carry_out(self, name: str, numbers: list[int]) -> str | None:
        if name in OF_CONTROLLER:
            OF_CONTROLLER[name].check_count(len(numbers), Code.TOO_FEW, Code.TOO_MANY)
            answer: str | None = OF_CONTROLLER[name].run(self.controller, *numbers)
            return answer
        if name not in OF_CHANNEL:
            raise Refused(Code.UNKNOWN)
        if not numbers:
            raise Refused(Code.TOO_FEW)
        check(0 <= numbers[0] < len(self.controller.channels))
        channel, command = self.controller.channels[numbers[0]], OF_CHANNEL[name]
        command.check_count(len(numbers) - 1, Code.TOO_FEW, Code.TOO_MANY)
        if command.moves and channel.locked:
            raise Refused(Code.LOCKED)
        answer = command.run(channel, *numbers[1:])
        # An answer repeats the number of the channel behind its name.
        return answer.replace("#", str(numbers[0])) if answer else None


class Mcs(Controller):
    """The controller: channels numbered from 0 on."""

    channel = McsChannel
    dialogue = McsDialogue

    def __init__(self, axes: Sequence[Axis]) -> None:
        """Number the axes from 0 on."""
        super().__init__(axes)
        self.communication = 0  # 0: every command is acknowledged
        self.sensors = 1


def _error(channel: int, code: int) -> bytes:
    return f":E{channel},{code:d}\n".encode()


def _step(channel: McsChannel, steps: int, level: int, hertz: int) -> None:
    check(abs(steps) <= _ENDLESS and 0 <= level <= _LEVELS)
    check(LEAST_HERTZ <= hertz <= MOST_HERTZ)
    volts = level * FULL_SCALE_V / _LEVELS
    channel.step(steps, volts, float(hertz), endless=abs(steps) == _ENDLESS)


def _scan(channel: McsChannel, level: float, speed: int) -> None:
    check(0 <= level <= _LEVELS and speed >= 0)
    channel.axis.command_scan(level * FULL_SCALE_V / _LEVELS)


def _set_limits(channel: McsChannel, low: int, high: int) -> None:
    channel.set_limits(soft_low=_NM * low, soft_high=_NM * high)


def _limits(channel: McsChannel) -> str:
    low, high = (channel.limit(name) for name in ("soft_low", "soft_high"))
    return f"PL#,{round(low / _NM)},{round(high / _NM)}"


def _set_mode(name: str, modes: int) -> Request:
    """Return the command that sets an attribute of the controller to a mode below ``modes``."""

    def run(controller: Mcs, mode: int) -> None:
        check(0 <= mode < modes)
        setattr(controller, name, mode)

    return Request(run, 1)


def _setting(name: str) -> dict[str, Request]:
    """Return the commands that store and report a setting."""

    def store(channel: McsChannel, *numbers: int) -> None:
        channel.settings[name] = list(numbers)

    def report(channel: McsChannel) -> str:
        return f"{name}#,{','.join(map(str, channel.settings[name]))}"

    return {f"S{name}": Request(store, len(_SETTINGS[name])), f"G{name}": Request(report)}


OF_CONTROLLER: dict[str, Request] = {
    "GSI": Request(lambda c: "ID1"),
    "GIV": Request(lambda c: "IV1,2,0"),
    "GNC": Request(lambda c: f"N{len(c.channels)}"),
    "SCM": _set_mode("communication", 2),
    "GCM": Request(lambda c: f"CM{c.communication}"),
    "SSE": _set_mode("sensors", 3),
    "GSE": Request(lambda c: f"SE{c.sensors}"),
    "R": Request(reset),
    "K": Request(lambda c, ms: check(ms == 0 or 100 <= ms <= 60000), 1),
}

OF_CHANNEL: dict[str, Request] = {
    "MST": Request(_step, 3, moves=True),
    "MPA": Request(lambda c, x, hold: c.go_to_for(_NM * x, hold), 2, moves=True),
    "MPR": Request(lambda c, x, hold: c.go_to_for(c.target + _NM * x, hold), 2, moves=True),
    "MSCA": Request(_scan, 2, moves=True),
    "MSCR": Request(lambda c, way, speed: _scan(c, c.level + way, speed), 2, moves=True),
    "S": Request(lambda c: c.axis.stop()),
    "CS": Request(lambda c: None, moves=True),
    "FRM": Request(refuse_reference, 3, moves=True),
    "SP": Request(lambda c, x: c.set_position(_NM * x), 1),
    "GP": Request(lambda c: f"P#,{round(c.position / _NM)}"),
    "GS": Request(lambda c: f"S#,{_STATUS.get(c.axis.mode, int(c.axis.moving))}"),
    "GVL": Request(lambda c: f"VL#,{c.level}"),
    "SPL": Request(_set_limits, 2),
    "GPL": Request(_limits),
    "GPPK": Request(lambda c: "PPK#,0"),
    "GST": Request(lambda c: "ST#,1"),  # a linear positioner with a nanosensor
    "SST": Request(lambda c, kind: check(kind == 1), 1),
    "GCT": Request(lambda c: "CT#,0"),  # a positioner
    "GSN": Request(lambda c: "SN#,1"),
    "GFV": Request(lambda c: "FV#,1,0,0"),
}
for _name in _SETTINGS:
    OF_CHANNEL |= _setting(_name)
