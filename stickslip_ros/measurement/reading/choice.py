# SPDX-License-Identifier: Apache-2.0
"""The quantities of a measurement, their columns, and the factors of these to SI units.

A quantity is found by the column given for it, by its usual names, or by a unit that no other
column has. A question shows the first lines and the option that answers it.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from stickslip_ros.measurement.reading.table import (
    LONGEST_NAME,
    Column,
    MeasurementError,
    Table,
    Unit,
    is_index,
    name_and_unit,
)
from stickslip_ros.physics.parameters.row import NUMBER, read_quantity

_SCALE = re.compile(rf"(?P<number>{NUMBER}|[+-])?\s*(?P<unit>[^\d\s/*][^\s/]*)?"
                    r"\s*(?:/\s*(?P<count>\d+\.?\d*)?\s*(?P<per>\S+))?")  # fmt: skip
#: Wavelengths (m) of light that interferometers use, ultraviolet to infrared.
_LIGHT = (1e-7, 2e-5)
#: What a scale is per where the column has plain numbers.
_COUNTS = {"count", "counts", "digit", "digits", "lsb", "step", "steps", "sample", "samples", "1"}


@dataclass(frozen=True)
class Reading:
    """How a measurement is read, where the file does not say it.

    Each field takes what the option of its name takes, as text: ``Reading(units="x=nm")``.
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
            if isinstance(given := getattr(self, name), str):
                try:
                    object.__setattr__(self, name, read(given))
                except ValueError as error:
                    raise MeasurementError(f"{name}: {error}") from None
        for name in ("columns", "units", "scale"):
            given = getattr(self, name)
            if not isinstance(given, Mapping):
                raise MeasurementError(
                    f'{name} is {given!r}; give a value for each key, such as {{"x": ...}}'
                )
        if self.rate is not None and not 0.0 < self.rate < math.inf:
            raise MeasurementError(f"rate is {self.rate:g} Hz; it has to be above 0")
        shortest, longest = _LIGHT
        if self.wavelength is not None and not shortest <= self.wavelength <= longest:
            raise MeasurementError(
                f"the wavelength is {self.wavelength:g} m; that of an interferometer lies between "
                f"{shortest:g} and {longest:g} m, such as 633nm"
            )


def _pairs(text: str) -> dict[str, str]:
    """Return the values by key of a text such as ``t=NAME,x=NAME``. Raises ValueError."""
    pairs = {}
    for part in re.split(r",(?=\s*\w+=)", text) if text else []:
        key, sign, value = (piece.strip() for piece in part.partition("="))
        if not sign or not value or not key:
            raise ValueError(f"{text!r} is not of the form t=...,x=...")
        pairs[key] = value
    return pairs


def _rows(text: str) -> tuple[int, int]:
    """Return the first and the last row of a text such as ``1:5000`` or ``5001:``. ValueError."""
    first, sign, last = text.partition(":")
    if not sign or not all(part.strip().isdecimal() or not part for part in (first, last)):
        raise ValueError(f"{text!r} is no range; write it as 1:5000 or 5001:")
    rows = int(first or 1), int(last or sys.maxsize)
    if not 1 <= rows[0] <= rows[1]:
        raise ValueError(f"{text!r}: rows count from 1, and the last must not be before the first")
    return rows


_TEXTS: dict[str, Callable[[str], Any]] = {
    "columns": _pairs, "units": _pairs, "scale": _pairs, "rows": _rows,
    "rate": lambda text: read_quantity(text, "Hz"),
    "wavelength": lambda text: read_quantity(text, "m"),
}  # fmt: skip


