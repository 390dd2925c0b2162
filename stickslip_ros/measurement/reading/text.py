# SPDX-License-Identifier: Apache-2.0
"""Delimited text as a table, packed or not, in whatever encoding it is.

It is laid out, named, and refused where it may be read in two ways. NumPy reads a block of lines at
once, with our reader of cells where it does not know their spelling. Of a block with lines that are
no rows, it reads a few at once, and those among them one by one: words are left out and counted.

Rohde & Schwarz write pairs: ``X.csv`` describes the numbers in ``X.Wfm.csv``, which have no header:
the time of the first sample, the step, and the unit of a single channel.
"""

from __future__ import annotations

import bz2
import codecs
import contextlib
import gzip
import io
import lzma
import re
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from stickslip_ros.base.opening import Allowance, ReadError, open_regular
from stickslip_ros.measurement.reading.cells import Stamps, value_of
from stickslip_ros.measurement.reading.layout import Layout, is_remark
from stickslip_ros.measurement.reading.preamble import columns_above
from stickslip_ros.measurement.reading.table import Column, Loaded, MeasurementError, Table
from stickslip_ros.physics.parameters.bounded_files import unwrap_numbers

#: Characters that are read at once; those that no line of a table has.
_BLOCK, _LONGEST = 4_000_000, 100_000
#: What a byte and a line of unpacked text take of the allowance: bytes in memory, and the time of a
#: row as bytes. A row of a measurement takes more than a byte when it is packed, as it has noise.
_GROWS, _ROW = 5, 300
_PACKED: dict[bytes, Any] = {b"\x1f\x8b": gzip.open, b"BZh": bz2.open, b"\xfd7zXZ": lzma.open}
_MARKS = {
    b"\xff\xfe\0\0": "utf-32", b"\0\0\xfe\xff": "utf-32", b"\xff\xfe": "utf-16",
    b"\xfe\xff": "utf-16", b"\xef\xbb\xbf": "utf-8-sig",
}  # fmt: skip
#: Characters that texts hardly have.
_NO_TEXT = re.compile(r"[\0-\x08\x0e-\x1a\x1c-\x1f\x7f-\x9f\ufffd]")
#: Share of rows that may be words before the table is taken for something else; so many lines of
#: words are read before that is judged.
_MOST_WORDS, _FEW_WORDS = 0.1, 20_000
#: Lines that are read at once where some in a block are no rows.
_FEW = 64
_BRACKETS = re.compile(r"^[ ]*[(\[]|[)\]][ ]*$", re.MULTILINE)
#: End of the name of Rohde & Schwarz's numbers.
_NUMBERS = ".wfm.csv"


def encoding_of(start: bytes) -> str | None:
    """Return the encoding that a text begins in, None if it is no text."""
    for mark, name in _MARKS.items():
        if start.startswith(mark):
            return name
    # An instrument may write µ in one byte; damage is replaced. The last character may be cut.
    for name in ("utf-16-le", "utf-16-be") if b"\0" in start else ("utf-8", "cp1252"):
        errors = "replace" if name == "cp1252" else "strict"
        with contextlib.suppress(UnicodeDecodeError):
            text = codecs.getincrementaldecoder(name)(errors).decode(start)
            plain = len(text) if name == "utf-8" else len(text.encode("ascii", "ignore"))
            odd = len(_NO_TEXT.findall(text))
            if plain >= 0.7 * len(text) and "\0" not in text and odd <= 0.02 * len(text):
                return name
    return None


@contextlib.contextmanager
def _open(path: Path) -> Iterator[tuple[Any, Any]]:
    """Open the file and its unpacked form. Raises MeasurementError if it cannot be unpacked."""
    with open_regular(path) as file:
        start = file.read(6)
        file.seek(0)
        unpack = next((one for mark, one in _PACKED.items() if start.startswith(mark)), None)
        try:
            yield file, unpack(file) if unpack else file
        except (EOFError, zlib.error, lzma.LZMAError) as error:
            raise MeasurementError(f"it cannot be unpacked: {error}") from None


def _blocks_of(path: Path, encoding: str) -> Iterator[tuple[list[str], bool]]:
    """Yield lists of lines, and whether they are the last; show the progress on a terminal.

    Raises MeasurementError for lines of no table, ReadError if it unpacks to too much.
    """
    allowance, size = Allowance(path), path.stat().st_size
    bar = tqdm(desc=f"reading {path.name}", total=size, unit="B", unit_scale=True, delay=0.5,
               disable=None)  # fmt: skip
    with _open(path) as (file, inner), bar:
        text = io.TextIOWrapper(inner, encoding, errors="replace", newline=None)
        rest, block = "", text.read(_BLOCK)
        while block:
            following = text.read(_BLOCK)
            # A row of single digits takes 8 bytes a number where it took 2.
            allowance.spend(_GROWS * len(block) + _ROW * block.count("\n"))
            lines = (rest + block).split("\n")
            rest = lines.pop() if following else ""
            if max(map(len, (rest, *lines))) > _LONGEST:
                raise MeasurementError(
                    f"a line has more than {_LONGEST} characters; write each sample on its own line"
                )
            yield lines, not following
            bar.update(max(0, file.tell() - bar.n))
            block = following


