# SPDX-License-Identifier: Apache-2.0
"""The runs of steps of both motions in pairs, with their metrics.

Both motions are read alike: the run at the samples of the measurement, and by the cycles that are
found there, so that a bias of the estimators is the same for both. The alignment says which run of
steps is which.

The tolerance of a metric is so many standard uncertainties of the difference that chance exceeds
one of all metrics in 0.3 % of comparisons (Šidák, J. Am. Stat. Assoc. 62 (1967) 626), and never
less than what the fits themselves can resolve.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.metric import COUNT, METRICS, ComparisonMetric
from stickslip_ros.measurement.motion_pair import Alignment, MotionPair, Pairs
from stickslip_ros.measurement.steps.analysis import analyse_cycles, runs_of
from stickslip_ros.measurement.steps.doubts import NO_REST, UNSURE_END
from stickslip_ros.measurement.steps.drive import Drive
from stickslip_ros.measurement.steps.noise import noise_of
from stickslip_ros.measurement.steps.record import TraceError
from stickslip_ros.measurement.steps.run import COVERAGE, Cycles, Run
from stickslip_ros.simulation.motion import Motion

#: Part of a step by which two ways differ; part of a period that shows where one begins and ends.
_PART, _NEAR = 0.25, 0.25
#: Doubts that leave the cycles sure.
_SURE = {NO_REST, UNSURE_END}


@dataclass(frozen=True)
class RunPair:
    """One run of steps in both motions; None where a motion does not show it, and why."""

    run: Run | None
    measured: Run | None
    metrics: Sequence[ComparisonMetric]  #: of this run alone
    why_missing: str = ""
    left_out: bool = False  #: whether it is in no part that is compared

    @classmethod
    def without_run(cls, measured: Run | None, why: str, left_out: bool = False) -> RunPair:
        """Return a measured run of steps, or a measurement without any, that has no partner."""
        missing = [replace(row, why_missing=why) for row in (*METRICS, COUNT)]
        return cls(None, measured, missing, why, left_out)

    @property
    def name(self) -> str:
        """Where the run is, for people."""
        if self.measured is None:
            return "whole measurement"
        way = "forward" if self.measured.direction > 0 else "backward"
        return f"run at {self.measured.start:.4g} s, {way}, {self.measured.steps} steps"

    @property
    def verdict(self) -> str:
        """The metrics that differ, in words."""
        differing = ", ".join(metric.name for metric in self.metrics if metric.differs)
        known = any(metric.differs is not None for metric in self.metrics)
        agrees = "agrees" if known else "not compared"
        return self.why_missing or (f"{differing} differs" if differing else agrees)


def runs_in(motion: Motion, frequency: float | None) -> list[Run]:
    """Return the runs of steps in a motion, sought at a frequency (Hz) first; none if unreadable.

    The actuator shows the cycles where the motion has one.
    """
    found: list[Run] = []
    for drive in (Drive.given(frequency), Drive()):
        with suppress(TraceError):
            found = runs_of(motion, drive) or found
        if any(set(one.doubts) <= _SURE for one in found):
            break
    return found


def pair_runs(
    motions: MotionPair,
    own: Sequence[Run],
    measured: Sequence[Run],
    alignment: Alignment,
    pairs: Pairs,
    period: float | None,
) -> list[RunPair]:
    """Pair each measured run with that of the run, read at the times of pairs by the same cycles.

    own are the runs of steps in all of the run, period (s) is that of its parameters, if it was
    made of them. Without measured runs, return one pair without runs.
    """
    if not measured:
        return [RunPair.without_run(None, "the measurement has no steps")]
    near = [nearest_run(own, one, alignment) for one in measured]
    wholes = [one if one and one.determined else None for one in near]
    cycles = [
        _cycles_in_common(pairs.t, one, whole, alignment)
        for one, whole in zip(measured, wholes, strict=True)
    ]
    noise, held = noise_of(motions.measurement.x), [one for one in cycles if len(one.slips)]
    with_noise = pairs.run + np.random.default_rng(1).normal(0.0, noise, len(pairs.t))
    readings: Iterator[tuple[Run, Run]] = iter(())
    with suppress(ArithmeticError, LookupError, ValueError):  # of samples too few to be read
        both = [analyse_cycles(pairs.t, x, held, noise) for x in (pairs.run, with_noise)]
        readings = zip(*both, strict=True)
    limit = significant(len(METRICS) * len(measured))
    found = []
    for one, some, whole, common in zip(measured, near, wholes, cycles, strict=True):
        partner, noisy = next(readings, (None, None)) if len(common.slips) else (None, None)
        if partner is None or not partner.is_clear or partner.step_size * one.direction < 0.0:
            found.append(RunPair.without_run(one, "the run has no such steps there"))
            continue
        same = whole if whole and whole.steps == partner.steps else None
        given = limit, period or (some or partner).period, noisy, same
        metrics = step_metrics(partner, one, motions.spacing, alignment.gain, *given)
        why = "; ".join(one.doubts) or ("" if whole else "the run does not show how many it has")
        if whole and not why and whole.steps == one.steps:
            why = _part_of_a_step(pairs, partner, one, alignment)
        count = replace(COUNT, why_missing=why)
        if whole and not why:
            count = replace(COUNT, run=whole.steps, measured=one.steps, tolerance=0.0)
        found.append(RunPair(partner, one, [*metrics, count]))
    return found


def _cycles_in_common(t: Array, one: Run, whole: Run | None, alignment: Alignment) -> Cycles:
    """Return the cycles of a measured run that a run has, too, if it is known, by its clock.

    t (s) are the times of the run that are compared.
    """
    near = _NEAR * one.period
    starts, slips, ends = map(alignment.run_time, (one.starts, one.slips, one.ends))
    first, last = (whole.start, whole.end) if whole else (-math.inf, math.inf)
    kept = (slips > max(first, t[0]) - near) & (slips < min(last, t[-1]) + near)
    excitation = whole.excitation if whole else math.nan
    return Cycles(one.period, one.direction, starts[kept], slips[kept], ends[kept], excitation)


def _part_of_a_step(pairs: Pairs, run: Run, measured: Run, alignment: Alignment) -> str:
    """Say that the measured way holds part of a step more or less than that of the run.

    Empty where both ways are as many steps, and where no samples tell.
    """
    begin, end = alignment.run_time(np.array([measured.start, measured.end])).tolist()
    near, last, t = _NEAR * measured.period, min(end + measured.period, pairs.t[-1]), pairs.t
    before, after = (t > begin - near) & (t < begin), (t > max(end, last - near)) & (t <= last)
    if not before.any() or not after.any():
        return ""
    ways, unsure = [], 0.0
    for x, one in ((pairs.run, run), (pairs.measured, measured)):
        ways.append(float(x[after].mean() - x[before].mean()) / one.step_size)
        unsure = math.hypot(unsure, COVERAGE * one.step_size_error / one.step_size)
    if not abs(ways[1] - ways[0]) > _PART + measured.steps * unsure:
        return ""
    return (
        f"{measured.steps} cycles each, but {ways[1]:.1f} steps from before them to after them, "
        f"where the run makes {ways[0]:.1f}: look whether the drive stopped within a cycle"
    )


def nearest_run(runs: Sequence[Run], measured: Run, alignment: Alignment) -> Run | None:
    """Return the run that shares most time and the direction with one measured, or None."""
    begin, end = alignment.run_time(np.array([measured.start, measured.end])).tolist()

    def shared(one: Run) -> float:
        return min(one.end, end) - max(one.start, begin)

    alike = [one for one in runs if one.direction == measured.direction and shared(one) > 0.0]
    return max(alike, key=shared, default=None)


def significant(comparisons: int) -> float:
    """Return the standard errors that one of so many differences exceeds by chance.

    That is as rare as one difference beyond `COVERAGE`.
    """
    chance = 2.0 * scipy.special.ndtr(-COVERAGE)
    return float(-scipy.special.ndtri(-0.5 * math.expm1(math.log1p(-chance) / comparisons)))


def _error(run: Run, row: ComparisonMetric, spacing: float) -> float:
    """Return its standard error, nan where that is unknown; spacing (s) is that of the samples."""
    if row.name == "period":  # the first and the last slip give it, each to about two samples
        return 2.0 * spacing / max(1, run.steps - 1)
    if row.unit == "m":
        return run.step_size_error if row.name == "step size" else run.backstep_error
    if run.ringing is None:
        return math.nan
    of_frequency, of_damping = run.ringing.frequency_error, run.ringing.damping_ratio_error
    if row.unit == "Hz" or not math.isfinite(of_frequency):
        return of_frequency  # of swings that are not known the decay is not, too
    # An infinite one is that of the method, the same for both. Chance moves frequency and decay
    # alike (the Cramer-Rao bounds of a damped oscillation).
    return of_frequency / run.ringing_frequency if math.isinf(of_damping) else of_damping


def step_metrics(
    run: Run,
    measured: Run,
    spacing: float,
    gain: float,
    limit: float,
    period: float | None = None,
    noisy: Run | None = None,
    whole: Run | None = None,
) -> list[ComparisonMetric]:
    """Return the metrics of one run of steps.

    spacing (s) is that of the samples, gain that of lengths of the measurement over those of the
    run, limit in standard errors; period (s) is that of the run where its parameters, or all of it,
    tell. noisy and whole are the run of steps as it is read with noise, and by all of its samples:
    by as much as these are apart, noise and samples of the measurement may be to blame. What chance
    does of it is in the uncertainties already, so that of the noise is added in squares.
    """
    sure = {*run.doubts, *measured.doubts} <= _SURE
    swings = [one.ringing_frequency for one in (run, measured) if one.ringing]
    folded = max(swings, default=0.0) * spacing > 0.5  # then samples show a slower swing
    metrics = []
    for row in METRICS:
        is_length = row.unit == "m"
        scale, why = 1.0 / gain if is_length else 1.0, ""
        name = row.name.replace(" ", "_")
        first, second = float(getattr(run, name)), scale * float(getattr(measured, name))
        blurred = [float(getattr(one or run, name)) - first for one in (noisy, whole)]
        error = math.hypot(_error(run, row, spacing), scale * _error(measured, row, spacing))
        if row.name == "period" and period is not None:
            first, blurred, error = period, [0.0, 0.0], _error(measured, row, spacing)
        if not math.isfinite(first + second):
            why = row.unseen
        elif folded and row.name in ("ringing frequency", "damping ratio"):
            why = "the samples are too far apart for the ringing: sample faster"
        elif not math.isfinite(error):
            why = "the record does not tell its uncertainty"
        elif not sure:  # two that are the same may be read as other cycles
            why = "not compared: the cycles are not sure, see steps"
        tolerance = max(limit * error, row.floor * (1.0 if is_length else abs(first)))
        by_noise, by_samples = (abs(one) if math.isfinite(one) else 0.0 for one in blurred)
        tolerance = math.hypot(tolerance, by_noise) + by_samples
        metrics.append(
            replace(
                row, run=first, measured=second, why_missing=why,
                tolerance=math.inf if why else tolerance,
                step=abs(run.step_size) if is_length else 0.0,
            )
        )  # fmt: skip
    return metrics
