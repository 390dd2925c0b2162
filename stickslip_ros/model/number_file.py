# SPDX-License-Identifier: Apache-2.0
"""Columns of numbers in text files that parameters name."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.parameters import ParameterError

#: 'np.float64(0.5)' and what else programs print around a number.
_WRAPPED = re.compile(r"(?:np|numpy)\.\w+\(\s*'?([^()']*)'?\s*\)|Decimal\('([^']*)'\)")


def unwrapped(text: str) -> str:
    """Return a text with ``np.float64(0.5)`` and the like replaced by the number in it."""
    return _WRAPPED.sub(lambda found: found[1] if found[1] is not None else found[2], text)


class FileVersion(NamedTuple):
    """A file as it was written at one time: the key to what was read from it."""

    path: Path
    changed: int  #: ns, as the file system tells
    size: int  #: bytes


def version_of(path: Path) -> FileVersion:
    """Return which version of a file is there; ParameterError if none can be read."""
    try:
        found = path.stat()
    except (OSError, ValueError) as error:
        raise cannot_read(path, error) from None
    return FileVersion(path, found.st_mtime_ns, found.st_size)


def cannot_read(path: Path, error: Exception) -> ParameterError:
    """Return the error that says why a file cannot be read."""
    return ParameterError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}")


def read_rows(
    path: Path, widths: tuple[int, ...], form: str
) -> tuple[list[int], NDArray[np.float64]]:
    """Return the numbers of the lines with numbers, and the rows, (rows, columns).

    Columns are parted by commas, semicolons or blanks; ``#`` begins a comment. ``np.float64(0.5)``
    is a number. widths are the numbers of columns allowed, form says so in words.
    Raises ParameterError with the line for anything else.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise cannot_read(path, error) from None
    except UnicodeDecodeError:
        raise ParameterError(f"{path} is not a text file; it has to hold {form}") from None
    lines: list[int] = []
    rows: list[list[float]] = []
    for number, line in enumerate(text.splitlines(), 1):
        cells = unwrapped(line.partition("#")[0]).replace(";", ",").replace(",", " ").split()
        if not cells:
            continue
        try:
            row = [float(cell) for cell in cells]
        except ValueError:
            raise ParameterError(
                f"{path}, line {number}: {line.strip()[:60]!r} is not made of numbers; "
                f"it has to hold {form}"
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
    return lines, np.array(rows)
