# SPDX-License-Identifier: Apache-2.0
"""The common form of all formats: named columns with units, whose values are read on demand."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.errors import StickslipError, printable
from stickslip_ros.measurement.reading.units import Unit, is_index, name_and_unit

#: Characters of a name in a message.
LONGEST_NAME = 60
#: Decimal logarithms of the largest number that is one, and of the farthest way to the next.
_LARGEST, _LEAP = 40.0, 60.0
#: Whole numbers from here on are not all held by a float.
WHOLE = 2**53
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
    origin: int = 0  #: what its values count from, where a float would round them
    joined: bool = False  #: whole seconds; the column behind it holds nanoseconds to add

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
    def is_foreign(self) -> bool:
        """Whether it holds other things than numbers, or complex ones: taken if it is named."""
        return self.values is not None and self.values.dtype.kind not in "fiub"

    @property
    def counts(self) -> bool:
        """Whether it numbers the samples."""
        return is_index(self.unit) or (self.unit is None and self.name.lower() in _INDICES)


@dataclass(frozen=True)
class Loaded:
    """Values of some columns, row by row, and the notes on them."""

    values: list[NDArray[np.float64]]  #: of each, from its origin on; nan where a row has none
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

        Dates and durations count in seconds from the first one. clock is that of columns without
        one. Raises MeasurementError if there are no columns.
        """
        held = []
        for number, one in enumerate(columns, 1):
            name, unit = name_and_unit(one.name) if one.unit is None else (one.name, one.unit)
            values, origin = np.asarray(one.values), 0
            with contextlib.suppress(TypeError, ValueError):  # where they are numbers
                values = values.astype(np.float64) if values.dtype == object else values
            if values.dtype.kind in "mM":
                values, unit = (values - values[:1]) / np.timedelta64(1, "s"), "s"
            elif values.dtype.kind in "iu" and values.size and abs(int(values[0])) > WHOLE:
                origin = int(values[0])  # the difference of unsigned ones may be below 0
                values = (values - values[0]).astype(np.int64)
            one = replace(one, name=name, unit=unit, number=number, clock=one.clock or clock)
            held.append(replace(one, values=values, length=len(values), origin=origin))
        if not held:
            raise MeasurementError(
                f"it holds no columns of numbers over time{''.join(f'; {one}' for one in notes)}"
            )
        return cls(held, lambda wanted: Loaded([_numbers(one) for one in wanted]), notes=notes)

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


def _numbers(column: Column) -> NDArray[np.float64]:
    """Return the values of a column in memory. Raises MeasurementError.

    Binary numbers that are read from a wrong byte on leap wildly in size. Instruments send up to
    9.9e37 for what they could not measure.
    """
    values = np.asarray(column.values)
    try:
        if values.dtype.kind == "c":
            raise TypeError
        values = values.astype(np.float64)
    except (TypeError, ValueError):
        what = {"c": "complex numbers", "O": "objects"}.get(values.dtype.kind, "no numbers")
        raise MeasurementError(
            f"column {column} holds {what}; expected is one real number for each sample"
        ) from None
    sizes = np.abs(values[np.isfinite(values) & (values != 0.0)])
    decades = np.log10(sizes)
    leaps = np.abs(np.diff(decades))
    if decades.max(initial=0.0) > _LARGEST or leaps.max(initial=0.0) > _LEAP:
        raise MeasurementError(
            f"column {column} holds numbers from {sizes.min():.1g} to {sizes.max():.1g} in size: "
            "it is damaged; write it anew"
        )
    return values
