# SPDX-License-Identifier: Apache-2.0
"""Steps and backsteps of cycles that an actuator or a clock gives."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.steps.backstep import find_ringing, measure_slip
from stickslip_ros.measurement.steps.cycle_values import cycle_values
from stickslip_ros.measurement.steps.fold import fold_slips
from stickslip_ros.measurement.steps.measured_value import MeasuredValue, estimate_settled_mean
from stickslip_ros.measurement.steps.noise import noise_of
from stickslip_ros.measurement.steps.record import MeanPosition, Pyramid, Record
from stickslip_ros.measurement.steps.run import Cycles, Run
from stickslip_ros.measurement.steps.timing import SlipGrid
from stickslip_ros.simulation.settled import settled_from, settled_mean

#: Noise (m) below which positions are simulated, and extremes are those of single samples.
EXACT = 1e-11
#: Part of a period after a slip in which its deepest point lies.
_DEEPEST = 0.5


def analyse_cycles(
    time: Array,
    position: Array,
    actuator: Array | None,
    cycles: Cycles,
    noise: float | None = None,
) -> Run:
    """Analyse given cycles of a trace: times (s), runner (m), actuator (m) if known.

    noise (m) is that of a sample, estimated if not given. Positions of simulated motion, without
    noise, are taken as they are; to treat one like a noisy motion, pass the noise of that one.
    """
    noise = noise_of(position) if noise is None else noise
    record = Record(time, position)
    mean, pyramid = MeanPosition(record), Pyramid(record)
    grid = SlipGrid(float(cycles.slips[0]), cycles.period, len(cycles.slips), cycles.direction)
    first = settled_from(grid.count)
    kept = cycles.slips[first : max(grid.count - 1, first + 1)]
    fold = fold_slips(record, mean, kept, cycles.period, cycles.direction)
    rest = cycles.slips[-1] + cycles.period, float(time[-1])
    last = replace(grid, first=float(cycles.slips[-1]), count=1)
    ringing = find_ringing(record, fold, last, rest if rest[1] > rest[0] else None)
    slip = measure_slip(record, fold, cycles.period, 0.0, ringing)
    excitation = math.nan if actuator is None else _stroke(time, actuator, cycles)
    values = cycle_values(record, pyramid, cycles, ringing, slip, 0.0, actuator is not None)
    step = estimate_settled_mean(values.step_sizes, exact=False)
    run = Run(
        cycles, step, slip.backstep, ringing, values.step_sizes, values.backsteps, values.points,
        slip.regained, excitation, why_no_backstep=slip.why_unknown,
    )  # fmt: skip
    return _exact(record, run) if noise < EXACT else run


def _exact(record: Record, run: Run) -> Run:
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
    mean_step = estimate_settled_mean(steps, exact=True)
    first = settled_from(len(steps))
    back = backsteps[first : max(len(steps) - 1, first + 1)]
    error = float(np.std(back)) / math.sqrt(len(back))
    return replace(
        run,
        mean_step=replace(mean_step, value=cycles.direction * mean_step.value),
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


def _stroke(t: Array, u: Array, cycles: Cycles) -> float:
    """Return the actuator's deflection peak to peak, mean over the settled cycles, m."""
    parts = (
        u[slice(*np.searchsorted(t, [begin, end]))]
        for begin, end in zip(cycles.starts, cycles.ends, strict=True)
    )
    return settled_mean(np.array([np.ptp(one) if len(one) else math.nan for one in parts]))
