# SPDX-License-Identifier: Apache-2.0
"""Delimited text as a table, packed or not, in whatever encoding it is.

It is laid out, named, and refused where it may be read in two ways. NumPy reads a block of lines at
once. A block that it cannot read, or that does not have as many separators as its rows have, is
read line by line: rows with words are left out and counted.

Rohde & Schwarz write pairs: ``X.csv`` describes the numbers in ``X.Wfm.csv``, which have no header.
With one column more than channels were exported, the first is the time; otherwise the description
gives the time of the first sample and the step.
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
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from stickslip_ros.base.opening import Allowance, ReadError, open_regular
from stickslip_ros.measurement.reading.layout import (
    COMMENTS,
    GAPS,
    Layout,
    Stamps,
    lines_text,
    number_text,
    value_of,
)
from stickslip_ros.measurement.reading.preamble import columns_above
from stickslip_ros.measurement.reading.table import (
    Clock,
    Column,
    Loaded,
    MeasurementError,
    Table,
    Unit,
)

#: Characters that the form of a table is found from, and that are read at once.
_SAMPLE, _BLOCK = 2_000_000, 4_000_000
#: What a byte and a line of unpacked text take of the allowance: bytes in memory, and the time of a
#: row as bytes. A row of a measurement takes more than a byte when it is packed, as it has noise.
_GROWS, _ROW = 5, 300
#: Lines longer than this are of no table.
_LONGEST = 100_000
_PACKED: dict[bytes, Callable[..., Any]] = {
    b"\x1f\x8b": gzip.open,
    b"BZh": bz2.open,
    b"\xfd7zXZ": lzma.open,
}
_ENCODINGS = {
    b"\xff\xfe\0\0": "utf-32", b"\0\0\xfe\xff": "utf-32", b"\xff\xfe": "utf-16",
    b"\xfe\xff": "utf-16", b"\xef\xbb\xbf": "utf-8-sig",
}  # fmt: skip
#: Bytes that texts hardly have.
_CONTROLS = bytes([*range(1, 9), *range(14, 27), *range(28, 32)])
#: Faults of packed files.
UNPACKING = (EOFError, zlib.error, lzma.LZMAError)
#: A line of numbers and separators alone.
_PLAIN = re.compile(r"[-+0-9.eE,;|\s\"]*[0-9][-+0-9.eE,;|\s\"]*")
#: Share of rows that may be words before the table is taken for something else; so many lines of
#: words are read before that is judged, each alone.
_MOST_WORDS, _FEW_WORDS = 0.1, 20_000
#: A block has a number in a form that NumPy does not read.
_ODD = ("#", "%", "d", "D", "∞")
_BRACKETS = re.compile(r"^[ ]*[(\[]|[)\]][ ]*$", re.MULTILINE)
#: End of the name of Rohde & Schwarz's numbers; bytes of their description at most.
_NUMBERS, _DESCRIPTION = ".wfm.csv", 1_000_000
_WITH_UNIT = re.compile(r"[-+]?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?\s*(?P<unit>[^\W\d]\S*)")


def encoding_of(start: bytes) -> str | None:
    """Return the encoding that a text begins in, None if it is no text."""
    for mark, name in _ENCODINGS.items():
        if start.startswith(mark):
            return name
    if b"\0" in start:
        halves = start[1:4000:2], start[0:4000:2]
        for half, other, name in zip(halves, halves[::-1], ("utf-16-le", "utf-16-be"), strict=True):
            if half.count(0) > 0.7 * len(half) and other.count(0) < 0.1 * len(other):
                return name
        return None
    if len(start) - len(start.translate(None, _CONTROLS)) > 0.02 * len(start):
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
        self._allowance.spend(_GROWS * len(found) + _ROW * found.count(b"\n"))
        buffer[: len(found)] = found
        return len(found)


@contextmanager
def _open(path: Path) -> Iterator[tuple[Any, Any]]:
    """Open the file and its unpacked form. Raises ReadError if it unpacks to too much."""
    with open_regular(path) as file:
        start = file.read(6)
        file.seek(0)
        unpack = next((one for mark, one in _PACKED.items() if start.startswith(mark)), None)
        if unpack is None:
            yield file, file
        else:
            with unpack(file) as inner:
                yield file, io.BufferedReader(_Unpacked(inner, Allowance(path)))


def text_start(path: Path) -> tuple[list[str], str] | None:
    """Return the first whole lines of a text and its encoding, None if it is no text."""
    with _open(path) as (_, inner):
        encoding = encoding_of(inner.read(65536))
    if encoding is None:
        return None
    with _open(path) as (_, inner):
        text = io.TextIOWrapper(inner, encoding, errors="replace", newline=None)
        lines = text.read(_SAMPLE).split("\n")
        if text.read(1):
            lines.pop()
    if max(map(len, lines), default=0) > _LONGEST:
        raise MeasurementError(
            f"a line has more than {_LONGEST} characters; write each sample on a line of its own"
        )
    return lines, encoding


def blocks_of(path: Path, encoding: str) -> Iterator[tuple[list[str], bool]]:
    """Yield lists of lines, and whether they are the last; show the progress on a terminal."""
    with (
        _open(path) as (file, inner),
        tqdm(
            total=path.stat().st_size,
            desc=f"reading {path.name}",
            unit="B",
            unit_scale=True,
            delay=0.5,
            disable=None,
        ) as bar,
    ):
        text = io.TextIOWrapper(inner, encoding, errors="replace", newline=None)
        rest = ""
        while block := text.read(_BLOCK):
            lines = (rest + block).split("\n")
            rest = lines.pop()
            if len(rest) > _LONGEST:
                raise MeasurementError(f"a line has more than {_LONGEST} characters")
            yield lines, False
            bar.update(max(0, file.tell() - bar.n))
        yield ([rest] if rest else []), True


def read_text_table(path: Path, decimal: str | None = None) -> Table | None:
    """Return a text table, None if the file is no text. Raises MeasurementError and OSError."""
    begun = text_start(path)
    if begun is None:
        return None
    lines, encoding = begun
    stated = None  # LabVIEW's header says it
    for line in lines[:30]:
        key, _, sign = line.strip().partition("\t")
        if key == "Decimal_Separator" and sign.strip() in (".", ","):
            stated = sign.strip()
    try:
        layout = Layout.of(lines, decimal or stated)
    except MeasurementError as error:
        shown = preview_of(lines, 0)
        raise MeasurementError(f"{error}{shown and f'; it begins:{chr(10)}{shown}'}") from None
    columns = _described(path, columns_above(lines, layout))
    _check_units(lines, layout)
    _check_commas(lines, layout, decimal)

    def load(wanted: Sequence[Column]) -> Loaded:
        rows = Rows(layout, wanted, lines)
        for block, last in blocks_of(path, encoding):
            rows.add(block, last)
        return rows.loaded()

    return Table(columns, load, preview_of(lines, layout.first))


class Rows:
    """Reads the wanted columns of lines as they come."""

    def __init__(self, layout: Layout, wanted: Sequence[Column], lines: Sequence[str]) -> None:
        """lines are the first ones of the file, which show the form of its rows."""
        self._layout, self._wanted = layout, wanted
        self._stamps = [Stamps() for _ in wanted]
        begin = [line for line in lines[layout.first : layout.first + 500] if not _is_empty(line)]
        marks = [line.count(layout.delimiter) for line in begin] if layout.delimiter else []
        #: Separators that nearly every row has.
        self._marks = max(set(marks), key=marks.count) if marks else 0
        self._parts: list[list[NDArray[Any]]] = []
        self._count = self._lines_seen = self._words = 0
        self._first_word = ""
        self._breaks: list[int] = []
        self._no_rows: list[int] = []  # lines from the first row on that are none
        self._lengths: list[int] = []  # of the last lines

    def add(self, lines: list[str], last: bool) -> None:
        """Read further lines; the last one of all may be cut off."""
        skip = max(0, self._layout.first - self._lines_seen)
        indices = range(self._lines_seen + skip, self._lines_seen + len(lines))
        self._lines_seen += len(lines)
        self._take(lines[skip:], indices, last)

    def loaded(self) -> Loaded:
        """Return the table. Raises MeasurementError if too many lines are words."""
        self._check_words()
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

    def _check_words(self) -> None:
        """Raise MeasurementError if too many lines are words."""
        if self._words > _MOST_WORDS * max(self._count, 10):
            raise MeasurementError(
                f"{self._words} of {self._words + self._count} lines are no rows of numbers, first "
                f"{self._first_word}; remove them, or export a table of numbers"
            )

    def _place(self, row: int) -> str:
        """Return the place of a row in the file, for people."""
        line = self._layout.first + row
        for other in sorted(self._no_rows):
            if other > line:
                break
            line += 1
        return f"line {line + 1}"

    def _take(self, lines: list[str], indices: Sequence[int], last: bool) -> None:
        """Read lines, of which each has an index in the file."""
        values = None if last else self._at_once(lines)
        if values is None:
            values = self._mixed(lines, indices, last)
        self._parts.append([np.ascontiguousarray(column, np.float64) for column in values])
        self._count += len(values[0])
        if self._words > _FEW_WORDS:
            self._check_words()
        self._lengths = [len(line) for line in lines[-200:] if line] or self._lengths

    def _mixed(self, lines: list[str], indices: Sequence[int], last: bool) -> list[NDArray[Any]]:
        """Return the columns of lines some of which are no rows like the others.

        Those that look like the others are read at once, the rest one by one.
        """
        alike = [] if last else [k for k, line in enumerate(lines) if self._is_plain(line)]
        at_once = self._at_once([lines[k] for k in alike])
        if at_once is None:
            alike, at_once = [], []
        rows = np.full((len(lines), len(self._wanted)), np.nan)
        is_row = np.zeros(len(lines), bool)
        is_row[alike] = True
        for column, values in enumerate(at_once):
            rows[alike, column] = values
        words = []
        for k in np.flatnonzero(~is_row).tolist():
            if not _is_empty(lines[k]):
                row = self._row(lines[k])
                if row is not None and not (last and len(lines[k]) < min(self._lengths, default=0)):
                    rows[k], is_row[k] = row, True
                    continue
                words.append(k)
            self._no_rows.append(indices[k])
        if words and not self._first_word:
            text = " ".join(lines[words[0]].split())
            self._first_word = f"line {indices[words[0]] + 1} ({text[:40]!r})"
        self._words += len(words)
        self._breaks += (self._count + np.cumsum(is_row)[words]).tolist()
        return list(rows[is_row].T)

    def _is_plain(self, line: str) -> bool:
        mark = self._layout.delimiter
        return _PLAIN.fullmatch(line) is not None and (
            mark is None or line.count(mark) == self._marks
        )

    def _at_once(self, lines: list[str]) -> list[NDArray[Any]] | None:
        """Return the columns of lines that are rows like all others, None if they are not."""
        layout, mark, block = self._layout, self._layout.delimiter, "\n".join(lines)
        if not lines or layout.grouped or any(column.stamped for column in self._wanted):
            return None
        if any(odd in block for odd in _ODD) or (
            mark is not None and block.count(mark) != len(lines) * self._marks
        ):
            return None
        if "(" in block or "[" in block:
            block = _BRACKETS.sub("", block)
        if '"' in block:
            if mark is None or mark == layout.decimal or self._marks != len(layout.kinds) - 1:
                return None
            block = block.replace('"', "")  # no separator is within quotes
        if layout.decimal == ",":
            if "." in block:
                return None
            block = block.replace(",", ".")
        wanted = [column.number - 1 for column in self._wanted]
        if mark is None:  # all are read, so that rows of another width are seen
            rows = _load(block, None, None)
            return None if rows is None or rows.shape != (len(lines), len(layout.kinds)) else list(
                rows.T[wanted])  # fmt: skip
        rows = _load(block, mark, wanted)
        if rows is None:
            edge, words = re.escape(mark), "|".join(map(re.escape, GAPS))
            gap = rf"(^|{edge})[ ]*[-+]?(?:{words})(?=[ ]*(?:{edge}|$))"
            block = re.sub(gap, r"\1nan", block, flags=re.MULTILINE | re.IGNORECASE)
            rows = _load(block, mark, wanted)
        return None if rows is None or len(rows) != len(lines) else list(rows.T)

    def _row(self, line: str) -> list[float] | None:
        """Return the wanted numbers of a line, None if it is no row."""
        text = lines_text(line, self._layout.delimiter)
        row = self._layout.split(text.split(" #")[0] if " #" in text else text)
        layout = self._layout
        width = len(layout.kinds)
        if len(row) != width:
            if layout.delimiter is None or any(row[width:]):
                return None
            row = row[:width] + [""] * (width - len(row))
        try:
            return [
                stamps.seconds(row[column.number - 1])
                if column.stamped
                else value_of(row[column.number - 1], layout.decimal, layout.grouped)
                for column, stamps in zip(self._wanted, self._stamps, strict=True)
            ]
        except (ValueError, OverflowError):
            return None


def _is_empty(line: str) -> bool:
    """Return whether a line has nothing for the table: blanks, or a comment."""
    return (text := line.strip()) == "" or text.startswith(COMMENTS)


def _load(block: str, mark: str | None, wanted: list[int] | None) -> NDArray[Any] | None:
    """Return the wanted columns of lines, None if there are words in them."""
    try:
        return np.loadtxt(block.split("\n"), delimiter=mark, usecols=wanted, comments=None, ndmin=2)
    except ValueError:
        return None


def numbers_of(path: Path) -> Path:
    """Return the file with the numbers: path itself, or the file that it describes."""
    if path.suffix.lower() == ".csv" and not path.name.lower().endswith(_NUMBERS):
        partner = path.with_name(f"{path.name[:-4]}.Wfm.csv")
        if partner.is_file():
            return partner
    return path


def _described(path: Path, columns: list[Column]) -> list[Column]:
    """Return columns with what Rohde & Schwarz's description beside the numbers says of them."""
    if not path.name.lower().endswith(_NUMBERS) or any(column.name for column in columns):
        return columns
    try:
        with open_regular(
            path.with_name(f"{path.name[: -len(_NUMBERS)]}.csv"), _DESCRIPTION
        ) as file:
            text = file.read().decode("utf-8", "replace")
    except (OSError, ReadError):
        return columns
    pairs = (line.partition(":")[::2] for line in text.splitlines())
    facts = {key: value.rstrip(":").split(":") for key, value in pairs}
    if "XStart" not in facts or "SignalResolution" not in facts:
        return columns
    names = [(facts.get("Source", [""])[0], facts.get("BaseUnit", [""])[0])]
    if facts.get("MultiChannelExport", ["Off"])[0] == "On":
        rows = (facts.get(f"MultiChannel{key}", [])[1:]
                for key in ("ExportState", "Source", "ViewUnit"))  # fmt: skip
        names = [(name, unit) for state, name, unit in zip_longest(*rows, fillvalue="")
                 if state == "On" and name]  # fmt: skip
    clock = None
    if len(columns) == len(names) + 1:
        names = [("time", "s"), *names]
    # Of several acquisitions one after the other, nothing says when they were.
    elif facts.get("NumberOfAcquisitions", ["1"])[0] == "1":
        start, step = float(facts["XStart"][0]), float(facts["SignalResolution"][0])
        count = int(facts.get("SignalRecordLength", ["0"])[0]) or None
        clock = Clock(start, step, count) if step > 0.0 else None
    if len(columns) != len(names):
        return columns
    return [
        replace(column, name=name, unit=unit or None, clock=clock)
        for column, (name, unit) in zip(columns, names, strict=True)
    ]


