# SPDX-License-Identifier: Apache-2.0
"""The SCPI interface of a SmarAct MCS2, as two public drivers speak it.

Commands, state bits and errors: the EPICS driver motorSmarAct (smarActMCS2MotorDriver.cpp) and the
Tango server of the CNR (SmarActController.py). Positions in pm, amplitudes in 65535 levels of
100 V. Nothing but questions is answered; what was wrong waits in the queue of errors.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple

from stickslip_ros.axis import Axis, CommandRefused
from stickslip_ros.emulator.dialogue import Waiting
from stickslip_ros.emulator.smaract import FULL_SCALE_V, LEAST_HERTZ, Channel
from stickslip_ros.version import __version__

_MOST_ERRORS = 20
_LEVELS, _MOST_HERTZ, _MOST_STEPS = 65535, 20000, 100000
_PM = 1e-12
_OF_MODULE = 3  # channels of a bus module
_FOR_EVER = (-1, 0xFFFFFFFF)  # ms
ABSOLUTE, RELATIVE, SCAN_ABSOLUTE, SCAN_RELATIVE, STEP = range(5)
MOVING, CLOSED_LOOP, SENSOR, CALIBRATED = 0x1, 0x2, 0x20, 0x40
END_STOP, MOVE_FAILED = 0x100, 0x800
ERRORS = {
    0: "No error",
    -101: "Invalid character",
    -104: "Data type error",
    -108: "Parameter not allowed",
    -109: "Missing parameter",
    -113: "Undefined header",
    -222: "Data out of range",
    -350: "Queue overflow",
    -363: "Input buffer overrun",
    34: "Invalid channel index",
    259: "No sensor present",
    262: "Movement locked",
}
_LINE = re.compile(r"(:?[A-Za-z*][A-Za-z0-9:*]*\??)(?:\s+(.*))?", re.DOTALL)
#: Names as SCPI writes them: the capitals are the short form, all letters the long one
_MNEMONICS = (
    "CHANnel", "REFerence", "CALibration", "MMODe", "FREQuency", "AMPLitude", "AMPLifier",
    "POSition", "TARGet", "CURRent", "RLIMit", "MINimum", "MAXimum", "STATe", "PTYPe", "FERRor",
    "ERRor", "TEMPerature", "VELocity", "ACCeleration", "OPTion", "SDIRection", "SENSor",
    "DEVice", "SNUMber", "NOCHannels", "NOBModules", "SYSTem", "COUNt",
)  # fmt: skip
_SHORT = {name.upper(): "".join(filter(str.isupper, name)) for name in _MNEMONICS}
_LONG = re.compile("|".join(sorted(_SHORT, key=len, reverse=True)))
_CHANNEL = re.compile(r"(CHAN(?=\d+:)|MOVE|STOP|REF|CAL)(\d{1,4})(?=$|:|\?)")


class Refused(Exception):
    """A command that leaves an error in the queue."""

    def __init__(self, code: int) -> None:
        """Keep the error code for the queue."""
        super().__init__(code)
        self.code = code


class Mcs2Channel(Channel):
    """A channel with its settings."""

    def __init__(self, axis: Axis) -> None:
        """Start with the drive that the axis has."""
        super().__init__(axis)
        self.mode = ABSOLUTE
        self.amplifier = 1
        self.hertz = min(axis.status.frequency, _MOST_HERTZ)
        self.level = round(axis.status.amplitude * _LEVELS / FULL_SCALE_V)
        #: stored and reported, without an effect on the motion
        self.kept = dict.fromkeys(
            ("VEL", "ACC", "MCLF", "MCLF:CURR", "REF:OPT", "CAL:OPT", "SDIR", "SENS:MODE"), 0
        )
        self.kept["PTYP"] = 300
        self.hold_ms = 0

    @property
    def state(self) -> int:
        """The bits of what the channel does."""
        bits = (
            (self.stepping or self.targeting or self.scanning, MOVING),
            (self.targeting or self.at_target, CLOSED_LOOP),
            (bool(self.axis.status.held_at), END_STOP),
            (self.locked, MOVE_FAILED),
        )
        return SENSOR | CALIBRATED | sum(bit for true, bit in bits if true)

    def move(self, value: float) -> None:
        """Move as the move mode says: pm, levels or steps."""
        if self.locked:
            raise Refused(262)
        if self.mode == STEP:
            _check(abs(value) <= _MOST_STEPS)
            volts = self.level * FULL_SCALE_V / _LEVELS
            self.step(int(value), volts, float(self.hertz), endless=False)
        elif self.mode in (SCAN_ABSOLUTE, SCAN_RELATIVE):
            start = self.scan_volts * _LEVELS / FULL_SCALE_V if self.mode == SCAN_RELATIVE else 0
            _check(0 <= round(start + value) <= _LEVELS)
            self.scan_to(min((start + value) * FULL_SCALE_V / _LEVELS, FULL_SCALE_V))
        else:
            start = self.target if self.mode == RELATIVE else 0.0
            hold = math.inf if self.hold_ms in _FOR_EVER else 1e-3 * self.hold_ms
            self.go_to(start + _PM * value, hold)


class Mcs2:
    """The controller: channels numbered from 0 on."""

    name = "mcs2"

    def __init__(self, axes: Sequence[Axis]) -> None:
        """Number the axes from 0 on."""
        self.channels = [Mcs2Channel(axis) for axis in axes]

    def connect(self) -> Mcs2Dialogue:
        """Return the dialogue with a new client."""
        return Mcs2Dialogue(self)

    def tick(self) -> None:
        """End the holds that are over."""
        for channel in self.channels:
            channel.tick()


class Mcs2Dialogue:
    """Commands of one client, with a queue of its errors."""

    greeting = b""
    patience: float | None = None

    def __init__(self, controller: Mcs2) -> None:
        """Begin the dialogue of one client with a controller."""
        self.controller = controller
        self.errors: deque[int] = deque()

    def answer(self, line: bytes | None) -> bytes | Waiting:
        """Return the answers to a line, of questions only."""
        if line is None:
            self.note(-363)
            return b""
        answers = []
        for text in line.decode("ascii", "replace").split(";"):
            if text.strip():
                try:
                    answers.append(self._carry_out(text.strip()))
                except Refused as refused:
                    self.note(refused.code)
                except CommandRefused:
                    self.note(-222)
        said = [answer for answer in answers if answer is not None]
        return (";".join(said) + "\r\n").encode() if said else b""

    def note(self, code: int) -> None:
        """Put an error into the queue; the last place says that there were more."""
        if len(self.errors) < _MOST_ERRORS:
            self.errors.append(code if len(self.errors) < _MOST_ERRORS - 1 else -350)

    def over(self) -> bool:
        """Whether the server should hang up; it never should."""
        return False

    def _carry_out(self, text: str) -> str | None:
        found = _LINE.fullmatch(text)
        if not found:
            raise Refused(-101)
        header = found[1].removeprefix(":").upper()
        header = _LONG.sub(lambda name: _SHORT[name[0]], header)
        place = _CHANNEL.match(header)
        if not place:
            return self._of_controller(header, found[2])
        if not int(place[2]) < len(self.controller.channels):
            raise Refused(34)
        channel = self.controller.channels[int(place[2])]
        return _of_channel(channel, header.replace(place[0], place[1], 1), found[2])

    def _of_controller(self, header: str, argument: str | None) -> str | None:
        if header not in OF_CONTROLLER:
            raise Refused(-113)
        if argument:
            raise Refused(-108)
        return OF_CONTROLLER[header](self)


def _of_channel(channel: Mcs2Channel, header: str, argument: str | None) -> str | None:
    name = header.removeprefix("CHAN:")
    if header.endswith("?"):
        setting = OF_CHANNEL.get(name[:-1])
        if not setting or not setting.get:
            raise Refused(-113)
        if argument:
            raise Refused(-108)
        return str(setting.get(channel))
    setting = OF_CHANNEL.get(name)
    if not setting or not setting.set:
        raise Refused(-113)
    if setting.plain:
        if argument:
            raise Refused(-108)
        setting.set(channel, 0.0)
        return None
    if argument is None:
        raise Refused(-109)
    try:
        value = float(argument)
    except ValueError:
        raise Refused(-104) from None
    _check(math.isfinite(value))
    setting.set(channel, value)
    return None


def _check(condition: bool) -> None:
    if not condition:
        raise Refused(-222)


class Setting(NamedTuple):
    """A property of a channel, which can be set or read."""

    get: Callable[[Mcs2Channel], object] | None
    set: Callable[[Mcs2Channel, float], None] | None
    plain: bool = False  #: it takes no number


def _whole(name: str, low: int, high: int) -> Setting:
    """Return a setting that is an attribute with a whole number in a range."""

    def set_it(channel: Mcs2Channel, value: float) -> None:
        _check(low <= value <= high and value == int(value))
        setattr(channel, name, int(value))

    return Setting(lambda channel: round(getattr(channel, name)), set_it)


def _kept(name: str) -> Setting:
    def set_it(channel: Mcs2Channel, value: float) -> None:
        channel.kept[name] = int(value)

    return Setting(lambda channel: channel.kept[name], set_it)


def _unlock(channel: Mcs2Channel, value: float) -> None:
    """Switch the amplifier; switched on it leaves a fault."""
    _check(value in (0, 1))
    channel.amplifier = int(value)
    channel.axis.enable(bool(value))
    if value:
        channel.axis.reset()


def _reference(_: Mcs2Channel, __: float) -> None:
    raise Refused(259)  # the simulated sensor has no reference mark


OF_CHANNEL: dict[str, Setting] = {
    "MOVE": Setting(None, lambda c, value: c.move(value)),
    "STOP": Setting(None, lambda c, _: c.stop(), plain=True),
    "CAL": Setting(None, lambda c, _: None, plain=True),
    "REF": Setting(None, _reference, plain=True),
    "MMOD": _whole("mode", ABSOLUTE, STEP),
    "STEP:FREQ": _whole("hertz", LEAST_HERTZ, _MOST_HERTZ),
    "STEP:AMPL": _whole("level", 1, _LEVELS),
    "HOLD": _whole("hold_ms", -1, 0xFFFFFFFF),
    "AMPL": Setting(lambda c: c.amplifier, _unlock),
    "POS": Setting(
        lambda c: round(c.position / _PM), lambda c, value: c.set_position(_PM * value)
    ),
    "POS:CURR": Setting(lambda c: round(c.position / _PM), None),
    "POS:TARG": Setting(lambda c: round(c.target / _PM), None),
    "SCAN:POS": Setting(lambda c: round(c.scan_volts * _LEVELS / FULL_SCALE_V), None),
    "RLIM:MIN": Setting(
        lambda c: round(c.axis.parameters.limits.soft_low / _PM),
        lambda c, value: c.axis.set_parameters({"soft_low": _PM * value}),
    ),
    "RLIM:MAX": Setting(
        lambda c: round(c.axis.parameters.limits.soft_high / _PM),
        lambda c, value: c.axis.set_parameters({"soft_high": _PM * value}),
    ),
    "STAT": Setting(lambda c: c.state, None),
    "PTYP:NAME": Setting(lambda c: '"SL-S1I1E1"', None),
    "FERR": Setting(lambda c: round((c.target - c.position) / _PM), None),
    "ERR": Setting(lambda c: 262 if c.locked else 0, None),
    "TEMP": Setting(lambda c: 25, None),
    **{
        name: _kept(name)
        for name in (
            "VEL", "ACC", "MCLF", "MCLF:CURR", "REF:OPT", "CAL:OPT", "SDIR", "SENS:MODE", "PTYP",
        )
    },
}  # fmt: skip


def _next_error(dialogue: Mcs2Dialogue) -> str:
    code = dialogue.errors.popleft() if dialogue.errors else 0
    return f'{code},"{ERRORS[code]}"'


def _clear(dialogue: Mcs2Dialogue) -> None:
    dialogue.errors.clear()


def _reset(dialogue: Mcs2Dialogue) -> None:
    for channel in dialogue.controller.channels:
        channel.stop()
        _unlock(channel, 1.0)
    dialogue.errors.clear()


OF_CONTROLLER: dict[str, Callable[[Mcs2Dialogue], str | None]] = {
    "*IDN?": lambda d: f"SmarAct,MCS2 (stickslip_ros),SIM-1,{__version__}",
    "*OPC?": lambda d: "1",  # commands are carried out before the next one is read
    "*CLS": _clear,
    "*RST": _reset,
    "DEV:SNUM?": lambda d: '"SIM-1"',
    "DEV:NAME?": lambda d: '"MCS2 (stickslip_ros)"',
    "DEV:NOCH?": lambda d: str(len(d.controller.channels)),
    "DEV:NOBM?": lambda d: str(-(-len(d.controller.channels) // _OF_MODULE)),
    "DEV:STAT?": lambda d: "0",
    "DEV:NUMCHAN?": lambda d: str(len(d.controller.channels)),
    "SYST:ERR?": _next_error,
    "SYST:ERR:NEXT?": _next_error,
    "SYST:ERR:COUN?": lambda d: str(len(d.errors)),
}
