# SPDX-License-Identifier: Apache-2.0
"""Variables in Octave's text format, as ``save -text`` writes them.

Each variable begins with ``# name:`` and ``# type:``; a matrix goes on with its size and its rows,
a range with its base, limit and increment.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.measurement.reading.arrays import columns_in, table_from
from stickslip_ros.measurement.reading.table import MeasurementError, Table
from stickslip_ros.opening import Allowance, open_regular

_NAME, _TYPE = "# name:", "# type:"
_MATRICES = {"matrix", "float matrix", "complex matrix"}


def is_octave(start: bytes) -> bool:
    """Return whether a file begins as Octave writes it."""
    name, kind = _NAME.encode(), _TYPE.encode()
    return start.startswith(b"#") and name in start and kind in start


def read_octave(path: Path) -> Table:
    """Return the columns of all matrices. Raises MeasurementError and OSError."""
    with open_regular(path) as file:
        lines = file.read().decode("utf-8", "replace").splitlines()
    try:
        named = dict(_variables(lines, Allowance(path)))
    except (ValueError, IndexError) as error:
        raise MeasurementError(f"its Octave text is broken: {error}") from None
    return table_from([one for name, array in named.items() for one in columns_in(name, array)])


def _variables(
    lines: Sequence[str], allowance: Allowance
) -> Iterator[tuple[str, NDArray[np.float64]]]:
    starts = [k for k, line in enumerate(lines) if line.startswith(_NAME)]
    for start, end in zip(starts, [*starts[1:], len(lines)], strict=True):
        name = lines[start].removeprefix(_NAME).strip()
        kind = lines[start + 1].removeprefix(_TYPE).strip() if start + 1 < len(lines) else ""
        body = lines[start + 2 : end]
        sizes = dict(_sizes(body))
        rows = [line for line in body if line.strip() and not line.startswith("#")]
        if kind in ("range", "double_range"):
            numbers = [float(x) for x in rows[0].split()] if rows else []
            base, limit, step = (numbers if len(numbers) >= 3 else [sizes[key] for key in _RANGE])[
                :3
            ]
            if step == 0.0 or not 0.0 <= (limit - base) / step < math.inf:
                raise ValueError(f"the range {name} is not finite")
            count = int((limit - base) / step * (1 + 1e-12)) + 1
            allowance.spend(8 * count)
            yield name, base + step * np.arange(count, dtype=np.float64)
        elif kind in _MATRICES and not kind.startswith("complex"):
            if "ndims" in sizes:
                continue
            if not rows:
                raise ValueError(f"{name} has no rows")
            matrix: NDArray[np.float64] = np.loadtxt(
                io.StringIO("\n".join(rows)), np.float64, ndmin=2, comments=None
            )
            if matrix.shape != (sizes.get("rows", -1), sizes.get("columns", -1)):
                raise ValueError(
                    f"{name} has {matrix.shape[0]} rows of {matrix.shape[1]}, but it says "
                    f"{sizes.get('rows', 0):g} of {sizes.get('columns', 0):g}"
                )
            yield name, matrix
        elif kind == "scalar" and rows:
            yield name, np.array([float(rows[0])])


_RANGE = ("base", "limit", "increment")


def _sizes(body: Sequence[str]) -> Iterator[tuple[str, float]]:
    for line in body[:6]:
        key, sign, value = line.lstrip("# ").partition(":")
        if line.startswith("#") and sign:
            try:
                yield key.strip(), float(value)
            except ValueError:
                continue
