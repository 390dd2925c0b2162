# SPDX-License-Identifier: Apache-2.0
"""The page of an identification: what ``identify.html`` of `reporting` shows."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stickslip_ros.files import write_text
from stickslip_ros.identification.fit import Estimate, Fit
from stickslip_ros.pages.fitted_figures import figures
from stickslip_ros.parameters import parameter
from stickslip_ros.reporting import shown
from stickslip_ros.reporting.page import PlotPlace, page, plot_parts, versions


class _Row(NamedTuple):
    name: str
    value: str
    low: str
    high: str
    remark: str
    good: bool


def write_page(path: Path, found: Fit, command: str) -> None:
    """Write the page, all of it or nothing; WriteError, or PageError without plotly."""
    write_text(path, page_of(found, command))


def page_of(found: Fit, command: str) -> str:
    """Return the page as HTML; command made it. Raises PageError if plotly is not installed."""
    drawn = figures(found)
    return page(
        "identify.html",
        found=found,
        sources=[*(run.source for run in found.runs), *(one.source for one in found.curves)],
        rows=[_row(one) for one in found.parameters.values()],
        plots=[_plot(found, name) for name in drawn],
        known={
            name: f"{value:g} {parameter(name).unit}".strip()
            for name, value in found.base.flat().items()
            if isinstance(value, float)
            and name not in found.parameters
            and not (value == 0.0 and parameter(name).optional)
        },
        versions=versions(),
        command=command,
        **plot_parts(drawn),
    )


def _row(one: Estimate) -> _Row:
    low, high = (
        "–" if end is None else shown(end, one.unit, 4, like=one.value)
        for end in (one.low, one.high)
    )
    remark = "determined" if one.determined else "not determined"
    if one.at_bound:
        remark = "on a bound of the search"
    return _Row(one.name, shown(one.value, one.unit, 4), low, high, remark, one.determined)


def _plot(found: Fit, name: str) -> PlotPlace:
    kind, _, number = name.partition("-")
    if kind == "run":
        run = found.runs[int(number)]
        return PlotPlace(
            name,
            f"{run.source}: data and fit",
            f"Measured position and fit over {shown(float(np.ptp(run.t)), 's')}, and what the fit "
            f"leaves: {shown(run.residual, 'm', 3)} (root mean square).",
        )
    if kind == "folded":
        run = found.runs[int(number)]
        return PlotPlace(
            name,
            f"{run.source}: residuals over the drive cycle",
            "What the fit leaves at each place of the cycle, and its mean over the cycles. The "
            "slip is at 0 and 1. Noise has a mean near 0 everywhere.",
        )
    if kind == "curve":
        curve = found.curves[int(number)]
        return PlotPlace(
            name,
            f"{curve.source}: table and fit",
            f"{curve.points} points of {_listed(list(curve.measured))} over "
            f"{_listed(list(curve.varied))}, with their standard deviations, and the fit.",
        )
    return _whole(found, name)


def _whole(found: Fit, name: str) -> PlotPlace:
    if name == "profiles":
        return PlotPlace(
            name,
            "Profiles",
            "How far the deviance rises when one parameter is held and all others follow. The "
            "interval ends where the curve crosses the line.",
        )
    if name == "correlations":
        pairs = [
            (abs(value), a, b)
            for a, row in found.correlations.items()
            for b, value in row.items()
            if a < b and math.isfinite(value)
        ]
        size, a, b = max(pairs, default=(0.0, "", ""))
        most = f"Most go together {a} and {b} ({size:.2f})." if pairs else ""
        return PlotPlace(name, "Correlations", f"Of the logarithms of the parameters. {most}")
    best = min(start.deviance for start in found.starts)
    near = sum(start.deviance < 1.01 * best for start in found.starts)
    return PlotPlace(
        name,
        "Waterfall of starts",
        f"Deviance after each descent, the best first. {near} of {len(found.starts)} ended within "
        "1 % of the lowest.",
    )


def _listed(names: list[str]) -> str:
    texts = [name.replace("_", " ") for name in names]
    return texts[0] if len(texts) == 1 else f"{', '.join(texts[:-1])} and {texts[-1]}"
