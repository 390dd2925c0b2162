# SPDX-License-Identifier: Apache-2.0
"""Draws the tables of a claim as charts.yaml describes: panels with curves, bars or a map."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from stickslip_ros.paper.claim import Result, Table
from stickslip_ros.paper.parameter_sets import Array

NANO = 1e9
#: By the names that charts.yaml has for them; the blues are of values in order, small to large.
_COLOURS = {
    "ceim": "#1f4e9c", "lugre": "#c46a1b", "epm": "#2f7d4f", "epm_calc": "#8a4fa3",
    "black": "#222222", "grey": "#8c8c8c", "red": "#d3321d",
    "blue_1": "#9ecae1", "blue_2": "#4292c6", "blue_3": "#1f4e9c", "blue_4": "#0b2a5b",
}  # fmt: skip


class ChartCurve(NamedTuple):
    """A column over the x of its panel."""

    column: str
    label: str  #: in the legend, "" for none
    colour: str  #: by its name
    form: str = "-"  #: a format of Matplotlib
    of: str = ""  #: what the name of the table begins with that holds it, before the panel's ending
    error: str = ""  #: column with the standard deviation


@dataclass(frozen=True)
class Panel:
    """A part of a picture."""

    x: str  #: a column
    labels: tuple[str, str]  #: of the axes, units included
    curves: Sequence[ChartCurve] = ()
    table: str = ""  #: ending of the table that holds the columns
    y: str = ""  #: column of the vertical axis of a map
    values: tuple[str, str] = ("", "")  #: column (m) and label of a map, "" for none
    limit: float = 0.0  #: nm, ends of the colours of a map of steps of both signs
    factors: Sequence[float] = ()  #: nm, marks of the colours of a map whose scale is logarithmic
    bars: Sequence[str] = ()  #: names of bars, one for each row of x, in place of curves
    title: str = ""
    scales: tuple[float, float] = (1.0, NANO)  #: what one of x and of y is on the axes
    legend: Any = "best"  #: its place
    heading: str | None = None  #: of the legend
    levels: Sequence[tuple[float, str, str, str]] = ()  #: y, label, colour, form
    marks: Sequence[tuple[float, str, str]] = ()  #: x, text, colour
    ticks: Sequence[float] = ()  #: of x, the only ones
    span: tuple[float, float] | None = None  #: the least y, and the greatest over that of curves
    axes: Mapping[str, Any] = field(default_factory=dict)  #: for `Axes.set`

    @classmethod
    def of(cls, texts: Mapping[str, Any]) -> Panel:
        """Return the panel that a mapping of charts.yaml describes."""
        return cls(**{**texts, "curves": [ChartCurve(*one) for one in texts.get("curves", ())]})


def read_charts(path: Path) -> dict[str, Callable[[Result], Result]]:
    """Return functions that add the picture to a result, by the name of the claim."""
    return {
        name: partial(
            _with_picture,
            [Panel.of(one) for one in chart["panels"]],
            tuple(chart.get("size", Result.size)),
        )
        for name, chart in yaml.safe_load(path.read_text(encoding="utf-8")).items()
    }


def _with_picture(panels: Sequence[Panel], size: tuple[float, float], result: Result) -> Result:
    tables = {**result.tables, **result.drawn}
    return replace(result, draw=partial(_draw, panels, tables), size=size)


def _draw(panels: Sequence[Panel], tables: Mapping[str, Table], figure: Figure) -> None:
    for row, one in enumerate(panels, 1):
        axes = figure.add_subplot(len(panels), 1, row)
        axes.set(xlabel=one.labels[0], ylabel=one.labels[1])
        axes.set_title(one.title, fontsize=10)
        axes.grid(alpha=0.3)
        if one.bars:
            _draw_bars(axes, one.bars, tables[one.table][one.x])
        if one.y:
            _draw_map(axes, one, tables[one.table])
        tops = [_draw_curve(axes, one, curve, tables) for curve in one.curves]
        for level, label, colour, form in one.levels:
            axes.axhline(level, color=_COLOURS[colour], linestyle=form, label=label)
        for x, text, colour in one.marks:
            axes.axvline(x, color=_COLOURS[colour], linewidth=0.9, linestyle=":")
            axes.annotate(text, (x + 0.06, 0.01), fontsize=8, color=_COLOURS[colour])
        axes.set(**one.axes)
        if one.span:
            axes.set_ylim(one.span[0], one.span[1] * max(tops))
        if one.ticks:
            axes.set_xticks(one.ticks, [f"{tick:g}" for tick in one.ticks])
            axes.minorticks_off()
        if len(axes.get_legend_handles_labels()[1]) > 1:
            axes.legend(loc=one.legend, fontsize=8.5, framealpha=0.9, title=one.heading)


def _draw_curve(axes: Axes, one: Panel, curve: ChartCurve, tables: Mapping[str, Table]) -> float:
    """Draw a curve and return its greatest y."""
    table = tables[curve.of + one.table]
    x, y = one.scales[0] * table[one.x], one.scales[1] * table[curve.column]
    look: dict[str, Any] = {"color": _COLOURS[curve.colour], "label": curve.label or None}
    if curve.error:
        deviation = one.scales[1] * table[curve.error]
        axes.errorbar(x, y, deviation, fmt=curve.form, markersize=4, capsize=3, **look)
    else:
        # Circles without a line are open, so that a curve below them is seen.
        fill = "none" if curve.form == "o" else look["color"]
        axes.plot(x, y, curve.form, markersize=4, markerfacecolor=fill, **look)
    return float(np.nanmax(y))


def _draw_bars(axes: Axes, names: Sequence[str], values: Array) -> None:
    colours = [_COLOURS["ceim" if value > 0.0 else "lugre"] for value in values]
    axes.bar_label(axes.barh(names, values, color=colours), fmt="%.2g", padding=3, fontsize=8.5)
    axes.invert_yaxis()
    axes.axvline(0.0, color=_COLOURS["black"], linewidth=0.6)
    axes.margins(x=0.18)


def _draw_map(axes: Axes, one: Panel, table: Table) -> None:
    """Draw a map; nan stays grey, and of steps of both signs zero is white."""
    column, label = one.values
    x, y = table[one.x], table[one.y]
    across, up = np.unique(x), np.unique(y)
    grid = NANO * table[column][np.lexsort((x, y))].reshape(len(up), len(across))
    options: dict[str, Any] = {}
    if one.limit:
        options = {"cmap": "RdBu", "vmin": -one.limit, "vmax": one.limit}
    if one.factors:
        options = {"cmap": "viridis_r", "norm": LogNorm()}
    axes.grid(False)
    axes.set_facecolor("#d9d9d9")
    mesh = axes.pcolormesh(
        one.scales[0] * across, one.scales[1] * up, np.ma.masked_invalid(grid),
        shading="nearest", rasterized=True, **options,
    )  # fmt: skip
    figure: Any = axes.figure
    bar = figure.colorbar(mesh, ax=axes, label=label)
    if one.factors:
        bar.set_ticks(one.factors, labels=[f"{factor:g}" for factor in one.factors])
        bar.minorticks_off()
