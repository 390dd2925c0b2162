# SPDX-License-Identifier: Apache-2.0
"""The rows of a text table, block by block.

NumPy reads a block of lines at once. A block that it cannot read, or that does not have as many
separators as its rows have, is read line by line: rows with words are left out and counted.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.measurement.reading.layout import (
    Layout,
    Stamps,
    is_comment,
    is_number,
    lines_text,
    value_of,
    with_point,
)
from stickslip_ros.measurement.reading.table import Column, Loaded, MeasurementError

#: Lines that are read one by one where a block cannot be read at once.
_SINGLY = 500
#: Share of rows that may be words before the table is taken for something else.
_MOST_WORDS = 0.1
#: Numbers from here on lose digits in which times differ, if they have more than a float64 keeps.
_LONG, _DIGITS = 1e8, 15
#: A block has a number in a form that NumPy does not read.
_ODD = ('"', "#", "%", "(", "[", "d", "D", "∞")


class Rows:
    """Reads the wanted columns of lines as they come."""

    def __init__(self, layout: Layout, wanted: Sequence[Column], lines: Sequence[str]) -> None:
        """lines are the first ones of the file, which show the form of its rows."""
        self._layout, self._wanted = layout, wanted
        begin = [line for line in lines[layout.first : layout.first + 500] if line.strip()]
        self._origins = [self._origin(begin[:50], column) for column in wanted]
        self._stamps = [Stamps() for _ in wanted]
        marks = [line.count(layout.delimiter) for line in begin] if layout.delimiter else []
        #: Separators that nearly every row has.
        self._marks = max(set(marks), key=marks.count) if marks else 0
        self._parts: list[list[NDArray[np.float64]]] = []
        #: Rows from which on lines follow one another: number of the row and of its line.
        self._stretches: list[tuple[int, int]] = []
        self._count = self._lines_seen = self._words = 0
        self._first_word = ""
        self._breaks: list[int] = []
        self._lengths: list[int] = []  # of the last lines

    def add(self, lines: list[str], last: bool) -> None:
        """Read further lines; the last one of all may be cut off."""
        skip = max(0, self._layout.first - self._lines_seen)
        self._take(lines[skip:], self._lines_seen + skip, last)
        self._lines_seen += len(lines)

    def loaded(self) -> Loaded:
        """Return the table. Raises MeasurementError if too many lines are words."""
        if self._words > _MOST_WORDS * max(self._count, 10):
            raise MeasurementError(
                f"{self._words} of {self._words + self._count} lines are no rows of numbers, first "
                f"{self._first_word}; remove them, or export a table of numbers"
            )
        values = []
        for k in range(len(self._wanted)):
            values.append(np.concatenate([part[k] for part in self._parts] or [np.empty(0)]))
            for part in self._parts:
                part[k] = np.empty(0)  # its memory is needed
        notes = []
        if self._words:
            rows = "1 line is" if self._words == 1 else f"{self._words} lines are"
            notes.append(f"{rows} left out, not being numbers: {self._first_word}")
        return Loaded(values, self._place, tuple(notes), tuple(self._breaks))

    def _place(self, row: int) -> str:
        """Return the place of a row in the file, for people."""
        found = bisect_right(self._stretches, row, key=lambda stretch: stretch[0])
        first, line = self._stretches[max(0, found - 1)]
        return f"line {line + row - first + 1}"

    def _follow(self, row: int, line: int) -> None:
        """Note the line of a row, unless it follows from that of a row before."""
        first_row, first_line = self._stretches[-1] if self._stretches else (0, -1)
        if line - row != first_line - first_row:
            self._stretches.append((row, line))

    def _take(self, lines: list[str], number: int, last: bool) -> None:
        """Read lines, the first of them with an index in the file."""
        values = None if last else self._at_once(lines)
        if values is not None:
            self._follow(self._count, number)
            self._keep(values)
        elif len(lines) > _SINGLY:  # most of them are as they should be
            middle = len(lines) // 2
            self._take(lines[:middle], number, False)
            self._take(lines[middle:], number + middle, last)
        elif rows := self._one_by_one(lines, number, last):
            self._keep(list(np.array(rows, dtype=np.float64).T))
        self._lengths = [len(line) for line in lines[-200:] if line] or self._lengths

    def _keep(self, values: list[NDArray[np.float64]]) -> None:
        self._parts.append([np.ascontiguousarray(column, np.float64) for column in values])
        self._count += len(values[0])

    def _at_once(self, lines: list[str]) -> list[NDArray[Any]] | None:
        """Return the columns of lines that are rows like all others, None if they are not."""
        layout, mark, block = self._layout, self._layout.delimiter, "\n".join(lines)
        if not lines or layout.grouped or any(column.stamped for column in self._wanted):
            return None
        if any(odd in block for odd in _ODD) or (
            mark is not None and block.count(mark) != len(lines) * self._marks
        ):
            return None
        if layout.decimal == ",":
            if "." in block:
                return None
            block = block.replace(",", ".")
        rows = self._numbers(block)
        if rows is None and mark is not None:  # empty cells are gaps
            edge = re.escape(mark)
            gap = re.compile(rf"(^|{edge})(?=[ ]*(?:{edge}|$))", re.MULTILINE)
            rows = self._numbers(gap.sub(r"\1nan", block))
        if rows is None or len(rows) != len(lines):
            return None
        if mark is None:  # all were read, so that rows of another width are seen
            if rows.shape[1] != len(layout.kinds):
                return None
            rows = rows[:, [column.number - 1 for column in self._wanted]]
        return [
            column if origin is None else column - np.longdouble(origin)
            for column, origin in zip(rows.T, self._origins, strict=True)
        ]

    def _numbers(self, block: str) -> NDArray[Any] | None:
        """Return the wanted columns, all where blanks separate them; None if there are words."""
        long, mark = any(self._origins), self._layout.delimiter
        wanted = None if mark is None else [column.number - 1 for column in self._wanted]
        try:
            return np.loadtxt(
                block.split("\n"),
                dtype=np.longdouble if long else np.float64,
                delimiter=mark,
                usecols=wanted,
                comments=None,
                ndmin=2,
            )
        except ValueError:
            return None

    def _one_by_one(self, lines: list[str], number: int, last: bool) -> list[list[float]]:
        """Return rows; lines of words are counted."""
        rows: list[list[float]] = []
        for index, line in enumerate(lines, start=number):
            if not line.strip() or is_comment(line.strip()):
                continue
            text = lines_text(line, self._layout.delimiter)
            row = self._row(self._layout.split(text.split(" #")[0] if " #" in text else text))
            here = self._count + len(rows)
            if row is None or (last and len(line) < min(self._lengths, default=0)):
                self._words += 1
                self._breaks.append(here)
                self._first_word = self._first_word or (
                    f"line {index + 1} ({' '.join(line.split())[:40]!r})"
                )
                continue
            self._follow(here, index)
            rows.append(row)
        return rows

    def _row(self, row: list[str]) -> list[float] | None:
        """Return the wanted numbers of a row, None if it is none."""
        layout = self._layout
        width = len(layout.kinds)
        if len(row) != width:
            if layout.delimiter is None or any(row[width:]):
                return None
            row = row[:width] + [""] * (width - len(row))
        values = []
        for column, origin, stamps in zip(self._wanted, self._origins, self._stamps, strict=True):
            cell = row[column.number - 1]
            try:
                if column.stamped:
                    values.append(stamps.seconds(cell))
                elif origin is not None and is_number(cell, layout.decimal):
                    exact = np.longdouble(with_point(cell, layout.decimal))
                    values.append(float(exact - np.longdouble(origin)))
                else:
                    values.append(value_of(cell, layout.decimal, layout.grouped))
            except (ValueError, OverflowError):
                return None
        return values

    def _origin(self, lines: Sequence[str], column: Column) -> str | None:
        """Return an offset to subtract from numbers with more digits than a float64 has."""
        layout = self._layout
        if not column.shifted or column.stamped or layout.grouped:
            return None
        for line in lines:
            row = layout.split(lines_text(line, layout.delimiter))
            cell = row[column.number - 1] if len(row) >= column.number else ""
            if is_number(cell, layout.decimal):
                text = with_point(cell, layout.decimal).lower()
                digits = sum(character.isdigit() for character in text)
                long = digits > _DIGITS and not set("ed") & set(text) and abs(float(text)) > _LONG
                return text.split(".")[0] if long else None
        return None
