# SPDX-License-Identifier: Apache-2.0
"""Variables that MATLAB and Octave saved.

MATLAB's are read in a process of their own: a broken file can crash SciPy's reader. In Octave's
text (``save -text``) each variable begins with ``# name:`` and ``# type:``; a matrix goes on with
its size and its rows, a range with its base, limit and increment.
"""

from __future__ import annotations

import io
import math
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.measurement.reading.arrays import columns_in, of_mapping, read_hdf5, table_from
from stickslip_ros.measurement.reading.table import MeasurementError, Table
from stickslip_ros.opening import Allowance, open_regular

#: A file is broken if it takes longer: seconds, and those for each byte of it.
_PATIENCE, _PATIENCE_A_BYTE = 20.0, 1e-7
#: Memory (bytes) of the interpreter and its libraries; copies of the variables beside it.
_INTERPRETER, _COPIES = 500_000_000, 4
#: Reads the file named first and leaves its variables, or what is wrong, in the one named second;
#: the third argument is the memory (bytes) that it may take, where the system can limit that.
_CHILD = """
import sys
sys.path[:1] = []  # the folder that we happen to be in
import pickle, warnings
warnings.simplefilter("ignore")
try:
    import scipy.io
    try:
        import resource
        resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[3]),) * 2)
    except ImportError:
        pass
    held = scipy.io.loadmat(sys.argv[1])
except BaseException as error:
    held = " ".join(str(error).split())[:160] or type(error).__name__
    held = None if isinstance(error, MemoryError) else held
with open(sys.argv[2], "wb") as file:
    pickle.dump(held, file, 5)
"""


def read_mat(path: Path) -> Table:
    """Return the variables of a MATLAB file. Raises MeasurementError and OSError."""
    with open_regular(path) as file:
        if b"MATLAB 7.3" in file.read(32):
            return read_hdf5(path)
    with tempfile.TemporaryDirectory(prefix="stickslip-") as folder:
        out, allowance = Path(folder, "variables"), Allowance(path)
        memory = _INTERPRETER + _COPIES * allowance.left
        command = [sys.executable, "-c", _CHILD, os.path.abspath(path), str(out), str(memory)]
        patience = _PATIENCE + _PATIENCE_A_BYTE * path.stat().st_size
        one_thread = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}  # each reserves memory
        try:
            child = subprocess.run(
                command, capture_output=True, timeout=patience, check=False, env=one_thread
            )
        except subprocess.TimeoutExpired:
            raise MeasurementError("its MATLAB variables take too long to read") from None
        if child.returncode != 0 or not out.exists():
            raise MeasurementError("its MATLAB variables are broken; export it anew")
        allowance.spend(out.stat().st_size)
        held = pickle.loads(out.read_bytes())  # written by our own program
    if held is None:
        allowance.spend(allowance.left + 1)
    if isinstance(held, str):
        raise MeasurementError(f"its MATLAB variables cannot be read: {held}; export it anew")
    return of_mapping({name: v for name, v in held.items() if not name.startswith("__")})


_NAME, _TYPE = "# name:", "# type:"


def is_octave(start: bytes) -> bool:
    """Return whether a file begins as Octave writes it."""
    return start.startswith(b"#") and _NAME.encode() in start and _TYPE.encode() in start


def read_octave(path: Path) -> Table:
    """Return the columns of all matrices. Raises MeasurementError and OSError."""
    with open_regular(path) as file:
        lines = file.read().decode("utf-8", "replace").splitlines()
    try:
        named = dict(_variables(lines, Allowance(path)))
    except (ValueError, IndexError, KeyError) as error:
        raise MeasurementError(f"its Octave text is broken: {error}") from None
    return table_from([one for name, array in named.items() for one in columns_in(name, array)])


def _variables(
    lines: Sequence[str], allowance: Allowance
) -> Iterator[tuple[str, NDArray[np.float64]]]:
    starts = [k for k, line in enumerate(lines) if line.startswith(_NAME)]
    for start, end in zip(starts, [*starts[1:], len(lines)], strict=True):
        body = lines[start:end]
        keys = (line.lstrip("# ").partition(":")[::2] for line in body[:8] if line.startswith("#"))
        facts = {key.strip(): value.strip() for key, value in keys}
        name, kind = facts["name"], facts.get("type", "")
        rows = [line for line in body if line.strip() and not line.startswith("#")]
        if kind in ("range", "double_range"):
            stated = rows[0].split() if rows else []
            if len(stated) < 3:
                stated = [facts[key] for key in ("base", "limit", "increment")]
            base, limit, step = map(float, stated[:3])
            if step == 0.0 or not 0.0 <= (limit - base) / step < math.inf:
                raise ValueError(f"the range {name} is not finite")
            count = int((limit - base) / step * (1 + 1e-12)) + 1
            allowance.spend(8 * count)
            yield name, base + step * np.arange(count, dtype=np.float64)
        elif kind in ("matrix", "float matrix") and "ndims" not in facts:
            matrix: NDArray[np.float64] = np.loadtxt(
                io.StringIO("\n".join(rows)), np.float64, ndmin=2, comments=None
            )
            size = facts.get("rows", "no"), facts.get("columns", "no")
            if tuple(map(str, matrix.shape)) != size or not rows:
                raise ValueError(
                    f"{name} has {len(rows)} rows of {matrix.shape[1]}, but it says "
                    f"{size[0]} of {size[1]}"
                )
            yield name, matrix
