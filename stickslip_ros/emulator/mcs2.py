# SPDX-License-Identifier: Apache-2.0
"""The SCPI interface of a SmarAct MCS2, as two public drivers speak it.

Commands, state bits and errors: the EPICS driver motorSmarAct (smarActMCS2MotorDriver.cpp) and the
Tango server of the CNR (SmarActController.py). Positions in pm, amplitudes in 65535 levels of
100 V. Nothing but questions is answered, wrong ones with their error, so that no client waits in
vain; what was wrong also waits in the queue of errors.
"""

from __future__ import annotations

import math
import re
from collections import deque
from functools import reduce
from operator import or_
from typing import Any

from stickslip_ros.axis import Axis
from stickslip_ros.axis.command import HOLDING, JOGGING, SCANNING, TARGETING
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
from stickslip_ros.emulator.smaract import FULL_SCALE_V, LEAST_HERTZ, Channel, Code
from stickslip_ros.version import __version__

_MOST_ERRORS = 20
_LEVELS, _MOST_HERTZ, _MOST_STEPS = 65535, 20000, 100000
_PM = 1e-12
_OF_MODULE = 3  # channels of a bus module
_FOR_EVER = (-1, 0xFFFFFFFF)  # ms
_AUTO_ZERO = 0x4  # of the options of a search for the reference mark
ABSOLUTE, RELATIVE, SCAN_ABSOLUTE, SCAN_RELATIVE, STEP = range(5)
MOVING, CLOSED_LOOP, SENSOR, CALIBRATED = 0x1, 0x2, 0x20, 0x40
REFERENCING, REFERENCED = 0x8, 0x80
END_STOP, RANGE_LIMIT, MOVE_FAILED = 0x100, 0x200, 0x800
LOCKED, _NO_MARK, _OUT_OF_RANGE, _LACKING = 262, 259, -222, 32765
#: The bit of the state and the error of a limit
_LIMITS: dict[Code | None, tuple[int, int]] = {
    None: (0, 0),
    Code.END_STOP: (END_STOP, 512),
    Code.RANGE_LIMIT: (RANGE_LIMIT, 514),
}
ERRORS = {
    0: "No error",
    -101: "Invalid character",
    -104: "Data type error",
    -108: "Parameter not allowed",
    -109: "Missing parameter",
    -113: "Undefined header",
    _OUT_OF_RANGE: "Data out of range",
    -350: "Queue overflow",
    -363: "Input buffer overrun",
    34: "Invalid channel index",
    _NO_MARK: "No sensor present",
    LOCKED: "Movement locked",
    512: "End stop reached",
    514: "Range limit reached",
    _LACKING: "Feature not supported",
}
_LINE = re.compile(r"(:?[A-Za-z*][A-Za-z0-9:*]*\??)(?:\s+(.*))?", re.DOTALL)
#: Names as SCPI writes them: the capitals are the short form, all letters the long one
_MNEMONICS = (
    "CHANnel", "REFerence", "CALibration", "MMODe", "FREQuency", "AMPLitude", "AMPLifier",
    "POSition", "TARGet", "CURRent", "RLIMit", "MINimum", "MAXimum", "STATe", "PTYPe", "FERRor",
    "ERRor", "TEMPerature", "VELocity", "ACCeleration", "OPTion", "SDIRection", "SENSor",
    "DEVice", "SNUMber", "NOCHannels", "NOBModules", "SYSTem", "COUNt", "CALibrate", "MODule",
    "TUNing", "RESolution", "MTYPe", "RTYPe", "ACTuator", "ENABled", "INPosition", "THReshold",
    "DELay", "TREached", "DIAGnostic", "AVERage", "OFFSet", "INVersion", "LSCale",
)  # fmt: skip
_SHORT = {name.upper(): "".join(filter(str.isupper, name)) for name in _MNEMONICS}
_LONG = re.compile("|".join(sorted(_SHORT, key=len, reverse=True)))
_CHANNEL = re.compile(r"(CHAN(?=\d+:)|MOD(?=\d+:)|MOVE|STOP|REF|CAL)(\d{1,4})(?=$|:|\?)")
#: Settings that are stored and reported, without an effect on the motion
_KEPT = {
    **dict.fromkeys(
        ("VEL", "ACC", "MCLF", "MCLF:CURR", "REF:OPT", "CAL:OPT", "SDIR", "ACT:MODE", "INP:THR"), 0
    ),
    **dict.fromkeys(("INP:DEL", "TUN:THR:TRE", "DIAG:CLF:MAX", "DIAG:CLF:AVER"), 0),
    "PTYP": 300,
    "SENS:MODE": 1,
}


