# SPDX-License-Identifier: Apache-2.0
"""The page of a twin: measured and expected, residual, step size and parameters over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.pages.measured import TINTS
from stickslip_ros.parameters import PARAMETERS
from stickslip_ros.reporting import CONFIDENCE, MEASURED, SIMULATED, format_si
from stickslip_ros.reporting.page import PlotPlace, ResultPage
from stickslip_ros.reporting.plots import (
    Figure,
    axis_of,
    layout_of,
    line_of,
    stretch_of,
    thin_columns,
)
from stickslip_ros.twin import Twin, Update

Array = NDArray[np.float64]

#: Points of a line; colour of a band
_POINTS, _BAND = 4000, "#9db4d8"


def twin_page(twin: Twin, updates: Sequence[Update], source: str) -> ResultPage:
    """Return the page of a twin that has taken the readings of a source."""
    level, reason = twin.level
    parts = {
        "source": source,
        "level": level,
        "reason": reason,
        "readings": len(updates),
        "stepping": format_si(twin.driven, "s"),
        "estimates": twin.estimates(),
        "changes": twin.changes,
        "troubles": twin.troubles,
    }
    return ResultPage("twin.html", _plots(twin, updates), parts)


def _plots(twin: Twin, updates: Sequence[Update]) -> list[PlotPlace]:
    """Return the plots with their descriptions; changes are marked in each."""
    t, measured, expected, deviation = np.array([one[:4] for one in updates]).T
    nm = 1e9
    places = [
        ("position", "Measured and expected", "position (µm)",
         [(t, 1e-3 * nm * measured, None, "measured", MEASURED),
          (t, 1e-3 * nm * expected, None, "expected", SIMULATED)]),
        ("residual", "Residual", "measured less expected (nm)",
         [(t, nm * (measured - expected), CONFIDENCE * nm * deviation, "residual", MEASURED)]),
    ]  # fmt: skip
    history = twin.history
    if len(history) > 1:
        when = np.array([one.t for one in history])
        steps = np.array([(one.step_size, one.step_deviation) for one in history]).T
        places.append(
            ("step", "Step size", "step size (nm)",
             [(when, nm * steps[0], CONFIDENCE * nm * steps[1], "step size", SIMULATED)])
        )  # fmt: skip
        for k, name in enumerate(twin.tracker.names):
            value = np.array([one.values[k] for one in history])
            wide = CONFIDENCE * value * np.array([one.deviations[k] for one in history])
            places.append(
                (f"parameter-{k}", f"Parameter {name}", f"{name} ({PARAMETERS[name].unit})",
                 [(when, value, wide, name, SIMULATED)])
            )  # fmt: skip
    found = []
    for name, heading, y_name, lines in places:
        about = f"{heading} over time{', with 95 % bands' if lines[0][2] is not None else ''}."
        found.append(PlotPlace(name, heading, about, _figure(twin, y_name, lines)))
    return found


def _figure(
    twin: Twin, y_name: str, lines: Sequence[tuple[Array, Array, Array | None, str, str]]
) -> Figure:
    data = []
    for t, y, band, name, color in lines:
        columns = (y,) if band is None else (y, band)
        at, values, *wide = thin_columns(t, *columns, count=_POINTS)
        # The band of the residual lies about what is expected.
        middle = 0.0 if name == "residual" else values
        for half in (wide[0], -wide[0]) if wide else ():
            data.append(line_of(at, middle + half, "95 %", _BAND, "", "s"))
        data.append(line_of(at, values, name, color, "", "s"))
    shapes = [stretch_of(one.onset, one.told, TINTS[1]) for one in twin.changes]
    frame = layout_of(
        300, xaxis=axis_of("time (s)"), yaxis=axis_of(y_name), shapes=shapes, showlegend=False
    )
    return {"data": data, "layout": frame}
