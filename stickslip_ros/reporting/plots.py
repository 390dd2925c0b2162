# SPDX-License-Identifier: Apache-2.0
"""Parts of plots as plain data for plotly.js: lines with few points, axes, layouts."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Figure = dict[str, Any]


def line_of(
    x: Array, y: Array, name: str, color: str, unit: str, x_unit: str, **more: Any
) -> Figure:
    """Return a line through points; unit and x_unit are the units of y and x."""
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
    """Round values to seven digits of the largest, which is all that a plot can show."""
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


def stretch_of(start: float, end: float, tint: str, **more: Any) -> Figure:
    """Return a tinted stretch of x, over the whole height unless more says which."""
    return {
        "type": "rect", "xref": "x", "yref": "paper", "x0": start, "x1": end, "y0": 0, "y1": 1,
        "fillcolor": tint, "line": {"width": 0}, "layer": "below", **more,
    }  # fmt: skip


def thin_columns(t: Array, *columns: Array, count: int) -> tuple[Array, ...]:
    """Reduce t and the columns to about count samples: the lowest and highest of each interval.

    The extremes of every column stay, so lines look as they do with all samples.
    """
    if len(t) <= count:
        return (t, *columns)
    stretches = np.array_split(np.arange(len(t)), max(1, count // (2 * len(columns))))
    kept = {0, len(t) - 1}
    for stretch in stretches:
        for column in columns:
            part = column[stretch]
            kept |= {int(stretch[np.argmin(part)]), int(stretch[np.argmax(part)])}
    at = np.array(sorted(kept))
    return (t[at], *(column[at] for column in columns))