class Mcs2Channel(Channel):
    """A channel with its settings."""

    first_settings = _KEPT

    def __init__(self, axis: Axis) -> None:
        """Start with the drive that the axis has."""
        super().__init__(axis)
        self.mode = ABSOLUTE
        self.amplifier = 1
        self.hertz = min(axis.status.frequency, _MOST_HERTZ)
        self.level = round(axis.status.amplitude * _LEVELS / FULL_SCALE_V)
        self.hold_ms = 0

    @property
    def scan_level(self) -> float:
        """Level of the actuator, of 65535."""
        return self.axis.status.scan_level * _LEVELS / FULL_SCALE_V

    @property
    def state(self) -> int:
        """The status bits of the channel."""
        mode, steps = self.axis.mode, self.axis.moving and self.axis.mode != HOLDING
        limit, _ = _LIMITS[self.stopped_by]
        bits = (
            (steps or mode in (JOGGING, TARGETING, SCANNING), MOVING),
            (mode in (TARGETING, HOLDING), CLOSED_LOOP),
            (self.referencing, REFERENCING),
            (self.referenced, REFERENCED),
            (bool(self.axis.status.held_at), END_STOP),
            (bool(limit), limit),
            (self.locked, MOVE_FAILED),
        )
        return reduce(or_, (bit for true, bit in bits if true), SENSOR | CALIBRATED)

    @property
    def error(self) -> int:
        """The error of the last motion."""
        return LOCKED if self.locked else _LIMITS[self.stopped_by][1]

    def move(self, value: float) -> None:
        """Move as the move mode says: pm, levels or steps."""
        volts, hertz = self.level * FULL_SCALE_V / _LEVELS, float(self.hertz)
        if self.mode == STEP:
            require(value == int(value) and abs(value) <= _MOST_STEPS, _OUT_OF_RANGE)
            self.step(int(value), volts, hertz, endless=False)
        elif self.mode in (SCAN_ABSOLUTE, SCAN_RELATIVE):
            level = value + (self.scan_level if self.mode == SCAN_RELATIVE else 0.0)
            require(0 <= round(level) <= _LEVELS, _OUT_OF_RANGE)
            self.begin()
            self.axis.command("scan", min(level * FULL_SCALE_V / _LEVELS, FULL_SCALE_V))
        else:
            start = self.target if self.mode == RELATIVE else 0.0
            self.set_drive(volts, hertz)
            self.approach(start + _PM * value, self.hold_s)

    @property
    def hold_s(self) -> float:
        """Time that a target is held, s."""
        return math.inf if self.hold_ms in _FOR_EVER else 1e-3 * self.hold_ms

    def find_mark(self) -> None:
        """Go to the reference mark; the options say whether it counts as 0."""
        try:
            self.seek(self.hold_s, bool(int(self.settings["REF:OPT"]) & _AUTO_ZERO))
        except Refused:
            raise Refused(_NO_MARK) from None

    def switch(self, value: float) -> None:
        """Switch the amplifier; switched on it leaves a fault."""
        require(value in (0, 1), _OUT_OF_RANGE)
        self.amplifier = int(value)
        self.axis.command("enable", bool(value))
        if value:
            self.axis.command("reset")