def read_text_table(path: Path, decimal: str | None = None) -> Table | None:
    """Return a text table, None if the file is no text. Raises MeasurementError and OSError."""
    with _open(path) as (_, inner):
        encoding = encoding_of(inner.read(65536))
    if encoding is None:
        return None
    lines, _ = next(_blocks_of(path, encoding), ([""], True))
    for line in lines[:30]:  # LabVIEW's header says it
        key, _, sign = line.strip().partition("\t")
        if key == "Decimal_Separator" and sign.strip() in (".", ","):
            decimal = decimal or sign.strip()
    try:
        layout = Layout.of(lines, decimal)
    except MeasurementError as error:
        shown = _preview_of(lines, 0)
        raise MeasurementError(f"{error}{shown and f'; it begins:{chr(10)}{shown}'}") from None
    numbers = path.name.lower().endswith(_NUMBERS) and layout.first == 0
    described = _description(path) if numbers else []
    columns = columns_above([*described, *lines[: layout.first + 100]],
                            replace(layout, first=layout.first + len(described)))  # fmt: skip

    def load(wanted: Sequence[Column]) -> Loaded:
        rows = _Rows(layout, wanted)
        for block, last in _blocks_of(path, encoding):
            rows.add(block, last)
        return rows.loaded()

    return Table(columns, load, _preview_of(lines, layout.first))


