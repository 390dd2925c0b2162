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

    Parameters
    ----------
    source : array_like, DataFrame, Dataset or DataArray
        Times in s, with the others in more; or one object with times and positions as its columns,
        index or coordinates. Units stand in the names (``x (nm)``) or the attribute ``units``.
    *more : array_like
        Positions in m and, where it was measured, the actuator's deflection in m, (samples,).
    how : Reading, optional
        What the object does not say, as of a file.

    Raises
    ------
    MeasurementError
        There is no motion in them; the message says what was expected.
    """
    with _naming("table" if not more and hasattr(source, "columns") else "arrays"):
        return motion_of(given_table(source, *more), "arrays", how or Reading())


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
    if hasattr(source, "data_vars"):
        return Table.of(_columns_of_dataset(source))
    if hasattr(source, "columns") and hasattr(source, "index"):
        return Table.of(_columns_of_frame(source))
    raise MeasurementError(f"{_named(source)} is no measurement; {_EXPECTED}")


def _columns_of_arrays(arrays: tuple[Any, ...]) -> list[Column]:
    if len(arrays) > len(_ARRAYS):
        raise MeasurementError(f"{len(arrays)} arrays are given; they are times, positions and, "
                               "where it was measured, the actuator")  # fmt: skip
    found: list[Column] = []
    for (name, unit), given in zip(_ARRAYS, arrays, strict=False):
        stated = getattr(given, "attrs", {}).get("units", unit)
        values = _numbers_in(name, getattr(given, "values", given))
        if values.ndim != 1:
            raise MeasurementError(
                f"{name} has shape {values.shape}; it has to be (samples,), as the others"
            )
        if found and len(values) != found[0].length:
            raise MeasurementError(
                f"{name} has {len(values)} samples and time has {found[0].length}; give as many"
            )
        found.append(Column(name, str(stated), None, values, length=len(values)))
    return found


def _columns_of_dataset(dataset: Any) -> Iterator[Column]:
    for name, values in {**dict(dataset.coords), **dict(dataset.data_vars)}.items():
        if values.ndim == 1:
            unit = values.attrs.get("units")
            yield _column(str(name), values.values, None if unit is None else str(unit))


def _columns_of_frame(table: Any) -> Iterator[Column]:
    """Yield the columns of a DataFrame, and its index if that is more than the number of a row."""
    index = table.index
    if index.name is not None or index.dtype.kind in "mMf":
        yield _column(str(index.name or "time"), index.to_numpy())
    for name in table.columns:
        if table[name].dtype.kind in "iufmM":
            yield _column(str(name), table[name].to_numpy())


def _column(name: str, values: Any, unit: str | None = None) -> Column:
    """Return a column; dates and durations count in seconds from the first of them."""
    values = np.asarray(values)
    if values.dtype.kind in "mM":
        return Column(name, "s", None, (values - values[0]) / np.timedelta64(1, "s"))
    return Column(name, unit, None, _numbers_in(name, values))


def _numbers_in(name: str, values: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise MeasurementError(f"{name} is {_named(values)}, no numbers; {_EXPECTED}") from None


def _named(value: Any) -> str:
    text = " ".join(repr(value).split())
    return f"{type(value).__name__} {text[:40]}{'...' * (len(text) > 40)}"
