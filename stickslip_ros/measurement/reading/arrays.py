# SPDX-License-Identifier: Apache-2.0
"""Files of arrays: NumPy, HDF5 and MATLAB.

Vectors and the columns of matrices become columns of a table, named by their path, such as
``data.x`` or ``run/position``. Units and clocks are taken from attributes where a file has them.
MATLAB's files are read in a process of their own: a broken one can crash SciPy's reader.
"""

from __future__ import annotations

import contextlib
import importlib
import math
import os
import pickle
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.opening import Allowance, open_regular
from stickslip_ros.measurement.reading.instruments import LONGEST_MESSAGE, asking
from stickslip_ros.measurement.reading.table import Clock, Column, MeasurementError, Table

#: Matrices with more columns are no tables.
_WIDEST = 256
#: Names of attributes and variables for a unit, a step (s) and a start (s).
_UNITS = ("units", "unit", "Units", "Unit", "unit_string", "YUnits")
_STEPS = ("XInc", "dt", "Tinterval", "tInc", "sample_interval", "wf_increment")
_STARTS = ("XOrg", "t0", "Tstart", "wf_start_offset")
#: What h5py says of a file that another program writes, or was writing when it crashed.
_BEING_WRITTEN = dict.fromkeys(
    ("temporarily unavailable", "GetLastError() = 33", "already open for write"),
    "it is still open for writing; close the writer (after a crash, h5clear -s makes it readable)",
)
#: A MATLAB file is broken if it takes longer: seconds, and those for each byte of its arrays.
_PATIENCE, _PATIENCE_A_BYTE = 8.0, 1e-8
#: Memory (bytes) of the interpreter and its libraries; copies of the arrays beside it.
_INTERPRETER, _COPIES = 600_000_000, 3
#: Reads the file named first and leaves its arrays in the one named second. The others limit memory
#: (bytes) and time (s), where the system can. Objects, texts and lists of cells are no columns.
_CHILD = """
import sys
sys.path[:1] = []  # the folder that we happen to be in
import pickle, warnings
import numpy, scipy.io
warnings.simplefilter("ignore")
try:
    import resource
    resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[3]),) * 2)
    resource.setrlimit(resource.RLIMIT_CPU, (int(sys.argv[4]),) * 2)
except ImportError:
    pass
held = {
    name: value
    for name, value in scipy.io.loadmat(sys.argv[1]).items()
    if type(value) is numpy.ndarray and (value.dtype.kind in "cfiu" or value.size == 1)
    and not name.startswith("__")
}
with open(sys.argv[2], "wb") as file:
    pickle.dump(held, file, 5)
"""


def columns_in(
    name: str, array: Any, unit: str | None = None, clock: Clock | None = None
) -> Iterator[Column]:
    """Yield the columns that an array holds: its fields, or itself, or its columns."""
    if type(array) is not np.ndarray and not isinstance(array, np.void):
        return  # an object or a function of MATLAB
    array = np.squeeze(np.asarray(array))
    if names := array.dtype.names:
        for field in names:
            yield from columns_in(f"{name}.{field}".lstrip("."), array[field], None, clock)
    elif array.dtype == object and array.size == 1:
        yield from columns_in(name, array.item(), None, clock)
    elif array.dtype.kind in "cfiu" and array.ndim == 1 and array.size > 1:
        yield Column(name, unit, clock, array)
    elif array.dtype.kind in "cfiu" and array.ndim == 2 and min(array.shape) <= _WIDEST:
        for k, column in enumerate(array.T if len(array) >= len(array.T) else array, 1):
            yield Column(f"{name}[{k}]" if name else "", unit, clock, column)


def read_npy(path: Path) -> Table:
    """Read a file of `numpy.save`. Raises MeasurementError and OSError."""
    with asking("array"), open_regular(path) as file:
        return _of_mapping({"": _array(file, path.stat().st_size)})


def read_npz(path: Path) -> Table:
    """Read a file of ``numpy.savez``. Raises MeasurementError and OSError."""
    allowance, held = Allowance(path), {}
    with asking("arrays"), zipfile.ZipFile(path) as packed:
        for member in packed.infolist():
            allowance.spend(member.file_size)
            if (inside := Path(member.filename)).suffix == ".npy":
                with packed.open(member) as file:
                    held[inside.stem] = _array(file, member.file_size)
    return _of_mapping(held)