class _Rows:
    """Reads the wanted columns of lines as they come."""

    def __init__(self, layout: Layout, wanted: Sequence[Column]) -> None:
        self._layout, self._wanted = layout, wanted
        #: Reader of each cell by its place; those of cells that NumPy does not read.
        self._readers: dict[Any, Callable[[str], float]] = {}
        self._special: dict[Any, Callable[[str], float]] = {}
        self._stamps = {column.number: Stamps() for column in wanted}
        if layout.delimiter is None:  # all cells are read, so that rows of another width are seen
            odd = (k for k, kind in enumerate(layout.kinds) if kind != "n")
            self._special = dict.fromkeys(odd, lambda cell: 0.0)
        for column in wanted:
            reader, place = self._reader(column), column.number - 1
            self._readers |= dict.fromkeys((place, place + column.joined), reader)
            if column.stamped or (column.origin and not column.joined):
                self._special[place] = reader
        self._parts = [np.empty((0, len(self._readers)))]
        self._seen = 0  # lines
        self._usual = 0  # characters of the shortest of the last lines
        self._remarks: list[int] = []  # lines from the first row on that are empty or comments
        self._words: dict[int, str] = {}  # those that are left out, with their text

    def _reader(self, column: Column) -> Callable[[str], float]:
        """Return what reads a cell of a column."""
        layout, stamps = self._layout, self._stamps[column.number]
        origin = 0 if column.joined else column.origin

        def read(cell: str) -> float:
            cell = cell.strip()
            if column.stamped:
                return stamps.seconds(cell)
            if origin and cell.isdecimal():
                return float(int(cell) - origin)
            return value_of(cell, layout.decimal, layout.grouped) - origin

        return read

    def add(self, lines: list[str], last: bool) -> None:
        """Read further lines; the last one of all may be cut off."""
        skip = max(0, self._layout.first - self._seen)
        first, self._seen = self._seen + skip, self._seen + len(lines)
        lines, rest = lines[skip:], lines[-1]
        self._usual = min((len(line) for line in lines[-200:-1] if line), default=self._usual)
        cut_off = last and len(rest) < self._usual
        if cut_off:
            lines.pop()
        if not self._read(lines):
            for k in range(0, len(lines), _FEW):
                if not self._read(few := lines[k : k + _FEW]):
                    rows = [
                        row for n, line in enumerate(few, first + k) if (row := self._row(n, line))
                    ]
                    self._parts.append(np.array(rows, float).reshape(-1, len(self._readers)))
        if cut_off and rest:
            self._leave_out(self._seen - 1, rest)
        elif cut_off:
            self._remarks.append(self._seen - 1)

    def loaded(self) -> Loaded:
        """Return the table. Raises MeasurementError if too many lines are words."""
        notes = self._notes()
        cells = dict(zip(self._readers, np.concatenate(self._parts).T, strict=True))
        self._parts.clear()  # its memory is needed
        values = []
        for column in self._wanted:
            one = np.ascontiguousarray(cells[column.number - 1])
            if column.joined:
                one = 1e9 * (one - column.origin // 10**9) + cells[column.number]
            values.append(self._stamps[column.number].going_on(one) if column.stamped else one)
        words, no_rows = sorted(self._words), sorted([*self._words, *self._remarks])
        breaks = np.array(words, int) - self._layout.first - np.searchsorted(no_rows, words)

        def place(row: int) -> str:
            line = self._layout.first + row
            for other in no_rows:
                line += other <= line
            return f"line {line + 1}"

        return Loaded(values, place, notes, tuple(breaks.tolist()))

    def _row(self, number: int, line: str) -> list[float] | None:
        """Return the wanted numbers of a line, of this index in the file, None if it is no row."""
        if is_remark(line):
            self._remarks.append(number)
            return None
        layout, width = self._layout, len(self._layout.kinds)
        cells = layout.split(line.partition(" #")[0])
        if layout.delimiter:
            cells += (width - len(cells)) * [""]
        try:
            if len(cells) < width or any(cells[width:]):
                raise ValueError(line)
            return [reader(cells[place]) for place, reader in self._readers.items()]
        except (ValueError, OverflowError):
            self._leave_out(number, line)
            return None

    def _read(self, lines: list[str]) -> bool:
        """Read lines that are rows like all others; return False if some are not."""
        layout, mark, block = self._layout, self._layout.delimiter, "\n".join(lines)
        width = len(layout.kinds)
        counts = {line.count(mark) for line in lines} if mark else {width - 1}
        if counts != {width - 1} or block.strip() == "":
            return False
        if "(" in block or "[" in block:
            block = _BRACKETS.sub("", unwrap_numbers(block))
        quote = '"' if '"' in block else None
        if quote and mark:
            block = block.replace(f'{mark} "', f'{mark}"')
        plain: str | None = block
        if layout.decimal == ",":
            plain = None if mark == "," or "." in block else block.replace(",", ".")
        places = list(self._readers)
        for text, readers in ((plain, self._special), (block, self._special | self._readers)):
            if text is None:
                continue
            try:
                rows = np.loadtxt(
                    text.split("\n"), delimiter=mark, comments=None, quotechar=quote, ndmin=2,
                    usecols=places if mark else None, converters=readers, encoding=None,
                )  # fmt: skip
            except (ValueError, OverflowError):
                continue
            if len(rows) == len(lines) and (mark or rows.shape[1] == width):
                self._parts.append(rows if mark else rows[:, places])
                return True
        return False

    def _leave_out(self, number: int, line: str) -> None:
        """Count a line, of this index in the file, that is no row."""
        shown = _shown(" ".join(line.split()))[:40]
        self._words[number] = f"line {number + 1} ({shown!r})"
        if len(self._words) > _FEW_WORDS:
            self._notes()

    def _notes(self) -> tuple[str, ...]:
        """Return a note on lines that are left out. Raises MeasurementError if they are many."""
        words, lines = len(self._words), self._seen - self._layout.first - len(self._remarks)
        if not words:
            return ()
        first = self._words[min(self._words)]
        if words > _MOST_WORDS * max(lines - words, 10):
            raise MeasurementError(
                f"{words} of {lines} lines are no rows of numbers, first {first}; remove them, or "
                "export a table of numbers"
            )
        rows = "1 line is" if words == 1 else f"{words} lines are"
        return (f"{rows} left out, not being numbers: {first}",)


def numbers_of(path: Path) -> Path:
    """Return the file with the numbers: path itself, or the file that it describes."""
    described = path.suffix.lower() == ".csv" and not path.name.lower().endswith(_NUMBERS)
    partner = path.with_name(f"{path.name[:-4]}.Wfm.csv") if described else path
    return partner if partner.is_file() else path


def _description(path: Path) -> list[str]:
    """Return the header that Rohde & Schwarz's description beside numbers without one makes."""
    try:
        described = path.with_name(f"{path.name[: -len(_NUMBERS)]}.csv")
        with open_regular(described, largest=1_000_000) as file:
            lines = file.read().decode("utf-8", "replace").splitlines()
    except (OSError, ReadError):
        return []
    facts = {key: value.rstrip(":") for key, _, value in (line.partition(":") for line in lines)}
    keys = {"start": "XStart", "increment": "SignalResolution", "points": "SignalRecordLength"}
    if facts.get("MultiChannelExport") != "On":  # of several channels, each has its own unit
        keys["vunit"] = "BaseUnit"
    # Of several acquisitions one after the other, nothing says when they were.
    one = facts.get("NumberOfAcquisitions", "1") == "1"
    return [f"{key}: {facts[name]}" for key, name in keys.items() if one and name in facts]


def _shown(text: str) -> str:
    """Return a text of a file for people, nothing of it if it is none."""
    return "no text" if _NO_TEXT.search(text) else text


def _preview_of(lines: Sequence[str], first: int) -> str:
    """Return the lines about the first numbers, with their numbers, as people read them."""
    shown = range(max(0, first - 4), min(first + 3, len(lines)))
    texts = ("".join(c if c.isprintable() else " " for c in _shown(lines[k]))[:100] for k in shown)
    numbered = zip(shown, texts, strict=True)
    return "\n".join(f"  {k + 1:>4} | {text}" for k, text in numbered).rstrip()
