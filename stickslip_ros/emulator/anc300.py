# SPDX-License-Identifier: Apache-2.0
"""The console of an attocube ANC300, as its public drivers know it.

Dialogue, units and ranges: PyMeasure, pymeasure/instruments/attocube/anc300.py and its test;
commands beyond: pylablib, pylablib/devices/Attocube/anc300.py. docs/emulator.md says what is known
from there and what was chosen here.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable

from stickslip_ros.axis import Axis
from stickslip_ros.axis.command import FAULT, STOPPED
from stickslip_ros.emulator.controller import (
    Controller,
    Dialogue,
    Lines,
    Reasons,
    Refused,
    Request,
    Waiting,
    lacking,
    require,
    stored,
)
from stickslip_ros.version import __version__

PASSWORD = b"123456"
MODES = ("gnd", "inp", "ext", "cap", "stp", "off", "stp+", "stp-")
#: Modes in which the actuator stands at the offset voltage, with its sign.
_OFFSET = {"off": 1.0, "stp+": 1.0, "stp-": -1.0}
MOST_VOLTS, LEAST_HERTZ, MOST_HERTZ = 150.0, 1, 10000
#: What PyMeasure's recorded dialogues read (999 and 1020 nF); no parameter of the model sets it.
CAPACITANCE_NF = 1000.0
_MEASURING_S = 1.0  # that a measurement of the capacitance takes
_TRIES = 3  # for the password
_PATIENCE_S = 60.0  # for the password
_SLOTS = 7  # of the chassis; those without a module answer as such
# Telnet: the console will echo, and will not wait for go-aheads. Drivers skip these bytes.
_NEGOTIATION = b"\xff\xfb\x01\xff\xfb\x03"
#: What clients send of Telnet's own (RFC 854): options, parameters of one from IAC SB to IAC SE, in
#: which anything may stand, other commands. The end of a line, or their length, ends parameters
#: without IAC SE; what is left of that line is no command.
_PARAMETERS = rb"\xff\xfa(?:[^\xff]|\xff[^\xf0]){0,512}"
_TELNET = re.compile(
    rb"\xff[\xfb-\xfe].|"
    + _PARAMETERS
    + rb"\xff\xf0|(\xff\xfa.{0,512}?(?=\r\n))|\xff[\xf0-\xf9\xff]",
    re.DOTALL,
)
_BEGUN = re.compile(rb"(?:\xff[\xfb-\xfe]?|" + _PARAMETERS + rb"\xff?)\Z", re.DOTALL)
_PROMPT = "> "
_RANGE = "Value out of range"
_LABELS = {"aci": "acin", "dci": "dcin", "tu": "trigger", "td": "trigger"}
_RAMP = tuple(range(256))


class Module:
    """One axis module: an axis and the state of the controller for it."""

    def __init__(self, axis: Axis) -> None:
        """Start grounded, as after power-up."""
        self.axis = axis
        self.mode = "gnd"
        self.settings = dict.fromkeys(_LABELS, "off")  #: that nothing is connected to
        self._silent = math.nan  # amplitude (V) of the axis that represents 0 V
        self._offset = 0.0  # V
        self._measured_at = -math.inf  # when the capacitance will have been measured, s
        if axis.status.amplitude > MOST_VOLTS:
            axis.command("amplitude", MOST_VOLTS)
        hertz = min(max(axis.status.frequency, LEAST_HERTZ), MOST_HERTZ)
        if hertz != axis.status.frequency:
            axis.command("frequency", hertz)

    # -- settings

    @property
    def voltage(self) -> float:
        """Amplitude, V."""
        volts = self.axis.status.amplitude
        return 0.0 if volts == self._silent else volts

    def set_voltage(self, volts: float) -> None:
        """Set the amplitude (V); 0 leaves the axis without motion."""
        require(0.0 <= volts <= MOST_VOLTS, _RANGE)
        if volts:
            self.axis.command("amplitude", volts)
            self._silent = math.nan
        else:
            self._silent = self.axis.status.amplitude
            if self.axis.moving:
                self.axis.command("stop")

    def set_frequency(self, hertz: float) -> None:
        """Set the frequency (Hz), rounded to a whole number as the controller reports it."""
        require(LEAST_HERTZ <= hertz <= MOST_HERTZ, _RANGE)
        self.axis.command("frequency", float(round(hertz)))

    def set_mode(self, mode: str) -> None:
        """Connect the axis to the stepping generator, the offset, the meter, the input, ground."""
        require(mode in MODES, f"Wrong mode, there are {' '.join(MODES)}")
        if self.axis.mode == FAULT:
            self.axis.command("reset")
        if mode in _OFFSET:
            self.axis.command("scan", _OFFSET[mode] * self._offset)
        elif mode != "stp":
            self._ground()
        self.mode = mode
        if mode == "cap":
            self._measured_at = self.axis.state.t + _MEASURING_S

    @property
    def offset(self) -> float:
        """Offset voltage, V."""
        return self._offset

    def set_offset(self, volts: float) -> None:
        """Set the offset voltage (V), which the axis gets in modes off, stp+ and stp-."""
        require(0.0 <= volts <= MOST_VOLTS, _RANGE)
        if self.mode in _OFFSET:
            self.axis.command("scan", _OFFSET[self.mode] * volts)
        self._offset = volts

    # -- motion

    def step(self, sign: int, count: str) -> None:
        """Run steps upwards or downwards; c and 0 stand for no end."""
        endless = count.lower() == "c"
        number = 0 if endless else _whole(count)
        require(number >= 0, _RANGE)
        require(self.mode.startswith("stp"), "Axis in wrong mode")
        if self._silent == self.axis.status.amplitude:
            return
        if number:
            self.axis.command("steps", sign * number)
        else:
            self.axis.command("jog", sign * self.axis.status.frequency)

    @property
    def output(self) -> float:
        """Voltage at the actuator, V; its amount, as the console knows no sign."""
        if self.mode != "stp" and self.mode not in _OFFSET:
            return 0.0
        return abs(self.axis.state.u) / self.axis.parameters.actuator.gain_in_force

    @property
    def measuring(self) -> bool:
        """Whether the capacitance is being measured."""
        return self.mode == "cap" and self.axis.state.t < self._measured_at

    def tick(self) -> None:
        """Ground the axis once its capacitance is measured; after steps, set the offset again."""
        if self.mode == "cap" and not self.measuring:
            self.mode = "gnd"
        wanted = _OFFSET.get(self.mode, 0.0) * self._offset
        if wanted and self.axis.mode == STOPPED and not self.axis.status.scan_level:
            self.axis.command("scan", wanted)

    def _ground(self) -> None:
        if self.axis.status.scan_level:
            self.axis.command("scan", 0.0)
        else:
            self.axis.command("stop")


class TelnetLines(Lines):
    """Cuts the lines of a client, without what it says to the Telnet below."""

    def __init__(self) -> None:
        """Begin with nothing."""
        super().__init__()
        self._begun = b""  # of Telnet's own

    def take(self, data: bytes) -> list[bytes | None]:
        """Return the lines that end in the data, however they and Telnet's commands are cut."""
        data = _TELNET.sub(lambda found: b"?" * bool(found[1]), self._begun + data)
        begun = _BEGUN.search(data)
        self._begun = begun[0] if begun else b""
        return super().take(data.removesuffix(self._begun))


