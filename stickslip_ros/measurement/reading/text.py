# SPDX-License-Identifier: Apache-2.0
"""Delimited text: opened in any encoding, laid out, and its columns read in blocks.

NumPy reads a block of lines at once. A block that it cannot read, or that does not have as many
separators as its rows have, is read line by line: rows with words are left out and counted.
"""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import re
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from stickslip_ros.measurement.reading import cells, rohde_schwarz
from stickslip_ros.measurement.reading.layout import (
    Layout,
    is_comment,
    lines_text,
)
from stickslip_ros.measurement.reading.preamble import Preamble
from stickslip_ros.measurement.reading.table import Column, Loaded, MeasurementError, Table
from stickslip_ros.measurement.reading.units import Unit
from stickslip_ros.opening import Allowance, open_regular

#: Characters that the form of a table is found from, and that are read at once.
_SAMPLE, _BLOCK = 2_000_000, 8_000_000
#: Lines that are read one by one where a block cannot be read at once.
_SINGLY = 500
#: Bytes in memory for a byte of unpacked text.
_GROWS = 5
#: Lines longer than this are of no table.
_LONGEST = 100_000
#: Share of rows that may be words before the table is taken for something else.
_MOST_WORDS = 0.1
#: Numbers from here on lose digits in which times differ.
_LONG = 1e8
_WITH_UNIT = re.compile(r"[-+]?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?\s*(?P<unit>[^\W\d]\S*)")
#: A block has a number in a form that NumPy does not read.
_ODD = ('"', "#", "%", "(", "[", "d", "D", "∞")
_PACKED: dict[bytes, Callable[..., Any]] = {
    b"\x1f\x8b": gzip.open,
    b"BZh": bz2.open,
    b"\xfd7zXZ": lzma.open,
}
#: Faults of packed files.
UNPACKING = (EOFError, zlib.error, lzma.LZMAError)


