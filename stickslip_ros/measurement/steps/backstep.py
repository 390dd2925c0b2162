# SPDX-License-Identifier: Apache-2.0
"""Ringing and backstep from the mean cycle.

The backstep is the distance from where the slip begins to the deepest point after it. Its error
holds noise, the begin of the slip between samples, the curve between samples at the deepest point,
unevenness of the slips, and the steps of the converter.

Samples that are further apart than a quarter of a swing do not show where it turns: with three of
them the deepest point is missed by up to 1 - cos(pi / 3), half of the amplitude, and a swing that
takes one sample cannot be told from an alias.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.steps.fold import Fold, Rest
from stickslip_ros.measurement.steps.record import Level, Record, smooth
from stickslip_ros.measurement.steps.ringing import (
    SWINGS_IN_CYCLE,
    Ringing,
    combine,
    fit_later_ringing,
)
from stickslip_ros.measurement.steps.run import MeasuredValue
from stickslip_ros.measurement.steps.settings import SETTINGS
from stickslip_ros.measurement.steps.slips import SlipGrid, unrung

#: Samples of a fold and of a rest in which ringing is sought; times from the begin of a slip to its
#: deepest point that the rest is looked at; samples of it at most.
_FEW_BINS, _FEW_REST, _REST_FALLS, _REST_SAMPLES = 20, 40, 80.0, 2000
#: Parts of a record that may be the rest at its end; swings in a cycle, or cycles in a swing, of a
#: quick drive.
_ENDS, _QUICK = (0.6, 0.45, 0.34, 0.25, 0.19, 0.14, 0.1, 0.06), 4.0
#: Samples of a quarter of a swing in the fold, places of a swing at which all cycles together are
#: sampled, samples of the parabola at the deepest point, and at the begin, at least.
_QUARTER_SAMPLES, _PLACES, _DEEPEST_SAMPLES, _BEGIN_SAMPLES = 6.0, 8.0, 8, 6
#: Distance of samples in a fold, in swings, from which on cycles are sampled at the same places;
#: swings that a fall takes there; distances of samples within which its deepest point is fitted.
_ALIKE_SWINGS, _FALLS, _ALIKE_PLACES = 0.035, (0.2, 0.9), 2.1
#: Swings before the begin that show how the runner rises, those about it that need not, places of
#: samples there at least; deviations from the rise that are none.
_RISE_SWINGS, _GUARD_SWINGS, _RISE_PLACES, _FALLEN = 2.5, 0.15, 5, 4.0
#: Where cycles are sampled at the same places: part of the backstep by which its two ends between
#: samples are missed, in their distance in swings.
_BETWEEN = 1.1
#: Times by which other errors are larger there, and in one or two cycles.
_FEW_PLACES, _FEW_CYCLES = 2.2, 3
#: Part of the backstep by which ringing that lasts until the next slip may move it.
_RINGS_ON = 0.03
#: Swings by which the begin of the slip may miss; length (m) that the shape of a fold may miss, and
#: parts of the step of the converter; backstep (m) below which its error is not judged as part.
_BEGIN_ERROR, _SHAPE, _CONVERTER, _SMALL = 0.02, 1e-10, 0.15, 1e-8


def find_ringing(record: Record, fold: Fold, grid: SlipGrid, rest: Rest | None) -> Ringing | None:
    """Return the ringing in the mean cycle and in the rest after a run; None if none is clear."""
    if not fold.enough:
        return None
    period = grid.period
    t, x = fold.binned()
    falling = (t > 0.0) & (t < 0.4 * period)
    deepest = float(t[falling][np.argmin(x[falling])]) if falling.any() else 0.0
    later = (t > deepest) & (t < 0.9 * period)
    in_cycle = in_rest = None
    if later.sum() > _FEW_BINS:
        in_cycle = fit_later_ringing(t[later], x[later], 0.9 * period)
        if in_cycle is not None and in_cycle.frequency * period <= SWINGS_IN_CYCLE:
            in_cycle = None
    begin = grid.last + deepest
    # The fall takes about half a swing; more than some swings add noise and other frequencies.
    end = min(begin if rest is None else rest[1], begin + _REST_FALLS * deepest)
    first, last = np.searchsorted(record.t, [begin, end])
    if last - first > _FEW_REST:
        part = slice(first, last, max(1, (last - first) // _REST_SAMPLES))
        in_rest = fit_later_ringing(record.t[part] - grid.last, record.x[part], period, 2)
    return combine(in_cycle, in_rest, period)


def ringing_at_the_end(record: Record, period: float) -> Ringing | None:
    """Return the ringing at the end of a record, if a drive of this period (s) is as quick as that.

    Its slips are hidden by ringing that lasts longer than its cycles, which the rest after the last
    one shows alone.
    """
    found = []
    for part in _ENDS:
        first = int(len(record.t) * (1.0 - part))
        stride = max(1, (len(record.t) - first) // (2 * _REST_SAMPLES))
        t, x = record.t[first::stride], record.x[first::stride]
        one = fit_later_ringing(t, x, _QUICK * period, 1)
        if one is None or one.swing < period / _QUICK:
            continue
        turns = one.frequency * period  # near a whole number it is the drive itself
        if abs(turns - round(turns)) * (t[-1] - t[0]) > period or round(turns) == 0:
            found.append(one)
    return min(found, key=lambda one: one.frequency_error, default=None)


def begin_of_slip(t: Array, x: Array, ringing: Ringing, period: float) -> float:
    """Return when (s) the slip begins in a fold: where its middle, without ringing, falls most."""
    swing = ringing.swing
    spacing = swing / 60.0
    even = np.arange(-min(0.4 * period, 2.0 * swing), min(0.45 * period, 2.0 * swing), spacing)
    level = Level(np.interp(even, t, x), spacing, float(even[0]))
    speed = np.gradient(unrung(level, ringing, period).x)
    near = np.abs(even) < min(0.6 * swing, 0.3 * period)
    return float(even[int(np.argmin(np.where(near, speed, math.inf)))]) - 0.01 * swing


@dataclass(frozen=True)
class MeanSlip:
    """The mean slip of the settled cycles of a run."""

    backstep: MeasuredValue = field(default_factory=MeasuredValue)  #: m
    begin: float = 0.0  #: of the fall, s after the slips of the run
    deepest: float = math.nan  #: of the deepest point, s after the slips of the run
    regained: float = math.nan  #: from the deepest point to where the runner rings about, m
    why_unknown: str = ""  #: why the backstep is not determined


def measure_slip(
    record: Record, fold: Fold, period: float, unevenness: float, ringing: Ringing | None
) -> MeanSlip:
    """Return the mean slip of the settled cycles of a run; unevenness (s) is that of its slips."""
    if ringing is None or not fold.enough:
        return MeanSlip(why_unknown="no ringing is seen that shows where slips begin")
    swing, span = ringing.swing, float(np.ptp(fold.t))
    # Cycles may be sampled at the same places.
    gaps = np.diff(fold.t) > 0.2 * record.spacing / fold.cycles
    apart = span / max(int(np.count_nonzero(gaps)), 1)
    samples, places, least = swing / record.spacing, swing / apart, SETTINGS.samples_a_swing
    if samples < least or 0.25 * swing * len(fold.t) / span < _QUARTER_SAMPLES:
        return MeanSlip(
            why_unknown=f"{samples:.1f} samples a swing of the ringing, in {fold.cycles} cycles; "
            f"{least:g} are needed, and {_QUARTER_SAMPLES:g} in a quarter swing of all cycles"
        )
    if places < _PLACES:
        return MeanSlip(
            why_unknown=f"all cycles are sampled at {places:.1f} places a swing of the ringing; "
            f"{_PLACES:g} are needed"
        )
    t, x = fold.binned()
    begin = begin_of_slip(t, x, ringing, period)
    inside = np.flatnonzero((t > begin) & (t <= begin + min(1.2 * swing, 0.5 * period)))
    if len(inside) < 4:
        return MeanSlip(begin=begin, why_unknown="too few samples in the slip")
    smoothed = smooth(x, max(0.02 * swing * len(t) / float(np.ptp(t)), 0.5))
    deepest = float(t[inside[np.argmin(smoothed[inside])]])
    slip, fall = MeanSlip(begin=begin, deepest=deepest), (deepest - begin) / swing
    alike = apart > _ALIKE_SWINGS * swing
    if alike and not _FALLS[0] < fall < _FALLS[1]:
        why = (
            f"all cycles are sampled at the same places, {places:.1f} in a swing of the ringing, "
            f"and the fall takes {fall:.2g} swings: a faster one looks alike"
        )
        return replace(slip, why_unknown=why)
    reach = max(0.1 * swing, _ALIKE_PLACES * apart if alike else 0.0)
    about = np.abs(fold.t - deepest) < reach
    rise = _rise_before(fold, begin, ringing, record.resolution) if alike else None
    high = rise if alike else _rise_about(fold, begin, swing, apart)
    if about.sum() < _DEEPEST_SAMPLES or high is None:
        return replace(slip, why_unknown="too few samples where slips begin and end")
    low, low_error, _ = _vertex(fold.t[about] - deepest, fold.x[about], reach)
    value = high.value - low
    few = alike or fold.cycles < _FEW_CYCLES
    error = (_FEW_PLACES if few else 1.0) * math.hypot(
        low_error,
        high.error,
        0.5 * (2.0 * math.pi * unevenness / swing) ** 2 * value,
        _RINGS_ON * math.exp(-ringing.decay * period) * value,
        _CONVERTER * record.resolution,
        _SHAPE,
    )
    error = math.hypot(error, _BETWEEN * (apart / swing) * value if alike else 0.0)
    slip = replace(slip, regained=_centre(fold, deepest, ringing) - low)
    if error > SETTINGS.backstep_error * max(value, _SMALL) or value < 0.0:
        return replace(slip, why_unknown=f"its error, {1e9 * error:.2g} nm, is too large")
    return replace(slip, backstep=MeasuredValue(value, error))


def _rise_about(fold: Fold, begin: float, swing: float, apart: float) -> MeasuredValue | None:
    """Return the place (m) where the slip begins, from samples just before and about it."""
    about = (fold.t > begin - 0.15 * swing) & (fold.t < begin + 0.01 * swing)
    if about.sum() < _BEGIN_SAMPLES:
        return None
    high, error, speed = _vertex(fold.t[about] - begin, fold.x[about], 0.0)
    return MeasuredValue(high, math.hypot(error, speed * max(_BEGIN_ERROR * swing, 0.3 * apart)))


def _rise_before(
    fold: Fold, begin: float, ringing: Ringing, resolution: float
) -> MeasuredValue | None:
    """Return the place (m) where the slip begins, None if there are too few samples before it.

    Before it the runner rises and rings on. This goes on until the first sample that falls from it;
    the slip begins between that and the sample before.
    """
    swing = ringing.swing
    guard = _GUARD_SWINGS * swing
    near = (fold.t > begin - guard - _RISE_SWINGS * swing) & (fold.t < begin + 0.5 * swing)
    t, x = fold.t[near] - begin, fold.x[near]
    before = t < -guard
    places = len(np.unique(np.round(t[before] / (1e-3 * swing))))
    if places < _RISE_PLACES:
        return None
    order = 2 if places >= 6 * _RISE_PLACES else 1
    design = np.column_stack([*((t / swing) ** k for k in range(order + 1)), ringing.columns(t)])
    found, *_ = np.linalg.lstsq(design[before], x[before], rcond=None)
    left = x - design @ found
    freedom = max(before.sum() - design.shape[1], 1)
    scatter = math.sqrt(float(left[before] @ left[before]) / freedom)
    fallen = np.flatnonzero((t >= -guard) & (left < -max(_FALLEN * scatter, resolution, _SHAPE)))
    if not len(fallen):
        return None
    last = int(np.searchsorted(t, t[fallen[0]] - 1e-6 * swing)) - 1
    columns = design[[int(np.searchsorted(t, t[last])), int(fallen[0])]]
    ends = columns @ found
    inverse = np.linalg.pinv(design[before].T @ design[before])
    chance = scatter**2 * float(columns[0] @ inverse @ columns[0])
    return MeasuredValue(
        float(ends.mean()), math.sqrt(max(chance, 0.0) + float(ends[1] - ends[0]) ** 2 / 12.0)
    )


def _centre(fold: Fold, deepest: float, ringing: Ringing) -> float:
    """Return the place (m) about which the runner rings at the deepest point of a fold."""
    part = (fold.t > deepest) & (fold.t < deepest + 1.25 * ringing.swing)
    if part.sum() < _DEEPEST_SAMPLES:
        return math.nan
    since = fold.t[part] - deepest
    design = np.column_stack([np.ones_like(since), since, ringing.columns(since)])
    return float(np.linalg.lstsq(design, fold.x[part], rcond=None)[0][0])


def _vertex(t: Array, x: Array, reach: float) -> tuple[float, float, float]:
    """Return the least value (m) of a parabola within reach (s) of 0, its error, the speed at 0."""
    scale = float(np.abs(t).max())
    columns = np.stack([np.ones_like(t), t / scale, (t / scale) ** 2], axis=1)
    found, *_ = np.linalg.lstsq(columns, x, rcond=None)
    left = x - columns @ found
    variance = float(left @ left) / max(len(t) - 3, 1)
    reach /= scale
    at = float(np.clip(-0.5 * found[1] / found[2], -reach, reach)) if found[2] > 0.0 else 0.0
    row = np.array([1.0, at, at * at])
    error = variance * float(row @ np.linalg.pinv(columns.T @ columns) @ row)
    return float(row @ found), math.sqrt(max(error, 0.0)), float(found[1]) / scale
