# SPDX-License-Identifier: Apache-2.0
"""The page of a twin: measured and expected, residual, step size and parameters over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.reporting import CONFIDENCE, MEASURED, SIMULATED, format_si
from stickslip_ros.base.reporting.page import (
    Figure,
    PlotPlace,
    ResultPage,
    axis_of,
    layout_of,
    line_of,
    page,
    stretch_of,
    thin_columns,
)
from stickslip_ros.cli.pages.measured import TINTS
from stickslip_ros.measurement.twin import TrackedParameter
from stickslip_ros.measurement.twin.story import TwinStory

#: x, y, the ends of its band, name, colour
Line = tuple[Array, Array, Array | None, Array | None, str, str]

#: Points of a line; colour of a band
_POINTS, _BAND = 4000, "#9db4d8"


def twin_page(story: TwinStory, live: bool = False) -> ResultPage:
    """Return the page of a twin; a live one asks for `live_parts` at ``/twin``."""
    return ResultPage("twin.html", _plots(story), {**_parts(story), "live": live})


def live_parts(story: TwinStory) -> dict[str, Any]:
    """Return what changes on a live page: its first section, and the plots by name."""
    figures = {plot.name: plot.figure for plot in _plots(story)}
    return {"known": page("twin_known.html", **_parts(story)), "figures": figures}


def _parts(story: TwinStory) -> dict[str, Any]:
    return {
        "source": story.source, "level": story.level, "reason": story.reason,
        "readings": len(story.readings), "stepping": format_si(story.stepping, "s"),
        "estimates": story.history[-1][1] if story.history else [],
        "changes": [text for *_, text in story.changes], "troubles": story.troubles,
    }  # fmt: skip


def _plots(story: TwinStory) -> list[PlotPlace]:
    """Return the plots with their descriptions; changes are marked in each."""
    t, measured, expected, deviation = np.array(list(story.readings)).reshape(-1, 4).T
    nm, um = 1e9, 1e6
    places: list[tuple[str, str, str, list[Line]]] = [
        ("position", "Measured and expected", "position (µm)",
         [(t, um * measured, None, None, "measured", MEASURED),
          (t, um * expected, None, None, "expected", SIMULATED)]),
        ("residual", "Residual", "measured less expected (nm)",
         [(t, nm * (measured - expected), -CONFIDENCE * nm * deviation, CONFIDENCE * nm * deviation,
           "residual", MEASURED)]),
    ]  # fmt: skip
    tracked: dict[str, list[tuple[float, TrackedParameter]]] = {}
    for when, estimates in list(story.history):
        for one in estimates:
            tracked.setdefault(one.name, []).append((when, one))
    for k, (name, found) in enumerate(tracked.items()):
        unit = found[0][1].unit
        at, value, low, high = np.array([(t, one.value, one.low, one.high) for t, one in found]).T
        places.append(
            (f"estimate-{k}", name.capitalize(), f"{name} ({unit})",
             [(at, value, low, high, name, SIMULATED)])
        )  # fmt: skip
    made = []
    for name, heading, y_name, lines in places:
        about = f"{heading} over time{', with 95 % bands' if lines[0][2] is not None else ''}."
        made.append(PlotPlace(name, heading, about, _figure(story, y_name, lines)))
    return made


def _figure(story: TwinStory, y_name: str, lines: Sequence[Line]) -> Figure:
    data = []
    for t, y, low, high, name, color in lines:
        columns = (y,) if low is None or high is None else (y, low, high)
        at, values, *band = thin_columns(t, *columns, count=_POINTS)
        data += [line_of(at, edge, "95 %", _BAND, "", "s") for edge in band]
        data.append(line_of(at, values, name, color, "", "s"))
    shapes = [stretch_of(onset, told, TINTS[1]) for onset, told, _ in story.changes]
    frame = layout_of(
        300, xaxis=axis_of("time (s)"), yaxis=axis_of(y_name), shapes=shapes, showlegend=False
    )
    return {"data": data, "layout": frame}
