# SPDX-License-Identifier: Apache-2.0
"""The page of a comparison: the content of the template ``compare.html``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import islice
from typing import NamedTuple

from stickslip_ros.measurement.comparison import Comparison
from stickslip_ros.measurement.load_motion import LoadedMotion
from stickslip_ros.measurement.verdict import Judgement
from stickslip_ros.pages.compared_figures import comparison_figures, points_of
from stickslip_ros.parameters import PARAMETERS, Value
from stickslip_ros.reporting import format_si
from stickslip_ros.reporting.page import PlotPlace, ResultPage, versions

#: Rows of the table of cycles.
_ROWS = 200


class _Cycles(NamedTuple):
    rows: list[list[str]]  #: nm
    left_out: int


def comparison_page(
    found: Comparison, judgements: Sequence[Judgement], simulation: LoadedMotion
) -> ResultPage:
    """Return the page of a comparison.

    simulation holds parameters and version of the run, where they are known.
    """
    known = simulation.parameters or {}
    parts = {
        "found": found,
        "judgements": judgements,
        "versions": {"stickslip_ros, run": simulation.version or "not known", **versions()},
        "cards": _cards(found),
        "largest": _largest,
        "cycles": _cycles(found),
        "parameters": {name: _parameter(name, value) for name, value in known.items()},
    }
    return ResultPage("compare.html", _plots(found), parts)


def _cards(found: Comparison) -> list[tuple[str, str, str]]:
    """Return label, number and remark of each card at the top."""
    place = found.alignment
    offset = format_si(place.offset, "s", 6) if found.fits.offset else "not fitted"
    spread = (
        f"± {format_si(place.offset_error, 's', 2)}" if math.isfinite(place.offset_error) else ""
    )
    cards = [
        ("RMSE", format_si(found.rmse, "m"), f"{100.0 * found.normalised:.3g} % of the range"),
        (
            "largest difference",
            format_si(found.largest, "m"),
            f"at {format_si(found.largest_at, 's', 5)}",
        ),
        ("RMSE of the steps", format_si(found.step_rmse, "m"), "adds up from step to step"),
        ("RMSE of the shape", format_si(found.shape_rmse, "m"), "within the cycles"),
        ("sensor noise", format_si(found.noise, "m"), "standard deviation"),
        ("clock offset", offset, spread),
    ]
    if found.fits.drift:
        cards.append(("clock drift", f"{1e6 * place.drift:.4g} ppm", "fitted"))
    if found.fits.gain:
        cards.append(("sensor gain", f"{place.gain:.6g}", "fitted"))
    return cards


def _plots(found: Comparison) -> list[PlotPlace]:
    """Return the plots that there are, with their titles and descriptions."""
    drawn = comparison_figures(found)
    step = next(metric for metric in found.metrics if metric.name == "step size")
    in_run, as_measured = format_si(step.run, step.unit), format_si(step.measured, step.unit)
    within = (
        f" Within the cycles it is {format_si(found.shape_rmse, 'm')} RMSE."
        if math.isfinite(found.shape_rmse)
        else ""
    )
    points = ", ".join(points_of(found))
    places = (
        PlotPlace(
            "overview",
            "Whole run",
            "Position of run and measurement over "
            f"{format_si(float(found.t[-1] - found.t[0]), 's')}, and their "
            f"residual: {format_si(found.rmse, 'm')} RMSE, at most "
            f"{format_si(found.largest, 'm')}, at {format_si(found.largest_at, 's')}.{within}",
        ),
        PlotPlace("step", "One step and its phases", f"One cycle with its points {points}. "
              f"The step is {in_run} in the run and {as_measured} as measured."),
        PlotPlace("slip", "Backstep and ringing", "The same cycle, close to its slip."),
        PlotPlace("cycles", "Cycle by cycle", "Step, backstep and RMSE of each cycle, run and "
              "measurement, on the scale of the settled steps, with 95 % intervals of the measured "
              "means. The table below has the numbers."),
    )  # fmt: skip
    return [one._replace(figure=drawn[one.name]) for one in places if one.name in drawn]


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


def _parameter(name: str, value: Value) -> str:
    if not isinstance(value, float):
        return str(value)
    return f"{value:g} {PARAMETERS[name].unit if name in PARAMETERS else ''}".strip()
