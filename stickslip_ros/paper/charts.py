# SPDX-License-Identifier: Apache-2.0
"""Draws what charts.yaml says of the tables of a claim: panels with curves, or a map, and a legend.

A picture that needs more, such as bars, is drawn by the function that computes the claim.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stickslip_ros.paper import style
from stickslip_ros.paper.claim import Result, Table
from stickslip_ros.paper.style import NANO, color_map, legend, panel, signed_map

#: Size of a picture of one panel, inches
_USUAL = (6.2, 3.9)


class Curve(NamedTuple):
    """A column over the x of its panel."""

    column: str
    label: str  #: in the legend, "" for none
    colour: str  #: by its name in `style`
    form: str = "-"  #: a format of Matplotlib
    of: str = ""  #: what the name of the table begins with that holds it, before the panel's ending
    error: str = ""  #: column with the standard deviation


@dataclass(frozen=True)
class Panel:
    """A part of a picture."""

    x: str  #: a column
    labels: tuple[str, str]  #: of the axes, units included
    curves: Sequence[Curve] = ()
    table: str = ""  #: ending of the table that holds the columns
    y: str = ""  #: column of the vertical axis of a map
    values: tuple[str, str] = ("", "")  #: column (m) and label of a map, "" for none
    limit: float = 0.0  #: nm, ends of the colours of a map of steps of both signs
    title: str = ""
    scales: tuple[float, float] = (1.0, NANO)  #: what one of x and of y is on the axes
    legend: str = "best"  #: its place
    heading: str | None = None  #: of the legend
    levels: Sequence[tuple[float, str, str, str]] = ()  #: y, label, colour, form
    marks: Sequence[tuple[float, str, str]] = ()  #: x, text, colour
    ticks: Sequence[float] = ()  #: of x, the only ones
    span: tuple[float, float] | None = None  #: the least y, and the greatest over that of curves
    axes: Mapping[str, Any] = field(default_factory=dict)  #: for `Axes.set`

    @classmethod
    def of(cls, texts: Mapping[str, Any]) -> Panel:
        """Return the panel that a mapping of charts.yaml describes."""
        return cls(**{**texts, "curves": [Curve(*one) for one in texts.get("curves", ())]})


class Chart(NamedTuple):
    """A picture."""

    panels: Sequence[Panel]  #: from the top down
    size: tuple[float, float]  #: inches

    def drawn(self, result: Result) -> Result:
        """Return a result with its picture, drawn from its tables."""
        tables = {**result.tables, **result.drawn}
        return replace(result, draw=partial(_draw, self.panels, tables), size=self.size)


def read_charts(path: Path) -> dict[str, Callable[[Result], Result]]:
    """Return what gives the result of a claim its picture, by the claim's name."""
    return {
        name: Chart([Panel.of(one) for one in chart["panels"]], chart.get("size", _USUAL)).drawn
        for name, chart in yaml.safe_load(path.read_text(encoding="utf-8")).items()
    }


def _draw(panels: Sequence[Panel], tables: Mapping[str, Table], figure: Figure) -> None:
    for row, one in enumerate(panels, 1):
        axes = panel(figure, *one.labels, one.title, (len(panels), 1, row))
        if one.y:
            _draw_map(axes, one, tables[one.table])
        tops = [_draw_curve(axes, one, curve, tables) for curve in one.curves]
        for level, label, colour, form in one.levels:
            axes.axhline(level, color=style.PALETTE[colour], linestyle=form, label=label)
        for x, text, colour in one.marks:
            axes.axvline(x, color=style.PALETTE[colour], linewidth=0.9, linestyle=":")
            axes.annotate(text, (x + 0.06, 0.01), fontsize=8, color=style.PALETTE[colour])
        axes.set(**one.axes)
        if one.span:
            axes.set_ylim(one.span[0], one.span[1] * max(tops))
        if one.ticks:
            axes.set_xticks(one.ticks, [f"{tick:g}" for tick in one.ticks])
            axes.minorticks_off()
        if len(axes.get_legend_handles_labels()[1]) > 1:
            legend(axes, one.legend, one.heading)


def _draw_curve(axes: Axes, one: Panel, curve: Curve, tables: Mapping[str, Table]) -> float:
    """Draw a curve and return its greatest y."""
    table = tables[curve.of + one.table]
    x, y = one.scales[0] * table[one.x], one.scales[1] * table[curve.column]
    look: dict[str, Any] = {"color": style.PALETTE[curve.colour], "label": curve.label or None}
    if curve.error:
        deviation = one.scales[1] * table[curve.error]
        axes.errorbar(x, y, deviation, fmt=curve.form, markersize=4, capsize=3, **look)
    else:
        # Circles without a line are open, so that a curve below them is seen.
        fill = "none" if curve.form == "o" else look["color"]
        axes.plot(x, y, curve.form, markersize=4, markerfacecolor=fill, **look)
    return float(np.nanmax(y))


def _draw_map(axes: Axes, one: Panel, table: Table) -> None:
    column, label = one.values
    x, y = table[one.x], table[one.y]
    across, up = np.unique(x), np.unique(y)
    grid = NANO * table[column][np.lexsort((x, y))].reshape(len(up), len(across))
    place = one.scales[0] * across, one.scales[1] * up
    if one.limit:
        signed_map(axes, *place, grid, one.limit)
    else:
        color_map(axes, *place, grid, label)