@dataclass(frozen=True)
class Question:
    """An unknown property, and the option that gives it: ``--option key=value``."""

    text: str
    option: str
    key: str = ""
    value: str = ""
    columns: Sequence[Column] = ()  #: among which to choose


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

    def factor(self, column: Column, given: Reading) -> float | Question:
        """Return the factor of a column to SI, or the question to ask. MeasurementError."""
        if column.stamped:
            return 1.0
        key, example = self.key, self.example
        stated = given.units.get(key, column.unit)
        unit = Unit.of(stated)
        if key in given.units and unit is None:
            raise MeasurementError(
                f"{key}={stated}: the unit {stated!r} is not known; write it as {example}"
            )
        where = f"column {column} ({self.what})"
        if key in given.scale:
            return self._scaled(where, given.scale[key], stated, unit)
        if unit is None and not stated and self.default:
            unit = Unit.of(self.default)
        if unit is None:
            says = f"has the unit {stated!r}, which is not known" if stated else "states no unit"
            return Question(f"{where} {says}", "units", key, example)
        if unit.dimension == self.dimension:
            return unit.factor
        if unit.dimension == "voltage" and self.dimension == "length":
            return Question(f"{where} is a voltage; what is one volt?", "scale", key, "50nm/V")
        raise MeasurementError(
            f"{where} is in {stated}, which is no unit of {self.dimension}; name another column "
            f"with --columns {key}=NAME, or say with --scale {key}=... what one {stated} is"
        )

    def _scaled(
        self, where: str, text: str, stated: str | None, unit: Unit | None
    ) -> float | Question:
        """Return the factor by a scale as typed: ``50nm/V``, ``-0.5um/V``, ``2nm`` or ``-1``."""
        found = _SCALE.fullmatch(text.strip())
        number, given, count, per = found.group("number", "unit", "count", "per") if found else (
            None, None, None, None)  # fmt: skip
        to, of = Unit.of(given), None if per is None or per.lower() in _COUNTS else Unit.of(per)
        factor = float(f"{number}1" if number in ("+", "-") else number or 1.0)
        if (to is None if given or per else number is None) or not 0.0 < abs(factor) < 1e30:
            raise MeasurementError(
                f"the scale {text!r} is not understood; write it as 50nm/V, -0.5um/V or -1"
            )
        if per and per.lower() not in _COUNTS and of is None:
            raise MeasurementError(f"the scale {text!r}: {per!r} is not a known unit")
        if to is None:  # a factor on what the unit says
            if unit is None:
                return Question(f"{where} states no unit", "units", self.key, self.example)
            to = of = Unit(self.dimension, 1.0)
        if to.dimension != self.dimension:
            raise MeasurementError(
                f"the scale {text!r} gives a {to.dimension}; it has to give a {self.dimension}"
            )
        factor *= to.factor / float(count or 1.0)
        if unit is None:
            return factor / (of.factor if of else 1.0)
        if of is None or unit.dimension != of.dimension:
            stands = f"the scale is per {of.dimension}" if of else "the scale has to say per what"
            example = f"--scale {self.key}=50{self.example}/{stated}"
            raise MeasurementError(f"{where} is in {stated}, but {stands}, such as {example}")
        return factor * unit.factor / of.factor


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
VELOCITY = Quantity("v", "runner velocity", "velocity", ("runner velocity",), "m/s", required=False)
#: Of a motion.
MOTION = (TIME, POSITION, DEFLECTION, VELOCITY)
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


