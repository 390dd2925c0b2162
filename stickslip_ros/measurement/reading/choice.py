# SPDX-License-Identifier: Apache-2.0
"""Which column is what; what cannot be known is asked for.

A quantity is found by the column that was named for it, by its usual names, or by a unit that no
other column has. A question shows the first lines and the option that answers it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from stickslip_ros.measurement.reading.quantities import (
    TIME,
    Quantity,
    Question,
)
from stickslip_ros.measurement.reading.table import (
    LONGEST_NAME,
    Column,
    MeasurementError,
    Table,
    described,
)
from stickslip_ros.measurement.reading.units import Unit, is_index, name_and_unit

_OTHER_TIMES = ("elapsed", "elapsed time", "clock", "seconds", "second")
#: Names of columns that number the samples.
_INDICES = ("sample", "samples", "index", "no", "no.", "nr", "nr.", "n", "#", "row", "sequence",
            "sample number", "point", "field.header.seq")  # fmt: skip


@dataclass(frozen=True)
class Reading:
    """How a measurement is read, where the file does not say it; mappings by key of a quantity."""

    columns: Mapping[str, str] = field(default_factory=dict)  #: name or number, from 1
    units: Mapping[str, str] = field(default_factory=dict)  #: such as {"x": "nm"}
    scales: Mapping[str, str] = field(default_factory=dict)  #: such as {"x": "-50nm/V"}
    rate: float | None = None  #: Hz, in place of a column of time
    angle: float = 0.0  #: between the sensor's axis and the motion, rad
    rows: tuple[int, int] | None = None  #: first and last row, from 1
    decimal: str | None = None  #: sign of the table
    progress: bool = False  #: show the progress on a terminal


@dataclass
class Chosen:
    """A column for each quantity, and the factor to SI."""

    columns: dict[str, Column] = field(default_factory=dict)
    factors: dict[str, float] = field(default_factory=dict)


def choose(table: Table, quantities: Sequence[Quantity], given: Reading) -> Chosen:
    """Return columns and factors; none of time where a rate or a clock of the file replaces it.

    Raises MeasurementError with everything that has to be asked.
    """
    chosen, questions = Chosen(), list[Question]()
    likely: Column | None = None  # the position, for further questions
    for quantity in quantities:
        if quantity.key in given.columns:
            chosen.columns[quantity.key] = _named(table, given.columns[quantity.key])
    for quantity in quantities:
        if quantity is TIME or quantity.key in chosen.columns:
            continue
        found = _find(table, quantity, given, chosen)
        if isinstance(found, Question):
            questions.append(found)
            if found.columns:  # so that all is asked at once
                likely = likely or found.columns[0]
                factor = quantity.factor(found.columns[0], given.units, given.scales)
                questions += [factor] if isinstance(factor, Question) else []
        elif found is not None:
            chosen.columns[quantity.key] = found
    if TIME in quantities and TIME.key not in chosen.columns and given.rate is None:
        time = _find_time(table, chosen, chosen.columns.get("x", likely))
        if isinstance(time, Question):
            questions.append(time)
        elif time is not None:
            chosen.columns[TIME.key] = time
    for quantity in quantities:
        if quantity.key in chosen.columns:
            factor = quantity.factor(chosen.columns[quantity.key], given.units, given.scales)
            if isinstance(factor, Question):
                questions.append(factor)
            else:
                chosen.factors[quantity.key] = factor
    if questions:
        raise _asked(table, questions)
    return chosen


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
    table: Table, quantity: Quantity, given: Reading, chosen: Chosen
) -> Column | Question | None:
    """Return the column of a quantity other than time, None if an optional one is not there."""
    free = [
        column
        for column in table.columns
        if column not in chosen.columns.values() and _may_be(quantity, column, given)
    ]
    usual = [column for name in quantity.names for column in free if column.name.lower() == name]
    if not quantity.required:
        given_here = quantity.key in given.units or quantity.key in given.scales
        return next((column for column in usual if given_here or Unit.of(column.unit)), None)
    if usual and not _is_abscissa(usual[0], table):
        return usual[0]
    by_unit = [column for column in free if _dimension(column) == quantity.dimension]
    if len(by_unit) == 1:
        return by_unit[0]
    values = [column for column in free if not _is_time(column)]
    if len(values) == 1:
        return values[0]
    if len(values) == 2 and len(free) == 2 and _in_given_order(table, chosen, values):
        return values[0] if quantity.key == "voltage" else values[1]
    values = values or [column for column in table.columns if not _is_time(column)]
    # Those with a unit are likelier; of those without names the first is often the time.
    values = sorted(
        values,
        key=lambda c: (
            _dimension(c) is None,
            (not c.name and c.number == 1) or _is_abscissa(c, table),
            c.name.lower().endswith("stamp"),
        ),
    )
    return Question(
        f"which column is the {quantity.what}?", "columns", quantity.key, _called(values), values
    )


def _in_given_order(table: Table, chosen: Chosen, values: Sequence[Column]) -> bool:
    """Return whether two columns of which nothing else is known are time and position."""
    nameless = not any(column.name for column in table.columns)
    return (
        (nameless or len(table.columns) == 2)
        and not any(column.clock for column in values)
        and _dimension(values[0]) is None
        and not counts(values[0])
        and TIME.key not in chosen.columns
        and not _is_abscissa(values[0], table)
    )


def _may_be(quantity: Quantity, column: Column, given: Reading) -> bool:
    """Return whether the unit of a column does not speak against a quantity."""
    if column.stamped or counts(column):
        return False
    unit = Unit.of(column.unit)
    fits = unit is None or unit.dimension == quantity.dimension
    voltage = quantity.required and unit is not None and unit.dimension == "voltage"
    return fits or voltage or (quantity.key in given.scales and unit is not None
                               and unit.dimension != "time")  # fmt: skip


def _find_time(table: Table, chosen: Chosen, base: Column | None) -> Column | Question | None:
    """Return the column of time that goes with the position base, None if a clock does."""
    if base is not None and base.alone:
        return None
    free = [
        column
        for column in table.columns
        if column not in chosen.columns.values()
        and column is not base
        and (column.length is None or base is None or column.length == base.length)
    ]
    timed = [column for column in free if _is_time(column)]
    numbers = [column for column in timed if not column.stamped]
    if base is not None:
        folders = [column for column in numbers if base.name.startswith(_folder(column))]
        deepest = max((len(_folder(column)) for column in folders), default=0)
        numbers = [c for c in folders if len(_folder(c)) == deepest] or numbers
    usual = [column for name in TIME.names for column in numbers if column.name.lower() == name]
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
    left = [c for c in free if Unit.of(c.unit) is None and not counts(c)]
    nameless = not any(column.name for column in table.columns)
    if len(left) == 1 and (nameless or len(table.columns) == 2) and left[0].number == 1:
        return left[0]
    if left:
        text = "which column is the time, or what is the rate of the samples (--rate 10kHz)?"
        return Question(text, "columns", "t", _called(left))
    return Question("there is no column of time; what is the rate of the samples?", "rate")


def _called(columns: Sequence[Column]) -> str:
    """Return how an option names the first of some columns."""
    if not columns:
        return "NAME"
    same = [column for column in columns if column.name == columns[0].name]
    plain = len(same) == 1 and _is_plain(columns[0].name)
    plain = plain and len(columns[0].name) <= LONGEST_NAME
    return columns[0].name if plain else str(columns[0].number)


def _asked(table: Table, questions: Sequence[Question]) -> MeasurementError:
    texts = "; ".join(question.text for question in questions)
    options: dict[str, list[str]] = {}
    for question in questions:
        options.setdefault(question.option, []).append(f"{question.key}={question.value}")
    added = [
        "--rate 10kHz" if option == "rate" else f"--{option} {','.join(values)}"
        for option, values in options.items()
    ]
    listed = "\n".join(f"  {line}" for line in described(table.columns).splitlines())
    preview = f"it begins:\n{table.preview}\n" if "|" in table.preview else ""
    return MeasurementError(
        f"{texts}; add, for example: {' '.join(added)}\n{preview}columns:\n{listed}"
    )


def _is_plain(name: str) -> bool:
    return bool(name) and not any(character in name for character in " ,='\"()[]")


def counts(column: Column) -> bool:
    """Return whether a column numbers the samples."""
    return is_index(column.unit) or (column.unit is None and column.name.lower() in _INDICES)


def _dimension(column: Column) -> str | None:
    unit = Unit.of(column.unit)
    return unit.dimension if unit else None


def _is_time(column: Column) -> bool:
    if column.stamped or _dimension(column) == "time":
        return True
    base = column.name.lower().rsplit("/", 1)[-1].rsplit(".", 1)[-1]
    usual = (*TIME.names, *_OTHER_TIMES)
    known = column.unit is not None and (Unit.of(column.unit) or is_index(column.unit))
    return not known and (column.name.lower() in usual or base in usual)


def _is_abscissa(column: Column, table: Table) -> bool:
    """Return whether x is what the others are over, as in ``x,y``, and no position."""
    others = [other for other in table.columns if other is not column]
    return (
        column.name.lower() == "x"
        and column.number == 1
        and _dimension(column) is None
        and not any(_is_time(other) or other.clock for other in others)
    )


def _folder(column: Column) -> str:
    """Return the path that a name stands in, with the mark at its end."""
    mark = "/" if "/" in column.name else "."
    folder, found, _ = column.name.rpartition(mark)
    return folder + found
