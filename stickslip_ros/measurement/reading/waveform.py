# SPDX-License-Identifier: Apache-2.0
"""Oscilloscopes' own files, through RigolWFM: Rigol, Tektronix, LeCroy, Keysight, Siglent, R&S, ...

The library assumes that every trace is in volts over seconds, and reads the places that the headers
name, even if the file is cut. But a trace may also be a spectrum, a current or a length from the
scope's mathematics, or a row of segments. So axes and size of a file are read here, by the
library's descriptions of the formats, or by the makers' manuals that `RigolWFM` names.
"""

from __future__ import annotations

import importlib
import io
import re
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_ros.measurement.reading import paired_files
from stickslip_ros.measurement.reading.instruments import asking, even_clock, library
from stickslip_ros.measurement.reading.table import Clock, MeasurementError, Named, Table
from stickslip_ros.opening import open_regular

#: Bytes at the start of a file that hold its header.
_HEAD = 65536
#: Numbers in a preamble by Tektronix that the library would make up, by their long key.
_ISF_NUMBERS = ("XINCR", "YMULT", "YOFF", "YZERO")
#: Keysight's numbers of units.
_KEYSIGHT = {1: "V", 2: "s", 4: "A", 5: "dB", 6: "Hz"}
#: Start of the part behind the checksum, in files of newer scopes by Tektronix.
_META = b"tekmeta!"
#: Bytes before the samples of Rigol's DS1000 families.
_RIGOL_HEADS = (276, 272, 256)


@dataclass(frozen=True)
class _Axes:
    """The axes of a file; None for missing information."""

    along: str | None = None  #: unit of the axis that the library calls time
    value: str | None = None
    segments: int = 1


def read_waveform(path: Path) -> Table:
    """Return the channels of an oscilloscope's own file. Raises MeasurementError and OSError."""
    wfm = library("RigolWFM.wfm", "waveforms of oscilloscopes", "RigolWFM")
    path = paired_files.description_of(path)
    with open_regular(path) as file:
        head = file.read(_HEAD)
    found: list[Named] = []
    with asking("waveform"):
        axes = _axes(path, head)
        if axes.along is not None and axes.along.lower() not in ("", "s", "sec", "second"):
            raise MeasurementError(f"its waveform is over {axes.along}, not over time")
        if axes.segments > 1:
            raise MeasurementError(
                f"its waveform has {axes.segments} segments with gaps between them; export one "
                "as text"
            )
        for channel in wfm.Wfm.from_file(str(path)).channels:
            if not channel.enabled or channel.volts is None or channel.times is None:
                continue
            times, volts = np.asarray(channel.times), np.asarray(channel.volts)
            if volts.ndim == 1 and len(volts) > 1 and len(times) == len(volts):
                unit = {"v": "V", "a": "A", "w": "W"}.get(str(channel.unit.name).lower())
                clock = _clock(even_clock(times), float(channel.seconds_per_point), len(times))
                found.append((channel.name, axes.value or unit, volts, clock))
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
    # A number stored with seven digits means the shortest number that gives them.
    return Clock(seen.start, float(str(single)) if float(single) == stated else stated)


def _axes(path: Path, head: bytes) -> _Axes:
    """Return the axes of a file. Raises MeasurementError if it is damaged."""
    size = path.stat().st_size
    try:
        if b":CURV" in head:
            return _isf(head, size)
        if b"WAVEDESC" in head:
            return _lecroy(path, head, size)
        if head[3:7] == b"WFM#":
            return _tektronix(path, head)
        if head[:2] in (b"AG", b"RG"):
            return _keysight(path, head, size)
        if head[:4] == b"\xa5\xa5\0\0":
            return _rigol(head, size)
    except struct.error:
        raise MeasurementError("its waveform ends within a header: it is damaged") from None
    return _Axes(value=paired_files.sample_unit(path) if head.startswith(b"<?xml") else None)


def _check_size(expected: int, size: int) -> None:
    if expected != size:
        raise MeasurementError(
            f"its waveform takes {expected} bytes, but there are {size}: it is damaged"
        )


def _isf(head: bytes, size: int) -> _Axes:
    """Tektronix's ``.isf``: keys with values, long or short, then a block of samples."""
    preamble, _, block = head.partition(b":CURV")
    pairs = (part.split(None, 1) for part in preamble.decode("latin-1").split(";"))
    facts = {pair[0].rpartition(":")[2]: pair[1].strip(' "') for pair in pairs if len(pair) == 2}

    def fact(key: str, short: str) -> str | None:
        return facts.get(key, facts.get(short))

    for key in _ISF_NUMBERS:
        if not re.fullmatch(r"[-+]?[\d.]+(?:[eE][-+]?\d+)?", fact(key, key[:3]) or ""):
            raise MeasurementError(f"its preamble states no {key}: it is damaged; save it anew")
    counts, width = fact("NR_PT", "NR_P"), fact("BYT_NR", "BYT_N")
    found = re.match(rb"E? +#(\d)", block)
    if found and counts and width:
        start = found.end() + int(found[1])
        stated = int(block[found.end() : start])
        there = size - len(preamble) - len(b":CURV") - start
        _check_size(int(counts) * int(width), stated)
        if there not in (stated, stated + 1, stated + 2):  # a line end may follow
            _check_size(stated, there)
    return _Axes(fact("XUNIT", "XUN"), fact("YUNIT", "YUN"))


