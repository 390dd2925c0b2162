# SPDX-License-Identifier: Apache-2.0
"""Text files opened, packed or not, in whatever encoding they are."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tqdm import tqdm

from stickslip_ros.measurement.reading.table import MeasurementError
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


def text_start(path: Path) -> tuple[list[str], str] | None:
    """Return the first whole lines of a text and its encoding, None if it is no text."""
    with _opened(path) as (_, inner):
        encoding = encoding_of(inner.read(65536))
    if encoding is None:
        return None
    with _opened(path) as (_, inner):
        text = io.TextIOWrapper(inner, encoding, errors="replace", newline=None)
        lines = text.read(_SAMPLE).split("\n")
        if text.read(1):
            lines.pop()
    if max(map(len, lines), default=0) > _LONGEST:
        raise MeasurementError(
            f"a line has more than {_LONGEST} characters; write each sample on a line of its own"
        )
    return lines, encoding


def blocks_of(path: Path, encoding: str, progress: bool) -> Iterator[tuple[list[str], bool]]:
    """Yield lists of lines, and whether they are the last; show the progress on a terminal."""
    with (
        _opened(path) as (file, inner),
        tqdm(
            total=path.stat().st_size,
            desc=f"reading {path.name}",
            unit="B",
            unit_scale=True,
            delay=0.5,
            disable=None if progress else True,
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
