# SPDX-License-Identifier: Apache-2.0
"""Chooses the columns of the quantities; asks where the choice is unclear.

A quantity is found by the column given for it, by its usual names, or by a unit that no other
column has. A question shows the first lines and the option that answers it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from stickslip_ros.measurement.reading.quantities import TIME, Quantity, Question, Reading
from stickslip_ros.measurement.reading.table import (
    LONGEST_NAME,
    Column,
    MeasurementError,
    Table,
    is_index,
    name_and_unit,
)

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
        scaled = quantity.key in given.scales and column.dimension != "time"
        no_value = column.stamped or column.counts or column in chosen.values()
        if (fits or scaled) and not no_value:
            free.append(column)
    usual = _with_names(free, quantity.names)
    if not quantity.required:
        given_here = quantity.key in given.units or quantity.key in given.scales
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
