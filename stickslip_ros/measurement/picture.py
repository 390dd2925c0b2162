# SPDX-License-Identifier: Apache-2.0
"""Pictures of a comparison and of a measurement alone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stickslip_ros.files import whole_file
from stickslip_ros.measurement.analysis_page import CONFIDENCE, TINTS
from stickslip_ros.measurement.comparison import Comparison
from stickslip_ros.measurement.figures import ACTUATOR, DIFFERENCE, MEASURED, RUN, SHAPE
from stickslip_ros.measurement.thinning import thinned
from stickslip_ros.reporting import scale_of, shown
from stickslip_ros.traces.motion import Motion
from stickslip_ros.traces.runs import Run, after_slip

_POINTS = 6000
#: Kinds of pictures of a measurement, by the end of the file's name.
PICTURES = (".png", ".svg", ".pdf")


def plot_runs(path: Path, motion: Motion, runs: Sequence[Run]) -> None:
    """Write a picture of a measurement with its runs marked: steps, backsteps, ringing.

    The name ends with one of `PICTURES`. All of it is written or nothing, or OSError.
    """
    figure = Figure(figsize=(10.0, 8.5), layout="constrained")
    grid = figure.add_gridspec(3, 2, height_ratios=(1.2, 1.0, 1.0))
    factor, unit = scale_of(float(np.ptp(motion.x)), "m")
    time, time_unit = scale_of(float(motion.t[-1] - motion.t[0]), "s")
    t, x = thinned(motion.t, motion.x, count=_POINTS)
    whole = figure.add_subplot(grid[0, :])
    whole.plot(time * t, factor * x, color=MEASURED, linewidth=1)
    whole.set(xlabel=f"time ({time_unit})", ylabel=f"position ({unit})")
    steps, slip = figure.add_subplot(grid[1, :]), figure.add_subplot(grid[2, 1])
    backsteps = figure.add_subplot(grid[2, 0])
    first, colors = 1, (MEASURED, RUN, ACTUATOR)
    for k, run in enumerate(runs):
        color = colors[k % len(colors)]
        whole.axvspan(time * run.start, time * run.end, color=TINTS[k % len(TINTS)], zorder=0)
        whole.annotate(
            f"{run.steps} steps, {run.frequency:.4g} Hz\n"
            + shown(run.step_size, "m", uncertainty=CONFIDENCE * run.step_size_error),
            (0.5 * time * (run.start + run.end), 1.0), xycoords=("data", "axes fraction"),
            ha="center", va="bottom", fontsize="small",
        )  # fmt: skip
        number = np.arange(first, first + run.steps)
        mark = "." if run.steps <= 200 else ","
        steps.plot(number, 1e9 * run.analysis.step_sizes, mark, color=color, label=f"run {k + 1}")
        settled = number[[min(run.first_cycle, run.steps - 1), -1]]
        size, error = 1e9 * run.step_size, 1e9 * CONFIDENCE * run.step_size_error
        steps.fill_between(settled, size - error, size + error, color=color, alpha=0.3, linewidth=0)
        steps.plot(settled, [size, size], color=color, linewidth=1)
        backsteps.plot(number, 1e9 * run.analysis.backsteps, mark, color=color)
        slip.plot(*_micro_nano(*after_slip(motion.t, motion.x, run)), color=color, linewidth=1)
        first += run.steps
    steps.set(xlabel="cycle, counted through all runs", ylabel="step (nm)",
              title="step by step; bands: 95 % confidence of the step size")  # fmt: skip
    backsteps.set(xlabel="cycle", ylabel="backstep (nm)", title="backsteps")
    slip.set(xlabel="time after the slip (µs)", ylabel="displacement (nm)",
             title="backstep and ringing, mean of settled cycles")  # fmt: skip
    if len(runs) > 1:
        steps.legend()
    for axes in figure.axes:
        axes.grid(alpha=0.3)
    figure.suptitle(motion.source)
    with whole_file(path) as part:
        figure.savefig(part, dpi=110, format=path.suffix[1:].lower())


def _micro_nano(
    seconds: NDArray[np.float64], metres: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return 1e6 * seconds, 1e9 * metres


def plot_comparison(path: Path, found: Comparison) -> None:
    """Write a PNG, all of it or nothing; OSError if that cannot be."""
    figure = Figure(figsize=(10.0, 9.0), layout="constrained")
    grid = figure.add_gridspec(3, 2, height_ratios=(1.4, 0.8, 1.2))
    factor, unit = scale_of(float(np.ptp(found.x)), "m")
    time, time_unit = scale_of(float(found.t[-1] - found.t[0]), "s")
    rest, rest_unit = scale_of(found.largest, "m")
    t, x, measured, difference, shape = thinned(
        found.t, found.x, found.measured, found.difference, found.shape_difference, count=_POINTS
    )
    whole = figure.add_subplot(grid[0, :])
    whole.plot(time * t, factor * measured, color=MEASURED, linewidth=1, label="measured")
    whole.plot(time * t, factor * x, color=RUN, linewidth=1, label="run")
    whole.set(ylabel=f"position ({unit})", title="whole run")
    whole.legend()
    left = figure.add_subplot(grid[1, :], sharex=whole)
    left.plot(time * t, rest * difference, color=DIFFERENCE, linewidth=0.8, label="difference")
    if len(found.slips):
        left.plot(time * t, rest * shape, color=SHAPE, linewidth=0.8, label="within the cycles")
        left.legend()
    left.set(xlabel=f"time ({time_unit})", ylabel=f"residual ({rest_unit})")
    steps = found.run_steps
    if steps is not None:
        slip = float(steps.slips[len(steps.slips) // 2])
        swing = (
            1.0 / steps.ringing_frequency if steps.ringing_frequency > 0.0 else steps.period / 50
        )
        inside = (found.t > slip - swing) & (found.t < slip + 8.0 * swing)
        near = figure.add_subplot(grid[2, 0])
        since = 1e6 * (found.t[inside] - slip)
        x0 = float(np.interp(slip, found.t, found.x))
        near.plot(since, 1e9 * (found.measured[inside] - x0), color=MEASURED, linewidth=1)
        near.plot(since, 1e9 * (found.x[inside] - x0), color=RUN, linewidth=1)
        near.set(xlabel="time after the slip (µs)", ylabel="displacement (nm)",
                 title="backstep and ringing")  # fmt: skip
    if found.cycles is not None:
        cycles = figure.add_subplot(grid[2, 1])
        number = np.arange(1, len(found.cycles.slip) + 1)
        mark = "." if len(number) <= 200 else ","
        cycles.plot(number, 1e9 * found.cycles.measured_step, mark, color=MEASURED)
        cycles.plot(number, 1e9 * found.cycles.step, mark, color=RUN)
        cycles.set(xlabel="cycle", ylabel="step (nm)", title="cycle by cycle")
    for axes in figure.axes:
        axes.grid(alpha=0.3)
    figure.suptitle(
        f"{found.run.source} and {found.measurement.source}: RMSE {shown(found.rmse, 'm')}"
    )
    with whole_file(path) as part:
        figure.savefig(part, dpi=110, format="png")