class Console(Dialogue):
    """The console that one client sees."""

    greeting = _NEGOTIATION + b"\r\nAuthorization code: "
    patience: float | None = _PATIENCE_S
    reasons = Reasons(
        unknown="Unknown command",
        no_channel="Wrong axis type",
        too_few="Wrong number of arguments",
        too_many="Wrong number of arguments",
        locked="",
        impossible=_RANGE,
    )

    def __init__(self, controller: Anc300) -> None:
        """Ask for the password first."""
        super().__init__(controller)
        self._authorized = False
        self._tries = 0
        self._echo = True

    def cutter(self) -> Lines:
        """Cut lines out of a Telnet session."""
        return TelnetLines()

    def answer(self, said: bytes | None) -> bytes | Waiting:
        """Return the answer to a line: echo, lines, OK or ERROR, prompt."""
        if not self._authorized:
            return self._authorize(said or b"")
        text = "" if said is None else said.replace(b"\0", b"").decode("ascii", "replace").strip()
        echo = f"{text}\r\n" if self._echo else ""
        if said is not None and not text:
            return self._ended(echo)
        try:
            require(said is not None, "Line too long")
            found = self._answer(text.split())
        except Refused as refused:
            detail = f": {refused.__cause__}" if refused.__cause__ else ""
            return self._ended(f"{echo}{refused.reason}{detail}\r\nERROR\r\n")
        if isinstance(found, Waiting):
            waiting = found
            return Waiting(
                waiting.done, lambda: self._ended(f"{echo}{waiting.answer().decode()}OK\r\n")
            )
        return self._ended(f"{echo}{found}OK\r\n")

    def over(self) -> bool:
        """Return whether the password was wrong too often."""
        return self._tries >= _TRIES

    def set_echo(self, word: str) -> None:
        """Send lines back, or not."""
        require(word in ("on", "off"), "Unknown command")
        self._echo = word == "on"

    def _ended(self, text: str) -> bytes:
        return (text + (_PROMPT if self._echo else "")).encode("ascii", "replace")

    def _authorize(self, said: bytes) -> bytes:
        stars = b"*" * len(said) + b"\r\n"
        if said.strip() == PASSWORD:
            self._authorized, self.patience = True, None
            return stars + b"Authorization success\r\n" + _PROMPT.encode()
        self._tries += 1
        again = b"" if self.over() else b"Authorization code: "
        return stars + b"Authorization failed\r\n" + again

    def _answer(self, words: list[str]) -> str | Waiting:
        """Return the lines of the answer to a command, or wait; raises Refused."""
        name, *rest = words
        name = name.lower()
        if name in OF_CONTROLLER:
            return self.carry_out(OF_CONTROLLER[name], self, rest) or ""
        require(rest or name not in OF_CHANNEL, "Axis number missing")
        module = None
        if name in OF_CHANNEL:
            numbered = rest[0].isascii() and rest[0].isdigit()
            require(numbered and 1 <= int(rest[0][:9]) <= _SLOTS, "Wrong axis number")
            module = self.channel(int(rest[0][:9]) - 1)
        return self.carry_out(OF_CHANNEL.get(name), module, rest[1:]) or ""


