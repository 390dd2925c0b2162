# SPDX-License-Identifier: Apache-2.0
"""Oscilloscopes' own files, through RigolWFM: Rigol, Tektronix, LeCroy, Keysight, Siglent, R&S, ...

The library takes every trace for volts over seconds. A trace may as well be a spectrum, a current
or a length from the scope's mathematics, or a row of segments: that is read here from the library's
descriptions of the formats, so that no such trace is taken for what it is not.
"""

from __future__ import annotations

import importlib
import io
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_ros.measurement.reading import rohde_schwarz, waveform_damage
from stickslip_ros.measurement.reading.arrays import Named
from stickslip_ros.measurement.reading.instruments import clock_of
from stickslip_ros.measurement.reading.libraries import asking, missing
from stickslip_ros.measurement.reading.table import Clock, MeasurementError, Table
from stickslip_ros.opening import open_regular

#: Bytes at the start of a file that hold its header.
_HEAD = 65536
_ISF_UNIT = re.compile(rb'(?:XUNI?T?|XUN)\s+"([^"]*)"')
_ISF_VALUE_UNIT = re.compile(rb'(?:YUNI?T?|YUN)\s+"([^"]*)"')
_ISF_BLOCK = re.compile(rb":CURVE? +#(\d)")
_ISF_COUNT = re.compile(rb"NR_P(?:T)? +(\d+)")
_ISF_WIDTH = re.compile(rb"BYT_N(?:R)? +(\d)")
_ISF_NUMBERS = {
    name: re.compile(rb"[;: ]" + name[:3].encode() + rb"[A-Z]*\s+[-+]?[\d.]+(?:[eE][-+]?\d+)?\s*;")
    for name in ("XINCR", "YMULT", "YOFF", "YZERO")
}
#: Keysight's numbers of units.
_KEYSIGHT = {1: "V", 2: "s", 4: "A", 5: "dB", 6: "Hz"}


@dataclass(frozen=True)
class _Axes:
    """What a file says of its axes; None where it says nothing."""

    along: str | None = None  #: unit of what the library takes for time
    value: str | None = None
    segments: int = 1
    expected: int | None = None  #: bytes that the waveform says it takes
    size: int = 0  #: bytes that there are


def read_waveform(path: Path) -> Table:
    """Return the channels of an oscilloscope's own file. Raises MeasurementError and OSError."""
    try:
        from RigolWFM import wfm
    except ImportError:
        raise missing("waveforms of oscilloscopes", "RigolWFM") from None
    path = rohde_schwarz.description_of(path)
    with open_regular(path) as file:
        head = file.read(_HEAD)
    found: list[Named] = []
    with asking("waveform"):
        waveform_damage.check(path, head)
        axes = _axes(path, head)
        _refuse(axes)
        scope = wfm.Wfm.from_file(str(path))
        for channel in scope.channels:
            if not channel.enabled or channel.volts is None or channel.times is None:
                continue
            times, volts = np.asarray(channel.times), np.asarray(channel.volts)
            if volts.ndim != 1 or len(volts) < 2 or len(times) != len(volts):
                continue
            unit = {"v": "V", "a": "A", "w": "W"}.get(str(channel.unit.name).lower())
            clock = _clock(clock_of(times), float(channel.seconds_per_point), len(times))
            found.append((channel.name, axes.value or unit, volts, clock))
    if not found:
        raise MeasurementError("its waveform holds no channel")
    return Table.of(found)


def _clock(seen: Clock, stated: float, count: int) -> Clock:
    """Return the clock with the step (s) that the file states.

    For some scopes the library spreads the times over the whole record, from its start to its
    end, which makes the step longer by a part in the count of samples. Raises MeasurementError if
    both differ by more.
    """
    if not stated > 0.0 or not np.isfinite(stated):
        return seen
    if abs(seen.step / stated - 1.0) > 2.0 / count:
        raise MeasurementError(f"its times are {seen.step:g} s apart, but it states {stated:g} s")
    single = np.float32(stated)
    # What was stored with seven digits meant the shortest number that gives them.
    return Clock(seen.start, float(str(single)) if float(single) == stated else stated)