def preview_of(lines: Sequence[str], first: int, count: int = 3) -> str:
    """Return the lines about the first numbers, with their numbers, as people read them."""
    start = max(0, first - 4)
    shown = [(k + 1, lines[k]) for k in range(start, min(first + count, len(lines)))]
    texts = ["".join(c if c.isprintable() else " " for c in text)[:100] for _, text in shown]
    return "\n".join(
        f"  {number:>4} | {text}" for (number, _), text in zip(shown, texts, strict=True)
    ).rstrip()


def _check_units(lines: Sequence[str], layout: Layout) -> None:
    """Refuse a table that has units beside its numbers."""
    beside = (_WITH_UNIT.fullmatch(cell.strip(' "'))
              for cell in re.split(r"[;\t]|,\s*", lines[layout.first]))  # fmt: skip
    if with_unit := next((one for one in beside if one and Unit.of(one["unit"])), None):
        raise MeasurementError(
            f"line {layout.first + 1} has a unit behind a number ({with_unit[0]!r}); leave numbers "
            "only, and put the unit into the name of the column, as in 'x (nm)'"
        )


def _check_commas(lines: Sequence[str], layout: Layout, decimal: str | None) -> None:
    """Refuse a table whose commas may be read in two ways; decimal is the sign that was given."""
    first, width = layout.first, len(layout.kinds.rstrip("e"))
    header = lines[first - 1].strip() if first else ""
    names = [cell for cell in layout.split(header.lstrip("#% ")) if cell]
    halved = layout.delimiter == "," and not layout.quoted and 2 * len(names) == width
    whole = not any(set(".eE") & set(line) for line in lines[first : first + 50])
    if names and halved and whole:
        raise MeasurementError(
            f"line {first + 1} has {width} values below {len(names)} names; with decimal "
            "commas, separate the values with ; or a tab"
        )
    if layout.decimal != "," or decimal or layout.delimiter == ",":
        return
    begin = lines[first : first + 2000]
    rows = [layout.split(lines_text(one, layout.delimiter)) for one in begin if one.strip()]
    for k in range(width):
        column = [row[k].lstrip("+-") for row in rows if k < len(row) and row[k]]
        with_comma = [cell for cell in column if "," in cell]
        without = [cell for cell in column if "," not in cell]
        thousands = all(number_text(one, ".", True) and one[0] != "0" for one in with_comma)
        if with_comma and without and thousands and all(len(cell) <= 3 for cell in without):
            raise MeasurementError(
                f"column {k + 1}: is {with_comma[0]!r} a number with a decimal comma or one above "
                "a thousand? Say so with --decimal , or --decimal .\n"
                f"{preview_of(lines, first)}"
            )