class Anc300(Controller):
    """The controller: modules numbered from 1 on."""

    channel = Module
    dialogue = Console


# -- the commands


def _number(word: str) -> float:
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    require(math.isfinite(value), "Number expected")
    return value


def _whole(word: str) -> int:
    value = _number(word)
    require(value == int(value), "Whole number expected")
    require(abs(value) < 2**31, _RANGE)
    return int(value)


def _value(name: str, value: float, unit: str) -> str:
    return f"{name} = {value:.6f} {unit}\r\n"


def _wait_for_capacitance(module: Module) -> Waiting:
    text = _value("capacitance", CAPACITANCE_NF, "nF").encode()
    return Waiting(lambda: not module.measuring, lambda: text)


def _pattern(*_: object) -> str:
    return "".join(f"{value}\r\n" for value in _RAMP)


def _set_pattern(_: Module, *words: str) -> None:
    require(tuple(map(_whole, words)) == _RAMP, "Only the linear pattern is simulated")


def _switch(name: str) -> dict[str, Request]:
    """Return the commands that set and get a setting that nothing is connected to."""
    label = _LABELS[name]
    allowed = ("off", *map(str, range(1, 8))) if label == "trigger" else ("on", "off")

    def read(word: str) -> str:
        require(word in allowed, _RANGE)
        return word

    set_it, get_it = stored(name, read, show=lambda word: f"{label} = {word}\r\n")
    return {f"set{name}": set_it, f"get{name}": get_it}


def _reading(name: str, unit: str, read: Callable[[Module], float]) -> Request:
    """Return the command that gets a value with its unit."""
    return Request(lambda module: _value(name, read(module), unit))


OF_CHANNEL: dict[str, Request] = {
    "setm": Request(lambda m, mode: m.set_mode(mode), 1),
    "getm": Request(lambda m: f"mode = {m.mode}\r\n"),
    "setv": Request(lambda m, volts: m.set_voltage(_number(volts)), 1),
    "getv": _reading("voltage", "V", lambda m: m.voltage),
    "setf": Request(lambda m, hertz: m.set_frequency(_number(hertz)), 1),
    # The line feed inside is the controller's own.
    "getf": Request(lambda m: f"frequency = {round(m.axis.status.frequency)} Hz\r\n"),
    "seta": Request(lambda m, volts: m.set_offset(_number(volts)), 1),
    "geta": _reading("voltage", "V", lambda m: m.offset),
    "geto": _reading("voltage", "V", lambda m: m.output),
    "getc": _reading("capacitance", "nF", lambda m: CAPACITANCE_NF),
    "capw": Request(_wait_for_capacitance),
    "stepu": Request(lambda m, count="1": m.step(+1, count), optional=1),
    "stepd": Request(lambda m, count="1": m.step(-1, count), optional=1),
    "stepw": Request(lambda m: Waiting(lambda: not m.axis.moving, lambda: b"")),
    "stop": Request(lambda m: m.axis.command("stop")),
    "getser": Request(lambda m: f"SIM-{m.axis.parameters.node.axis_name}\r\n"),
    "getpu": Request(_pattern),
    "getpd": Request(_pattern),
    "setpu": Request(_set_pattern, len(_RAMP)),
    "setpd": Request(_set_pattern, len(_RAMP)),
}
for _name in _LABELS:
    OF_CHANNEL |= _switch(_name)
OF_CHANNEL |= lacking("Wrong axis type", "getfil setfil")  # a filter that other modules have

OF_CONTROLLER: dict[str, Request] = {
    "ver": Request(
        lambda _: f"attocube ANC300 controller version {__version__} (stickslip_ros)\r\n"
    ),
    "getcser": Request(lambda _: "SIM-0\r\n"),
    "echo": Request(Console.set_echo, 1),
    "help": Request(lambda _, asked=None: _help(asked), optional=1),
}
_ARGUMENTS = {"echo": "on|off", "help": "[<command>]"}


def _usage(name: str) -> str:
    command = OF_CHANNEL.get(name)
    if not command:
        return f"{name} {_ARGUMENTS.get(name, '')}".rstrip()
    needed = "<value> " * min(command.fewest, 1) + "... " * (command.fewest > 1)
    return f"{name} <axis> {needed}{'[<value>]' * command.optional}".rstrip()


def _help(asked: str | None) -> str:
    """Return the commands with their arguments, or the one that is asked for."""
    names = sorted(n for n, one in {**OF_CHANNEL, **OF_CONTROLLER}.items() if not one.lacking)
    found = names if asked is None else [name for name in names if name == asked.lower()]
    require(found, "Unknown command")
    return "".join(f"{_usage(name)}\r\n" for name in found)
