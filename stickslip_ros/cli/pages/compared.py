# SPDX-License-Identifier: Apache-2.0
"""The page of a comparison: the content of the template ``compare.html``, with its plots."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from stickslip_ros.base.reporting import ACTUATOR, MEASURED, SIMULATED, format_si, scale_of
from stickslip_ros.base.reporting.page import (
    Figure,
    PlotPlace,
    ResultPage,
    axis_of,
    layout_of,
    line_of,
    stretch_of,
    thin_columns,
    versions,
)
from stickslip_ros.cli.pages.measured import RESIDUAL, motion_and_residual
from stickslip_ros.measurement.bags.load_motion import LoadedMotion
from stickslip_ros.measurement.comparison import Comparison
from stickslip_ros.measurement.metric import ComparisonMetric
from stickslip_ros.physics.parameters import PARAMETERS, Value
from stickslip_ros.simulation.motion import Motion

SHAPE = "#b3a5d9"
#: Points of a line over one step.
_DETAIL = 4000
#: The phases between the points of Fig. 2 (Fig. 1), with a tint for each.
PHASES = (
    ("A", "B", "presliding 1", "#dfe8d3"),
    ("B", "C", "stick", "#eef3e6"),
    ("C", "E", "slowdown 1, presliding 2, slip", "#f3c9bd"),
    ("E", "F", "slowdown 2", "#dccfe8"),
)


def comparison_page(
    found: Comparison, judgements: Sequence[ComparisonMetric], simulation: LoadedMotion
) -> ResultPage:
    """Return the page of a comparison.

    simulation holds parameters and version of the run, where they are known.
    """
    known = simulation.parameters or {}
    parts = {
        "found": found,
        "judgements": judgements,
        "versions": {"stickslip_ros, run": simulation.version or "not known", **versions()},
        "parameters": {name: _parameter(name, value) for name, value in known.items()},
    }
    return ResultPage("compare.html", _plots(found), parts)


def _plots(found: Comparison) -> list[PlotPlace]:
    """Return the plots that there are, with their titles and descriptions."""
    span, at = format_si(float(found.t[-1] - found.t[0]), "s"), format_si(found.largest_at, "s")
    text = (
        f"Position of run and measurement over {span}, and their residual: "
        f"{format_si(found.rmse, 'm')} RMSE, at most {format_si(found.largest, 'm')}, at {at}."
    )
    if math.isfinite(found.shape_rmse):
        text += f" Within the cycles it is {format_si(found.shape_rmse, 'm')} RMSE."
    plots = [PlotPlace("overview", "Whole run", text, _overview(found))]
    if found.main.run is not None:
        middle = len(found.main.run.slips) // 2
        step = next(metric for metric in found.metrics if metric.name == "step size")
        in_run, as_measured = (format_si(one, step.unit) for one in (step.run, step.measured))
        text = (
            f"One cycle with its points {', '.join(points_of(found))}. The step is {in_run} in the "
            f"run and {as_measured} as measured."
        )
        close = "The same cycle, close to its slip."
        plots.append(PlotPlace("step", "One step and its phases", text, _step(found, middle)))
        plots.append(PlotPlace("slip", "Backstep and ringing", close, _slip(found, middle)))
    return plots


def _parameter(name: str, value: Value) -> str:
    if not isinstance(value, float):
        return str(value)
    return f"{value:g} {PARAMETERS[name].unit if name in PARAMETERS else ''}".strip()


def points_of(found: Comparison) -> dict[str, float]:
    """Return the points of the cycle that is shown, times in s; D is in the contact, unseen."""
    steps = found.main.run
    if steps is None:
        return {}
    every = {name: float(steps.points[name][len(steps.slips) // 2]) for name in "ABCEF"}
    return {name: at for name, at in every.items() if np.isfinite(at)}


def _overview(found: Comparison) -> Figure:
    residuals = [(found.difference, "measured − run", RESIDUAL)]
    if len(found.slips):
        residuals.append((found.shape_difference, "of that, within the cycles", SHAPE))
    lines = [(found.measured, "measured", MEASURED), (found.x, "run", SIMULATED)]
    return motion_and_residual(found.t, lines, residuals)


def _step(found: Comparison, k: int) -> Figure:
    """Show one cycle with its phases."""
    steps = found.main.run
    assert steps is not None
    start, slip = float(steps.starts[k]), float(steps.slips[k])
    after = 3.0 / steps.ringing_frequency if steps.ringing_frequency > 0.0 else 0.1 * steps.period
    window = start - 0.02 * steps.period, slip + min(0.9 * steps.period, 4.0 * after)
    origin = float(np.interp(start, found.t, found.x))
    figure = _close(found, window, start, origin, found.run)
    factor, _ = scale_of(window[1] - window[0], "s")
    shapes, notes = [], []
    for first, last, name, tint in PHASES:
        begin, end = (factor * (float(steps.points[p][k]) - start) for p in (first, last))
        if not end > begin:
            continue
        shapes.append(stretch_of(begin, end, tint))
        figure["data"].append(
            {"type": "scatter", "mode": "markers", "x": [None], "y": [None], "name": name,
             "marker": {"symbol": "square", "size": 12, "color": tint}}
        )  # fmt: skip
    # Points come in close pairs: one name left of its line, one right of it.
    sides = {"A": ("right", 0), "B": ("left", 0), "C": ("right", 0), "E": ("left", 0),
             "F": ("left", 16)}  # fmt: skip
    for point, at in points_of(found).items():
        side, lift = sides[point]
        notes.append(
            {"x": factor * (at - start), "y": 0, "yref": "paper", "yanchor": "bottom",
             "text": f"<b>{point}</b>", "showarrow": False, "xanchor": side, "yshift": lift}
        )  # fmt: skip
    figure["layout"].update(shapes=shapes, annotations=notes)
    return figure


def _slip(found: Comparison, k: int) -> Figure:
    """Show the backstep and the ringing after a slip."""
    steps = found.main.run
    assert steps is not None
    slip = float(steps.slips[k])
    swing = 1.0 / steps.ringing_frequency if steps.ringing_frequency > 0.0 else 0.02 * steps.period
    window = slip - 1.0 * swing, slip + min(8.0 * swing, 0.9 * steps.period)
    origin = float(np.interp(slip, found.t, found.x))
    return _close(found, window, slip, origin, None)


def _close(
    found: Comparison,
    window: tuple[float, float],
    origin: float,
    x0: float,
    with_actuator: Motion | None,
) -> Figure:
    inside = (found.t >= window[0]) & (found.t <= window[1])
    columns = found.t[inside], found.x[inside], found.measured[inside]
    t, x, measured = thin_columns(*columns, count=_DETAIL)
    time, time_unit = scale_of(window[1] - window[0], "s")
    factor, unit = 1e9, "nm"
    data = [
        line_of(time * (t - origin), factor * (measured - x0), "measured", MEASURED, unit,
                time_unit, mode="lines+markers" if len(t) < 400 else "lines", marker={"size": 4}),
        line_of(time * (t - origin), factor * (x - x0), "run", SIMULATED, unit, time_unit),
    ]  # fmt: skip
    if with_actuator is not None and with_actuator.u is not None:
        piece = with_actuator.between(*window)
        if piece.u is not None and len(piece.t):
            u0 = float(np.interp(origin, with_actuator.t, with_actuator.u))
            shown_t, u = thin_columns(piece.t, piece.u - u0, count=_DETAIL // 4)
            place = time * (shown_t - origin)
            data.append(line_of(place, factor * u, "actuator", ACTUATOR, unit, time_unit))
    what = "start of the cycle" if with_actuator is not None else "slip"
    layout = layout_of(
        380 if with_actuator is None else 420,
        xaxis=axis_of(f"time after the {what} ({time_unit})"),
        yaxis=axis_of(f"displacement ({unit})"),
    )
    return {"data": data, "layout": layout}