def choose(table: Table, quantities: Sequence[Quantity], given: Reading) -> dict[str, Column]:
    """Return a column for each quantity, with its factor to SI.

    There is none of time if a rate or a clock of the file replaces it. Raises MeasurementError with
    all questions.
    """
    chosen, questions = dict[str, Column](), list[Question]()
    likely: Column | None = None  # the position, so that all is asked at once
    for quantity in quantities:
        if quantity.key in given.columns:
            chosen[quantity.key] = _named(table, given.columns[quantity.key])
    # The time is looked for last: it goes with the position.
    for quantity in sorted(quantities, key=lambda one: one is TIME):
        if quantity.key in chosen or (quantity is TIME and given.rate is not None):
            continue
        found = (
            _find_time(table, chosen, chosen.get("x", likely))
            if quantity is TIME
            else _find(table, quantity, given, chosen)
        )
        if isinstance(found, Question):
            questions.append(found)
            if found.columns:
                likely = likely or found.columns[0]
                factor = quantity.factor(found.columns[0], given)
                questions += [factor] if isinstance(factor, Question) else []
        elif found is not None:
            chosen[quantity.key] = found
    for quantity in quantities:
        if quantity.key in chosen:
            factor = quantity.factor(chosen[quantity.key], given)
            if isinstance(factor, Question):
                questions.append(factor)
            else:
                chosen[quantity.key] = replace(chosen[quantity.key], factor=factor)
    if questions:
        raise _asked(table, questions)
    return chosen


def contradictions(chosen: Mapping[str, Column], given: Reading) -> Iterator[str]:
    """Say which units given are not those that the file states for the columns chosen."""
    for key, column in chosen.items():
        stated, used = Unit.of(column.unit), Unit.of(given.units.get(key))
        if stated and used and stated != used and not column.stamped:
            yield f"the header says {column.unit}; --units {key}={given.units[key]} is used"


def _named(table: Table, wanted: str) -> Column:
    """Return the column with a name or a number. Raises MeasurementError."""
    plain = wanted.strip().lower()
    name, unit = name_and_unit(wanted)
    for match in (
        [c for c in table.columns if c.name.lower() == plain],
        [c for c in table.columns if unit and (c.name.lower(), c.unit) == (name.lower(), unit)],
        [c for c in table.columns if str(c.number) == plain],
    ):
        if len(match) > 1:
            numbers = ", ".join(str(column.number) for column in match)
            raise MeasurementError(
                f"{len(match)} columns are named {wanted!r}; name one by its number: {numbers}"
            )
        if match:
            return match[0]
    listed = ", ".join(map(str, table.columns[:20]))
    raise MeasurementError(f"there is no column {wanted!r}; the columns are: {listed}")


def _find(
    table: Table, quantity: Quantity, given: Reading, chosen: Mapping[str, Column]
) -> Column | Question | None:
    """Return the column of a quantity other than time, None if an optional one is not there."""
    free = []  # those whose unit does not speak against the quantity
    for column in table.columns:
        fits = column.dimension in (None, quantity.dimension) or (
            quantity.required and column.dimension == "voltage"
        )
        scaled = quantity.key in given.scale and column.dimension != "time"
        no_value = column.stamped or column.counts or column in chosen.values()
        if (fits or scaled) and not no_value:
            free.append(column)
    usual = _with_names(free, quantity.names)
    if not quantity.required:
        given_here = quantity.key in given.units or quantity.key in given.scale
        return next((column for column in usual if given_here or column.dimension), None)
    if usual and not _is_abscissa(usual[0], table):
        return usual[0]
    by_unit = [column for column in free if column.dimension == quantity.dimension]
    values = [column for column in free if not _is_time(column)]
    for only in (by_unit, values):
        if len(only) == 1:
            return only[0]
    if len(values) == 2 and len(free) == 2:
        first, second = values  # without names and units, the first may well be the time
        bare = first.dimension is None and not (first.counts or first.clock or second.clock)
        timely = TIME.key not in chosen and not _is_abscissa(first, table)
        if bare and timely and _by_place(table):
            return first if quantity.key == "voltage" else second
    values = values or [column for column in table.columns if not _is_time(column)]
    # Those with a unit are likelier; of those without names the first is often the time.
    values = sorted(
        values,
        key=lambda c: (
            c.dimension is None,
            (not c.name and c.number == 1) or _is_abscissa(c, table),
            c.name.lower().endswith("stamp"),
        ),
    )
    return Question(
        f"which column is the {quantity.what}?", "columns", quantity.key, _called(values), values
    )


