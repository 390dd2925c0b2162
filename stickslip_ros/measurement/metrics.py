# SPDX-License-Identifier: Apache-2.0
"""Metrics of run and measurement side by side, and which of them differ.

A value differs if the two are further apart than the tolerance: three times the standard
uncertainty of the difference, and never less than what the fits themselves can resolve. The
uncertainty comes from the scatter between settled cycles, for ringing from fits to parts of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.measurement.motion_pair import Alignment, ComparisonMetric, MotionPair
from stickslip_ros.traces.motion import Motion
from stickslip_ros.traces.ringing import Ringing, fit_ringing
from stickslip_ros.traces.runs import Run
from stickslip_ros.traces.steps import COVERAGE, MeasuredValue

Array = NDArray[np.float64]

#: Parts of a motion in which ringing is fitted, for its uncertainty, and cycles of each.
_PARTS, _CYCLES_OF_PART = 4, 3
#: Amplitudes vary if the actuator's deflections vary by this part, over this many kinds of cycles.
_VARIED, _AMPLITUDES = 0.1, 3
#: Part of a period by which cycles are not the same.
_UNLIKE = 0.1
#: Fewest steps, as part of the deflection, that count as clear for the 0-amplitude.
_CLEAR = 0.1
_ZERO_AMPLITUDE = "0-amplitude"


def error_of_steps_and_shape(
    t: Array, difference: Array, slips: Array, weights: Array
) -> tuple[float, float]:
    """Split the root mean square of a difference into the parts of steps and of shape, m.

    t (s), difference (m) and weights (that add up to 1) have the shape (samples,); slips (s),
    (cycles,), increase. The part of the steps is the mean difference of each cycle, from slip to
    slip, with the rests before and after as cycles of their own: it grows by the difference in step
    size in every cycle. The difference within the cycles is the shape: backstep, ringing, rise.
    Both parts are orthogonal, so that rmse^2 = steps^2 + shape^2. nan where there are no slips.
    """
    if not len(slips):
        return math.nan, math.nan
    whole = float(weights @ difference**2)
    steps = float(weights @ level_of_cycles(t, difference, slips, weights) ** 2)
    return math.sqrt(steps), math.sqrt(max(whole - steps, 0.0))


def level_of_cycles(t: Array, difference: Array, slips: Array, weights: Array) -> Array:
    """Return the weighted mean difference (m) of the cycle that a sample is in, (samples,)."""
    edges = np.unique(np.concatenate(([0], np.searchsorted(t, slips), [len(t)])))
    starts = edges[:-1]
    if not len(starts):
        return np.empty(0)
    weight = np.add.reduceat(weights, starts)
    levels = np.add.reduceat(weights * difference, starts) / np.where(weight > 0.0, weight, 1.0)
    return np.repeat(levels, np.diff(edges))


def missing_metrics(why: str) -> list[ComparisonMetric]:
    """Return the metrics, without values, of a run that one of both motions does not show."""
    names = [*(row[:2] for row in _METRICS), (_ZERO_AMPLITUDE, "m")]
    return [ComparisonMetric.missing(name, unit, why) for name, unit in names]


def step_metrics(
    motions: MotionPair, seen: Motion, run: Run, measured: Run, alignment: Alignment
) -> list[ComparisonMetric]:
    """Return the metrics of one run of steps, lengths and times of the measurement made comparable.

    seen has the samples that the run is analysed at.
    """
    metrics = []
    own, other = _estimates(seen, run), _estimates(motions.measurement, measured)
    own["backstep"], other["backstep"] = _backsteps_of(run, measured)
    for name, unit, floor, length, missing in _METRICS:
        first, second = own[name], other[name]
        scale = 1.0 / alignment.gain if length else 1.0
        error = math.hypot(first.error, scale * second.error)
        tolerance = max(COVERAGE * error, floor(first.value))
        why = missing if not math.isfinite(first.value + second.value) else ""
        if not why and not math.isfinite(error):
            why = "too few cycles to tell its uncertainty"
        metrics.append(
            ComparisonMetric(name, unit, first.value, scale * second.value, tolerance, why)
        )
    metrics.append(_zero_amplitude(motions.run, run, measured, alignment))
    return metrics


def _estimates(motion: Motion, run: Run) -> dict[str, MeasuredValue]:
    """Return the values of one motion by the name of the metric."""
    parts = _ringing_in_parts(motion, run)
    return {
        # The first and the last slip give the period, each to about two samples.
        "period": MeasuredValue(run.period, 2.0 * motion.spacing / max(1, run.steps - 1)),
        "step size": run.mean_step,
        "backstep": run.mean_backstep,
        "ringing frequency": MeasuredValue(
            run.ringing_frequency, _error_of([part.frequency for part in parts])
        ),
        "damping ratio": MeasuredValue(
            run.damping_ratio, _error_of([part.damping_ratio for part in parts])
        ),
    }


def _backsteps_of(run: Run, measured: Run) -> tuple[MeasuredValue, MeasuredValue]:
    """Return the backsteps of both by the same method, so that its error cancels."""
    both = run.mean_backstep, measured.mean_backstep
    if both[0].method != both[1].method:
        return both
    first, second = (MeasuredValue(one.value, one.chance) for one in both)
    return first, second


def _error_of(values: list[float]) -> float:
    if len(values) < 2:
        return 0.0  # too short to cut: the floor decides
    return float(np.std(values, ddof=1)) / math.sqrt(len(values))


def _ringing_in_parts(motion: Motion, steps: Run) -> list[Ringing]:
    """Return the ringing in parts of a motion, each of three cycles or more."""
    if not math.isfinite(steps.ringing_frequency):
        return []
    # A cycle begins with the end of a slip, or with a sample of the slip, which is left out.
    first = np.searchsorted(motion.t, steps.starts[1:], side="right") + 1
    last = np.searchsorted(motion.t, steps.slips[1:])
    count = min(_PARTS, len(first) // _CYCLES_OF_PART)
    if count < 2:
        return []
    found = [
        fit_ringing(
            [(motion.t[j:k] - motion.t[j], motion.x[j:k]) for j, k in zip(js, ks, strict=True)]
        )
        for js, ks in zip(np.array_split(first, count), np.array_split(last, count), strict=True)
    ]
    return [ringing for ringing in found if ringing is not None]


def _zero_amplitude(
    run: Motion, run_steps: Run, measured_steps: Run, alignment: Alignment
) -> ComparisonMetric:
    """Return where lines through steps over amplitudes cross zero (Fig. 7), of both."""

    def missing(why: str) -> ComparisonMetric:
        return ComparisonMetric.missing(_ZERO_AMPLITUDE, "m", why)

    deflection = deflections_of(run, run_steps)
    if not np.nanmax(deflection, initial=0.0) > 0.0:
        return missing("the run does not hold the actuator's deflection")
    if np.nanmin(deflection) > (1.0 - _VARIED) * np.nanmax(deflection):
        return missing("the amplitude does not vary")
    if abs(measured_steps.period - run_steps.period) > _UNLIKE * run_steps.period:
        return missing("run and measurement have other periods")
    places = np.searchsorted(
        run_steps.slips,
        alignment.run_time(measured_steps.slips) - 0.5 * run_steps.period,
    )
    known = places < len(run_steps.slips)
    own = zero_crossing(deflection, single_steps(run_steps))
    other = zero_crossing(
        deflection[places[known]], single_steps(measured_steps)[known] / alignment.gain
    )
    if not math.isfinite(own.value + other.value):
        return missing(f"fewer than {_AMPLITUDES} clear steps of different amplitude")
    tolerance = max(COVERAGE * math.hypot(own.error, other.error), 1e-10)
    return ComparisonMetric(_ZERO_AMPLITUDE, "m", own.value, other.value, tolerance)


def deflections_of(motion: Motion, steps: Run) -> Array:
    """Return the actuator's deflection (m, peak to peak) in each cycle; nan in a cut one."""
    found = []
    for slip in steps.slips:
        first, last = slip - 0.9 * steps.period, slip + 0.1 * steps.period
        u = motion.between(first, last).u
        whole = motion.t[0] <= first and last <= motion.t[-1]
        found.append(np.ptp(u) if u is not None and len(u) and whole else math.nan)
    return np.array(found)


