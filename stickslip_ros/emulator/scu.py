# SPDX-License-Identifier: Apache-2.0
"""The ASCII interface of a SmarAct SCU, as two public drivers speak it.

Commands and answers: PyMeasure (instruments/smaract/scu_ascii.py) and the EPICS driver motorSmarAct
(smarActSCUMotorDriver.cpp). Positions in um, amplitudes in tenths of a volt. A query is answered; a
command that is carried out is not.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any, NamedTuple

from stickslip_ros.axis import Axis, CommandRefused
from stickslip_ros.axis.state_machine import DISABLED, FAULT, HOLDING, SCANNING, TARGETING
from stickslip_ros.emulator.dialogue import Controller, Dialogue, Refused
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

_MOST_STEPS, _LEAST_VOLTS = 30000, 15.0
_UM = 1e-6
#: A command, the number of its channel, and letters with a number or a direction each.
_COMMAND = re.compile(r"([A-Z]+)(\d?)((?:[A-Z](?:-?\d{1,12}(?:\.\d{1,9})?|[UD]))*)")
_VALUE = re.compile(r"([A-Z])(-?\d+(?:\.\d+)?|[UD])")
_BAUD = re.compile(r"CB\d{4,6}")
#: Letter of what a channel does in a state; in others M while it moves and S at rest
_STATUS = {TARGETING: "T", HOLDING: "H", SCANNING: "A", FAULT: "S", DISABLED: "S"}


class ScuChannel(Channel):
    """A channel with its settings."""

    def __init__(self, axis: Axis) -> None:
        """Start with the controller's defaults."""
        super().__init__(axis)
        self.loop_hertz = MOST_HERTZ  #: stored and reported, without an effect on the motion
        self.safe_direction = 0  #: likewise
        self.positioner = 1  #: a linear one


class ScuCommand(NamedTuple):
    """A command of a channel."""

    run: Callable[..., Any]  #: gets the channel and the values by letter; returns the answer
    required: str = ""  #: letters of values that have to follow
    optional: str = ""  #: letters of values that may follow
    moves: bool = False  #: refused while the channel may not move


class ScuDialogue(Dialogue):
    """One client; a line may hold several commands."""

    def answer(self, line: bytes | None) -> bytes:
        """Return the answers to the commands of a line, `:E<channel>C<code>` for a bad one."""
        text = None if line is None else line.decode("ascii", "replace").strip()
        if text == "":
            return b""
        if text is None or not text.startswith(":"):
            return _error("", Code.SYNTAX)
        return b"".join(self._answer_command(part) for part in text[1:].split(":"))

    def _answer_command(self, text: str) -> bytes:
        found = _COMMAND.fullmatch(text)
        if text in OF_CONTROLLER:
            return _line(OF_CONTROLLER[text](self.controller))
        if _BAUD.fullmatch(text):
            return b""  # TCP has no rate
        if not found:
            return _error("", Code.SYNTAX)
        name, number, values = found.groups()
        try:
            return _line(self._carry_out(name, number, dict(_VALUE.findall(values))))
        except Refused as refused:
            return _error(number, refused.reason)
        except CommandRefused:
            return _error(number, Code.INVALID)

    def _carry_out(self, name: str, number: str, values: dict[str, str]) -> str | None:
        if name not in OF_CHANNEL:
            raise Refused(Code.UNKNOWN)
        command, channels = OF_CHANNEL[name], self.controller.channels
        if not number or set(command.required) - set(values):
            raise Refused(Code.TOO_FEW)
        check(int(number) < len(channels))
        check(set(values) <= set(command.required + command.optional))
        channel = channels[int(number)]
        if command.moves and channel.locked:
            raise Refused(Code.LOCKED)
        answer: str | None = command.run(channel, **values)
        # An answer repeats the number of the channel behind its name.
        return answer.replace("#", number) if answer else None


class Scu(Controller):
    """The controller: up to three channels, numbered from 0 on."""

    channel = ScuChannel
    dialogue = ScuDialogue


def _line(answer: str | None) -> bytes:
    return f":{answer}\n".encode() if answer else b""


def _error(channel: str, code: int) -> bytes:
    return f":E{channel or -1}C{code:d}\n".encode()


def _number(text: str) -> float:
    """Return a value that must be no direction."""
    check(text not in ("U", "D"))
    return float(text)


def _step(sign: int) -> Callable[..., None]:
    """Return the command that steps up or down: F frequency (Hz), A amplitude (0.1 V), S steps."""

    def run(channel: ScuChannel, F: str, A: str, S: str) -> None:
        hertz, volts, steps = _number(F), 0.1 * _number(A), int(_number(S))
        check(LEAST_HERTZ <= hertz <= MOST_HERTZ and 1 <= steps <= _MOST_STEPS)
        check(_LEAST_VOLTS <= volts <= FULL_SCALE_V)
        channel.step(sign * steps, volts, hertz, endless=False)

    return run


def _go_to_end(channel: ScuChannel, D: str) -> None:
    check(D in ("U", "D"))
    channel.axis.command_jog(math.copysign(channel.axis.status.frequency, 1 if D == "U" else -1))


def _set(name: str, letter: str, low: int, high: int) -> Callable[..., None]:
    """Return the command that stores a whole number."""

    def run(channel: ScuChannel, **values: str) -> None:
        value = _number(values[letter])
        check(low <= value <= high)
        setattr(channel, name, int(value))

    return run


OF_CONTROLLER: dict[str, Callable[[Scu], str | None]] = {
    "I": lambda c: f"ISmarAct CU-{len(c.channels)}D",
    "GID": lambda c: "ID1",
    "R": reset,
}

OF_CHANNEL: dict[str, ScuCommand] = {
    "U": ScuCommand(_step(1), "FAS", moves=True),
    "D": ScuCommand(_step(-1), "FAS", moves=True),
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
    "MTR": ScuCommand(refuse_reference, "", "HZ", moves=True),
    "S": ScuCommand(lambda c: c.axis.stop()),
    "CS": ScuCommand(lambda c: None, moves=True),
    "SZ": ScuCommand(lambda c: c.set_position(0.0)),
    "GP": ScuCommand(lambda c: f"P#P{c.position / _UM:.4f}"),
    "GPPK": ScuCommand(lambda c: "PPK#P0"),
    "M": ScuCommand(lambda c: f"M#{_STATUS.get(c.axis.mode, 'SM'[c.axis.moving])}"),
    "GSP": ScuCommand(lambda c: "SP#P"),
    "GST": ScuCommand(lambda c: f"ST#T{c.positioner}"),
    "SST": ScuCommand(_set("positioner", "T", 1, 40), "T"),
    "GCLF": ScuCommand(lambda c: f"CLF#F{c.loop_hertz}"),
    "SCLF": ScuCommand(_set("loop_hertz", "F", LEAST_HERTZ, MOST_HERTZ), "F"),
    "GSD": ScuCommand(lambda c: f"SD#D{c.safe_direction}"),
    "SSD": ScuCommand(_set("safe_direction", "D", 0, 1), "D"),
}
