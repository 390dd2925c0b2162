# SPDX-License-Identifier: Apache-2.0
"""The page of a measurement alone: the content of the template ``analyse.html``, with its plots."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import islice

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.reporting import (
    ACTUATOR,
    CONFIDENCE,
    MEASURED,
    SIMULATED,
    format_si,
    scale_of,
)
from stickslip_ros.base.reporting.page import (
    Figure,
    PlotPlace,
    ResultPage,
    axis_of,
    layout_of,
    line_of,
    stretch_of,
    thin_columns,
)
from stickslip_ros.measurement.steps.analysis import Findings
from stickslip_ros.measurement.steps.fold import fold_slips
from stickslip_ros.measurement.steps.record import MeanPosition, Record
from stickslip_ros.measurement.steps.run import Run
from stickslip_ros.simulation.motion import Motion
from stickslip_ros.simulation.settled import settled_from

#: Points of a line over the whole measurement; rows of the table of cycles; cycles whose slips are
#: laid over each other; colours of runs.
_OVERVIEW, _ROWS, _CYCLES = 6000, 400, 200
TINTS = ("#dfe8d3", "#f3c9bd", "#dccfe8")
RESIDUAL = "#5b4a8a"


def measurement_page(motion: Motion, seen: Findings) -> ResultPage:
    """Return the page of a measurement and the runs in it."""
    parts = {
        "source": motion.source,
        "samples": len(motion.t),
        "duration": format_si(motion.duration, "s"),
        "runs": [run.as_json() for run in seen.runs],
        "interval": CONFIDENCE,
        "disturbances": seen.disturbances,
        "cycles": _table(seen.runs),
    }
    return ResultPage("analyse.html", _plots(motion, seen.runs), parts)


def _plots(motion: Motion, runs: Sequence[Run]) -> list[PlotPlace]:
    """Return the plots with their descriptions, without empty plots."""
    plots = (
        PlotPlace("overview", "Whole measurement",
              f"Position over {format_si(motion.duration, 's')}. Runs of steps are marked.",
              _overview(motion, runs)),
        PlotPlace("steps", "Step by step",
              "Each step and each backstep, which is estimated from its own cycle alone. Lines are "
              "the step sizes and backsteps of the runs, from all settled cycles, with their 95 % "
              "confidence intervals.", _cycle_by_cycle(runs)),
        PlotPlace("slip", "Backstep and ringing",
              "Displacement after the slips: the mean over the settled cycles of each run.",
              _slips(motion, runs)),
    )  # fmt: skip
    return [plot for plot in plots if plot.figure["data"]]


def _overview(motion: Motion, runs: Sequence[Run]) -> Figure:
    factor, unit = scale_of(float(np.ptp(motion.x)), "m")
    time, time_unit = scale_of(motion.duration, "s")
    t, x = thin_columns(motion.t, motion.x, count=_OVERVIEW)
    shapes, notes = [], []
    for k, run in enumerate(runs):
        begin, end = time * run.start, time * run.end
        shapes.append(stretch_of(begin, end, TINTS[k % len(TINTS)]))
        notes.append(
            {"x": 0.5 * (begin + end), "y": 1, "yref": "paper", "yanchor": "bottom",
             "text": f"run {k + 1}", "showarrow": False}
        )  # fmt: skip
    data = [line_of(time * t, factor * x, "measured", MEASURED, unit, time_unit)]
    frame = layout_of(
        420,
        xaxis=axis_of(f"time ({time_unit})"),
        yaxis=axis_of(f"position ({unit})"),
        shapes=shapes,
        annotations=notes,
        showlegend=False,
    )
    return {"data": data, "layout": frame}


def motion_and_residual(
    t: Array, lines: Sequence[tuple[Array, str, str]], residuals: Sequence[tuple[Array, str, str]]
) -> Figure:
    """Return a plot of positions (m) over time (s), and of residuals (m) below.

    Each line is its values, its name and its colour.
    """
    time, time_unit = scale_of(float(np.ptp(t)), "s")
    factor, unit = scale_of(float(np.ptp(lines[0][0])), "m")
    rest, rest_unit = scale_of(float(np.max(np.abs(residuals[0][0]))), "m")
    every = (*lines, *residuals)
    at, *thin = thin_columns(t, *(values for values, _, _ in every), count=_OVERVIEW)
    data = []
    for k, (values, (_, name, color)) in enumerate(zip(thin, every, strict=True)):
        y, scale, named = ("y", factor, unit) if k < len(lines) else ("y2", rest, rest_unit)
        data.append(line_of(time * at, scale * values, name, color, named, time_unit, yaxis=y))
    layout = layout_of(
        520,
        xaxis=axis_of(f"time ({time_unit})", anchor="y2"),
        yaxis=axis_of(f"position ({unit})", domain=[0.42, 1.0]),
        yaxis2=axis_of(f"residual ({rest_unit})", domain=[0.0, 0.34], zeroline=True),
    )
    return {"data": data, "layout": layout}


def _cycle_by_cycle(runs: Sequence[Run]) -> Figure:
    data, shapes, first = [], [], 1
    for k, run in enumerate(runs):
        number = np.arange(first, first + run.steps, dtype=np.float64)
        shown_once = {"legendgroup": "all", "showlegend": k == 0}
        mode = "lines+markers" if run.steps <= 200 else "lines"
        steps, backs = _settled(run, first)
        for values, mean, name, whole, colors, place, settled in (
            (run.step_sizes, run.step_size, "step", "step size", (MEASURED, SIMULATED), "y", steps),
            (run.backsteps, run.backstep, "single backstep", "backstep", (ACTUATOR, RESIDUAL),
             "y2", backs),
        ):  # fmt: skip
            if not np.isfinite(values).any():
                continue
            data.append(
                line_of(number[: len(values)], 1e9 * values, name, colors[0], "nm", "", mode=mode,
                     yaxis=place, marker={"size": 4}, **shown_once)
            )  # fmt: skip
            data.append(
                line_of(settled, np.full(2, 1e9 * mean), whole, colors[1], "nm", "",
                     yaxis=place, **shown_once)
            )  # fmt: skip
        shapes += settled_bands(run, first)
        first += run.steps
    frame = layout_of(
        520,
        xaxis=axis_of("cycle, counted through all runs", anchor="y2", tickformat="d"),
        yaxis=axis_of("step (nm)", domain=[0.46, 1.0]),
        yaxis2=axis_of("backstep (nm)", domain=[0.0, 0.38]),
        shapes=shapes,
    )
    return {"data": data, "layout": frame}


def settled_bands(run: Run, first: int, gain: float = 1.0) -> list[Figure]:
    """Return the intervals of step size and backstep over the settled cycles of a run.

    first: number of its first cycle; gain: what lengths are divided by. Steps are on y, backsteps
    on y2, both in nm.
    """
    steps, backs = _settled(run, first)
    bands = []
    for mean, error, place, (begin, end) in (
        (run.step_size, run.step_size_error, "y", steps),
        (run.backstep, run.backstep_error, "y2", backs),
    ):
        half = CONFIDENCE * error
        if math.isfinite(half):
            low, high = (1e9 * (mean + sign * half) / gain for sign in (-1, 1))
            bands.append(stretch_of(begin, end, "#dccfe8", yref=place, y0=low, y1=high))
    return bands


def _settled(run: Run, first: int) -> tuple[Array, Array]:
    """Return where the settled steps of a run begin and end, and the backsteps without the last.

    The only one counts; one alone is seen, too.
    """
    steps, backs = (
        np.array([first + settled_from(count) - 0.4, first + count - 0.6])
        for count in (run.steps, max(run.steps - 1, 1))
    )
    return steps, backs


def _slips(motion: Motion, runs: Sequence[Run]) -> Figure:
    colors = (MEASURED, SIMULATED, ACTUATOR)
    data = []
    record = Record(motion.t, motion.x)
    mean = MeanPosition(record)
    for k, run in enumerate(runs):
        kept = run.slips[run.first_cycle :][:_CYCLES]
        fold = fold_slips(record, mean, kept, run.period, run.direction)
        if fold.enough:
            since, x = fold.binned()
            x -= float(np.interp(0.0, since, x))
            data.append(line_of(1e6 * since, 1e9 * x, f"run {k + 1}", colors[k % 3], "nm", "µs"))
    frame = layout_of(
        380, xaxis=axis_of("time after the slip (µs)"), yaxis=axis_of("displacement (nm)")
    )
    return {"data": data, "layout": frame}


def _table(runs: Sequence[Run]) -> dict[str, object]:
    every = (
        (k + 1, cycle + 1, run.slips[cycle], step, back)
        for k, run in enumerate(runs)
        for cycle, (step, back) in enumerate(zip(run.step_sizes, run.backsteps, strict=True))
    )
    rows = [
        [str(run), str(cycle), f"{slip:.9g}"]
        + [f"{1e9 * value:.3f}" if math.isfinite(value) else "" for value in lengths]
        for run, cycle, slip, *lengths in islice(every, _ROWS)
    ]
    return {"rows": rows, "left_out": sum(run.steps for run in runs) - len(rows)}
