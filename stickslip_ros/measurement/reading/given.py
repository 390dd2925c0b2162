# SPDX-License-Identifier: Apache-2.0
"""Measurements that a program holds: arrays, tables of pandas, and xarray's, with their units.

Nothing of these libraries is imported: what an object offers says what it is.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from stickslip_ros.measurement.reading.choice import Reading
from stickslip_ros.measurement.reading.motion import ActuatorLoop, loop_of, motion_of
from stickslip_ros.measurement.reading.table import Column, MeasurementError, Table
from stickslip_ros.simulation.motion import Motion

#: Names and units of arrays, in the order that they are given in.
_ARRAYS = (("time", "s"), ("position", "m"), ("actuator", "m"))
_EXPECTED = (
    "expected is a file, a Motion, a DataFrame, a Dataset, or times (s) and positions (m) as arrays"
)


def given_motion(source: Any, *more: Any, how: Reading | None = None) -> Motion:
    """Return the motion in arrays, a DataFrame or an xarray object.

    source: times in s, (samples,), with positions and, where it was measured, the deflection of the
    actuator in m in more; or one object with times and positions as its columns, index or
    coordinates. Units stand in the names (``x (nm)``) or the attribute ``units``.
    how: what the object does not say, as of a file.
    Raises MeasurementError: there is no motion in them; the message says what was expected.
    """
    how = how or Reading()
    with _naming("table" if not more and hasattr(source, "columns") else "arrays"):
        return motion_of(given_table(source, *more), "arrays", how)


def given_loop(source: Any, how: Reading | None = None) -> ActuatorLoop:
    """Return voltage and deflection of an actuator in a DataFrame or an xarray object.

    Raises MeasurementError.
    """
    with _naming("table"):
        return loop_of(given_table(source), how or Reading())


@contextmanager
def _naming(what: str) -> Iterator[None]:
    """Begin every MeasurementError with what it is of, and say how a program gives options."""
    try:
        yield
    except MeasurementError as error:
        cure = "\nin a program, options are arguments, such as units='x=nm' of read_measurement"
        raise MeasurementError(f"{what}: {error}{cure if '--' in str(error) else ''}") from None


def given_table(source: Any, *more: Any) -> Table:
    """Return the columns of arrays, as in `given_motion`, a DataFrame or an xarray object.

    Raises MeasurementError.
    """
    if isinstance(source, tuple | list) and not more and 2 <= len(source) <= len(_ARRAYS):
        source, *more = source  # type: ignore[assignment]
    if more:
        return Table.of(_columns_of_arrays((source, *more)))
    if hasattr(source, "to_dataset"):  # a DataArray
        source = source.to_dataset(name=source.name or "position")
    columns: dict[Any, Any] = {}
    if hasattr(source, "data_vars"):
        columns = {**dict(source.coords), **dict(source.data_vars)}
    elif hasattr(source, "columns") and hasattr(source, "index"):
        index = source.index
        if index.name is not None or index.dtype.kind in "mMf":  # more than the number of a row
            columns = {index.name or "time": index}
        columns |= {name: source[name] for name in source.columns}
    else:
        raise MeasurementError(f"{_named(source)} is no measurement; {_EXPECTED}")
    found = []
    for name, values in columns.items():
        unit = getattr(values, "attrs", {}).get("units")
        if values.ndim == 1:
            found.append(Column(str(name), unit and str(unit), None, np.asarray(values)))
    return Table.of(found)


def _columns_of_arrays(arrays: tuple[Any, ...]) -> Iterator[Column]:
    if len(arrays) > len(_ARRAYS):
        raise MeasurementError(f"{len(arrays)} arrays are given; they are times, positions and, "
                               "where it was measured, the actuator")  # fmt: skip
    first = len(np.asarray(arrays[0])) if np.ndim(arrays[0]) else 0
    for (name, unit), given in zip(_ARRAYS, arrays, strict=False):
        values = np.asarray(given)
        if values.ndim == 0:
            raise MeasurementError(f"{name} is {_named(given)}, no numbers; {_EXPECTED}")
        if values.ndim != 1:
            raise MeasurementError(
                f"{name} has shape {values.shape}; it has to be (samples,), as the others"
            )
        if len(values) != first:
            raise MeasurementError(
                f"{name} has {len(values)} samples and time has {first}; give as many"
            )
        yield Column(name, str(getattr(given, "attrs", {}).get("units", unit)), None, values)


def _named(value: Any) -> str:
    text = " ".join(repr(value).split())
    return f"{type(value).__name__} {text[:40]}{'...' * (len(text) > 40)}"
