# SPDX-License-Identifier: Apache-2.0
"""The runs of steps of both motions in pairs, with their metrics.

Both motions are analysed alike: the run at the samples of the measurement, by position alone, so
that a bias of the estimators is the same for both. Only if both motions include their actuators,
each is analysed with its own. The alignment says which run of steps is which.

The tolerance of a metric is so many standard uncertainties of the difference that chance exceeds
one of all metrics in 0.3 % of comparisons (Šidák, J. Am. Stat. Assoc. 62 (1967) 626), and never
less than what the fits themselves can resolve.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.measurement.metric import COUNT, METRICS, ComparisonMetric
from stickslip_ros.measurement.motion_pair import Alignment, MotionPair, Pairs
from stickslip_ros.measurement.steps.actuator_cycles import runs_of_signal
from stickslip_ros.measurement.steps.analysis import analyse_cycles, has_actuator, runs_of
from stickslip_ros.measurement.steps.cycle_values import EXACT
from stickslip_ros.measurement.steps.doubts import NO_REST, UNSURE_END
from stickslip_ros.measurement.steps.drive import Drive
from stickslip_ros.measurement.steps.noise import noise_of
from stickslip_ros.measurement.steps.record import TraceError
from stickslip_ros.measurement.steps.run import COVERAGE, Run, main_run
from stickslip_ros.simulation.motion import Motion

#: Samples of a cycle that both have in common, at least.
_SAMPLES = 2
#: Part of a step by which two ways differ; part of a period that shows where one begins and ends.
_PART, _NEAR = 0.25, 0.25
#: A time (s) before or after all motions.
_EVER = 1e12


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
    with suppress(TraceError):
        found = runs_of(motion, Drive.given(frequency))
    if any(set(one.doubts) <= {NO_REST, UNSURE_END} for one in found):
        return found
    with suppress(TraceError):
        return runs_of(motion) or found
    return found


def pair_runs(
    motions: MotionPair,
    own: Sequence[Run],
    measured: Sequence[Run],
    alignment: Alignment,
    pairs: Pairs,
    period: float | None,
) -> list[RunPair]:
    """Pair each measured run with that of the run, analysed at the times of pairs.

    own are the runs of steps in all of the run, period (s) is that of its parameters, if it was
    made of them. Without measured runs, return one pair without runs.
    """
    if not measured:
        return [RunPair.without_run(None, "the measurement has no steps")]
    run, driven = motions.run, has_actuator(motions.run.u)
    seen = Motion(run.source, pairs.t, pairs.run)
    alike = driven and has_actuator(motions.measurement.u)
    # As those measured were found, so that two motions that are the same have the same runs.
    runs = own if alike else runs_in(seen, main_run(measured).frequency)
    limit = significant(len(METRICS) * len(measured))
    middles = [0.5 * (a.end + b.start) for a, b in pairwise(measured)]
    edges = alignment.run_time(np.array([-_EVER, *middles, _EVER]))
    found = []
    for one, free in zip(measured, pairwise(edges.tolist()), strict=True):
        begin, end = alignment.run_time(np.array([one.start, one.end])).tolist()
        partner, why = nearest_run(runs, one.direction, begin, end), "none are found there"
        if driven and not alike and not (partner and partner.determined):
            try:
                partner = _driven_run(motions, seen.between(*free), run.between(*free))
            except TraceError as error:  # its position shows the run, or it has none
                why = str(error)
        if partner is None:
            found.append(RunPair.without_run(one, f"the run has no such steps: {why}"))
            continue
        whole = nearest_run(own, one.direction, begin, end) or partner
        others = [whole] if driven and whole.determined and whole.steps == partner.steps else []
        compared = partner, one, motions.spacing, alignment.gain, limit, period
        metrics = step_metrics(*compared, others)
        if others and any(metric.differs for metric in metrics):
            others += _with_noise(seen, noise_of(motions.measurement.x), partner)
            metrics = step_metrics(*compared, others)
        count = metrics[-1]
        if whole.determined and one.determined:  # though the part in common may cut a cycle
            count = replace(COUNT, run=whole.steps, measured=one.steps, tolerance=0.0)
        if not count.why_missing:
            part = _part_of_a_step(pairs, partner, one, begin, end)
            if whole.steps == one.steps and part:
                count = replace(COUNT, why_missing=part)
            else:
                count = replace(count, run=whole.steps)
        found.append(RunPair(partner, one, [*metrics[:-1], count]))
    return found


def _part_of_a_step(pairs: Pairs, run: Run, measured: Run, begin: float, end: float) -> str:
    """Say that the measured way holds part of a step more or less than that of the run.

    begin and end (s) are those of the measured run by the clock of pairs. Empty where both ways are
    as many steps, and where no samples tell.
    """
    period, t = measured.period, pairs.t
    before = (t > begin - _NEAR * period) & (t < begin)
    last = min(end + period, float(t[-1]))
    after = (t > max(end, last - _NEAR * period)) & (t <= last)
    if not before.any() or not after.any():
        return ""
    ways = [
        float(x[after].mean() - x[before].mean()) / one.step_size
        for x, one in ((pairs.run, run), (pairs.measured, measured))
    ]
    errors = [COVERAGE * one.step_size_error / one.step_size for one in (run, measured)]
    if not abs(ways[1] - ways[0]) > _PART + measured.steps * math.hypot(*errors):
        return ""
    return (
        f"{measured.steps} cycles each, but {ways[1]:.1f} steps from before them to after them, "
        f"where the run makes {ways[0]:.1f}: look whether the drive stopped within a cycle"
    )


def _driven_run(motions: MotionPair, seen: Motion, part: Motion) -> Run:
    """Return the run of steps in a part of the run, whose actuator gives its cycles.

    seen has the samples of the part that are analysed. Raises TraceError.
    """
    if not has_actuator(part.u):
        raise TraceError("its actuator rests there")
    cycles = max(runs_of_signal(part.t, part.u), key=lambda one: len(one.slips), default=None)
    if cycles is None or len(seen.t) < _SAMPLES * len(cycles.slips):
        raise TraceError(f"fewer than {_SAMPLES} samples a cycle are in common")
    noise = max(noise_of(motions.measurement.x), EXACT)
    return analyse_cycles(seen.t, seen.x, [cycles], noise)[0]


def _with_noise(seen: Motion, noise: float, run: Run) -> list[Run]:
    """Return a run of steps as it is found in the motion seen with noise (m), if it is."""
    x = seen.x + np.random.default_rng(1).normal(0.0, noise, len(seen.x))
    found = runs_in(replace(seen, x=x), run.frequency)
    one = nearest_run(found, run.direction, run.start, run.end)
    return [one] if one and one.steps == run.steps else []


def nearest_run(runs: Sequence[Run], direction: int, begin: float, end: float) -> Run | None:
    """Return the run with most time between begin and end (s), None if there is none."""
    shared = [
        (min(one.end, end) - max(one.start, begin), k)
        for k, one in enumerate(runs)
        if one.direction == direction
    ]
    longest, k = max(shared, default=(0.0, 0))
    return runs[k] if longest > 0.0 else None


def significant(comparisons: int) -> float:
    """Return the standard errors that one of so many differences exceeds by chance.

    That is as rare as one difference beyond `COVERAGE`.
    """
    chance = 2.0 * scipy.special.ndtr(-COVERAGE)
    return float(-scipy.special.ndtri(-0.5 * math.expm1(math.log1p(-chance) / comparisons)))


def _value(run: Run, row: ComparisonMetric) -> float:
    """Return a metric of a run of steps, by the name that the run has for it."""
    return float(getattr(run, row.name.replace(" ", "_")))


def _error(run: Run, row: ComparisonMetric, spacing: float) -> float:
    """Return its standard error, nan where that is unknown; spacing (s) is that of the samples."""
    if row.name == "period":  # the first and the last slip give it, each to about two samples
        return 2.0 * spacing / max(1, run.steps - 1)
    if row.unit == "m":
        return float(getattr(run, f"{row.name.replace(' ', '_')}_error"))
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
    others: Sequence[Run] = (),
) -> list[ComparisonMetric]:
    """Return the metrics of one run of steps, and the number of its steps.

    spacing (s) is that of the samples, gain that of lengths of the measurement over those of the
    run, limit in standard errors; period (s) is that of the parameters that the run was made of.
    others are the run of steps as all of its samples show it, or samples with noise: by as much as
    these are apart, samples and noise of the measurement may be to blame.
    """
    doubts = dict.fromkeys((*run.doubts, *measured.doubts))
    swings = [one for one in (run.ringing_frequency, measured.ringing_frequency) if one > 0.0]
    folded = max(swings, default=0.0) * spacing > 0.5  # then samples show a slower swing
    metrics = []
    for row in METRICS:
        scale, is_length, why = 1.0 / gain if row.scaled else 1.0, row.unit == "m", ""
        first, second = _value(run, row), scale * _value(measured, row)
        blurred = [abs(first - _value(one, row)) for one in others]
        error = math.hypot(_error(run, row, spacing), scale * _error(measured, row, spacing))
        if row.name == "period" and period is not None:
            first, blurred, error = period, [], _error(measured, row, spacing)
        if not math.isfinite(first + second):
            why = row.unseen
        elif folded and row.name in ("ringing frequency", "damping ratio"):
            why = "the samples are too far apart for the ringing: sample faster"
        elif not math.isfinite(error):
            why = "the record does not tell its uncertainty"
        # Two that are the same may be read as other cycles.
        elif not doubts.keys() <= {NO_REST, UNSURE_END}:
            why = "not compared: the cycles are not sure, see steps"
        tolerance = max(limit * error, row.floor * (1.0 if is_length else abs(first)))
        tolerance += max(filter(math.isfinite, blurred), default=0.0)
        metrics.append(
            replace(
                row,
                run=first,
                measured=second,
                tolerance=math.inf if why else tolerance,
                why_missing=why,
                step=abs(run.step_size) if is_length else 0.0,
            )
        )
    if doubts:
        return [*metrics, replace(COUNT, why_missing="; ".join(doubts))]
    return [*metrics, replace(COUNT, run=run.steps, measured=measured.steps, tolerance=0.0)]
