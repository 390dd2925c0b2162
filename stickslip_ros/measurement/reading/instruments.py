# SPDX-License-Identifier: Apache-2.0
"""Files read by external libraries: LabVIEW's TDMS, universal files.

A library is loaded when a file needs it; its errors become a MeasurementError.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import math
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_ros.measurement.reading.table import Clock, MeasurementError, Named, Table
from stickslip_ros.opening import Allowance, ReadError

#: Characters of a library's message that are shown.
_LONGEST = 160
#: Steps of a waveform that differ by less than this share are one.
_EVEN = 1e-3
#: Quantities of a data set of universal file format 58, by its numbers.
_SPECIFIC_TIME, _SPECIFIC = 17, {8: "m", 11: "m/s", 12: "m/s^2", 13: "N"}
#: Placeholder for no text in a universal file.
_NO_TEXT = ("", "NONE")


def library(module: str, what: str, package: str = "") -> Any:
    """Import the library that reads what; package: its name for pip, if different.

    The packages come with ``pip install stickslip_ros[formats]``. Raises MeasurementError.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        package = package or module
        raise MeasurementError(
            f"{what} are read by {package}, which is not installed; install it with "
            f"pip install {package}, or export the measurement as text"
        ) from None


@contextlib.contextmanager
def asking(kind: str) -> Iterator[None]:
    """Turn errors of a library about a broken file into a MeasurementError; hide its output."""
    said = io.StringIO()
    with (
        warnings.catch_warnings(),
        contextlib.redirect_stdout(said),
        contextlib.redirect_stderr(said),
    ):
        warnings.simplefilter("ignore")
        try:
            yield
        except (MeasurementError, ReadError, KeyboardInterrupt):
            raise
        except Exception as error:  # the libraries raise of every kind
            text = " ".join(str(error).split())[:_LONGEST]
            raise MeasurementError(
                f"its {kind} cannot be read: {text or type(error).__name__}; export it as text"
            ) from None


def even_clock(times: Any) -> Clock:
    """Return the clock of even times. Raises MeasurementError."""
    steps = np.diff(times)
    step = float((times[-1] - times[0]) / (len(times) - 1))
    rounding = 4.0 * float(np.spacing(np.abs(times).max()))
    if not step > 0.0 or float(np.abs(steps - step).max()) > _EVEN * step + rounding:
        raise MeasurementError("its waveform has no even times; export it as text")
    return Clock(float(times[0]), step)


def read_tdms(path: Path) -> Table:
    """Return the channels of a LabVIEW TDMS file. Raises MeasurementError and OSError."""
    nptdms = library("nptdms", "TDMS")
    console, said = nptdms.log.log_manager.console_handler, io.StringIO()
    before = console.setStream(said)
    try:
        with asking("TDMS"), nptdms.TdmsFile.open(path) as file:
            found = list(_channels(file, Allowance(path)))
    finally:
        console.setStream(before)
    faults = said.getvalue().splitlines()[:1]
    return Table.of(found, tuple(f"its TDMS is damaged: {text[:_LONGEST]}" for text in faults))


def _channels(file: Any, allowance: Allowance) -> Iterator[Named]:
    """Yield the channels that hold numbers or dates."""
    for channel in (channel for group in file.groups() for channel in group.channels()):
        if len(channel) < 2:
            continue
        allowance.spend(len(channel) * np.dtype(channel.dtype or object).itemsize)
        values, facts = np.asarray(channel[:]), channel.properties
        unit = facts.get("unit_string") or None
        if values.dtype.kind == "M":  # dates: seconds from the first one
            values, unit = (values - values[0]) / np.timedelta64(1, "s"), "s"
        if values.dtype.kind in "fiu":
            step = float(facts.get("wf_increment", 0.0))
            clock = Clock(float(facts.get("wf_start_offset", 0.0)), step)
            known = clock if 0.0 < step < math.inf else None
            yield f"{channel.group_name}/{channel.name}", unit, values, known


def read_uff(path: Path) -> Table:
    """Return the functions of time in a universal file. Raises MeasurementError and OSError."""
    pyuff = library("pyuff", "universal files")
    found: list[Named] = []
    with asking("universal file"):
        file = pyuff.UFF(str(path))
        kinds = np.atleast_1d(file.get_set_types())
        for k in np.flatnonzero(kinds == 58).tolist():
            found += _function(file.read_sets(k))
    return Table.of(found)


def _function(data: Any) -> Iterator[Named]:
    """Yield a data set 58 that is a real function of time."""
    values = np.asarray(data["data"])
    if int(data.get("num_pts", len(values))) != len(values):
        raise MeasurementError(
            f"a function has {len(values)} values, but states {data['num_pts']}; write it anew"
        )

    def text(key: str) -> str | None:
        found = str(data.get(key, "")).strip()
        return None if found.upper() in _NO_TEXT else found

    along = int(data.get("abscissa_spec_data_type", 0))
    unit_t = text("abscissa_axis_units_lab")
    if along not in (0, _SPECIFIC_TIME) or not (along or unit_t):
        return
    if int(data.get("func_type", 0)) not in (0, 1) or values.dtype.kind == "c" or len(values) < 2:
        return
    times = np.asarray(data["x"], dtype=np.float64)
    specific = _SPECIFIC.get(int(data.get("ordinate_spec_data_type", 0)))
    unit = text("ordinate_axis_units_lab") or specific
    name = text("id1") or f"set {data.get('rsp_node', 0)}"
    seconds = unit_t is None or unit_t.upper() in ("S", "SEC", "SECONDS")
    if seconds and int(data.get("abscissa_spacing", 1)) == 1:
        yield name, unit, values, even_clock(times)
    else:
        yield f"{name} time", "s" if seconds else unit_t, times, None
        yield name, unit, values, None
