# SPDX-License-Identifier: Apache-2.0
"""Files read by external libraries: LabVIEW's TDMS, universal files, waveforms of oscilloscopes.

A library is loaded when a file needs it; its errors, or that it is not installed, become a
MeasurementError.

Oscilloscopes' own files (Rigol, Tektronix, LeCroy, Keysight, Siglent, ...) are read by RigolWFM,
which takes every trace for volts over seconds. But a trace may also be a spectrum, a current or a
length from the scope's mathematics, or a row of segments: so the units of its axes are read here.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import math
import warnings
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_ros.base.opening import Allowance, ReadError, open_regular
from stickslip_ros.measurement.reading.table import Clock, Column, MeasurementError, Table

#: Characters of a library's message that are shown.
LONGEST_MESSAGE = 160
#: Quantities of a data set of universal file format 58, by its numbers.
_SPECIFIC_TIME, _SPECIFIC = 17, {8: "m", 11: "m/s", 12: "m/s^2", 13: "N"}
#: Bytes at the start of an oscilloscope's file that hold its header.
_HEAD = 65536
#: Keysight's numbers of units.
_KEYSIGHT = {1: "V", 2: "s", 4: "A", 5: "dB", 6: "Hz"}


@contextlib.contextmanager
def asking(kind: str, known: Mapping[str, str] = {}) -> Iterator[None]:
    """Turn errors of a library about a broken file into a MeasurementError; hide its output.

    known are sentences for errors that contain some words.
    """
    redirect, said = contextlib.redirect_stdout, io.StringIO()
    with warnings.catch_warnings(), redirect(said), contextlib.redirect_stderr(said):
        warnings.simplefilter("ignore")
        try:
            yield
        except (MeasurementError, ReadError):
            raise
        except ModuleNotFoundError as error:  # they come with pip install stickslip_ros[formats]
            package = str(error.name).partition(".")[0]
            raise MeasurementError(
                f"{kind} is read by {package}, which is not installed; install it with pip install "
                f"{package}, or export the measurement as text"
            ) from None
        except Exception as error:  # the libraries raise of every kind
            text = " ".join(str(error).split())[:LONGEST_MESSAGE] or type(error).__name__
            cannot = f"its {kind} cannot be read: {text}; export it as text"
            said_of = (sentence for words, sentence in known.items() if words in str(error))
            raise MeasurementError(next(said_of, cannot)) from None


def read_tdms(path: Path) -> Table:
    """Return the channels of a LabVIEW TDMS file. Raises MeasurementError and OSError.

    Their clocks count from the earliest start.
    """
    said, found, allowance = io.StringIO(), list[Column](), Allowance(path)
    with asking("TDMS"):
        nptdms = importlib.import_module("nptdms")
        before = nptdms.log.log_manager.console_handler.setStream(said)
        try:
            with nptdms.TdmsFile.open(path) as file:
                channels = [c for group in file.groups() for c in group.channels() if len(c) >= 2]
                starts = [c.properties.get("wf_start_time") for c in channels]
                dated = [start for start in starts if isinstance(start, np.datetime64)]
                for channel, start in zip(channels, starts, strict=True):
                    allowance.spend(len(channel) * np.dtype(channel.dtype or object).itemsize)
                    values, facts = np.asarray(channel[:]), channel.properties
                    step = float(facts.get("wf_increment", 0.0))
                    begin = float(facts.get("wf_start_offset", 0.0))
                    if isinstance(start, np.datetime64):
                        begin += float((start - min(dated)) / np.timedelta64(1, "s"))
                    clock = Clock(begin, step) if 0.0 < step < math.inf else None
                    name, unit = f"{channel.group_name}/{channel.name}", facts.get("unit_string")
                    if values.dtype.kind in "cfiuM":
                        found.append(Column(name, unit or None, clock, values))
        finally:
            nptdms.log.log_manager.console_handler.setStream(before)
    faults = said.getvalue().splitlines()[:1]
    notes = tuple(f"its TDMS is damaged: {text[:LONGEST_MESSAGE]}" for text in faults)
    return Table.of(found, notes=notes)


def read_uff(path: Path) -> Table:
    """Return the functions of time in a universal file. Raises MeasurementError and OSError."""
    found: list[Column] = []
    with asking("universal file"):
        file = importlib.import_module("pyuff").UFF(str(path))
        kinds = np.atleast_1d(file.get_set_types())
        for k in np.flatnonzero(kinds == 58).tolist():
            found += _function(file.read_sets(k))
    return Table.of(found)


def _function(data: Mapping[str, Any]) -> Iterator[Column]:
    """Yield a data set 58 that is a real function of time."""
    values, numbers = np.asarray(data["data"]), defaultdict(int, data)
    if (stated := int(data.get("num_pts", len(values)))) != len(values):
        raise MeasurementError(
            f"a function has {len(values)} values, but states {stated}; write it anew"
        )
    texts = {key: str(value).strip() for key, value in data.items()}
    along, unit, name = (
        "" if (text := texts.get(key, "")).upper() == "NONE" else text
        for key in ("abscissa_axis_units_lab", "ordinate_axis_units_lab", "id1")
    )
    of_time = numbers["abscissa_spec_data_type"] == _SPECIFIC_TIME or (
        along and numbers["abscissa_spec_data_type"] == 0
    )
    if not of_time or numbers["func_type"] not in (0, 1) or values.dtype.kind == "c":
        return
    name = name or f"set {numbers['rsp_node']}"
    known = unit or _SPECIFIC.get(numbers["ordinate_spec_data_type"])
    seconds = along.upper() in ("", "S", "SEC", "SECONDS")
    if seconds and numbers["abscissa_spacing"] == 1 and numbers["abscissa_inc"] > 0.0:
        clock = Clock(float(numbers["abscissa_min"]), float(numbers["abscissa_inc"]))
        yield Column(name, known, clock, values)
    else:
        yield Column(f"{name} time", "s" if seconds else along, None, np.asarray(data["x"], float))
        yield Column(name, known, None, values)


def read_waveform(path: Path) -> Table:
    """Return the channels of an oscilloscope's own file. Raises MeasurementError and OSError."""
    with open_regular(path) as file:
        content = file.read()
    found: list[Column] = []
    with asking("waveform"):
        wfm = importlib.import_module("RigolWFM.wfm")
        along, value, segments = _axes(content)
        if along and along.lower() not in ("s", "sec", "second"):
            raise MeasurementError(f"its waveform is over {along}, not over time")
        if segments > 1:
            raise MeasurementError(
                f"its waveform has {segments} segments with gaps between them; export one as text"
            )
        for channel in wfm.Wfm.from_file(str(path)).channels:
            if not channel.enabled or channel.volts is None or channel.times is None:
                continue
            times, volts = np.asarray(channel.times), np.asarray(channel.volts)
            if volts.ndim == 1 and len(volts) > 1 and len(times) == len(volts):
                unit = {"v": "V", "a": "A", "w": "W"}.get(str(channel.unit.name).lower())
                clock = _clock(times, float(channel.seconds_per_point))
                found.append(Column(channel.name, value or unit, clock, volts))
    return Table.of(found)


