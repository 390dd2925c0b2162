# SPDX-License-Identifier: Apache-2.0
"""Picture of the benchmark: error against cost, one panel a case, one curve a method."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stickslip_ros.benchmark.measuring import LIMIT, CaseResult
from stickslip_ros.benchmark.methods import METHODS, OURS

_MICRO, _NANO = 1e6, 1e9
#: Errors below this are rounding, nm: drawn at the edge.
_FLOOR = 1e-9
_COLOURS = ("black", "#1f77b4", "#17becf", "#2ca02c", "#9467bd", "#d62728", "#ff7f0e", "#e377c2")
_MARKERS = "os^vDPX<>"


def plot(path: Path, results: Sequence[CaseResult]) -> None:
    """Write a PNG with the results of one run."""
    columns = min(len(results), 5) or 1
    rows = math.ceil(len(results) / columns)
    figure = Figure(figsize=(max(4.2 * columns, 8.0), 4.4 * rows + 1.2), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False, sharey=True)
    for panel, result in zip(panels.flat, results, strict=False):
        _panel(panel, result)
    for panel in panels.flat[len(results) :]:
        panel.set_visible(False)
    for row in panels:
        row[0].set_ylabel("error per cycle (nm)")
    for column in range(columns):
        panels[-1, column].set_xlabel("time per cycle (us)")
    drawn = {
        label: line
        for panel in panels.flat
        for line, label in zip(*panel.get_legend_handles_labels(), strict=True)
    }
    figure.legend(drawn.values(), drawn.keys(), loc="outside lower center", ncols=5)
    figure.suptitle(
        "Error against cost, each method at several tolerances (ringed: the one that is quoted)"
    )
    figure.savefig(path, dpi=100, format="png")


def _panel(axes: Axes, result: CaseResult) -> None:
    for number, (name, entry) in enumerate(METHODS.items()):
        one = result.measured.get(name)
        points = [point for point in one.points if point.times] if one else []
        if one is None or not points:
            continue
        colour = _COLOURS[number % len(_COLOURS)]
        axes.plot(
            [_MICRO * point.median for point in points],
            [max(_NANO * point.error, _FLOOR) for point in points],
            marker=_MARKERS[number % len(_MARKERS)],
            markersize=4,
            color=colour,
            linewidth=2.2 if name == OURS else 1.1,
            label=entry.title,
            zorder=3 if name == OURS else 2,
        )
        quoted = one.quoted
        if quoted is not None and quoted.times:
            axes.plot(
                [_MICRO * quoted.median],
                [max(_NANO * quoted.error, _FLOOR)],
                "o",
                markersize=11,
                markerfacecolor="none",
                markeredgecolor=colour,
                zorder=4,
            )
    axes.axhline(_NANO * LIMIT, color="grey", linestyle="--", linewidth=1.0)
    axes.set(xscale="log", yscale="log", title=result.case.title)
    axes.grid(alpha=0.3)
