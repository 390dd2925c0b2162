# SPDX-License-Identifier: Apache-2.0
"""The GCS 2 interface of a PI E-871, as two public drivers speak it.

Commands, answers and codes: PI's PIPython and the EPICS driver motorPIGCS2. Positions in mm; the
axis is called 1. A query is answered, a command only sets the error that `ERR?` tells and clears.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from enum import IntEnum

from stickslip_ros.axis import Axis
from stickslip_ros.axis.command import TARGETING
from stickslip_ros.emulator.controller import (
    Channel,
    Controller,
    Dialogue,
    Lines,
    Reasons,
    Refused,
    Request,
    lacking,
    require,
    stored,
    within,
)
from stickslip_ros.version import __version__

_MM = 1e-3


class Code(IntEnum):
    """The errors that `ERR?` tells."""

    NONE, SYNTAX, UNKNOWN, TOO_LONG = 0, 1, 2, 3
    NO_SERVO, LIMITS, VELOCITY, STOPPED, INVALID_AXIS, RANGE, COUNT = 5, 7, 8, 10, 15, 17, 24
    NO_LIMIT_SWITCH, UNKNOWN_PARAMETER, READ_ONLY, SERVO_ON = 32, 54, 64, 79


#: Parameters by number: type, whether it may be set, first value, what it is.
_PARAMETERS: dict[int, tuple[str, bool, float, str]] = {
    0xA: ("FLOAT", True, 5.0, "largest velocity (mm/s)"),
    0xB: ("FLOAT", True, 100.0, "acceleration (mm/s^2)"),
    0xC: ("FLOAT", True, 100.0, "deceleration (mm/s^2)"),
    0xE: ("INT", False, 1000000, "counts per unit, numerator"),
    0xF: ("INT", False, 1, "counts per unit, denominator"),
    0x14: ("INT", False, 1, "has a reference switch"),
    0x32: ("INT", False, 1, "has no limit switches"),
    0x4A: ("FLOAT", True, 1000.0, "largest acceleration (mm/s^2)"),
    0x4B: ("FLOAT", True, 1000.0, "largest deceleration (mm/s^2)"),
    0x50: ("FLOAT", True, 1.0, "velocity of reference moves (mm/s)"),
}


class GcsAxis(Channel):
    """An axis with its servo mode and its reference."""

    first_settings = {"velocity": 1.0} | {number: row[2] for number, row in _PARAMETERS.items()}

    def __init__(self, axis: Axis) -> None:
        """Start in open loop, without a reference."""
        super().__init__(axis)
        self.servo = False
        self.needs_reference = True  #: before closed-loop moves
        self.steps = 0.0  #: commanded last, in open loop
        self.home = 0.0  #: where the position was that counts as 0, mm

    def set_servo(self, on: float) -> None:
        """Switch the closed loop; off stops the axis."""
        require(on in (0.0, 1.0), Code.RANGE)
        if on and self.locked:
            self.axis.command("reset")
        self.servo = bool(on)
        if not on:
            self.halt()

    def halt(self) -> None:
        """Stop."""
        self.axis.command("stop")

    def move(self, mm: float) -> None:
        """Go to a position (mm) and hold it."""
        require(self.servo and (self.referenced or not self.needs_reference), Code.NO_SERVO)
        low, high = self.range
        require(low <= mm <= high, Code.LIMITS)
        self.go_to(_MM * mm, math.inf)

    def seek(self) -> None:
        """Go to the reference mark, which counts as 0; hold it if the servo is on."""
        self.find_reference(math.inf if self.servo else 0.0, zero=True)

    def count_as(self, mm: float) -> None:
        """Let the position count as one (mm), which is a reference, too."""
        require(not self.needs_reference, Code.NO_SERVO)
        self.set_position(_MM * mm)
        self.referenced = True

    def define_home(self) -> None:
        """Let the present position count as 0."""
        self.home += self.position / _MM
        self.set_position(0.0)

    def run_steps(self, steps: float) -> None:
        """Run whole steps in open loop."""
        require(not self.servo, Code.SERVO_ON)
        require(steps == int(steps) and abs(steps) < 2**31, Code.RANGE)
        if steps:
            self.axis.command("steps", int(steps))
        else:
            self.halt()
        self.steps = steps

    def register(self, number: float) -> str:
        """Return the one register, of the state."""
        require(number == 1, Code.RANGE)
        return f"0x{self.bits:04X}"

    def set_parameter(self, number: float, value: float) -> None:
        """Store a parameter; none has an effect on the motion."""
        kind, settable, *_ = _PARAMETERS.get(int(number), ("", False))
        require(kind, Code.UNKNOWN_PARAMETER)
        require(settable, Code.READ_ONLY)
        self.settings[int(number)] = value

    @property
    def range(self) -> tuple[float, float]:
        """Lowest and highest position, mm."""
        low, high = self.reach
        return low / _MM, high / _MM

    @property
    def on_target(self) -> bool:
        """Whether the closed loop is where it should be."""
        return self.servo and not self.referencing and self.axis.mode != TARGETING

    @property
    def bits(self) -> int:
        """The state as the EPICS driver reads it: limits, servo, moving, referencing, on target."""
        held = self.axis.status.held_at
        flags = (held == "low", held == "high", self.servo, self.moving, self.referencing)
        return (
            sum(bit for bit, on in zip((1, 4, 0x1000, 0x2000, 0x4000), flags, strict=True) if on)
            + 0x8000 * self.on_target
        )


class Requests(Lines):
    """Lines, and single bytes that are commands and need no end."""

    def take(self, data: bytes) -> list[bytes | None]:
        """Return the lines and commands that end in the data."""
        return super().take(re.sub(rb"[\x03-\x09\x0b\x18\x1b]", rb"\n\g<0>\n", data))


class GcsDialogue(Dialogue):
    """One client of the controller, which all share one error."""

    reasons = Reasons(
        Code.UNKNOWN, Code.INVALID_AXIS, Code.COUNT, Code.COUNT, Code.NO_SERVO, Code.RANGE
    )

    def cutter(self) -> Lines:
        """Cut lines and single bytes."""
        return Requests()

    def answer(self, line: bytes | None) -> bytes:
        """Return the answer to a query, nothing to a command; the error is kept."""
        controller: Gcs = self.controller
        words = (line or b"").decode("latin-1").split(" ")
        words = [word for word in words if word]
        try:
            require(line is not None, Code.TOO_LONG)
            return self._answer(words).encode("latin-1") if words else b""
        except Refused as refused:
            controller.error = refused.reason
        return b""

    def read(self, value: str) -> float:
        """Return an argument as a number, which may be hexadecimal. Raises Refused."""
        try:
            number = float(int(value, 16)) if value[:2].lower() == "0x" else float(value)
        except (ValueError, OverflowError):
            number = math.nan
        require(math.isfinite(number), Code.SYNTAX)
        return number

    def _answer(self, words: list[str]) -> str:
        controller: Gcs = self.controller
        name, rest = words[0].upper(), words[1:]
        if name in OF_CONTROLLER:
            return OF_CONTROLLER[name](controller) or ""
        command, axes = OF_CHANNEL.get(name), controller.axes
        if command is None or command.lacking:
            return self.carry_out(command, controller, [])
        each = 1 + command.fewest
        rest = rest or (list(axes) if each == 1 else [])
        require(rest and len(rest) % each == 0, Code.COUNT)
        answers = []
        for first in range(0, len(rest), each):
            word, *numbers = rest[first : first + each]
            require(word in axes, Code.INVALID_AXIS)
            found = self.carry_out(command, axes[word], numbers)
            if name in ("SPA?", "SRG?"):
                word = " ".join([word, *numbers])
            answers.append(f"{word}={found}")
        if not name.endswith("?"):
            if name in ("HLT", "STP"):
                controller.error = Code.STOPPED
            return ""
        return " \n".join(answers) + "\n"


class Gcs(Controller):
    """The controller of one axis."""

    channel = GcsAxis
    dialogue = GcsDialogue
    error: int = Code.NONE  #: of the last command that had one

    @property
    def axes(self) -> dict[str, GcsAxis]:
        """The axes by name."""
        return {str(number): axis for number, axis in enumerate(self.channels, 1)}

    def stop(self) -> None:
        """Stop all axes, which is told as an error."""
        for axis in self.channels:
            axis.halt()
        self.error = Code.STOPPED

    def tell_error(self) -> str:
        """Return the error and forget it."""
        error, self.error = self.error, Code.NONE
        return f"{error:d}\n"

    def restart(self) -> None:
        """Begin as at power-on."""
        for axis in self.channels:
            axis.halt()
        self.channels = [GcsAxis(one.axis) for one in self.channels]
        self.error = Code.NONE


def _parameter(axis: GcsAxis, number: float) -> str:
    kind = _PARAMETERS.get(int(number), ("",))[0]
    require(kind, Code.UNKNOWN_PARAMETER)
    value = axis.settings[int(number)]
    return f"{value:.0f}" if kind == "INT" else f"{value:.6f}"


OF_CHANNEL: dict[str, Request] = {
    "CST?": Request(lambda a: f"SIM-{a.axis.parameters.node.axis_name}"),
    "DFH": Request(GcsAxis.define_home),
    "DFH?": Request(lambda a: f"{a.home:.7f}"),
    "FNL": Request(lambda a: require(False, Code.NO_LIMIT_SWITCH), moves=True),
    "FPL": Request(lambda a: require(False, Code.NO_LIMIT_SWITCH), moves=True),
    "FRF": Request(GcsAxis.seek, moves=True),
    "FRF?": Request(lambda a: f"{a.referenced:d}"),
    "GOH": Request(lambda a: a.move(0.0), moves=True),
    "HLT": Request(GcsAxis.halt),
    "LIM?": Request(lambda a: "0"),
    "MOV": Request(GcsAxis.move, 1, moves=True),
    "MOV?": Request(lambda a: f"{a.target / _MM:.7f}"),
    "MVR": Request(lambda a, mm: a.move(a.target / _MM + mm), 1, moves=True),
    "ONT?": Request(lambda a: f"{a.on_target:d}"),
    "OSM": Request(GcsAxis.run_steps, 1, moves=True),
    "OSM?": Request(lambda a: f"{a.steps:.0f}"),
    "OSN?": Request(lambda a: f"{a.axis.status.steps_left:d}"),
    "OVL": Request(lambda a, hertz: a.axis.command("frequency", hertz), 1),
    "OVL?": Request(lambda a: f"{a.axis.status.frequency:.6f}"),
    "POS": Request(GcsAxis.count_as, 1),
    "POS?": Request(lambda a: f"{a.position / _MM:.7f}"),
    "RON": Request(lambda a, on: setattr(a, "needs_reference", bool(on)), 1),
    "RON?": Request(lambda a: f"{a.needs_reference:d}"),
    "SPA": Request(GcsAxis.set_parameter, 2),
    "SPA?": Request(_parameter, 1),
    "SRG?": Request(GcsAxis.register, 1),
    "STP": Request(GcsAxis.halt),
    "SVO": Request(GcsAxis.set_servo, 1),
    "SVO?": Request(lambda a: f"{a.servo:d}"),
    "TMN?": Request(lambda a: f"{a.range[0]:.7f}"),
    "TMX?": Request(lambda a: f"{a.range[1]:.7f}"),
    "TRS?": Request(lambda a: "1"),
}

for _name, _setting, _most, _code in (
    ("ACC", 0xB, _PARAMETERS[0x4A][2], Code.RANGE),
    ("DEC", 0xC, _PARAMETERS[0x4B][2], Code.RANGE),
    ("VEL", "velocity", _PARAMETERS[0xA][2], Code.VELOCITY),
):
    OF_CHANNEL[_name], OF_CHANNEL[f"{_name}?"] = stored(
        _setting, within(0.0, _most, _code), show="{:.6f}".format
    )
OF_CHANNEL |= lacking(
    Code.UNKNOWN,
    "CCL CPY CTO CTO? DEL DIO DIO? DRC DRC? DRR? DRT DRT? FED HDR? IFC IFC? IFS IFS? JAX JAX? JDT "
    "JLT JLT? JON JON? MAC MAC? MEX OAC OAC? OAD OAD? ODC ODC? OMA OMA? RMC? RPA RTR RTR? SAI SEP "
    "SEP? TAC? TAV? TIO? TNR? TRI TRI? TRO TRO? TWC VAR VAR? VLS VLS? WAC WPA",
)


def _help(_: Gcs) -> str:
    single = {"\x04": "#4", "\x05": "#5", "\x07": "#7", "\x18": "#24"}
    known = [name for name, one in OF_CHANNEL.items() if not one.lacking]
    names = sorted([*known, *(single.get(name, name) for name in OF_CONTROLLER)])
    return " \n".join(["The following commands are valid:", *names, "end of help"]) + "\n"


def _parameters(_: Gcs) -> str:
    rows = [
        f"0x{n:X}=\t0\t1\t{kind}\tmotion\t{text}" for n, (kind, *_r, text) in _PARAMETERS.items()
    ]
    return " \n".join(["The following parameters are valid:", *rows, "end of help"]) + "\n"


OF_CONTROLLER: dict[str, Callable[[Gcs], str | None]] = {
    "\x04": lambda c: "0x" + "".join(f"{axis.bits:04X}" for axis in c.channels) + "\n",
    "\x05": lambda c: f"{sum(a.moving << n for n, a in enumerate(c.channels)):X}\n",
    "\x07": lambda c: ("\xb0" if any(a.referencing for a in c.channels) else "\xb1") + "\n",
    "\x18": Gcs.stop,
    "*IDN?": lambda c: f"(c)stickslip_ros Physik Instrumente, E-871.1A1, SIM-0, {__version__}\n",
    "CCL?": lambda c: "0\n",
    "CSV?": lambda c: "2.0\n",
    "ERR?": Gcs.tell_error,
    "HLP?": _help,
    "HPA?": _parameters,
    "RBT": Gcs.restart,
    "SAI?": lambda c: " \n".join(c.axes) + "\n",
    "SSN?": lambda c: "SIM-0\n",
    "TVI?": lambda c: "".join(c.axes) + "\n",
    "VER?": lambda c: f"stickslip_ros {__version__}\n",
}
