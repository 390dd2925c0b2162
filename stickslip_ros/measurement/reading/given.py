# SPDX-License-Identifier: Apache-2.0
"""Measurements that a program holds: arrays, tables of pandas, and xarray's, with their units.

Nothing of these libraries is imported: what an object offers says what it is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from stickslip_ros.measurement.reading.choice import Reading
from stickslip_ros.measurement.reading.formats import naming
from stickslip_ros.measurement.reading.motion import ActuatorLoop, loop_of, motion_of
from stickslip_ros.measurement.reading.table import Column, MeasurementError, Table
from stickslip_ros.simulation.motion import Motion

#: Names and units of arrays, in the order that they are given in.
_ARRAYS = (("time", "s"), ("position", "m"), ("actuator", "m"))
_EXPECTED = (
    "expected is a file, a Motion, a DataFrame, a Dataset, or times (s), positions (m) and, where "
    "it was measured, deflections of the actuator (m) as arrays"
)


def given_motion(source: Any, *more: Any, how: Reading | None = None) -> Motion:
    """Return the motion in arrays, a DataFrame or an xarray object.

    source: times in s, (samples,), with positions and, where it was measured, the deflection of the
    actuator in m in more; or one object with times and positions as its columns, index or
    coordinates. Units stand in the names (``x (nm)``) or the attribute ``units``.
    how: what the object does not say, as of a file.
    Raises MeasurementError: there is no motion in them; the message says what was expected.
    """
    with naming("table" if not more and hasattr(source, "columns") else "arrays"):
        return motion_of(given_table(source, *more), "arrays", how or Reading())


def given_loop(source: Any, how: Reading | None = None) -> ActuatorLoop:
    """Return voltage and deflection of an actuator in a DataFrame or an xarray object.

    Raises MeasurementError.
    """
    with naming("table"):
        return loop_of(given_table(source), how or Reading())


def given_table(source: Any, *more: Any) -> Table:
    """Return the columns of arrays, as in `given_motion`, a DataFrame or an xarray object.

    Raises MeasurementError.
    """
    if more:
        source = (source, *more)
    columns: dict[Any, Any] = {}
    if isinstance(source, tuple | list) and 2 <= len(source) <= len(_ARRAYS):
        return Table.of(_columns_of_arrays(source))
    if hasattr(source, "to_dataset"):  # a DataArray
        source = source.to_dataset(name=source.name or "position")
    if hasattr(source, "data_vars"):
        columns = {**dict(source.coords), **dict(source.data_vars)}
    elif hasattr(source, "columns") and hasattr(source, "index"):
        index = source.index
        if index.name is not None or index.dtype.kind in "mMf":  # more than the number of a row
            columns = {index.name or "time": index}
        columns |= {name: source[name] for name in source.columns}
    else:
        raise MeasurementError(f"{_named(source)} is no measurement; {_EXPECTED}")
    return Table.of(
        Column(str(name), _unit_of(values), None, np.asarray(values))
        for name, values in columns.items()
        if values.ndim == 1
    )


def _columns_of_arrays(arrays: Sequence[Any]) -> Iterator[Column]:
    samples = np.asarray(arrays[0]).size
    for (name, unit), given in zip(_ARRAYS, arrays, strict=False):
        values = np.asarray(given)
        if values.ndim == 0:
            raise MeasurementError(f"{name} is {_named(given)}, no numbers; {_EXPECTED}")
        if values.shape != (samples,):
            size = f"{len(values)} samples" if values.ndim == 1 else f"shape {values.shape}"
            raise MeasurementError(f"{name} has {size} and time has {samples}; give as many")
        yield Column(name, _unit_of(given) or unit, None, values)


def _unit_of(values: Any) -> str | None:
    unit = getattr(values, "attrs", {}).get("units")
    return unit and str(unit)


def _named(value: Any) -> str:
    text = " ".join(repr(value).split())
    return f"{type(value).__name__} {text[:40]}{'...' * (len(text) > 40)}"