def _array(file: IO[bytes], size: int) -> NDArray[Any] | None:
    """Return the array in a file of so many bytes, None if it holds objects of Python.

    Its shape may promise more than the file holds: it would be reserved at once. MeasurementError.
    """
    form = np.lib.format
    first = form.read_magic(file) == (1, 0)
    shape, _, dtype = (form.read_array_header_1_0 if first else form.read_array_header_2_0)(file)
    if dtype.hasobject:
        return None
    if size != file.tell() + math.prod(shape) * dtype.itemsize:
        what = "it is longer or shorter than its shape"
        raise MeasurementError(f"its array cannot be read: {what}; write it anew")
    file.seek(0)
    return np.asarray(form.read_array(file, allow_pickle=False))


def read_hdf5(path: Path) -> Table:
    """Return the datasets of an HDF5 file. Raises MeasurementError and OSError."""
    found: list[Column] = []
    allowance = Allowance(path)

    def take(name: str, item: Any) -> None:
        kind, shape = getattr(item, "dtype", None), getattr(item, "shape", None)
        if kind is None or kind.hasobject or kind.kind not in "cfiuV" or name.startswith("#refs#"):
            return
        if shape is None or item.size < 2 or len(shape) > 3:
            return
        if item.external or item.is_virtual:
            raise MeasurementError(f"its {name} is kept in other files; copy it into this one")
        # What was never written takes no room on the disk; one value unpacks a whole chunk.
        numbers = max(item.size, math.prod(item.chunks or ()))
        allowance.spend(int(numbers) * kind.itemsize)
        facts = {**_plain(item.parent.attrs), **_plain(item.attrs)}
        unit = next((str(facts[key]) for key in _UNITS if key in facts), None)
        found.extend(columns_in(name, item[()], unit, _clock(facts)))

    with asking("HDF5", _BEING_WRITTEN), importlib.import_module("h5py").File(path) as file:
        file.visititems(take)
    return Table.of(found)


def _plain(attributes: Any) -> dict[str, Any]:
    """Return those attributes that say units or times, as Python has them, if they can be read."""
    plain = {}
    for key in {*_UNITS, *_STEPS, *_STARTS} & set(attributes):
        with contextlib.suppress(OSError, TypeError, ValueError, KeyError, RuntimeError):
            value = np.asarray(attributes[key]).reshape(-1)[:1].tolist()[0]
            plain[key] = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
    return plain


def _of_mapping(held: Mapping[str, Any]) -> Table:
    """Return the columns of named arrays, without objects; single numbers may give their clock."""
    arrays = {name: value for name, value in held.items() if value is not None}
    single = {name: one.reshape(-1)[0] for name, one in arrays.items()
              if one.size == 1 and one.dtype.kind in "fiu"}  # fmt: skip
    found = [one for name, array in arrays.items() for one in columns_in(name, array)]
    objects = ", ".join(name or "its array" for name, value in held.items() if value is None)
    left_out = f"{objects}: objects of Python, not numbers, left out; save float64 arrays"
    return Table.of(found, _clock(single), (left_out,) if objects else ())


def _clock(facts: Mapping[str, Any]) -> Clock | None:
    """Return the clock that facts give, None if they give none."""
    try:
        step = next((float(facts[k]) for k in _STEPS if facts.get(k) is not None), 0.0)
        start = next((float(facts[k]) for k in _STARTS if facts.get(k) is not None), 0.0)
    except (TypeError, ValueError):
        return None
    return Clock(start, step) if 0.0 < step < 1e6 and abs(start) < 1e12 else None


def read_mat(path: Path) -> Table:
    """Return the variables of a MATLAB file. Raises MeasurementError and OSError."""
    with tempfile.TemporaryDirectory(prefix="stickslip-") as folder:
        out, allowance = Path(folder, "variables"), Allowance(path)
        patience = _PATIENCE + _PATIENCE_A_BYTE * allowance.left
        limits = map(int, (_INTERPRETER + _COPIES * allowance.left, patience))
        command = [sys.executable, "-c", _CHILD, os.path.abspath(path), str(out), *map(str, limits)]
        one_thread = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}  # each reserves memory
        try:  # the clock goes on while other programs work
            child = subprocess.run(command, capture_output=True, env=one_thread, text=True,
                                   errors="replace", timeout=10.0 * patience)  # fmt: skip
        except subprocess.TimeoutExpired:
            raise MeasurementError("its MATLAB variables take too long to read") from None
        if "MemoryError" in child.stderr:
            allowance.spend(allowance.left + 1)
        if child.returncode != 0 or not out.exists():
            said = " ".join(child.stderr.splitlines()[-1:])[:LONGEST_MESSAGE] or "they are broken"
            raise MeasurementError(f"its MATLAB variables cannot be read: {said}; export it anew")
        allowance.spend(out.stat().st_size)
        return _of_mapping(pickle.loads(out.read_bytes()))  # written by our own program