class Mcs2Dialogue(Dialogue):
    """Commands of one client, with a queue of its errors."""

    reasons = Reasons(-113, 34, -109, -108, LOCKED, _OUT_OF_RANGE)

    def __init__(self, controller: Mcs2) -> None:
        """Begin the dialogue of one client with a controller."""
        super().__init__(controller)
        self.errors: deque[int] = deque()

    def answer(self, line: bytes | None) -> bytes:
        """Return the answers to a line, of questions only."""
        if line is None:
            self._note(-363)
            return b""
        answers, path = [], ""
        for text in filter(None, map(str.strip, line.decode("ascii", "replace").split(";"))):
            header = text.split()[0]
            try:
                answers.append(self._answer_below(path, text))
            except Refused as refused:
                self._note(refused.reason)
                if header.endswith("?"):
                    answers.append(error_text(refused.reason))
            if ":" in header[1:]:
                path = header.rpartition(":")[0] + ":"
        said = [str(answer) for answer in answers if answer is not None]
        return (";".join(said) + "\r\n").encode() if said else b""

    def next_error(self) -> str:
        """Take the oldest error off the queue and return it with its text."""
        return error_text(self.errors.popleft() if self.errors else 0)

    def reset(self) -> None:
        """Stop all channels, switch them on, forget the errors."""
        for channel in self.controller.channels:
            channel.halt()
            channel.switch(1.0)
        self.errors.clear()

    def _note(self, code: int) -> None:
        """Put an error into the queue; the last place says that there were more."""
        if len(self.errors) < _MOST_ERRORS:
            self.errors.append(code if len(self.errors) < _MOST_ERRORS - 1 else -350)

    def _answer_below(self, path: str, text: str) -> object:
        """Answer a header without a first colon below the path of the one before (IEEE 488.2)."""
        if path and text[0] not in ":*":
            try:
                return self._answer(path + text)
            except Refused as refused:
                if refused.reason != self.reasons.unknown:
                    raise
        return self._answer(text)

    def _answer(self, text: str) -> object:
        """Return the answer to a question, None to a command; raises Refused."""
        found = _LINE.fullmatch(text)
        if not found:
            raise Refused(-101)
        header = found[1].removeprefix(":").upper()
        header = _LONG.sub(lambda name: _SHORT[name[0]], header)
        table, place = OF_CONTROLLER, _CHANNEL.match(header)
        whose: Any = self
        if place:
            table = OF_CHANNEL
            whose = self.channel(int(place[2]) * (_OF_MODULE if place[1] == "MOD" else 1))
            header = header.replace(place[0], place[1], 1).removeprefix("CHAN:")
        return self.carry_out(table.get(header), whose, [found[2]] if found[2] else [])

    def read(self, value: str) -> float:
        """Return an argument as a number. Raises Refused."""
        try:
            number = float(value)
        except ValueError:
            raise Refused(-104) from None
        require(math.isfinite(number), _OUT_OF_RANGE)
        return number


class Mcs2(Controller):
    """The controller: channels numbered from 0 on."""

    channel = Mcs2Channel
    dialogue = Mcs2Dialogue


def error_text(code: int) -> str:
    """Return an error as it is answered."""
    return f'{code},"{ERRORS[code]}"'


def _attribute(header: str, name: str, low: int, high: int) -> dict[str, Request]:
    """Return the commands that set and read an attribute that is a whole number in a range."""

    def write(channel: Mcs2Channel, value: float) -> None:
        require(low <= value <= high and value == int(value), _OUT_OF_RANGE)
        setattr(channel, name, int(value))

    return {
        header: Request(write, 1),
        f"{header}?": Request(lambda channel: round(getattr(channel, name))),
    }


