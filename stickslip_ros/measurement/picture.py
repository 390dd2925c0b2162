# SPDX-License-Identifier: Apache-2.0
"""Picture of a comparison: whole run, residual, one slip, cycle by cycle."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from stickslip_ros.files import whole_file
from stickslip_ros.measurement.comparison import Comparison
from stickslip_ros.measurement.figures import DIFFERENCE, MEASURED, RUN
from stickslip_ros.measurement.thinning import thinned
from stickslip_ros.reporting import scale_of, shown

_POINTS = 6000


def plot_comparison(path: Path, found: Comparison) -> None:
    """Write a PNG, all of it or nothing; OSError if that cannot be."""
    figure = Figure(figsize=(10.0, 9.0), layout="constrained")
    grid = figure.add_gridspec(3, 2, height_ratios=(1.4, 0.8, 1.2))
    factor, unit = scale_of(float(np.ptp(found.x)), "m")
    time, time_unit = scale_of(float(found.t[-1] - found.t[0]), "s")
    rest, rest_unit = scale_of(found.largest, "m")
    t, x, measured, difference = thinned(
        found.t, found.x, found.measured, found.difference, count=_POINTS
    )
    whole = figure.add_subplot(grid[0, :])
    whole.plot(time * t, factor * measured, color=MEASURED, linewidth=1, label="measured")
    whole.plot(time * t, factor * x, color=RUN, linewidth=1, label="run")
    whole.set(ylabel=f"position ({unit})", title="whole run")
    whole.legend()
    left = figure.add_subplot(grid[1, :], sharex=whole)
    left.plot(time * t, rest * difference, color=DIFFERENCE, linewidth=0.8)
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
