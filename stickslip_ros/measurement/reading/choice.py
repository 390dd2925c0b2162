# SPDX-License-Identifier: Apache-2.0
"""What its user says of a measurement, its quantities, their columns, and factors to SI units.

A quantity is found by the column given for it, by its usual names, or by a unit that no other
column has. A question shows the first lines and the option that answers it.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from stickslip_ros.measurement.reading.table import LONGEST_NAME, Column, MeasurementError, Table
from stickslip_ros.measurement.reading.units import Unit, is_index, name_and_unit
from stickslip_ros.physics.parameters.row import NUMBER, read_quantity

_SCALE = re.compile(rf"(?P<number>{NUMBER}|[+-])?\s*(?P<unit>[^\d\s/*][^\s/]*)?"
                    r"\s*(?:/\s*(?P<count>\d+\.?\d*)?\s*(?P<per>\S+))?")  # fmt: skip
#: What a scale is per where the column has plain numbers.
_COUNTS = {"count", "counts", "digit", "digits", "lsb", "step", "steps", "sample", "samples", "1"}
#: Unit, lowest and highest value, example. Interferometers use light, ultraviolet to infrared.
_BOUNDS = {"rate": ("Hz", 0.0, math.inf, "10kHz"), "wavelength": ("m", 1e-7, 2e-5, "633nm")}


@dataclass(frozen=True)
class Reading:
    """How a measurement is read, where the file does not say it.

    Each field takes what the option of its name takes, as text, ``Reading(units="x=nm")``, the
    first three also several texts.
    """

    columns: Mapping[str, str] = field(default_factory=dict)  #: name or number, from 1
    units: Mapping[str, str] = field(default_factory=dict)  #: such as {"x": "nm"}
    scale: Mapping[str, str] = field(default_factory=dict)  #: such as {"x": "-50nm/V"}
    rate: float | None = None  #: Hz, in place of a column of time
    angle: float = 0.0  #: between the sensor's axis and the motion, rad
    #: of an interferometer, m: jumps by whole halves of it are taken out
    wavelength: float | None = None
    rows: tuple[int, int] | None = None  #: first and last row, from 1
    decimal: str | None = None  #: sign of the table

    def __post_init__(self) -> None:
        """Turn texts into values, and hold these against their bounds; MeasurementError."""
        for name, read in _TEXTS.items():
            try:
                if isinstance(given := getattr(self, name), str) or read is _pairs:
                    object.__setattr__(self, name, read(given))
            except ValueError as error:
                raise MeasurementError(f"{name}: {error}") from None
        for name, (unit, low, high, example) in _BOUNDS.items():
            if (value := getattr(self, name)) is not None and not low < value < high:
                raise MeasurementError(
                    f"{name} is {value:g} {unit}; it has to lie between {low:g} and {high:g} "
                    f"{unit}, such as {example}"
                )


def _pairs(given: Any) -> dict[str, str]:
    """Return values by key, given as such or in texts, ``t=NAME,x=NAME``. ValueError."""
    if isinstance(given, Mapping):
        return {key: str(value) for key, value in given.items()}
    found = {}
    for text in filter(None, given if isinstance(given, list | tuple) else [given]):
        for part in re.split(r",(?=\s*\w+=)", str(text)):
            key, _, value = (piece.strip() for piece in part.partition("="))
            if not value or not key:
                raise ValueError(f"{text!r} is not of the form t=...,x=...")
            found[key] = value
    return found


def _rows(text: str) -> tuple[int, int]:
    """Return the first and the last row of a text such as ``1:5000`` or ``5001:``. ValueError."""
    found = re.fullmatch(r"\s*(\d*)\s*:\s*(\d*)\s*", text, re.ASCII)
    rows = (int(found[1] or 1), int(found[2] or sys.maxsize)) if found else (0, 0)
    if not 1 <= rows[0] <= rows[1]:
        raise ValueError(
            f"{text!r} is no range of rows; write it as 1:5000 or 5001:, from 1, where the last "
            "must not be before the first"
        )
    return rows


#: Of fields that are given as text.
_TEXTS: dict[str, Callable[[Any], Any]] = {
    **dict.fromkeys(("columns", "units", "scale"), _pairs),
    "rows": _rows,
    "rate": lambda text: read_quantity(text, "Hz"),
    "wavelength": lambda text: read_quantity(text, "m"),
}
#: What is asked: its text, the option that answers it, and an example of its value.
Question = tuple[str, str, str]


@dataclass(frozen=True)
class Quantity:
    """Something that a measurement holds."""

    key: str  #: as options name it
    what: str  #: for people
    dimension: str
    names: tuple[str, ...]  #: that are understood unaided
    example: str  #: a unit
    required: bool = True
    default: str | None = None  #: unit where none is stated
    of_any_unit: bool = False  #: only its course counts

    def factor(self, column: Column, given: Reading) -> float | Question:
        """Return the factor of a column to SI, or the question to ask. MeasurementError."""
        key, stated = self.key, given.units.get(self.key, column.unit)
        unit = Unit.of(stated or self.default)
        if column.stamped or self.of_any_unit:
            return unit.factor if unit and not column.stamped else 1.0
        if key in given.units and unit is None:
            raise MeasurementError(
                f"{key}={stated}: the unit {stated!r} is not known; write it as {self.example}"
            )
        where = f"column {column} ({self.what})"
        if key in given.scale:
            return self._scaled(where, given.scale[key], stated)
        if unit is None:
            says = f"has the unit {stated!r}, which is not known" if stated else "states no unit"
            return f"{where} {says}", "units", f"{key}={self.example}"
        if unit.dimension == self.dimension:
            return unit.factor
        if unit.dimension == "voltage" and self.dimension == "length":
            return f"{where} is a voltage; what is one volt?", "scale", f"{key}=50nm/V"
        raise MeasurementError(
            f"{where} is in {stated}, which is no unit of {self.dimension}; name another column "
            f"with --columns {key}=NAME, or say with --scale {key}=... what one {stated} is"
        )

    def _scaled(self, where: str, text: str, stated: str | None) -> float | Question:
        """Return the factor by a scale as typed: ``50nm/V``, ``-0.5um/V``, ``2nm`` or ``-1``."""
        found = _SCALE.fullmatch(text.strip())
        number, given, count, per = found.groups() if found else (None,) * 4
        counts, unit, to, of = (per or "1").lower() in _COUNTS, *map(Unit.of, (stated, given, per))
        factor = float(f"{number}1" if number in ("+", "-") else number or 1.0)
        factor /= float(count or 1) or math.nan
        known = (to is not None and to.dimension == self.dimension) if given or per else number
        if not known or not (counts or of) or not 0.0 < abs(factor) < 1e30:
            raise MeasurementError(
                f"the scale {text!r} gives no {self.dimension} by units that are known; write it "
                "as 50nm/V, -0.5um/V or -1"
            )
        if to is None:  # a factor on what the unit says
            if unit is None:
                return f"{where} states no unit", "units", f"{self.key}={self.example}"
            to = of = Unit(self.dimension, 1.0)
        if unit is not None and (of is None or unit.dimension != of.dimension):
            stands = f"the scale is per {of.dimension}" if of else "the scale has to say per what"
            example = f"--scale {self.key}=50{self.example}/{stated}"
            raise MeasurementError(f"{where} is in {stated}, but {stands}, such as {example}")
        return factor * to.factor * (unit.factor if unit else 1.0) / (of.factor if of else 1.0)


TIME = Quantity(
    "t", "time", "time", ("t", "time", "times", "timestamp", "zeit", "__time", "x_value"), "ms"
)
POSITION = Quantity(
    "x", "position", "length",
    ("x", "position", "pos", "runner", "slider", "displacement", "distance", "weg"), "nm",
)  # fmt: skip
DEFLECTION = Quantity(
    "u", "actuator deflection", "length", ("u", "actuator", "piezo"), "nm", required=False
)
#: Of the actuator, of which only the cycles are used.
VOLTAGE = Quantity(
    "voltage", "actuator voltage", "voltage", (), "V", required=False, of_any_unit=True
)
VELOCITY = Quantity("v", "runner velocity", "velocity", ("runner velocity",), "m/s", required=False)
#: Of a motion.
MOTION = (TIME, POSITION, DEFLECTION, VOLTAGE, VELOCITY)
#: Of the loops of an actuator: the first two columns, in V and m, where nothing else is said.
LOOP = (
    Quantity("t", "time", "time", TIME.names, "ms", required=False),
    Quantity("voltage", "voltage", "voltage", ("voltage", "volt", "volts"), "V", default="V"),
    Quantity(
        "deflection", "deflection", "length",
        ("deflection", "displacement", "position", "x", "elongation", "stroke"), "um",
        default="m",
    ),
)  # fmt: skip
_OTHER_TIMES = ("elapsed", "elapsed time", "clock", "seconds", "second")


def choose(
    table: Table, quantities: Sequence[Quantity], given: Reading
) -> tuple[dict[str, Column], list[str]]:
    """Return a column for each quantity, with its factor to SI; notes on units that are not used.

    There is none of time if a rate or a clock of the file replaces it. Raises MeasurementError with
    all questions.
    """
    named = (one for one in quantities if one.key in given.columns)
    chosen = {one.key: _named(table, given.columns[one.key]) for one in named}
    likely, questions = dict(chosen), list[Question]()  # what is asked, so that all is at once
    # The time is looked for last: it goes with the position.
    for quantity in sorted(quantities, key=lambda one: one is TIME):
        key, timely = quantity.key, quantity is TIME
        if key in chosen or (key == "t" and given.rate is not None):
            continue
        if timely:
            found = _times(table, chosen, likely.get("x", Column("")))
        else:
            found = _candidates(table, quantity, given, chosen)
        if isinstance(found, Column):
            chosen[key] = likely[key] = found
        elif timely and found == []:
            text = "there is no column of time; what is the rate of the samples?"
            questions.append((text, "rate", "10kHz"))
        elif found is not None:
            rate = ", or what is the rate of the samples (--rate 10kHz)" * timely
            text = f"which column is the {quantity.what}{rate}?"
            questions.append((text, "columns", f"{key}={_called(found)}"))
            if found and not timely:
                likely[key] = found[0]
    for column in chosen.values():
        if column.is_foreign:
            table.load([column])  # says what was expected
    for quantity in sorted(quantities, key=lambda one: one.key in chosen):
        if quantity.key in likely:
            factor = quantity.factor(likely[quantity.key], given)
            if isinstance(factor, tuple):
                questions.append(factor)
            elif quantity.key in chosen:
                chosen[quantity.key] = replace(chosen[quantity.key], factor=factor)
    if not questions:
        return chosen, [
            f"the header says {c.unit}; --units {key}={given.units[key]} is used"
            for key, c in chosen.items()
            if (stated := Unit.of(c.unit)) and (used := Unit.of(given.units.get(key)))
            if stated != used and not c.stamped
        ]
    texts, options, values = zip(*questions, strict=True)
    added = (
        f"--{option} {','.join(v for o, v in zip(options, values, strict=True) if o == option)}"
        for option in dict.fromkeys(options)
    )
    begins = f"it begins:\n{table.preview}\n" if table.preview else ""
    raise MeasurementError(
        f"{'; '.join(texts)}; add, for example: {' '.join(added)}\n{begins}"
        f"columns:\n{table.described()}"
    )


def _named(table: Table, wanted: str) -> Column:
    """Return the column with a name or a number. Raises MeasurementError."""
    plain = wanted.strip().lower()
    name, unit = name_and_unit(wanted)
    match = [c for c in table.columns if c.name.lower() == plain]
    match = match or [c for c in table.columns if unit and (c.name, c.unit) == (name, unit)]
    match = match or [c for c in table.columns if str(c.number) == plain]
    if len(match) == 1:
        return match[0]
    if match:
        numbers = ", ".join(str(column.number) for column in match)
        raise MeasurementError(
            f"{len(match)} columns are named {wanted!r}; name one by its number: {numbers}"
        )
    listed = ", ".join(map(str, table.columns[:20]))
    raise MeasurementError(f"there is no column {wanted!r}; the columns are: {listed}")


def _candidates(
    table: Table, quantity: Quantity, given: Reading, chosen: Mapping[str, Column]
) -> Column | list[Column] | None:
    """Return the column of a quantity other than time, those that it may be if that is not sure.

    None where it is not there and need not be.
    """
    known = quantity.key in given.units or quantity.key in given.scale
    dimensions = {None, quantity.dimension, *(["voltage"] if quantity.required else [])}
    free = [  # those whose unit does not speak against the quantity
        c
        for c in table.columns
        if not (c.stamped or c.counts or c in chosen.values())
        and not (c.is_foreign and c.dimension is None and c.name not in quantity.names)
        and (c.dimension in dimensions or (quantity.key in given.scale and c.dimension != "time"))
    ]
    usual = _with_names(free, quantity.names)
    if not quantity.required:
        return next((c for c in usual if known or c.dimension), None)
    if usual and not _is_abscissa(usual[0], table):
        return usual[0]
    values = [c for c in free if not _is_time(c)]
    for only in ([c for c in free if c.dimension == quantity.dimension], values):
        if len(only) == 1:
            return only[0]
    if len(values) == 2 and len(free) == 2:
        first, second = values  # without names and units, the first may well be the time
        bare = first.dimension is None and not (first.counts or first.clock or second.clock)
        timely = TIME.key not in chosen and not _is_abscissa(first, table)
        if bare and timely and _by_place(table):
            return first if quantity.key == "voltage" else second
    # Those with a unit are likelier; of those without names the first is often the time.
    likely = values or [c for c in table.columns if not _is_time(c)]
    late = {c.number for c in likely if (not c.name and c.number == 1) or _is_abscissa(c, table)}
    return sorted(likely, key=lambda c: (c.dimension is None, c.number in late))


def _times(
    table: Table, chosen: Mapping[str, Column], base: Column
) -> Column | list[Column] | None:
    """Return the time of the position base, those that it may be, None if base has a clock."""
    if base.alone:
        return None
    free = [
        c
        for c in table.columns
        if c not in (*chosen.values(), base)
        and (c.length is None or base.length in (None, c.length))
    ]
    timed = [c for c in free if _is_time(c)]
    numbers = [c for c in timed if not c.stamped]
    beside = [c for c in numbers if base.name.startswith(_folder(c))]
    deepest = max(map(len, map(_folder, beside)), default=0)
    numbers = [c for c in beside if len(_folder(c)) == deepest] or numbers
    if usual := _with_names(numbers, TIME.names):
        same = [c for c in usual if c.name.lower() == usual[0].name.lower()]
        # Some programs write a column of time before each channel.
        return ([c for c in same if c.number < base.number] or same)[-1]
    if len(numbers) == 1:
        return numbers[0]
    if base.clock is not None:
        return None
    if numbers or timed:
        return numbers or timed[0]
    left = [c for c in free if c.dimension is None and not c.counts]
    return left[0] if len(left) == 1 and left[0].number == 1 and _by_place(table) else left


def _with_names(columns: Sequence[Column], names: Sequence[str]) -> list[Column]:
    """Return the columns that have one of the names, in the order of the names."""
    return [column for name in names for column in columns if column.name.lower() == name]


def _by_place(table: Table) -> bool:
    """Return whether the place of a column may identify it."""
    return len(table.columns) == 2 or not any(column.name for column in table.columns)


def _is_time(column: Column) -> bool:
    if column.stamped or column.dimension == "time":
        return True
    known = column.dimension is not None or is_index(column.unit)
    own = re.split(r"[./]", column.name.lower())[-1]
    return not known and own in (*TIME.names, *_OTHER_TIMES)


def _is_abscissa(column: Column, table: Table) -> bool:
    """Return whether x is an abscissa, as in ``x,y``, and not a position."""
    first = column.name.lower() == "x" and column.number == 1 and column.dimension is None
    others = (other for other in table.columns if other is not column)
    return first and not any(_is_time(other) or other.clock for other in others)


def _folder(column: Column) -> str:
    """Return the path that a name stands in, with the mark at its end."""
    return column.name[: 1 + max(map(column.name.rfind, "./"))]


def _called(columns: Sequence[Column]) -> str:
    """Return how an option names the first of some columns."""
    if not columns:
        return "NAME"
    first = columns[0]
    alone = [column.name for column in columns].count(first.name) == 1
    plain = 0 < len(first.name) <= LONGEST_NAME and not set(first.name) & set(" ,='\"()[]")
    return first.name if alone and plain else str(first.number)
