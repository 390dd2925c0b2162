# SPDX-License-Identifier: Apache-2.0
"""The page of an identification: the content of the template ``identify.html``."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from stickslip_ros.files import write_text
from stickslip_ros.identification.fit import Estimate, Fit
from stickslip_ros.pages.fitted_figures import figures
from stickslip_ros.parameters import parameter
from stickslip_ros.reporting import format_si
from stickslip_ros.reporting.page import page, plot_parts, versions


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
        plots=drawn,
        known={
            name: f"{value:g} {parameter(name).unit}".strip()
            for name, value in found.base.flat().items()
            if isinstance(value, float)
            and name not in found.parameters
            and not (value == 0.0 and parameter(name).optional)
        },
        versions=versions(),
        command=command,
        **plot_parts({plot.name: plot.figure for plot in drawn}),
    )


def _row(one: Estimate) -> _Row:
    low, high = (
        "–" if end is None else format_si(end, one.unit, 4, like=one.value)
        for end in (one.low, one.high)
    )
    remark = "determined" if one.determined else "not determined"
    if one.at_bound:
        remark = "on a bound of the search"
    return _Row(one.name, format_si(one.value, one.unit, 4), low, high, remark, one.determined)