def _find_time(
    table: Table, chosen: Mapping[str, Column], base: Column | None
) -> Column | Question | None:
    """Return the column of time that goes with the position base, None if a clock does."""
    if base is not None and base.alone:
        return None
    free = [
        column
        for column in table.columns
        if column not in chosen.values()
        and column is not base
        and (column.length is None or base is None or column.length == base.length)
    ]
    timed = [column for column in free if _is_time(column)]
    numbers = [column for column in timed if not column.stamped]
    if base is not None:
        folders = [column for column in numbers if base.name.startswith(_folder(column))]
        deepest = max((len(_folder(column)) for column in folders), default=0)
        numbers = [c for c in folders if len(_folder(c)) == deepest] or numbers
    usual = _with_names(numbers, TIME.names)
    same = [column for column in usual if column.name.lower() == usual[0].name.lower()]
    if len(same) > 1 and base is not None:
        # Some programs write a column of time before each channel.
        before = [column for column in same if column.number < base.number]
        return (before or same)[-1]
    if usual or len(numbers) == 1:
        return (usual or numbers)[0]
    if base is not None and base.clock is not None:
        return None
    if len(numbers) > 1:
        return Question("which column is the time?", "columns", "t", _called(numbers))
    if timed:
        return timed[0]
    left = [c for c in free if c.dimension is None and not c.counts]
    if len(left) == 1 and _by_place(table) and left[0].number == 1:
        return left[0]
    if left:
        text = "which column is the time, or what is the rate of the samples (--rate 10kHz)?"
        return Question(text, "columns", "t", _called(left))
    return Question("there is no column of time; what is the rate of the samples?", "rate")


def _with_names(columns: Sequence[Column], names: Sequence[str]) -> list[Column]:
    """Return the columns that have one of the names, in the order of the names."""
    return [column for name in names for column in columns if column.name.lower() == name]


def _by_place(table: Table) -> bool:
    """Return whether the place of a column may identify it."""
    return len(table.columns) == 2 or not any(column.name for column in table.columns)


def _is_time(column: Column) -> bool:
    if column.stamped or column.dimension == "time":
        return True
    base = column.name.lower().rsplit("/", 1)[-1].rsplit(".", 1)[-1]
    usual = (*TIME.names, *_OTHER_TIMES)
    known = column.dimension is not None or is_index(column.unit)
    return not known and (column.name.lower() in usual or base in usual)


def _is_abscissa(column: Column, table: Table) -> bool:
    """Return whether x is an abscissa, as in ``x,y``, and not a position."""
    others = [other for other in table.columns if other is not column]
    return (
        column.name.lower() == "x"
        and column.number == 1
        and column.dimension is None
        and not any(_is_time(other) or other.clock for other in others)
    )


def _folder(column: Column) -> str:
    """Return the path that a name stands in, with the mark at its end."""
    mark = "/" if "/" in column.name else "."
    folder, found, _ = column.name.rpartition(mark)
    return folder + found


def _called(columns: Sequence[Column]) -> str:
    """Return how an option names the first of some columns."""
    if not columns:
        return "NAME"
    first = columns[0]
    alone = [column.name for column in columns].count(first.name) == 1
    plain = 0 < len(first.name) <= LONGEST_NAME and not set(first.name) & set(" ,='\"()[]")
    return first.name if alone and plain else str(first.number)


def _asked(table: Table, questions: Sequence[Question]) -> MeasurementError:
    texts = "; ".join(question.text for question in questions)
    options: dict[str, list[str]] = {}
    for question in questions:
        options.setdefault(question.option, []).append(f"{question.key}={question.value}")
    added = [
        "--rate 10kHz" if option == "rate" else f"--{option} {','.join(values)}"
        for option, values in options.items()
    ]
    preview = f"it begins:\n{table.preview}\n" if table.preview else ""
    return MeasurementError(
        f"{texts}; add, for example: {' '.join(added)}\n{preview}columns:\n{table.described()}"
    )
