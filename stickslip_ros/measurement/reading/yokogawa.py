# SPDX-License-Identifier: Apache-2.0
"""Yokogawa's pair of files: ``X.hdr`` describes the samples in ``X.wvf``.

The layout is that of Yokogawa's manual IM 707713-61E, which RigolWFM reads. Its `Wfm` keeps four
traces of the first group; here all are read, with units, and samples beyond the range are gaps.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from stickslip_ros.measurement.reading.libraries import asking, library
from stickslip_ros.measurement.reading.table import Clock, MeasurementError, Named, Table

#: How files begin that have the scope's own settings before and behind the samples.
_OWN = b"%WDF"


def read_wvf(path: Path) -> Table:
    """Return the traces of a pair, of which either may be named. MeasurementError and OSError."""
    layouts = library("RigolWFM.yokogawa_hdr", "waveforms of oscilloscopes", "RigolWFM")
    described, samples = _beside(path, ".hdr"), _beside(path, ".wvf")
    found: list[Named] = []
    with asking("Yokogawa waveform"):
        header = layouts.parse_hdr(str(described))
        content = samples.read_bytes()
        _check(header, samples.name, content)
        for g, group in enumerate(header.groups):
            for k, trace in enumerate(group.traces):
                kind = trace.v_data_type
                if kind.is_logic or trace.h_unit != "s" or trace.block_size < 2:
                    continue
                form = f"{header.byte_order}{kind.numpy_dtype}"
                place = layouts.wvf_byte_offset(header, g, k, 0)
                raw = np.frombuffer(content, form, trace.block_size, place)
                clock = Clock(trace.h_offset, trace.h_resolution)
                found.append((trace.name, trace.v_unit, _values(raw, trace), clock))
    return Table.of(found)


def _beside(path: Path, suffix: str) -> Path:
    """Return the file of that suffix, of the same name. Raises MeasurementError."""
    if path.suffix.lower() == suffix:
        return path
    for one in (suffix, suffix.upper()):
        if path.with_suffix(one).is_file():
            return path.with_suffix(one)
    raise MeasurementError(f"its {path.stem}{suffix} is not beside it; copy both")


def _check(header: Any, name: str, content: bytes) -> None:
    """Refuse a header of which not all traces can be read from the content. MeasurementError."""
    expected = header.data_offset
    for group in header.groups:
        if group.block_number != 1:
            raise MeasurementError(
                f"its waveform has {group.block_number} blocks with gaps between them; export one "
                "as text"
            )
        for trace in group.traces:
            if trace.v_data_type is None:
                raise MeasurementError(f"the form of the samples of {trace.name} is not known")
            expected += trace.block_size * trace.v_data_type.byte_num
    size = len(content)
    if size < expected or (size > expected and not content.startswith(_OWN)):
        raise MeasurementError(
            f"its waveform takes {expected} bytes, but {name} has {size}: it is damaged"
        )


def _values(raw: Any, trace: Any) -> Any:
    """Return samples in the unit of the trace; nan where it states that there is none."""
    values = trace.v_resolution * raw.astype(np.float64) + trace.v_offset
    for code in (trace.v_illegal, trace.v_plus_over, trace.v_minus_over):
        if code is not None:
            # A header may state the code of 16 bits without its sign.
            values[(raw == code) | (raw == code - (1 << 8 * raw.itemsize))] = np.nan
    return values