def encoding_of(start: bytes) -> str | None:
    """Return the encoding that a text begins in, None if it is no text."""
    for mark, name in ((b"\xff\xfe\0\0", "utf-32"), (b"\0\0\xfe\xff", "utf-32"),
                       (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"),
                       (b"\xef\xbb\xbf", "utf-8-sig")):  # fmt: skip
        if start.startswith(mark):
            return name
    if b"\0" in start:
        even, odd = start[0:4000:2], start[1:4000:2]
        if odd.count(0) > 0.7 * len(odd) and even.count(0) < 0.1 * len(even):
            return "utf-16-le"
        if even.count(0) > 0.7 * len(even) and odd.count(0) < 0.1 * len(odd):
            return "utf-16-be"
        return None
    controls = sum(start.count(byte) for byte in (*range(1, 9), *range(14, 27), *range(28, 32)))
    if controls > 0.02 * len(start):
        return None
    try:
        start.decode("utf-8")
    except UnicodeDecodeError as error:
        # cut within a character, or an instrument that writes µ in one byte
        return "utf-8" if error.start >= len(start) - 3 else "cp1252"
    return "utf-8"


class _Unpacked(io.RawIOBase):
    """Bytes of a packed file, as many as it is allowed to unpack to."""

    def __init__(self, inner: Any, allowance: Allowance) -> None:
        self._inner, self._allowance = inner, allowance

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        found = self._inner.read(len(buffer))
        # A row of single digits takes 8 bytes a number where it took 2.
        self._allowance.spend(_GROWS * len(found))
        buffer[: len(found)] = found
        return len(found)


@contextmanager
def _opened(path: Path) -> Iterator[tuple[Any, Any]]:
    """Give the file itself and what unpacks it. Raises ReadError where it unpacks to too much."""
    with open_regular(path) as file:
        start = file.read(6)
        file.seek(0)
        unpack = next((one for mark, one in _PACKED.items() if start.startswith(mark)), None)
        if unpack is None:
            yield file, file
        else:
            with unpack(file) as inner:
                yield file, io.BufferedReader(_Unpacked(inner, Allowance(path)))


def text_start(path: Path) -> tuple[str, str, bool] | None:
    """Return the first part of a text, its encoding, and whether that is all; None if no text."""
    with _opened(path) as (_, inner):
        start = inner.read(65536)
        encoding = encoding_of(start)
        if encoding is None:
            return None
    with _opened(path) as (_, inner):
        text = io.TextIOWrapper(inner, encoding, errors="replace", newline=None)
        sample = text.read(_SAMPLE)
        return sample, encoding, not text.read(1)


def read_text(path: Path, decimal: str | None = None, progress: bool = False) -> Table | None:
    """Return a text table, None if the file is no text. Raises MeasurementError and OSError."""
    path = rohde_schwarz.numbers_of(path)
    begun = text_start(path)
    if begun is None:
        return None
    sample, encoding, whole = begun
    lines = sample.split("\n")
    if not whole:
        lines = lines[:-1]
    if max(map(len, lines), default=0) > _LONGEST:
        raise MeasurementError(
            f"a line has more than {_LONGEST} characters; write each sample on a line of its own"
        )
    try:
        layout = Layout.of(lines, decimal or _stated_decimal(lines))
    except MeasurementError as error:
        shown = preview_of(lines, 0)
        raise MeasurementError(f"{error}{shown and f'; it begins:{chr(10)}{shown}'}") from None
    preamble = Preamble.of(lines, layout)
    rohde_schwarz.describe(path, layout, preamble)
    columns = preamble.columns(layout)
    _check_names(lines, layout, decimal)

    def load(wanted: Sequence[Column]) -> Loaded:
        return _Reader(path, encoding, layout, wanted, progress).read(lines)

    return Table(columns, load, preview_of(lines, layout.first))


def preview_of(lines: Sequence[str], first: int, count: int = 3) -> str:
    """Return the lines about the first numbers, with their numbers, as people read them."""
    start = max(0, first - 4)
    shown = [(k + 1, lines[k]) for k in range(start, min(first + count, len(lines)))]
    texts = ["".join(c if c.isprintable() else " " for c in text)[:100] for _, text in shown]
    return "\n".join(
        f"  {number:>4} | {text}" for (number, _), text in zip(shown, texts, strict=True)
    ).rstrip()


def _stated_decimal(lines: Sequence[str]) -> str | None:
    """Return the decimal sign that a LabVIEW header states."""
    for line in lines[:30]:
        key, _, sign = line.strip().partition("\t")
        if key == "Decimal_Separator" and sign.strip() in (".", ","):
            return sign.strip()
    return None


def _check_names(lines: Sequence[str], layout: Layout, decimal: str | None) -> None:
    """Refuse a table whose numbers may be read in two ways, or have units beside them."""
    line = lines[layout.first] if layout.first < len(lines) else ""
    beside = (_WITH_UNIT.fullmatch(cell.strip(' "')) for cell in re.split(r"[;\t]|,\s*", line))
    if with_unit := next((one for one in beside if one and Unit.of(one["unit"])), None):
        raise MeasurementError(
            f"line {layout.first + 1} has a unit behind a number ({with_unit[0]!r}); leave numbers "
            "only, and put the unit into the name of the column, as in 'x (nm)'"
        )
    width = len("".join(layout.kinds).rstrip("e"))
    header = lines[layout.first - 1].strip() if layout.first else ""
    names = [cell for cell in layout.split(header.lstrip("#% ")) if cell]
    halved = layout.delimiter == "," and not layout.quoted and 2 * len(names) == width
    rows_of_two = lines[layout.first : layout.first + 50]
    if halved and names and not any("." in line or "e" in line.lower() for line in rows_of_two):
        raise MeasurementError(
            f"line {layout.first + 1} has {width} values below {len(names)} names; with decimal "
            "commas, separate the values with ; or a tab"
        )
    if layout.decimal != "," or decimal or layout.delimiter == ",":
        return
    rows = [
        layout.split(lines_text(line, layout.delimiter))
        for line in lines[layout.first : layout.first + 2000]
        if line.strip()
    ]
    for k in range(width):
        column = [row[k] for row in rows if k < len(row) and row[k]]
        with_comma = [cell.lstrip("+-") for cell in column if "," in cell]
        without = [cell.lstrip("+-") for cell in column if "," not in cell]
        thousands = [cell for cell in with_comma if cells.is_number(cell, ".", True)]
        if (
            with_comma
            and without
            and len(thousands) == len(with_comma)
            and not any(cell.startswith("0") for cell in with_comma)
            and all(len(cell) <= 3 for cell in without)
        ):
            raise MeasurementError(
                f"column {k + 1}: is {with_comma[0]!r} a number with a decimal comma or one above "
                "a thousand? Say so with --decimal , or --decimal .\n"
                f"{preview_of(lines, layout.first)}"
            )


@dataclass
class _Reader:
    """Reads the wanted columns of a text, block by block."""

    path: Path
    encoding: str
    layout: Layout
    wanted: Sequence[Column]
    progress: bool
    _parts: list[list[NDArray[np.float64]]] = field(default_factory=list)
    _places: list[tuple[int, NDArray[np.int64] | int]] = field(default_factory=list)
    _words: int = 0
    _first_word: str = ""
    _rows: int = 0
    _breaks: list[int] = field(default_factory=list)
    _tail: list[int] = field(default_factory=list)

    def read(self, lines: Sequence[str]) -> Loaded:
        """Return the columns; lines are the first ones. Raises MeasurementError."""
        self._origins = [self._origin(lines, column) for column in self.wanted]
        self._stamps = [cells.Stamps() for _ in self.wanted]
        self._delimiters = self._usual_delimiters(lines)
        number = 0
        for block, last in self._blocks():
            skip = max(0, self.layout.first - number)
            self._take(block[skip:], number + skip, last)
            number += len(block)
        if self._words > _MOST_WORDS * max(self._rows, 10):
            raise MeasurementError(
                f"{self._words} of {self._words + self._rows} lines are no rows of numbers, first "
                f"{self._first_word}; remove them, or export a table of numbers"
            )
        values = []
        for k in range(len(self.wanted)):
            values.append(np.concatenate([part[k] for part in self._parts] or [np.empty(0)]))
            for part in self._parts:
                part[k] = np.empty(0)  # its memory is needed
        notes = []
        if self._words:
            rows = "1 line is" if self._words == 1 else f"{self._words} lines are"
            notes.append(f"{rows} left out, not being numbers: {self._first_word}")
        return Loaded(values, self._line, tuple(notes), tuple(self._breaks))

    def _blocks(self) -> Iterator[tuple[list[str], bool]]:
        """Yield lists of lines, and whether they are the last."""
        size = self.path.stat().st_size
        with (
            _opened(self.path) as (file, inner),
            tqdm(
                total=size,
                desc=f"reading {self.path.name}",
                unit="B",
                unit_scale=True,
                delay=0.5,
                disable=None if self.progress else True,
            ) as bar,
        ):
            text = io.TextIOWrapper(inner, self.encoding, errors="replace", newline=None)
            rest = ""
            while block := text.read(_BLOCK):
                lines = (rest + block).split("\n")
                rest = lines.pop()
                if len(rest) > _LONGEST:
                    raise MeasurementError(f"a line has more than {_LONGEST} characters")
                yield lines, False
                bar.update(max(0, file.tell() - bar.n))
            yield ([rest] if rest else []), True

    def _take(self, lines: list[str], number: int, last: bool) -> None:
        """Read lines, the first of them with an index in the file."""
        values = None if last else self._at_once(lines)
        if values is not None:
            self._parts.append(values)
            self._places.append((self._rows, number))
            self._rows += len(lines)
        elif len(lines) > _SINGLY:  # most of them are as they should be
            middle = len(lines) // 2
            self._take(lines[:middle], number, False)
            self._take(lines[middle:], number + middle, False)
        else:
            rows, places = self._one_by_one(lines, number, last)
            if rows:
                array = np.array(rows, dtype=np.float64)
                self._parts.append([np.ascontiguousarray(column) for column in array.T])
                self._places.append((self._rows, np.array(places, dtype=np.int64)))
                self._rows += len(rows)
        self._tail = [len(line) for line in lines[-200:] if line] or self._tail

    def _at_once(self, lines: list[str]) -> list[NDArray[np.float64]] | None:
        """Return the columns of lines that are rows like all others, None if they are not."""
        layout = self.layout
        if not lines or any(column.stamped for column in self.wanted) or layout.grouped:
            return None
        if layout.delimiter is not None:
            found = sum(map(str.count, lines, [layout.delimiter] * len(lines)))
            if self._delimiters is None or found != len(lines) * self._delimiters:
                return None
        block = "\n".join(lines)
        if any(odd in block for odd in _ODD):
            return None
        if layout.decimal == ",":
            if "." in block:
                return None
            lines = block.replace(",", ".").split("\n")
        numbers = [column.number - 1 for column in self.wanted]
        long = any(origin is not None for origin in self._origins)
        every = layout.delimiter is None  # so that rows of another width are seen
        rows: Any = None
        for text in (lines, self._filled(lines)):
            if text is None:
                continue
            try:
                rows = np.loadtxt(
                    text,
                    dtype=np.longdouble if long else np.float64,
                    delimiter=layout.delimiter,
                    usecols=None if every else numbers,
                    comments=None,
                    ndmin=2,
                )
                break
            except ValueError:
                continue
        if (
            rows is None
            or len(rows) != len(lines)
            or (every and rows.shape[1] != len(layout.kinds))
        ):
            return None
        picked = [rows[:, n] for n in numbers] if every else list(rows.T)
        for k, origin in enumerate(self._origins):
            if origin is not None:
                picked[k] = picked[k] - np.longdouble(origin)
        return [np.ascontiguousarray(column, dtype=np.float64) for column in picked]

    def _filled(self, lines: list[str]) -> list[str] | None:
        """Return lines whose empty cells are gaps in NumPy's words."""
        mark = self.layout.delimiter
        if mark is None:
            return None
        edge = re.escape(mark)
        gap = re.compile(rf"(^|{edge})(?=[ ]*(?:{edge}|$))", re.MULTILINE)
        return gap.sub(r"\1nan", "\n".join(lines)).split("\n")

    def _one_by_one(
        self, lines: list[str], number: int, last: bool
    ) -> tuple[list[list[float]], list[int]]:
        """Return rows and the indices of their lines; lines of words are counted."""
        layout = self.layout
        rows: list[list[float]] = []
        places: list[int] = []
        for index, line in enumerate(lines, start=number):
            if not line.strip() or is_comment(line.strip()):
                continue
            text = lines_text(line, layout.delimiter)
            row = self._row(layout.split(text.split(" #")[0] if " #" in text else text))
            if row is None or (last and len(line) < min(self._tail, default=0)):
                self._words += 1
                self._breaks.append(self._rows + len(rows))
                self._first_word = self._first_word or (
                    f"line {index + 1} ({' '.join(line.split())[:40]!r})"
                )
                continue
            rows.append(row)
            places.append(index)
        return rows, places

    def _row(self, row: list[str]) -> list[float] | None:
        """Return the wanted numbers of a row, None if it is none."""
        layout = self.layout
        width = len(layout.kinds)
        if len(row) != width:
            if layout.delimiter is None or any(row[width:]):
                return None
            row = row[:width] + [""] * (width - len(row))
        values = []
        for column, origin, stamps in zip(self.wanted, self._origins, self._stamps, strict=True):
            cell = row[column.number - 1]
            try:
                if column.stamped:
                    values.append(stamps.seconds(cell))
                elif origin is not None and cells.is_number(cell, layout.decimal, False):
                    exact = np.longdouble(cells.plain(cell, layout.decimal, False))
                    values.append(float(exact - np.longdouble(origin)))
                else:
                    values.append(cells.value_of(cell, layout.decimal, layout.grouped))
            except (ValueError, OverflowError):
                return None
        return values

    def _usual_delimiters(self, lines: Sequence[str]) -> int | None:
        """Return how many separators nearly every row has."""
        rows = [line for line in lines[self.layout.first : self.layout.first + 500] if line.strip()]
        if self.layout.delimiter is None or not rows:
            return None
        counts = [row.count(self.layout.delimiter) for row in rows]
        return max(set(counts), key=counts.count)

    def _origin(self, lines: Sequence[str], column: Column) -> str | None:
        """Return what to subtract from numbers with more digits than a float64 keeps."""
        if not column.shifted or column.stamped or self.layout.grouped:
            return None
        for line in lines[self.layout.first : self.layout.first + 50]:
            row = self.layout.split(lines_text(line, self.layout.delimiter))
            cell = row[column.number - 1] if len(row) >= column.number else ""
            if cells.is_number(cell, self.layout.decimal, False):
                text = cells.plain(cell, self.layout.decimal, False)
                digits = sum(character.isdigit() for character in text.lower().split("e")[0])
                long = digits > 15 and abs(float(text.lower().replace("d", "e"))) > _LONG
                return text.split(".")[0] if long and "e" not in text.lower() else None
        return None

    def _line(self, row: int) -> str:
        """Return the place of a row in the file."""
        for first, place in reversed(self._places):
            if row >= first:
                offset = row - first
                index = place + offset if isinstance(place, int) else int(place[offset])
                return f"line {index + 1}"
        return f"row {row + 1}"
