# SPDX-License-Identifier: Apache-2.0
"""Delimited text as a table, packed or not, in whatever encoding it is.

It is laid out, named, and refused where it may be read in two ways.
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
from pathlib import Path
from typing import Any

from tqdm import tqdm

from stickslip_ros.measurement.reading import paired_files
from stickslip_ros.measurement.reading.layout import Layout, is_number, lines_text
from stickslip_ros.measurement.reading.preamble import Preamble
from stickslip_ros.measurement.reading.rows import Rows
from stickslip_ros.measurement.reading.table import Column, Loaded, MeasurementError, Table, Unit
from stickslip_ros.opening import Allowance, open_regular

#: Characters that the form of a table is found from, and that are read at once.
_SAMPLE, _BLOCK = 2_000_000, 8_000_000
#: Bytes in memory for a byte of unpacked text.
_GROWS = 5
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
        self._allowance.spend(_GROWS * len(found))
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
    try:
        layout = Layout.of(lines, decimal or _stated_decimal(lines))
    except MeasurementError as error:
        shown = preview_of(lines, 0)
        raise MeasurementError(f"{error}{shown and f'; it begins:{chr(10)}{shown}'}") from None
    preamble = Preamble.of(lines, layout)
    paired_files.add_description(path, layout, preamble)
    _check_units(lines, layout)
    _check_commas(lines, layout, decimal)

    def load(wanted: Sequence[Column]) -> Loaded:
        rows = Rows(layout, wanted, lines)
        for block, last in blocks_of(path, encoding):
            rows.add(block, last)
        return rows.loaded()

    return Table(preamble.columns(layout), load, preview_of(lines, layout.first))


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
        thousands = all(is_number(one, ".", True) and one[0] != "0" for one in with_comma)
        if with_comma and without and thousands and all(len(cell) <= 3 for cell in without):
            raise MeasurementError(
                f"column {k + 1}: is {with_comma[0]!r} a number with a decimal comma or one above "
                "a thousand? Say so with --decimal , or --decimal .\n"
                f"{preview_of(lines, first)}"
            )