def single_steps(steps: Run) -> Array:
    """Return the sizes of steps (m); nan where a slip before was too small to be seen."""
    single = steps.slips - steps.starts < (1.0 + _UNLIKE) * steps.period
    return np.where(single, np.abs(steps.step_sizes), math.nan)


def zero_crossing(deflection: Array, step: Array) -> MeasuredValue:
    clear = np.isfinite(deflection) & np.isfinite(step) & (step >= _CLEAR * deflection)
    deflection, step = deflection[clear], step[clear]
    if len(np.unique(np.round(deflection, 10))) < _AMPLITUDES:
        return MeasuredValue(math.nan, math.nan)
    (slope, cut), covariance = np.polyfit(deflection, step, 1, cov="unscaled")
    zero = -cut / slope
    scatter = float(np.std(step - slope * deflection - cut, ddof=2))
    gradient = np.array([cut / slope**2, -1.0 / slope])
    return MeasuredValue(float(zero), scatter * math.sqrt(float(gradient @ covariance @ gradient)))


#: Name, unit, least tolerance for the run's value, whether the gain of the sensor counts, and why
#: it may be missing. A tenth of a nanometre is ten times what the model is solved to; the period
#: has its last digits from floating-point times.
_METRICS: tuple[tuple[str, str, Callable[[float], float], bool, str], ...] = (
    ("period", "s", lambda run: 1e-9 * run, False, ""),
    ("step size", "m", lambda run: 1e-10, True, "too few cycles"),
    ("backstep", "m", lambda run: 1e-10, True, "too few samples after the slips"),
    ("ringing frequency", "Hz", lambda run: 5e-3 * abs(run), False, "no ringing seen"),
    ("damping ratio", "", lambda run: 2e-2 * abs(run), False, "no ringing seen"),
)
