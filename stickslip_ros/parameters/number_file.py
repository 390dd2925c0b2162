# SPDX-License-Identifier: Apache-2.0
"""Columns of numbers in text files that parameters name."""

from __future__ import annotations

import math
import os
import re
import stat
from pathlib import Path
from typing import NamedTuple

from stickslip_ros.parameters.row import ParameterError

#: Size of a file that a parameter may name; a waveform of 10 000 points takes half of it.
MOST_BYTES = 1_000_000
#: Text that programs print around a number, such as np.float64(0.5).
_WRAPPED = re.compile(r"(?:np|numpy)\.\w+\(\s*'?([^()']*)'?\s*\)|Decimal\('([^']*)'\)")


def unwrap_numbers(text: str) -> str:
    """Return a text in which numbers replace ``np.float64(0.5)`` and the like."""
    return _WRAPPED.sub(lambda found: found[1] if found[1] is not None else found[2], text)


class FileVersion(NamedTuple):
    """Path, time of change and size of a file: the key of its cached content."""

    path: Path
    changed: int  #: ns, by the file system
    size: int  #: bytes

    @classmethod
    def of(cls, path: Path) -> FileVersion:
        """Return which version of a file is there; ParameterError if none can be read."""
        try:
            found = path.stat()
        except (OSError, ValueError) as error:
            raise cannot_read(path, error) from None
        if not stat.S_ISREG(found.st_mode):
            raise ParameterError(f"cannot read {path}: it is not a regular file; name one")
        if found.st_size > MOST_BYTES:
            raise ParameterError(
                f"cannot read {path}: it has {found.st_size} bytes, {MOST_BYTES} is the limit; "
                "name a shorter file"
            )
        return cls(path, found.st_mtime_ns, found.st_size)


def cannot_read(path: Path, error: Exception) -> ParameterError:
    """Return the error that says why a file cannot be read."""
    return ParameterError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}")


def read_bytes(path: Path) -> bytes:
    """Return the content of a regular file of moderate size; ParameterError for any other file.

    A remote user may name the file: a pipe would block, a device may have no end.
    """
    FileVersion.of(path)
    try:
        # Without waiting, should it have become a pipe meanwhile.
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
        with os.fdopen(handle, "rb") as file:
            return file.read(MOST_BYTES)
    except OSError as error:
        raise cannot_read(path, error) from None


def read_small_text(path: Path) -> str:
    """Return the text of a file as `read_bytes` does; UnicodeDecodeError if it is none."""
    return read_bytes(path).decode("utf-8-sig")


def read_rows(
    path: Path, widths: tuple[int, ...], form: str
) -> tuple[list[int], list[list[float]]]:
    """Return the numbers of the lines with numbers, and the rows of numbers.

    Columns are separated by commas, semicolons or blanks; ``#`` begins a comment.
    ``np.float64(0.5)`` is a number. widths are the allowed numbers of columns, form names them in
    words. Raises ParameterError with the line for anything else.
    """
    try:
        text = read_small_text(path)
    except UnicodeDecodeError:
        raise ParameterError(f"{path} is not a text file; it has to hold {form}") from None
    lines: list[int] = []
    rows: list[list[float]] = []
    for number, line in enumerate(text.splitlines(), 1):
        cells = unwrap_numbers(line.partition("#")[0]).replace(";", ",").replace(",", " ").split()
        if not cells:
            continue
        try:
            row = [float(cell) for cell in cells]
        except ValueError:
            raise ParameterError(
                f"{path}, line {number} is not a row of numbers; it has to hold {form}"
            ) from None
        if not all(math.isfinite(value) for value in row):
            raise ParameterError(f"{path}, line {number}: every number has to be finite")
        if len(row) not in widths or (rows and len(row) != len(rows[0])):
            raise ParameterError(
                f"{path}, line {number}: {len(row)} columns; it has to hold {form}, "
                "as many in every line"
            )
        lines.append(number)
        rows.append(row)
    return lines, rows
