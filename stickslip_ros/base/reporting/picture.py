# SPDX-License-Identifier: Apache-2.0
"""Pictures for papers of the plots that pages show: the same data, drawn by Matplotlib.

Text stays text, with its fonts in the file, so that journals take it and programs can edit it.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Picture
from matplotlib.figure import SubFigure
from matplotlib.patches import Rectangle
from matplotlib.ticker import AutoLocator

from stickslip_ros.base.files import whole_file
from stickslip_ros.base.reporting.page import Figure

#: Width of one and of two columns of a journal, and of a pixel of a page, inches.
COLUMN, TWO_COLUMNS, _PIXEL = 85.0 / 25.4, 170.0 / 25.4, 1.0 / 130.0
#: Room left, right, below and above the axes for labels, inches; above without names of lines.
_LEFT, _RIGHT, _BELOW, _ABOVE, _BARE = 0.75, 0.15, 0.45, 0.45, 0.15
LOOKS: Any = {"font.size": 8.0, "axes.grid": True, "grid.alpha": 0.3, "lines.linewidth": 1.0}
#: Dots of a PNG to an inch, as journals ask for.
_DOTS = 300
_FONTS: Any = {"pdf.fonttype": 42, "svg.fonttype": "none"}


def save_picture(path: Path, picture: Picture) -> None:
    """Write a picture in the form that its name ends with, all of it or nothing; or WriteError."""
    with whole_file(path) as part:
        _save(picture, part, path.suffix[1:].lower())


def svg_of(picture: Picture) -> bytes:
    """Return a picture as SVG."""
    file = io.BytesIO()
    _save(picture, file, "svg")
    return file.getvalue()


def _save(picture: Picture, to: Path | io.BytesIO, form: str) -> None:
    for axes in picture.axes:
        for axis in (axes.xaxis, axes.yaxis):
            locator = axis.get_major_locator()
            if isinstance(locator, AutoLocator):
                locator.set_params(steps=[1, 2, 5, 10])
    with matplotlib.rc_context({**LOOKS, **_FONTS}):
        picture.savefig(to, dpi=_DOTS, format=form)


def picture_of(draw: Callable[[Axes], object]) -> Picture:
    """Return a picture of one plot, which ``draw`` draws into its axes."""
    with matplotlib.rc_context(LOOKS):
        picture = Picture(figsize=(COLUMN, 0.8 * COLUMN), layout="constrained")
        draw(picture.add_subplot())
    return picture


def picture_of_plots(figures: Collection[Figure], title: str) -> Picture:
    """Return a picture of plots below each other; figures are plain data for plotly.js."""
    heights = [_PIXEL * figure["layout"]["height"] for figure in figures]
    with matplotlib.rc_context(LOOKS):
        picture = Picture(figsize=(TWO_COLUMNS, sum(heights) + 0.3))
        picture.suptitle(title, y=0.995, va="top")
        ratios = [0.3, *heights]
        parts = picture.subfigures(len(ratios), 1, height_ratios=ratios, squeeze=False)
        for part, height, figure in zip(parts[1:, 0], heights, figures, strict=True):
            _draw(part, height, figure)
    return picture


def _draw(part: SubFigure, height: float, figure: Figure) -> None:
    """Draw one plot into its part of the picture, of a height in inches."""
    layout, made = figure["layout"], dict[tuple[str, str], Axes]()
    named = [trace for trace in figure["data"] if trace.get("showlegend", True)]
    named = named if layout.get("showlegend", True) and len(named) > 1 else []
    above = _ABOVE if named or layout.get("annotations") else _BARE
    first: dict[str, Axes] = {}  # of each axis of x: those below each other share it
    for trace in figure["data"]:
        key = trace.get("xaxis", "x"), trace.get("yaxis", "y")
        if key not in made:
            x, y = (layout.get(f"{name[0]}axis{name[1:]}", {}) for name in key)
            place = _place(height, above, x, y)
            axes = part.add_axes(place, sharex=first.get(key[0]))
            first.setdefault(key[0], axes)
            made[key] = axes
            _label(axes, x, y, x.get("anchor", key[1]) == key[1])
        _line(made[key], trace)
    _mark(made, layout)
    if named:
        handles = [one for axes in made.values() for one in axes.get_legend_handles_labels()[0]]
        part.legend(
            handles=handles, loc="upper right", ncols=min(5, len(handles)), frameon=False,
            handlelength=1.2, columnspacing=1.2,
        )  # fmt: skip


def _place(height: float, above: float, x: Figure, y: Figure) -> tuple[float, float, float, float]:
    """Return the place of axes in their part, from their shares of its width and height."""
    wide, high = (TWO_COLUMNS - _LEFT - _RIGHT) / TWO_COLUMNS, (height - _BELOW - above) / height
    (left, right), (low, top) = x.get("domain", (0.0, 1.0)), y.get("domain", (0.0, 1.0))
    return (
        _LEFT / TWO_COLUMNS + wide * left,
        _BELOW / height + high * low,
        wide * (right - left),
        high * (top - low),
    )


def _label(axes: Axes, x: Figure, y: Figure, lowest: bool) -> None:
    axes.set_ylabel(y.get("title", {}).get("text", ""))
    if lowest:
        axes.set_xlabel(x.get("title", {}).get("text", ""))
    else:
        axes.tick_params(labelbottom=False)
    axes.ticklabel_format(useOffset=False)
    if x.get("tickformat") == "d":
        axes.locator_params(axis="x", integer=True)
    if np.diff(x.get("domain", (0.0, 1.0)))[0] < 0.5:
        axes.locator_params(axis="x", nbins=4)
    axes.tick_params(labelleft=y.get("showticklabels", True))
    if "range" in y:
        axes.set_ylim(*y["range"])


def _numbers(values: Any) -> Any:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def _line(axes: Axes, trace: Figure) -> None:
    marker = trace.get("marker", {})
    color = marker.get("color") or trace.get("line", {}).get("color")
    label = trace["name"] if trace.get("showlegend", True) else None
    x, y = _numbers(trace["x"]), _numbers(trace["y"])
    if not np.isfinite(x).any():  # a name for the list of names alone
        axes.plot([], [], "s", color=color, label=label)
        return
    style = {
        "color": color,
        "label": label,
        "linestyle": "-" if "lines" in trace["mode"] else "",
        "marker": "." if "markers" in trace["mode"] else "",
        "markersize": marker.get("size", 4),
        "alpha": marker.get("opacity", 1.0),
    }
    if "error_y" in trace:
        axes.errorbar(x, y, yerr=_numbers(trace["error_y"]["array"]), **style)
    else:
        axes.plot(x, y, **style)


def _mark(made: Mapping[tuple[str, str], Axes], layout: Figure) -> None:
    """Draw the areas, over the axes that they name, and the names over the first axes."""
    main = next(iter(made.values()))
    for shape in layout.get("shapes", ()):
        axes = made.get(("x", shape.get("yref", "y")), main)
        color, left, right = shape["fillcolor"], shape["x0"], shape["x1"]
        if shape.get("yref") == "paper":
            axes.axvspan(left, right, color=color, linewidth=0, zorder=0)
        else:
            corner = (left, shape["y0"])
            size = right - left, shape["y1"] - shape["y0"]
            axes.add_patch(Rectangle(corner, *size, color=color, linewidth=0, zorder=0))
    for note in layout.get("annotations", ()):
        text = note["text"].replace("<b>", "").replace("</b>", "")
        ha, va = note.get("xanchor", "center"), note.get("yanchor", "bottom")
        lift = 72.0 * _PIXEL * note.get("yshift", 0)
        main.annotate(
            text, (note["x"], note["y"]), (0.0, lift), main.get_xaxis_transform(),
            "offset points", ha=ha, va=va, annotation_clip=False,
        )  # fmt: skip