def _refuse(axes: _Axes) -> None:
    if axes.along is not None and axes.along.lower() not in ("", "s", "sec", "second"):
        raise MeasurementError(f"its waveform is over {axes.along}, not over time")
    if axes.expected is not None and axes.expected != axes.size:
        raise MeasurementError(
            f"its waveform takes {axes.expected} bytes, but there are {axes.size}: it is damaged"
        )
    if axes.segments > 1:
        raise MeasurementError(
            f"its waveform has {axes.segments} segments with gaps between them; export one as text"
        )


def _axes(path: Path, head: bytes) -> _Axes:
    """Return what a file says of its axes."""
    if b":CURV" in head:
        along, value = _ISF_UNIT.search(head), _ISF_VALUE_UNIT.search(head)
        expected, size = _isf_sizes(path, head)
        return _Axes(
            _text(along[1]) if along else None,
            _text(value[1]) if value else None,
            expected=expected,
            size=size,
        )
    if b"WAVEDESC" in head:
        start = head.index(b"WAVEDESC")
        version = "1_0" if head[start + 16 :].startswith(b"LECROY_1_0") else "2_3"
        order = "le" if head[start + 34] == 1 else "be"
        described = _parsed(f"lecroy_{version}_{order}_trc", path, start).wavedesc
        axes = _Axes(
            _text(described.hor_unit), _text(described.vert_unit), int(described.subarray_count)
        )
        return axes if version == "1_0" else _with_size(axes, described, path, start)
    if head[3:7] == b"WFM#":
        version = "001" if head[3:10] == b"WFM#001" else "002"
        order = "le" if head[:1] == b"\x0f" else "be"
        described = _parsed(f"tektronix_wfm_{version}_{order}_wfm", path, 0)
        header, frames = described.wfm_header, int(getattr(described, "n_frames", 1) or 1)
        return _Axes(_text(header.imp_dim1.units), _text(header.exp_dim1.units), frames)
    if head[:2] == b"AG":
        waveforms = _parsed("agilent_agxx_bin", path, 0).waveforms
        units = {int(one.wfm_header.x_units) for one in waveforms}
        return _Axes(" and ".join(_KEYSIGHT.get(unit, "") for unit in sorted(units)))
    if head.startswith(b"<?xml"):
        return _Axes(value=rohde_schwarz.unit_of(path))
    return _Axes()


def _with_size(axes: _Axes, described: Any, path: Path, start: int) -> _Axes:
    """Add the bytes that the parts of a LeCroy trace say they take, and those there are."""
    samples = int(described.wave_array_1_len)
    parts = (
        described.wave_descriptor,
        described.user_text_len,
        described.trigtime_array_len,
        described.ris_time_array_len,
        described.wave_array_2_len,
    )
    whole = int(described.wave_array_count) * (2 if described.is_16bit else 1) == samples
    expected = samples + sum(map(int, parts)) if whole else -1
    return replace(axes, expected=expected, size=path.stat().st_size - start)


def _isf_sizes(path: Path, head: bytes) -> tuple[int | None, int]:
    """Return the bytes that the block of samples says it has, and those there are.

    Raises MeasurementError without the numbers that the library would make up.
    """
    for name, number in _ISF_NUMBERS.items():
        if not number.search(head):
            raise MeasurementError(f"its preamble states no {name}: it is damaged; save it anew")
    found = _ISF_BLOCK.search(head)
    count = _ISF_COUNT.search(head)
    width = _ISF_WIDTH.search(head)
    if not found or not count or not width:
        return None, 0
    digits = int(found[1])
    start = found.end() + digits
    stated = int(head[found.end() : start])
    there = path.stat().st_size - start
    if int(count[1]) * int(width[1]) != stated:
        return -1, there
    # A line end may follow the block.
    return stated, stated if there in (stated, stated + 1, stated + 2) else there


def _parsed(module: str, path: Path, start: int) -> Any:
    """Return the parts of a file, from a byte on, as the library's description has them."""
    from kaitaistruct import KaitaiStream

    part = importlib.import_module(f"RigolWFM.{module}")
    name = "".join(word.capitalize() for word in module.split("_"))
    kind = next(value for key, value in vars(part).items() if key.lower() == name.lower())
    with path.open("rb") as file:
        file.seek(start)
        return kind(KaitaiStream(io.BytesIO(file.read())))


def _text(raw: bytes) -> str | None:
    return raw.split(b"\0")[0].decode("latin-1").strip() or None
