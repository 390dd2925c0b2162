# SPDX-License-Identifier: Apache-2.0
"""The registry of waveforms. A new one is a file beside these and a line in `WAVEFORMS`.

A waveform is arithmetic on parameters, written once for an operating point and for columns of many:
numbers in the parameters may be arrays. The constants that only this waveform has are
its rows: a frozen dataclass in the attribute ``rows`` of the function, see `with_rows`.

This room loads neither numba nor numpy, because the table of parameters needs it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from stickslip_ros.parameters import DriveParameters, register
from stickslip_ros.waveforms.built_in import (
    Shape,
    hold_shape,
    sawtooth_shape,
    shaped_shape,
    triangle_shape,
    with_rows,
)
from stickslip_ros.waveforms.table import table_shape

#: Waveforms by the name that the parameter ``waveform`` takes.
WAVEFORMS: Mapping[str, Callable[[DriveParameters], Shape]] = {
    "sawtooth": sawtooth_shape,
    "hold": hold_shape,
    "shaped": shaped_shape,
    "triangle": triangle_shape,
    "table": table_shape,
}

for _waveform in WAVEFORMS.values():
    if hasattr(_waveform, "rows"):
        register("drive", _waveform.rows)

__all__ = ["WAVEFORMS", "Shape", "with_rows"]
