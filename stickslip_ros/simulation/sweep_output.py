# SPDX-License-Identifier: Apache-2.0
"""Results of a sweep: its summary, and the CSV from which it can be continued.

The table is written in order, and read back to continue where it stopped. Its comment lines hold
the definition of the sweep, so that a file is never continued with other settings. Empty fields are
points without a value.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO

import numpy as np

from stickslip_ros.arrays import Array
from stickslip_ros.files import writing
from stickslip_ros.opening import open_regular
from stickslip_ros.reporting import format_si
from stickslip_ros.simulation.sweep_plan import Sweep, SweepError
from stickslip_ros.version import __version__

#: Start of the first line of every table, in all versions.
_TITLE = "# stickslip sweep, version "
#: Rows read back at once.
_ROWS = 10_000


class SweepSummary:
    """Collects the parts of a sweep as they come; without ``keep`` its memory does not grow."""

    def __init__(self, sweep: Sweep, keep: bool) -> None:
        """Start empty; with keep, all values are stored for tables and pictures."""
        self._sweep = sweep
        self.done = 0
        self.empty = 0
        self._first_empty = 0
        self._low = np.full(len(sweep.outputs), math.inf)
        self._high = np.full(len(sweep.outputs), -math.inf)
        shape = (sweep.points, len(sweep.outputs))
        self.kept: Array | None = np.full(shape, math.nan) if keep else None

    def add(self, first: int, values: Array) -> None:
        """Take the points from first on."""
        empty = ~np.isfinite(values).all(axis=1)
        if empty.any():
            if not self.empty:
                self._first_empty = first + int(np.argmax(empty))
            self.empty += int(empty.sum())
        self._low = np.fmin(self._low, np.fmin.reduce(values, axis=0))
        self._high = np.fmax(self._high, np.fmax.reduce(values, axis=0))
        if self.kept is not None:
            self.kept[first : first + len(values)] = values
        self.done = first + len(values)

    def complaint(self) -> str:
        """Return how many points have no value, and why the first has none."""
        return (
            f"{self.empty} of {self.done} points have an empty value; the first, "
            f"{self._sweep.why_empty(self._first_empty)}"
        )

    def summary(self) -> str:
        """Return a line for each metric."""
        rows = [f"{'points':<28} {self.done}"]
        for k, (name, unit) in enumerate(self._sweep.outputs):
            if self._low[k] <= self._high[k]:
                low, high = (format_si(end[k], unit, 4) for end in (self._low, self._high))
                rows.append(f"{name:<28} {low} to {high}")
            else:
                rows.append(f"{name:<28} no value")
        return "\n".join(rows)


def definition(sweep: Sweep) -> list[str]:
    """Return the lines that define the sweep."""
    varied = {axis.name for axis in sweep.axes}
    return [
        f"{_TITLE}{__version__}",
        *(f"# vary {axis}" for axis in sweep.axes),
        *(f"# metric {name}" for name in sweep.metrics),
        f"# steps {sweep.steps or 'until they settle'}",
        *(
            f"# set {name}={value}"
            for name, value in sweep.base.flat().items()
            if name not in varied
        ),
    ]


def heading(sweep: Sweep) -> list[str]:
    """Return the names of the columns with their units."""
    columns = [(axis.name, axis.unit) for axis in sweep.axes]
    columns += sweep.outputs
    return [f"{name} ({unit})" if unit else name for name, unit in columns]


def write_header(sweep: Sweep, file: TextIO) -> None:
    """Write the definition and the line of names with units."""
    file.write("\n".join([*definition(sweep), ",".join(heading(sweep)), ""]))


def write_rows(sweep: Sweep, first: int, values: Array, file: TextIO) -> None:
    """Write one line a point, from point first on; values has shape (points, metrics)."""
    coordinates = sweep.coordinates(first, first + len(values))
    columns = [[repr(value) for value in column.tolist()] for column in coordinates]
    for column in values.T:
        text = [repr(value) for value in column.tolist()]
        for k in np.flatnonzero(~np.isfinite(column)):
            text[k] = ""
        columns.append(text)
    file.write("".join(f"{','.join(row)}\n" for row in zip(*columns, strict=True)))


class SweepTable:
    """A CSV file that rows are appended to, in order, each part flushed."""

    def __init__(self, sweep: Sweep, path: Path, resume: bool) -> None:
        """Create the file, or with resume continue an existing one.

        With resume, raises SweepError if the file belongs to another sweep; without, if it holds a
        part of this sweep or no table of a sweep. WriteError if it cannot be written.
        """
        self._sweep = sweep
        self.path = path
        with writing(path):
            there, end = self._kept_rows(resume)
            self.done = there  #: points in the file
            self._file = path.open("r+" if end else "w", newline="", encoding="utf-8")
            if end:
                self._file.seek(end)
                self._file.truncate()
            else:
                write_header(sweep, self._file)
                self._file.flush()

    def _kept_rows(self, resume: bool) -> tuple[int, int]:
        """Return points and bytes of the file that can stay."""
        try:
            with open_regular(self.path) as file:
                found = [file.readline() for _ in range(len(definition(self._sweep)) + 1)]
                points = end = 0
                ours = self._complaint(found)
                if ours is None:
                    end = file.tell()
                    for line in file:
                        if line.endswith(b"\n"):  # the last one may have been cut
                            points, end = points + 1, end + len(line)
        except FileNotFoundError:
            return 0, 0
        if resume and ours:
            raise SweepError(f"{self.path} cannot be continued: {ours}")
        if not resume and found[0] and not found[0].startswith(_TITLE.encode()):
            raise SweepError(
                f"{self.path} exists and is not the table of a sweep: "
                "name another --out FILE.csv, or delete it"
            )
        if points > self._sweep.points:
            raise SweepError(f"{self.path} holds more points than the sweep has; delete it")
        if not resume and 0 < points < self._sweep.points:
            raise SweepError(
                f"{self.path} holds {points} of the {self._sweep.points} points of this sweep: "
                "continue with --resume, or delete it"
            )
        return (points, end) if resume else (0, 0)

    def _complaint(self, lines: list[bytes]) -> str | None:
        """Return how the head of a file differs from the head of our sweep, None if it does not."""
        for wanted, line in zip(definition(self._sweep), lines, strict=False):
            found = line.decode("utf-8", errors="replace").rstrip("\n")
            if found != wanted:
                return f"it says {found[:100]!r} where this sweep has {wanted!r}"
        return None if lines[-1].endswith(b"\n") else "its head is cut"

    def append(self, first: int, values: Array) -> None:
        """Append the points from first on; values has shape (points, metrics)."""
        with writing(self.path):
            write_rows(self._sweep, first, values, self._file)
            self._file.flush()
        self.done = first + len(values)

    def rows(self) -> Iterator[tuple[int, Array]]:
        """Yield (first point, metrics) of the points that were in the file when it was opened."""
        skipped = len(self._sweep.axes)
        with self.path.open(encoding="utf-8") as file:
            for _ in range(len(definition(self._sweep)) + 1):
                file.readline()
            for first in range(0, self.done, _ROWS):
                lines = [file.readline() for _ in range(min(_ROWS, self.done - first))]
                yield first, np.array([_fields(line, skipped) for line in lines])

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def points_in_file(self) -> int:
        """Return how many points the file holds now, also in the middle of an `append`."""
        if not self._file.closed:
            self._file.flush()
        return self._kept_rows(resume=True)[0]


def _fields(line: str, skipped: int) -> list[float]:
    return [float(field or "nan") for field in line.rstrip("\n").split(",")[skipped:]]
