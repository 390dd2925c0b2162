# SPDX-License-Identifier: Apache-2.0
"""Steps, backsteps and the points of Fig. 2 cycle by cycle.

In a measurement the mean slip gives what all cycles have in common, and single cycles how far they
are from it. Simulated motion has no noise: there they are those of its samples.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.steps.record import Record
from stickslip_ros.measurement.steps.ringing import Ringing
from stickslip_ros.measurement.steps.run import Cycles, Run
from stickslip_ros.simulation.settled import settled_from

#: Noise (m) below which positions are simulated, and extremes are those of single samples.
EXACT = 1e-11
#: Part of a period before a slip whose mean tells how far the runner has got; of it, the part at
#: the end that is left out, as slips are not quite even.
_RUN_UP, _UNEVEN = 0.2, 0.01


def steps_of_cycles(record: Record, cycles: Cycles, settled_step: float) -> Array:
    """Return the step (m) of each cycle, (cycles,); settled_step (m) is the mean of settled ones.

    A cycle ends with the mean position in its last part before the slip.
    """
    begins = np.searchsorted(record.t, cycles.slips - _RUN_UP * cycles.period)
    ends = np.searchsorted(record.t, cycles.slips - _UNEVEN * cycles.period)
    sums = np.concatenate([[0.0], np.cumsum(record.x - record.x[0])])
    count = ends - begins
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = (sums[ends] - sums[begins]) / count
    at = np.interp([cycles.starts[0], *cycles.slips], record.t, record.x) - record.x[0]
    rise = cycles.direction * abs(settled_step) * 0.5 * (_RUN_UP + _UNEVEN)
    return np.diff(np.where(count > 0, mean, at[1:]), prepend=at[0] - rise)


def points_of_cycles(
    cycles: Cycles, ringing: Ringing | None, deepest: float, driven: bool
) -> dict[str, Array]:
    """Return the times (s) of the points of Fig. 2, (cycles,) each; deepest (s) is after slips.

    From rest, a runner is as fast as its actuator, if that is known (driven), after a quarter
    swing. After the deepest point, it takes another quarter until the contact has unbent.
    """
    points = {name: np.full(len(cycles.slips), math.nan) for name in "ABCDEF"}
    points |= {"A": cycles.starts.copy(), "C": cycles.slips.copy(), "E": cycles.slips + deepest}
    if ringing is not None:
        points["F"] = points["E"] + 0.25 * ringing.swing
        if driven:
            points["B"] = cycles.starts + 0.25 * ringing.swing
    return points


def as_simulated(record: Record, run: Run) -> Run:
    """Return the run of a motion without noise: its steps and extremes are those of the samples."""
    forward = run.direction * record.x
    ends = run.ends if (run.ends > run.slips).all() else run.slips
    steps = np.diff(np.interp([run.starts[0], *ends], record.t, forward))
    deepest = [_deepest(record.t, forward, float(at), run.period) for at in run.slips]
    when, low = np.array(deepest).T
    backsteps = np.maximum(_just_before(record.t, forward, run.slips) - low, 0.0)
    first = settled_from(len(steps))
    kept, back = steps[first:], backsteps[first : max(len(steps) - 1, first + 1)]
    scatter = float(np.std(kept, ddof=1)) if len(kept) > 1 else 0.0
    return replace(
        run,
        step_size=run.direction * float(np.mean(kept)),
        step_size_error=scatter / math.sqrt(len(kept)),
        backstep=float(np.mean(back)),
        backstep_error=float(np.std(back)) / math.sqrt(len(back)),
        step_sizes=run.direction * steps,
        backsteps=backsteps,
        points=run.points | {"E": when},
    )


def _just_before(t: Array, x: Array, slips: Array) -> Array:
    """Return the place (m) where slips (s) begin, as the samples before them go on.

    Between two samples with the begin of a slip there is a kink.
    """
    k = np.clip(np.searchsorted(t, slips, side="right") - 1, 2, None)
    slope = (x[k] - x[k - 1]) / (t[k] - t[k - 1])
    bend = (slope - (x[k - 1] - x[k - 2]) / (t[k - 1] - t[k - 2])) / (t[k] - t[k - 2])
    return np.asarray(x[k] + (slips - t[k]) * (slope + bend * (slips - t[k - 1])))


def _deepest(t: Array, x: Array, slip: float, period: float) -> tuple[float, float]:
    """Return time (s) and height (m) of the deepest point in half a period after a slip.

    It is that of a parabola through three samples.
    """
    first, last = np.searchsorted(t, [slip, slip + 0.5 * period])
    if last - first < 3:
        return math.nan, math.nan
    k = first + int(np.argmin(x[first:last]))
    if not first < k < last - 1:
        return float(t[k]), float(x[k])
    bend, slope, low = np.polyfit(t[k - 1 : k + 2] - t[k], x[k - 1 : k + 2], 2)
    if not bend > 0.0:
        return float(t[k]), float(x[k])
    return float(t[k] - 0.5 * slope / bend), float(low - 0.25 * slope**2 / bend)
