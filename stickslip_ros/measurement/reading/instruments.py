# SPDX-License-Identifier: Apache-2.0
"""Files of testers and loggers that a library kept by others reads: TDMS, universal files.

The libraries come with ``pip install stickslip_ros[formats]`` and are imported when a file needs
them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_ros.measurement.reading.arrays import Named
from stickslip_ros.measurement.reading.libraries import asking, listening, missing
from stickslip_ros.measurement.reading.table import Clock, MeasurementError, Table
from stickslip_ros.opening import Allowance

#: Steps of a waveform that differ by less than this share are one.
_EVEN = 1e-3
#: What a data set of universal file format 58 may be of, by its numbers.
_SPECIFIC_TIME, _SPECIFIC = 17, {8: "m", 11: "m/s", 12: "m/s^2", 13: "N"}


def clock_of(times: Any) -> Clock:
    """Return the clock of even times. Raises MeasurementError."""
    steps = np.diff(times)
    step = float((times[-1] - times[0]) / (len(times) - 1))
    rounding = 4.0 * float(np.spacing(np.abs(times).max()))
    if not step > 0.0 or float(np.abs(steps - step).max()) > _EVEN * step + rounding:
        raise MeasurementError("its waveform has no even times; export it as text")
    return Clock(float(times[0]), step)


def read_tdms(path: Path) -> Table:
    """Return the channels of a LabVIEW TDMS file. Raises MeasurementError and OSError."""
    try:
        from nptdms import TdmsFile
    except ImportError:
        raise missing("TDMS", "nptdms") from None
    found: list[Named] = []
    allowance = Allowance(path)
    with asking("TDMS"), listening("nptdms") as said, TdmsFile.open(path) as file:
        for group in file.groups():
            for channel in group.channels():
                if len(channel) < 2:
                    continue
                allowance.spend(len(channel) * np.dtype(channel.dtype or object).itemsize)
                values = np.asarray(channel[:])
                unit = channel.properties.get("unit_string") or None
                if values.dtype.kind == "M":  # dates: seconds from the first one
                    values, unit = (values - values[0]) / np.timedelta64(1, "s"), "s"
                if values.dtype.kind not in "fiu":
                    continue
                step = float(channel.properties.get("wf_increment", 0.0))
                start = float(channel.properties.get("wf_start_offset", 0.0))
                clock = Clock(start, step) if 0.0 < step < math.inf else None
                found.append((f"{group.name}/{channel.name}", unit, values, clock))
    if not found:
        raise MeasurementError("its TDMS holds no channel with numbers")
    return Table.of(found, tuple(f"its TDMS is damaged: {text}" for text in said))


def read_uff(path: Path) -> Table:
    """Return the functions of time in a universal file. Raises MeasurementError and OSError."""
    try:
        import pyuff
    except ImportError:
        raise missing("universal files", "pyuff") from None
    found: list[Named] = []
    with asking("universal file"):
        file = pyuff.UFF(str(path))
        kinds = np.atleast_1d(file.get_set_types())
        for k in np.flatnonzero(kinds == 58).tolist():
            found += _function(file.read_sets(k))
    if not found:
        raise MeasurementError("it holds no function over time (data set 58)")
    return Table.of(found)


def _function(data: Any) -> Iterator[Named]:
    """Yield a data set 58 that is a real function of time."""
    values = np.asarray(data["data"])
    if int(data.get("num_pts", len(values))) != len(values):
        raise MeasurementError(
            f"a function has {len(values)} values, but states {data['num_pts']}; write it anew"
        )
    if int(data.get("abscissa_spec_data_type", 0)) not in (0, _SPECIFIC_TIME):
        return
    if int(data.get("func_type", 0)) not in (0, 1) or values.dtype.kind == "c" or len(values) < 2:
        return
    times = np.asarray(data["x"], dtype=np.float64)
    label = str(data.get("ordinate_axis_units_lab", "")).strip()
    unit = _SPECIFIC.get(int(data.get("ordinate_spec_data_type", 0)))
    stated = label if label and label.upper() != "NONE" else unit
    name = str(data.get("id1", "")).strip()
    name = name if name and name.upper() != "NONE" else f"set {data.get('rsp_node', 0)}"
    label_t = str(data.get("abscissa_axis_units_lab", "")).strip()
    if label_t and label_t.upper() not in ("NONE", "S", "SEC", "SECONDS"):
        yield f"{name} time", label_t, times, None
        yield name, stated, values, None
    elif int(data.get("abscissa_spec_data_type", 0)) == _SPECIFIC_TIME or label_t:
        if int(data.get("abscissa_spacing", 1)) == 1:
            yield name, stated, values, clock_of(times)
        else:
            yield f"{name} time", "s", times, None
            yield name, stated, values, None
