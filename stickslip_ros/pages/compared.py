# SPDX-License-Identifier: Apache-2.0
"""The page of a comparison: what ``compare.html`` of `reporting` shows."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

from stickslip_ros.files import write_text
from stickslip_ros.measurement.comparison import Comparison
from stickslip_ros.measurement.verdict import Judgement
from stickslip_ros.pages.compared_figures import figures
from stickslip_ros.reporting import shown
from stickslip_ros.reporting.page import PlotPlace, page, plot_parts

#: Rows of the table of cycles.
_ROWS = 200


@dataclass(frozen=True)
class About:
    """What the page says beside the numbers."""

    command: str  #: that made the page
    parameters: Mapping[str, Any]  #: of the run, empty if they are not known
    units: Mapping[str, str]  #: of the parameters
    versions: Mapping[str, str]  #: of programs by name


class _Card(NamedTuple):
    what: str
    value: str
    more: str


class _Cycles(NamedTuple):
    rows: list[list[str]]  #: nm
    left_out: int


def write_page(
    path: Path, found: Comparison, judgements: Sequence[Judgement], about: About
) -> None:
    """Write the page, all of it or nothing; WriteError, or PageError without plotly."""
    write_text(path, page_of(found, judgements, about))


def page_of(found: Comparison, judgements: Sequence[Judgement], about: About) -> str:
    """Return the page as HTML. Raises PageError if plotly is not installed."""
    drawn = figures(found)
    places = _plots(found)
    return page(
        "compare.html",
        found=found,
        judgements=judgements,
        about=about,
        cards=_cards(found),
        largest=_largest,
        plots=[places[name] for name in drawn],
        cycles=_cycles(found),
        parameters={name: _parameter(about, name) for name in about.parameters},
        **plot_parts(drawn),
    )


def _cards(found: Comparison) -> list[_Card]:
    place = found.alignment
    offset = shown(place.offset, "s", 6) if found.fits.offset else "not fitted"
    spread = f"± {shown(place.offset_error, 's', 2)}" if math.isfinite(place.offset_error) else ""
    cards = [
        _Card("RMSE", shown(found.rmse, "m"), f"{100.0 * found.normalised:.3g} % of the range"),
        _Card(
            "largest difference", shown(found.largest, "m"), f"at {shown(found.largest_at, 's', 5)}"
        ),
        _Card("RMSE of the steps", shown(found.step_rmse, "m"), "adds up from step to step"),
        _Card("RMSE of the shape", shown(found.shape_rmse, "m"), "within the cycles"),
        _Card("sensor noise", shown(found.noise, "m"), "standard deviation"),
        _Card("clock offset", offset, spread),
    ]
    if found.fits.drift:
        cards.append(_Card("clock drift", f"{1e6 * place.drift:.4g} ppm", "fitted"))
    if found.fits.gain:
        cards.append(_Card("sensor gain", f"{place.gain:.6g}", "fitted"))
    return cards


def _plots(found: Comparison) -> dict[str, PlotPlace]:
    """Return what each plot shows, in words."""
    step = next((metric for metric in found.metrics if metric.name == "step size"), None)
    steps = (
        f"The step is {shown(step.run, step.unit)} in the run and "
        f"{shown(step.measured, step.unit)} as measured."
        if step
        else ""
    )
    within = (
        f" Within the cycles it is {shown(found.shape_rmse, 'm')} RMSE."
        if math.isfinite(found.shape_rmse)
        else ""
    )
    places = (
        PlotPlace(
            "overview",
            "Whole run",
            f"Position of run and measurement over {shown(float(found.t[-1] - found.t[0]), 's')}, "
            f"and their residual: {shown(found.rmse, 'm')} RMSE, at most "
            f"{shown(found.largest, 'm')}, at {shown(found.largest_at, 's')}.{within}",
        ),
        PlotPlace("step", "One step and its phases", f"One cycle with its points A to F. {steps}"),
        PlotPlace(
            "slip", "Backstep and ringing", "The same cycle, close to its slip."
        ),
        PlotPlace(
            "cycles",
            "Cycle by cycle",
            "Step, backstep and RMSE of each cycle, run and measurement; the table below has the "
            "numbers.",
        ),
    )  # fmt: skip
    return {plot.name: plot for plot in places}


def _largest(*values: float) -> float:
    return max((abs(value) for value in values if math.isfinite(value)), default=0.0) or 1.0


def _cycles(found: Comparison) -> _Cycles | None:
    table = found.cycles
    if table is None:
        return None
    columns = (
        table.step, table.measured_step, table.measured_step - table.step,
        table.backstep, table.measured_backstep, table.measured_backstep - table.backstep,
        table.rmse,
    )  # fmt: skip
    rows = [
        [f"{1e9 * value:.2f}" if math.isfinite(value) else "" for value in row]
        for row in islice(zip(*columns, strict=True), _ROWS)
    ]
    return _Cycles(rows, len(table.slip) - len(rows))


def _parameter(about: About, name: str) -> str:
    value = about.parameters[name]
    if isinstance(value, float):
        return f"{value:g} {about.units.get(name, '')}".strip()
    return str(value)