def _limit(header: str, name: str) -> dict[str, Request]:
    """Return the commands of a soft limit, a parameter in m."""

    def write(channel: Mcs2Channel, value: float) -> None:
        channel.set_limits(**{name: _PM * value})

    return {
        header: Request(write, 1),
        f"{header}?": Request(lambda c: round(c.limit(name) / _PM)),
    }


OF_CHANNEL: dict[str, Request] = {
    "MOVE": Request(lambda c, value: c.move(value), 1, moves=True),
    "STOP": Request(Mcs2Channel.halt),
    "CAL": Request(lambda c: None),
    "REF": Request(Mcs2Channel.find_mark, moves=True),
    **_attribute("MMOD", "mode", ABSOLUTE, STEP),
    **_attribute("STEP:FREQ", "hertz", LEAST_HERTZ, _MOST_HERTZ),
    **_attribute("STEP:AMPL", "level", 1, _LEVELS),
    **_attribute("HOLD", "hold_ms", -1, 0xFFFFFFFF),
    "AMPL": Request(lambda c, value: c.switch(value), 1),
    "AMPL?": Request(lambda c: c.amplifier),
    "AMPL:ENAB": Request(lambda c, value: c.switch(value), 1),
    "AMPL:ENAB?": Request(lambda c: c.amplifier),
    "POS": Request(lambda c, value: c.set_position(_PM * value), 1),
    "POS?": Request(lambda c: round(c.position / _PM)),
    "POS:CURR?": Request(lambda c: round(c.position / _PM)),
    "POS:TARG?": Request(lambda c: round(c.target / _PM)),
    "SCAN:POS?": Request(lambda c: round(c.scan_level)),
    **_limit("RLIM:MIN", "soft_low"),
    **_limit("RLIM:MAX", "soft_high"),
    "STAT?": Request(lambda c: c.state),
    "PTYP:NAME?": Request(lambda c: '"SL-S1I1E1"'),
    "FERR?": Request(lambda c: round((c.target - c.position) / _PM)),
    "ERR?": Request(lambda c: c.error),
    "TEMP?": Request(lambda c: 25),
    "TUN:MTYP?": Request(lambda c: 0),  # linear
    "TUN:RTYP?": Request(lambda c: 2),  # one reference mark
    "TUN:BASE:UNIT?": Request(lambda c: 2),  # m
    "TUN:BASE:RES?": Request(lambda c: -12),
    "MOD:STAT?": Request(lambda c: 0),  # of the bus module of a channel
    "MOD:TEMP?": Request(lambda c: 25),
    **lacking(_LACKING, "LSC:INV LSC:INV? LSC:OFFS LSC:OFFS? SCAN:VEL SCAN:VEL?"),
}
for _header in _KEPT:
    OF_CHANNEL[_header], OF_CHANNEL[f"{_header}?"] = stored(_header, int)

OF_CONTROLLER: dict[str, Request] = {
    "*IDN?": Request(lambda d: f"SmarAct,MCS2 (stickslip_ros),SIM-1,{__version__}"),
    "*OPC?": Request(lambda d: 1),  # commands are carried out before the next one is read
    "*CLS": Request(lambda d: d.errors.clear()),
    "*RST": Request(lambda d: d.reset()),
    "DEV:SNUM?": Request(lambda d: '"SIM-1"'),
    "DEV:NAME?": Request(lambda d: '"MCS2 (stickslip_ros)"'),
    "DEV:NOCH?": Request(lambda d: len(d.controller.channels)),
    "DEV:NOBM?": Request(lambda d: -(-len(d.controller.channels) // _OF_MODULE)),
    "DEV:STAT?": Request(lambda d: 0),
    "DEV:NUMCHAN?": Request(lambda d: len(d.controller.channels)),
    "SYST:ERR?": Request(lambda d: d.next_error()),
    "SYST:ERR:NEXT?": Request(lambda d: d.next_error()),
    "SYST:ERR:COUN?": Request(lambda d: len(d.errors)),
}
