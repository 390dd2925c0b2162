# SPDX-License-Identifier: Apache-2.0
"""The common form of all formats: named columns with units, whose values are read on demand.

Units as instruments write them, and names of columns with units.

A unit is a prefix and a name, such as ``nm``, ``µs``, ``mV``, ``Volt``, ``seconds`` or
``nanometers``. Letters count as the SI has them, apart from spellings that can mean one thing only
(``S`` or ``SEC`` for seconds, ``MM`` for mm). What is not known here is asked for, never guessed.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.errors import StickslipError, printable
from stickslip_ros.physics.parameters.row import PREFIXES

_LONG_PREFIXES = {
    "": 1.0, "femto": 1e-15, "pico": 1e-12, "nano": 1e-9, "micro": 1e-6, "milli": 1e-3,
    "centi": 1e-2, "kilo": 1e3, "mega": 1e6, "giga": 1e9,
}  # fmt: skip
#: Symbols that take a prefix, by what they measure.
_SYMBOLS = {
    "s": "time", "m": "length", "V": "voltage", "A": "current", "Hz": "frequency",
    "N": "force", "g": "acceleration", "Pa": "pressure", "W": "power", "Ω": "resistance",
    "rad": "angle", "C": "charge", "B": "data", "T": "field", "K": "temperature",
    "m/s": "velocity", "m/s^2": "acceleration",
}  # fmt: skip
#: Words, each with or without a long prefix and a plural s.
_WORDS = {
    "second": "time", "sec": "time", "sekunde": "time", "meter": "length", "metre": "length",
    "volt": "voltage", "ampere": "current", "amp": "current", "hertz": "frequency",
    "newton": "force", "gram": "mass", "pascal": "pressure", "watt": "power", "ohm": "resistance",
    "radian": "angle",
}  # fmt: skip
#: Units with a size of their own.
_OTHERS = {
    "min": ("time", 60.0), "minute": ("time", 60.0), "minutes": ("time", 60.0),
    "h": ("time", 3600.0), "hr": ("time", 3600.0), "hour": ("time", 3600.0),
    "hours": ("time", 3600.0), "secs": ("time", 1.0), "usec": ("time", 1e-6),
    "msec": ("time", 1e-3), "nsec": ("time", 1e-9),
    "cm": ("length", 1e-2), "dm": ("length", 1e-1), "micron": ("length", 1e-6),
    "microns": ("length", 1e-6), "Å": ("length", 1e-10), "angstrom": ("length", 1e-10),
    "inch": ("length", 25.4e-3), "deg": ("angle", 0.017453292519943295),
    "°": ("angle", 0.017453292519943295), "degree": ("angle", 0.017453292519943295),
    "°C": ("temperature", 1.0), "degC": ("temperature", 1.0), "Vpp": ("voltage", 1.0),
    "mVolt": ("voltage", 1e-3), "mVolts": ("voltage", 1e-3), "%": ("share", 0.01),
    "dB": ("level", 1.0), "dBm": ("level", 1.0),
}  # fmt: skip
#: Capitals that cannot mean anything else.
_CAPITALS = {"S": "s", "MS": "ms", "US": "us", "NS": "ns", "SEC": "sec", "MM": "mm", "UM": "um",
             "v": "V", "mv": "mV", "uv": "uV", "kv": "kV"}  # fmt: skip
#: Units of columns that number the samples.
_INDEX_UNITS = {"sequence", "index", "sample", "samples", "point", "points", "no.", "#"}
#: Texts in a line of units that are not units.
_NO_UNITS = {"", "-", "--", "a.u.", "au", "n/a", "none", "1", "count", "counts", "lsb", "digits"}


@dataclass(frozen=True)
class Unit:
    """The quantity of a number, and the factor to its SI unit."""

    dimension: str
    factor: float

    @classmethod
    def of(cls, text: str | None) -> Unit | None:
        """Return the unit that a text means, None if it means none that is known."""
        if text is None:
            return None
        plain = text.strip().strip("()[]{}").strip()
        for spelling, letter in _SPELLINGS:
            plain = plain.replace(spelling, letter)
        plain = _CAPITALS.get(plain, plain)
        return _UNITS.get(plain) or _WORD_UNITS.get(plain.lower())


#: Other spellings of a part of a unit; two are UTF-8 that was read as Latin-1.
_SPELLINGS = (("Âµ", "u"), ("Î¼", "u"), ("µ", "u"), ("μ", "u"), ("²", "^2"), ("s2", "s^2"),
              ("**", "^"))  # fmt: skip
_UNITS = {
    **{prefix + symbol: Unit(dimension, factor) for symbol, dimension in _SYMBOLS.items()
       for prefix, factor in PREFIXES.items()},
    **{name: Unit(*what) for name, what in _OTHERS.items()},
}  # fmt: skip
#: Words mean the same in capitals and small letters.
_WORD_UNITS = {
    **{prefix + word + plural: Unit(dimension, factor) for word, dimension in _WORDS.items()
       for prefix, factor in _LONG_PREFIXES.items() for plural in ("", "s")},
    **{name: Unit(*what) for name, what in _OTHERS.items()},
}  # fmt: skip


def is_index(text: str | None) -> bool:
    """Return whether a unit says that a column numbers its samples."""
    return text is not None and text.strip().strip("()[]").lower() in _INDEX_UNITS


def is_unit_cell(text: str) -> bool:
    """Return whether a text can be a cell in a line of units."""
    plain = text.strip().strip("()[]").strip()
    return plain.lower() in _NO_UNITS or Unit.of(plain) is not None or is_index(plain)


_BRACKETS = re.compile(r"(?P<name>.*?)[\s_]*(?:\((?P<a>[^()]*)\)|\[(?P<b>[^\[\]]*)\]|"
                       r"\{(?P<c>[^{}]*)\})\s*\.?")  # fmt: skip
_IN = re.compile(
    r"(?P<name>.*?)\s*(?:\bin|/)\s+(?P<unit>\S+)|(?P<slashed>[^/]*?)\s*/(?P<after>\w+)"
)
_TAIL = re.compile(r"(?P<name>.+?)(?:[_\s:,]\s*)(?P<unit>[A-Za-zµμÅ/^0-9°%]+)")
_CHANNEL_WITH_UNIT = re.compile(r"(?P<name>(?:CH|CHAN|C|MATH)\d*)\s*(?P<unit>V|mV|A)")
#: Tails of a name that are one letter may be a word of it: only these end in their unit.
_WITH_LETTER = {
    "s": {"t", "time", "timestamp", "elapsed", "elapsed_time", "zeit", "seconds"},
    "m": {
        "x", "position", "pos", "runner", "slider", "displacement", "distance", "weg", "path",
        "deflection", "elongation", "stroke", "actuator", "piezo", "u",
    },
    "V": {"voltage", "volt", "drive", "piezo", "command", "u"},
}  # fmt: skip


def name_and_unit(text: str) -> tuple[str, str | None]:
    """Return a column's name and its unit as the header has them.

    Understood are ``x (nm)``, ``x [nm]``, ``x / nm``, ``x in nm``, ``x_nm``, ``CH1V``.
    """
    text = " ".join(text.split())
    if found := _BRACKETS.fullmatch(text):
        return found["name"].strip(), (found["a"] or found["b"] or found["c"] or "").strip() or None
    if found := _IN.fullmatch(text):
        name, unit = found["name"] or found["slashed"] or "", found["unit"] or found["after"]
        if Unit.of(unit) and not text.startswith("/"):
            return name.strip(), unit
    if found := _CHANNEL_WITH_UNIT.fullmatch(text):
        return found["name"], found["unit"]
    if (found := _TAIL.fullmatch(text)) and Unit.of(found["unit"]):
        name, unit = found["name"].strip(), found["unit"]
        if len(unit) > 1 and unit[:1] != "/":
            return name, unit
        if re.split(r"[./_ ]", name.lower())[-1] in _WITH_LETTER.get(unit, ()):
            return name, unit
    return text, None


#: Characters of a name in a message.
LONGEST_NAME = 60
#: Decimal logarithms of the largest number that is one, and of the farthest way to the next.
_LARGEST, _LEAP = 40.0, 60.0
#: Names of columns that number the samples.
_INDICES = ("sample", "samples", "index", "no", "no.", "nr", "nr.", "n", "#", "row", "sequence",
            "sample number", "point", "field.header.seq")  # fmt: skip


class MeasurementError(StickslipError, ValueError):
    """A measurement that cannot be read; the message names the place and the cure."""

    _keeps = "\n"  # of how a file begins, and of its columns


@dataclass(frozen=True)
class Clock:
    """Even times that a file states instead of listing them."""

    start: float  #: s
    step: float  #: s
    count: int | None = None  #: of samples, where the file states it


@dataclass(frozen=True)
class Column:
    """One column of a table."""

    name: str  #: without its unit; empty if it has none
    unit: str | None = None  #: as the file has it
    clock: Clock | None = None  #: of its samples, where the file states it
    values: NDArray[Any] | None = field(default=None, compare=False)  #: where they are in memory
    number: int = 0  #: from 1
    length: int | None = None  #: samples, where that is known before reading
    stamped: bool = False  #: holds dates or times of the day, read as seconds
    alone: bool = False  #: its clock is not that of a column of times beside it
    factor: float = 1.0  #: to the SI unit, of a column that is chosen for a quantity

    def __str__(self) -> str:
        name = f" {_short(self.name)}" if self.name else ""
        unit = f" ({_short(self.unit)})" if self.unit else ""
        return f"{self.number}{name}{unit}"

    @property
    def dimension(self) -> str | None:
        """The measured quantity, None if its unit does not tell."""
        unit = Unit.of(self.unit)
        return unit.dimension if unit else None

    @property
    def counts(self) -> bool:
        """Whether it numbers the samples."""
        return is_index(self.unit) or (self.unit is None and self.name.lower() in _INDICES)


@dataclass(frozen=True)
class Loaded:
    """Values of some columns, row by row, and the notes on them."""

    values: list[NDArray[np.float64]]  #: of each column; nan where a row has none
    place: Callable[[int], str] = lambda row: f"row {row + 1}"  #: of a row, for people
    notes: tuple[str, ...] = ()
    breaks: tuple[int, ...] = ()  #: rows before which something was left out


@dataclass(frozen=True)
class Table:
    """Columns of a file and the way to their values."""

    columns: Sequence[Column]
    load: Callable[[Sequence[Column]], Loaded]
    preview: str = ""  #: the first lines of a text
    notes: tuple[str, ...] = ()

    @classmethod
    def of(
        cls, columns: Iterable[Column], clock: Clock | None = None, notes: tuple[str, ...] = ()
    ) -> Table:
        """Return a table of columns in memory, whose names may end in units.

        clock is that of columns without one. Raises MeasurementError if there are no columns.
        """
        held = []
        for number, one in enumerate(columns, 1):
            name, unit = name_and_unit(one.name) if one.unit is None else (one.name, one.unit)
            length = None if one.values is None else len(one.values)
            held.append(replace(one, number=number, name=name, unit=unit, length=length,
                                clock=one.clock or clock))  # fmt: skip
        if not held:
            raise MeasurementError("it holds no columns of numbers over time")

        def load(wanted: Sequence[Column]) -> Loaded:
            chosen = [np.asarray(column.values, np.float64) for column in wanted]
            for column, values in zip(wanted, chosen, strict=True):
                _check(column, values)
            return Loaded(chosen)

        return cls(held, load, notes=notes)

    def described(self, most: int = 12) -> str:
        """Return a line for each of the first columns: number, name, unit, samples, step."""
        lines = []
        for column in self.columns[:most]:
            samples = "" if column.length is None else f", {column.length} samples"
            clock = "" if column.clock is None else f", every {column.clock.step:g} s"
            lines.append(f"  {column}{samples}{clock}")
        if len(self.columns) > most:
            lines.append(f"  ... and {len(self.columns) - most} more")
        return "\n".join(lines)


def _short(text: str) -> str:
    """Return a text of the file as messages hold it: where the header is no header, it is long."""
    return printable(text if len(text) <= LONGEST_NAME else f"{text[:LONGEST_NAME]}...")


def _check(column: Column, values: NDArray[np.float64]) -> None:
    """Refuse binary numbers that are read from a wrong byte on: their sizes leap wildly.

    Instruments send up to 9.9e37 for what they could not measure.
    """
    sizes = np.abs(values[np.isfinite(values) & (values != 0.0)])
    decades = np.log10(sizes)
    leaps = np.abs(np.diff(decades))
    if decades.max(initial=0.0) > _LARGEST or leaps.max(initial=0.0) > _LEAP:
        raise MeasurementError(
            f"column {column} holds numbers from {sizes.min():.1g} to {sizes.max():.1g} in size: "
            "it is damaged; write it anew"
        )