def _clock(times: Any, stated: float) -> Clock:
    """Return the clock of times with the step (s) that a file states, if it does.

    For some scopes the library spreads the times over the whole record, from its start to its
    end, which makes the step longer by a part in the count of samples. Raises MeasurementError if
    both steps differ by more.
    """
    step = float((times[-1] - times[0]) / (len(times) - 1))
    stated = stated if 0.0 < stated < math.inf else step
    if not abs(step / stated - 1.0) <= 2.0 / len(times):
        raise MeasurementError(
            f"its times are {step:g} s apart, but it states {stated:g} s; export it as text"
        )
    single = np.float32(stated)
    # A number stored with seven digits means the shortest number that gives them.
    return Clock(float(times[0]), float(str(single)) if float(single) == stated else stated)


def _axes(content: bytes) -> tuple[str | None, str | None, int]:
    """Return the units of time and value, None where a file does not say, and its segments."""
    head = content[:_HEAD]
    if b":CURV" in head:  # Tektronix's .isf: keys with values, long or short
        settings = head.partition(b":CURV")[0].decode("latin-1").split(";")
        pairs = (one.partition(" ") for one in settings)
        facts = {key.rpartition(":")[2]: text.strip(' "') for key, _, text in pairs}
        return facts.get("XUNIT", facts.get("XUN")), facts.get("YUNIT", facts.get("YUN")), 1
    if (start := head.find(b"WAVEDESC")) >= 0:
        version = "1_0" if head[start + 16 :].startswith(b"LECROY_1_0") else "2_3"
        order = "le" if head[start + 34] == 1 else "be"
        said = _parse(f"lecroy_{version}_{order}_trc", content[start:]).wavedesc
        return _text(said.hor_unit), _text(said.vert_unit), int(said.subarray_count)
    if head[3:7] == b"WFM#":
        version = "001" if head[3:10] == b"WFM#001" else "002"
        order = "le" if head[:1] == b"\x0f" else "be"
        said = _parse(f"tektronix_wfm_{version}_{order}_wfm", content)
        along, value = said.wfm_header.imp_dim1.units, said.wfm_header.exp_dim1.units
        return _text(along), _text(value), int(getattr(said, "n_frames", 1) or 1)
    if head[:2] == b"AG":
        waves = _parse("agilent_agxx_bin", content).waveforms
        units = {int(one.wfm_header.x_units) for one in waves}
        return " and ".join(_KEYSIGHT.get(one, "") for one in sorted(units)), None, 1
    return None, None, 1


def _parse(module: str, content: bytes) -> Any:
    """Return the parts of a file, as the library's description has them."""
    kind = getattr(importlib.import_module(f"RigolWFM.{module}"), module.title().replace("_", ""))
    return kind.from_bytes(content)


def _text(raw: bytes) -> str:
    return raw.split(b"\0")[0].decode("latin-1").strip()
