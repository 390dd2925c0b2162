# SPDX-License-Identifier: Apache-2.0
"""Files of arrays: NumPy and HDF5, and the content of MATLAB files.

Vectors and the columns of matrices become columns of a table, named by their path, such as
``data.x`` or ``run/position``. Units and clocks are taken from attributes where a file has them.
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np

from stickslip_ros.measurement.reading.instruments import asking, library
from stickslip_ros.measurement.reading.table import (
    Clock,
    MeasurementError,
    Named,
    Table,
    name_and_unit,
)
from stickslip_ros.opening import Allowance, open_regular

#: Matrices with more columns are no tables.
_WIDEST = 256
#: Names of attributes and variables for a unit, a step (s) and a start (s).
_UNITS = ("units", "unit", "Units", "Unit", "unit_string", "YUnits")
_STEPS = ("XInc", "dt", "Tinterval", "tInc", "sample_interval", "wf_increment")
_STARTS = ("XOrg", "t0", "Tstart", "wf_start_offset")


def columns_in(name: str, array: Any, unit: str | None = None) -> Iterator[Named]:
    """Yield the columns that an array holds: its fields, or itself, or its columns."""
    array = np.asarray(array)
    if array.dtype.names:
        flat = array.reshape(-1)
        for field in array.dtype.names:
            inner = flat[field][0] if flat.size == 1 else flat[field]
            yield from columns_in(f"{name}.{field}" if name else field, inner)
        return
    if array.dtype.kind not in "fiu" or array.size < 2:
        if array.dtype == object and array.size == 1:
            yield from columns_in(name, array.reshape(-1)[0])
        return
    array = np.squeeze(array)
    if array.ndim == 1:
        yield name, unit, array, None
    elif array.ndim == 2 and min(array.shape) <= _WIDEST:
        rows = array if array.shape[0] >= array.shape[1] else array.T
        for k in range(rows.shape[1]):
            yield (f"{name}[{k + 1}]" if name else ""), unit, rows[:, k], None


def read_npy(path: Path) -> Table:
    """Read a file of `numpy.save`. Raises MeasurementError and OSError."""
    with asking("array"):
        # A mapping is refused where the file is shorter than its shape says; nothing is reserved.
        mapped = np.load(path, mmap_mode="r", allow_pickle=False)
        if mapped.offset + mapped.nbytes != path.stat().st_size:
            raise MeasurementError("its array is followed by other bytes; write it anew")
    return table_from(list(columns_in("", np.array(mapped))))


def read_npz(path: Path) -> Table:
    """Read a file of `numpy.savez`. Raises MeasurementError and OSError."""
    allowance, held = Allowance(path), {}
    with asking("arrays"), zipfile.ZipFile(path) as packed:
        for member in packed.infolist():
            if not member.filename.endswith(".npy"):
                continue
            # The shape may promise more than the member holds: it would be reserved at once.
            with packed.open(member) as file:
                promised = _stated_bytes(file)
            if promised > member.file_size:
                raise MeasurementError(
                    f"{member.filename} is shorter than its shape; write it anew"
                )
            allowance.spend(member.file_size)
            with packed.open(member) as file:
                array = np.lib.format.read_array(file, allow_pickle=False)
            held[member.filename.removesuffix(".npy")] = array
    return of_mapping(held)


def _stated_bytes(file: IO[bytes]) -> int:
    """Return the bytes of the samples according to the header of an array."""
    form = np.lib.format
    first = form.read_magic(file) == (1, 0)
    read_header = form.read_array_header_1_0 if first else form.read_array_header_2_0
    shape, _, dtype = read_header(file)
    return math.prod(shape) * dtype.itemsize


def read_hdf5(path: Path) -> Table:
    """Return the datasets of an HDF5 file. Raises MeasurementError and OSError."""
    h5py = library("h5py", "HDF5 and MATLAB 7.3")
    found: list[Named] = []
    allowance = Allowance(path)

    def take(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or name.startswith("#refs#"):
            return
        if item.dtype.kind not in "fiuV" or item.dtype.hasobject or item.ndim > 3:
            return
        if item.shape is None or item.size < 2:
            return
        if item.external or item.is_virtual:
            raise MeasurementError(f"its {name} is kept in other files; copy it into this one")
        # What was never written takes no room on the disk; one value unpacks a whole chunk.
        numbers = max(item.size, math.prod(item.chunks or ()))
        allowance.spend(int(numbers) * item.dtype.itemsize)
        facts = {**_plain(item.parent.attrs), **_plain(item.attrs)}
        unit = next((str(facts[key]) for key in _UNITS if key in facts), None)
        for label, stated, values, _ in columns_in(name, item[()], unit):
            found.append((label, stated, values, _clock(facts)))

    open_regular(path).close()
    with asking("HDF5"), h5py.File(path, "r") as file:
        file.visititems(take)
    return table_from(found)


def _plain(attributes: Any) -> dict[str, Any]:
    """Return attributes as Python has them; those that cannot be read are passed over."""
    plain = {}
    for key in attributes:
        try:
            value = attributes[key]
        except (OSError, TypeError, ValueError, KeyError, RuntimeError):
            continue
        value = value.reshape(-1)[0] if isinstance(value, np.ndarray) and value.size else value
        plain[key] = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
    return plain


def of_mapping(held: Mapping[str, Any]) -> Table:
    """Return the columns of named arrays; single numbers may give the clock of all."""
    arrays = {name: np.asarray(value) for name, value in held.items()}
    single = {name: one.reshape(-1)[0] for name, one in arrays.items()
              if one.size == 1 and one.dtype.kind in "fiu"}  # fmt: skip
    found = [one for name, array in arrays.items() for one in columns_in(name, array)]
    return table_from(found, _clock(single))


def _clock(facts: Mapping[str, Any]) -> Clock | None:
    """Return the clock that facts give, None if they give none."""
    try:
        step = next((float(facts[k]) for k in _STEPS if facts.get(k) is not None), 0.0)
        start = next((float(facts[k]) for k in _STARTS if facts.get(k) is not None), 0.0)
    except (TypeError, ValueError):
        return None
    return Clock(start, step) if 0.0 < step < 1e6 and abs(start) < 1e12 else None


def table_from(found: list[Named], clock: Clock | None = None) -> Table:
    """Return a table of named arrays, whose names may end in units; clock of those without one."""
    return Table.of(
        [
            (*(name_and_unit(name) if unit is None else (name, unit)), values, own or clock)
            for name, unit, values, own in found
        ]
    )