def _lecroy(path: Path, head: bytes, size: int) -> _Axes:
    """LeCroy's ``.trc``: a header that states the sizes of all parts."""
    start = head.index(b"WAVEDESC")
    version = "1_0" if head[start + 16 :].startswith(b"LECROY_1_0") else "2_3"
    order = "le" if head[start + 34] == 1 else "be"
    said = _parse(f"lecroy_{version}_{order}_trc", path, start).wavedesc
    if version != "1_0":
        samples = int(said.wave_array_1_len)
        _check_size(int(said.wave_array_count) * (2 if said.is_16bit else 1), samples)
        parts = (said.wave_descriptor, said.user_text_len, said.trigtime_array_len,
                 said.ris_time_array_len, said.wave_array_2_len)  # fmt: skip
        _check_size(samples + sum(map(int, parts)), size - start)
    return _Axes(_text(said.hor_unit), _text(said.vert_unit), int(said.subarray_count))


def _tektronix(path: Path, head: bytes) -> _Axes:
    """Tektronix's ``.wfm``: the sum of all bytes before it, then nothing or facts by name."""
    little = head[:1] == b"\x0f"
    content, order = path.read_bytes(), "<" if little else ">"
    end = 15 + struct.unpack_from(f"{order}i", content, 11)[0]
    if not 8 < end <= len(content) or content[end : end + len(_META)] not in (b"", _META):
        _check_size(end, len(content))
    (stated,) = struct.unpack_from(f"{order}Q", content, end - 8)
    found = int(np.frombuffer(content, np.uint8, end - 8).sum(dtype=np.uint64))
    if stated not in (0, found):  # some programs leave it out
        raise MeasurementError(f"its bytes add up to {found}, not {stated}: it is damaged")
    version = "001" if head[3:10] == b"WFM#001" else "002"
    said = _parse(f"tektronix_wfm_{version}_{'le' if little else 'be'}_wfm", path, 0)
    along, value = said.wfm_header.imp_dim1.units, said.wfm_header.exp_dim1.units
    return _Axes(_text(along), _text(value), int(getattr(said, "n_frames", 1) or 1))


def _keysight(path: Path, head: bytes, size: int) -> _Axes:
    """Keysight's and Rigol's ``.bin``: waveforms one after the other, each with its buffers."""
    units: set[int] = set()
    with path.open("rb") as file:

        def number(place: int, form: str) -> int:
            file.seek(place)
            (found,) = struct.unpack(form, file.read(struct.calcsize(form)))
            return int(found)

        # Since version 3 sizes have 64 bits.
        long = head[:4] in (b"AG03", b"RG03")
        at = 16 if long else 12
        for _ in range(number(at - 4, "<I")):
            buffers, points = number(at + 8, "<I"), number(at + 12, "<I")
            units.add(number(at + 48, "<I"))
            at += number(at, "<I")
            for _ in range(buffers):
                width, length = number(at + 6, "<H"), number(at + 8, "<Q" if long else "<I")
                if width * points != length or at > size:
                    raise MeasurementError(
                        f"its waveform states {points} samples in {length} bytes: it is damaged"
                    )
                at += number(at, "<I") + length
    _check_size(at, size)
    # Rigol's numbers of units are not published.
    known = sorted(units) if head[:2] == b"AG" else []
    return _Axes(" and ".join(_KEYSIGHT.get(unit, "") for unit in known))


def _rigol(head: bytes, size: int) -> _Axes:
    """Rigol's ``.wfm`` of DS1000C, D and E: a byte a sample, two where logic was recorded."""
    (points,) = struct.unpack_from("<I", head, 28)
    bytes_each = int(head[49] != 0) + int(head[73] != 0) + 2 * (head[120] & 1)
    expected = [start + bytes_each * points for start in _RIGOL_HEADS]
    if size not in expected:
        _check_size(expected[0], size)
    return _Axes()


def _parse(module: str, path: Path, start: int) -> Any:
    """Return the parts of a file, from a byte on, as the library's description has them."""
    from kaitaistruct import KaitaiStream  # comes with the library

    part = importlib.import_module(f"RigolWFM.{module}")
    name = "".join(word.capitalize() for word in module.split("_"))
    kind = next(value for key, value in vars(part).items() if key.lower() == name.lower())
    with path.open("rb") as file:
        file.seek(start)
        return kind(KaitaiStream(io.BytesIO(file.read())))


def _text(raw: bytes) -> str | None:
    return raw.split(b"\0")[0].decode("latin-1").strip() or None
