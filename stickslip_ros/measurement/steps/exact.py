# SPDX-License-Identifier: Apache-2.0
"""Steps and backsteps of simulated motion, whose cycles are known, and which has no noise."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.steps.measured_value import MeasuredValue
from stickslip_ros.measurement.steps.record import Record
from stickslip_ros.measurement.steps.run import Run
from stickslip_ros.simulation.settled import settled_from

#: Noise (m) below which positions are simulated, and extremes are those of single samples.
EXACT = 1e-11
#: Part of a period after a slip in which its deepest point lies.
_DEEPEST = 0.5


def as_simulated(record: Record, run: Run) -> Run:
    """Return the run of a motion without noise: its steps and extremes are those of the samples."""
    cycles = run.cycles
    forward = cycles.direction * record.x
    ends = cycles.ends if (cycles.ends > cycles.slips).all() else cycles.slips
    levels = np.interp(ends, record.t, forward)
    steps = np.diff(levels, prepend=np.interp(cycles.starts[0], record.t, forward))
    before = _just_before(record.t, forward, cycles.slips)
    deepest = [_deepest(record.t, forward, float(at), cycles.period) for at in cycles.slips]
    when, low = np.array(deepest).T
    backsteps = np.maximum(before - low, 0.0)
    first = settled_from(len(steps))
    kept = steps[first:]
    scatter = float(np.std(kept, ddof=1)) / math.sqrt(len(kept)) if len(kept) > 1 else 0.0
    back = backsteps[first : max(len(steps) - 1, first + 1)]
    error = float(np.std(back)) / math.sqrt(len(back))
    return replace(
        run,
        mean_step=MeasuredValue(cycles.direction * float(np.mean(kept)), scatter),
        mean_backstep=MeasuredValue(float(np.mean(back)), error),
        step_sizes=cycles.direction * steps,
        backsteps=backsteps,
        points=run.points | {"E": when},
    )


def _just_before(t: Array, x: Array, slips: Array) -> Array:
    """Return the place (m) where slips (s) begin, as the samples before them go on.

    Between two samples with the begin of a slip there is a kink.
    """
    k = np.clip(np.searchsorted(t, slips, side="right") - 1, 2, None)
    third, second, last = (k - 2, k - 1, k)
    slope = (x[last] - x[second]) / (t[last] - t[second])
    before = (x[second] - x[third]) / (t[second] - t[third])
    bend = (slope - before) / (t[last] - t[third])
    since = slips - t[last]
    return np.asarray(x[last] + since * (slope + bend * (slips - t[second])))


def _deepest(t: Array, x: Array, slip: float, period: float) -> tuple[float, float]:
    """Return time (s) and height (m) of the deepest point after a slip, by a parabola there."""
    first, last = np.searchsorted(t, [slip, slip + _DEEPEST * period])
    if last - first < 3:
        return math.nan, math.nan
    k = first + int(np.argmin(x[first:last]))
    if not first < k < last - 1:
        return float(t[k]), float(x[k])
    before, after = t[k - 1] - t[k], t[k + 1] - t[k]
    left, right = (x[k - 1] - x[k]) / before, (x[k + 1] - x[k]) / after
    bend = (right - left) / (after - before)
    if not bend > 0.0:
        return float(t[k]), float(x[k])
    slope = left - bend * before
    return float(t[k] - 0.5 * slope / bend), float(x[k] - 0.25 * slope**2 / bend)
