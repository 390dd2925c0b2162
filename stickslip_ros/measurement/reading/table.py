# SPDX-License-Identifier: Apache-2.0
"""What every format comes to: named columns with units, the values read when they are asked for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.errors import StickslipError
from stickslip_ros.measurement.reading.units import Unit, is_index

#: What one column of an array in memory is: name, unit, values (samples,), clock.
Named = tuple[str, str | None, NDArray[np.float64], "Clock | None"]
#: Characters of a name in a message.
LONGEST_NAME = 60
#: Decimal logarithms of the largest number that is one, and of the farthest way to the next.
_LARGEST, _LEAP = 40.0, 60.0
#: Names of columns that number the samples.
_INDICES = ("sample", "samples", "index", "no", "no.", "nr", "nr.", "n", "#", "row", "sequence",
            "sample number", "point", "field.header.seq")  # fmt: skip


class MeasurementError(StickslipError, ValueError):
    """A measurement that cannot be read; the message names the place and the cure."""


@dataclass(frozen=True)
class Clock:
    """Even times that a file states instead of listing them."""

    start: float  #: s
    step: float  #: s
    count: int | None = None  #: of samples, where the file states it


@dataclass(frozen=True)
class Column:
    """One column of a table."""

    number: int  #: from 1
    name: str  #: without its unit; empty if it has none
    unit: str | None = None  #: as the file has it
    clock: Clock | None = None  #: of its samples, where the file states it
    length: int | None = None  #: samples, where that is known before reading
    stamped: bool = False  #: holds dates or times of the day, read as seconds
    alone: bool = False  #: its clock is not that of a column of times beside it
    shifted: bool = False  #: times may count from the first one, to keep their last digits

    def __str__(self) -> str:
        name = f" {_short(self.name)}" if self.name else ""
        unit = f" ({_short(self.unit)})" if self.unit else ""
        return f"{self.number}{name}{unit}"

    @property
    def dimension(self) -> str | None:
        """What it measures, None where its unit does not say that."""
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
    def of(cls, arrays: Sequence[Named], notes: tuple[str, ...] = ()) -> Table:
        """Return a table of arrays in memory. Raises MeasurementError if there are none."""
        if not arrays:
            raise MeasurementError("it holds no columns of numbers over time")
        columns = [
            Column(number, name, unit, clock, len(values))
            for number, (name, unit, values, clock) in enumerate(arrays, 1)
        ]

        def load(wanted: Sequence[Column]) -> Loaded:
            chosen = [np.asarray(arrays[column.number - 1][2], np.float64) for column in wanted]
            for column, values in zip(wanted, chosen, strict=True):
                _check(column, values)
            return Loaded(chosen)

        return cls(columns, load, notes=notes)

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
    return text if len(text) <= LONGEST_NAME else f"{text[:LONGEST_NAME]}..."


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
