# SPDX-License-Identifier: Apache-2.0
"""Parts of plots as plain data for plotly.js: lines, axes, layouts."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Figure = dict[str, Any]


def line_of(
    x: Array, y: Array, name: str, color: str, unit: str, x_unit: str, **more: Any
) -> Figure:
    """Return a line through points; units are those that x and y are given in."""
    return {
        "type": "scatter",
        "mode": "lines",
        "x": digits_of(x),
        "y": digits_of(y),
        "name": name,
        "line": {"color": color, "width": 1.5},
        "hovertemplate": f"%{{x}} {x_unit}, %{{y}} {unit}",
        **more,
    }


def digits_of(values: Array) -> list[float | None]:
    """Return seven digits of the largest: what a plot can show, in little space."""
    finite = values[np.isfinite(values)]
    size = float(np.max(np.abs(finite), initial=0.0))
    places = 7 - int(np.ceil(np.log10(size))) if size > 0.0 else 0
    rounded = np.round(values, places).tolist()
    return [value if np.isfinite(value) else None for value in rounded]


def axis_of(title: str, **more: Any) -> Figure:
    """Return an axis with a title."""
    return {"title": {"text": title, "standoff": 6}, "automargin": True, **more}


def layout_of(height: int, **more: Any) -> Figure:
    """Return the frame of a plot of a height in pixels."""
    return {
        "height": height,
        "margin": {"l": 60, "r": 12, "t": 34, "b": 44},
        "legend": {"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 0},
        "hovermode": "closest",
        "dragmode": "zoom",
        **more,
    }
