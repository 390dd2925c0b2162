# SPDX-License-Identifier: Apache-2.0
"""The runs of steps of both motions in pairs, with their metrics, and which of them differ.

Both motions are analysed alike: the run at the samples of the measurement, by position alone, so
that a bias of the estimators is the same for both. Only if both motions include their actuators,
each is analysed with its own. The alignment says which run of steps is which.

A value differs if the two are further apart than the tolerance: so many standard uncertainties of
the difference that chance exceeds one of all metrics in 0.3 % of comparisons (Šidák, J. Am. Stat.
Assoc. 62 (1967) 626), and never less than what the fits themselves can resolve.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.base.reporting import format_si
from stickslip_ros.measurement.alignment import align, align_starts
from stickslip_ros.measurement.metric_rows import METRICS
from stickslip_ros.measurement.motion_pair import Alignment, Fits, MotionPair, Pairs
from stickslip_ros.measurement.steps.actuator_cycles import cycles_of_actuator
from stickslip_ros.measurement.steps.doubts import NO_REST
from stickslip_ros.measurement.steps.known_cycles import analyse_cycles
from stickslip_ros.measurement.steps.measured_value import COVERAGE, MeasuredValue
from stickslip_ros.measurement.steps.motions import (
    find_runs,
    has_actuator,
    runs_of,
    why_left_out,
)
from stickslip_ros.measurement.steps.noise import noise_of
from stickslip_ros.measurement.steps.record import TraceError
from stickslip_ros.measurement.steps.run import Run, main_run
from stickslip_ros.simulation.motion import Motion

#: Periods of the drive before the first and after the last slip of a run that belong to it.
_BEFORE, _AFTER = 1.5, 0.98
#: Samples of a cycle that both have in common, at least.
_SAMPLES = 2
#: Part of a step by which two ways differ; part of a period that shows where one begins and ends.
_PART, _NEAR = 0.25, 0.25
#: A time (s) before or after all motions.
_EVER = 1e12


@dataclass(frozen=True)
class ComparisonMetric:
    """One quantity of both; nan where it cannot be determined."""

    name: str
    unit: str  #: SI
    run: float
    measured: float
    tolerance: float
    why_missing: str = ""

    @property
    def difference(self) -> float:
        """Measured minus run."""
        return self.measured - self.run

    @property
    def differs(self) -> bool | None:
        """Whether the two differ; None where that cannot be determined."""
        if not math.isfinite(self.difference) or not math.isfinite(self.tolerance):
            return None
        return bool(abs(self.difference) > self.tolerance)

    @property
    def verdict(self) -> str:
        """The same in a word, or why it cannot be determined."""
        if self.differs is None:
            return self.why_missing or "not determined"
        return "differs" if self.differs else "agrees"

    @property
    def texts(self) -> tuple[str, str, str, str]:
        """Run, measured, difference and tolerance with their unit; a dash for an unknown value."""
        size = float(np.nanmax(np.abs([self.run, self.measured]), initial=0.0))
        run, measured = (format_si(x, self.unit, 5, size) for x in (self.run, self.measured))
        difference, tolerance = (
            format_si(x, self.unit, 3) for x in (self.difference, self.tolerance)
        )
        return run, measured, difference, tolerance

    def as_json(self) -> dict[str, Any]:
        """Return it by name, without the name."""
        names = ("unit", "run", "measured", "difference", "tolerance", "differs")
        found = {name: getattr(self, name) for name in names}
        return {**found, "why_missing": self.why_missing or None}

    @classmethod
    def missing(cls, name: str, unit: str, why: str) -> ComparisonMetric:
        """Return a metric that cannot be determined."""
        return cls(name, unit, math.nan, math.nan, math.nan, why)


def most_different(runs: Sequence[Sequence[ComparisonMetric]]) -> list[ComparisonMetric]:
    """Return of each metric that of the run in which it is worst, in the order of the first run.

    A metric that differs is worse than one that is missing, and that is worse than one that agrees.
    """

    def badness(one: ComparisonMetric) -> tuple[int, float]:
        if one.differs is None:
            return 1, 0.0
        return 2 * one.differs, abs(one.difference) / max(one.tolerance, 1e-300)

    return [max(same, key=badness) for same in zip(*runs, strict=True)]


@dataclass(frozen=True)
class RunPair:
    """One run of steps in both motions; None where a motion does not show it, and why."""

    run: Run | None
    measured: Run | None
    metrics: Sequence[ComparisonMetric]  #: of this run alone
    why_missing: str = ""
    left_out: bool = False  #: whether it is in no part that is compared

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


def align_runs(motions: MotionPair, fits: Fits, measured: Sequence[Run]) -> Alignment:
    """Return the alignment by the measured run with most steps. Raises ComparisonError.

    Several runs look alike, so the whole motions are aligned before a run is chosen.
    """
    if not measured:
        return align(motions, fits, None, None)
    main, part = main_run(measured), motions.run
    begun = align_starts(motions, measured) if fits.offset else None
    if len(measured) > 1:
        clock = begun or align(motions, fits, None, None)
        first = main.slips[0] - _BEFORE * main.period
        last = main.slips[-1] + _AFTER * main.period
        part = part.between(*clock.run_time(np.array([first, last])))
    try:
        own = [
            one for one in motions.runs_in(part, main.frequency) if one.direction == main.direction
        ]
        return align(motions, fits, main_run(own), main, begun)
    except TraceError:
        return align(motions, fits, None, main)


def pair_runs(
    motions: MotionPair, measured: Sequence[Run], alignment: Alignment, pairs: Pairs
) -> list[RunPair]:
    """Pair each measured run with that of the run, analysed at the times of pairs.

    Without measured runs, return one pair without runs.
    """
    if not measured:
        missing = "the measurement has no steps"
        return [RunPair(None, None, missing_metrics(missing), missing)]
    run, frequency = motions.run, main_run(measured).frequency
    driven = has_actuator(run.u)
    alike = driven and has_actuator(motions.measurement.u)
    seen = Motion(run.source, pairs.t, pairs.run)
    try:  # as those measured were found, so that two motions that are the same have the same runs
        runs = runs_of(run) if alike else motions.runs_in(seen, frequency)
    except TraceError:
        runs = []
    limit = significant(len(METRICS) * len(measured))
    middles = [0.5 * (a.end + b.start) for a, b in pairwise(measured)]
    edges = [-_EVER, *middles, _EVER]
    found = []
    for one, free in zip(measured, pairwise(alignment.run_time(np.array(edges))), strict=True):
        begin, end = alignment.run_time(np.array([one.start, one.end])).tolist()
        own, why = nearest_run(runs, one.direction, begin, end), "none are found there"
        if driven and not alike and not (own and own.determined):
            try:
                own = _driven_run(motions, seen.between(*free), run.between(*free), one)
            except TraceError as error:  # its position shows the run, or it has none
                try:
                    found_there = find_runs(seen.t, seen.x, frequency)
                except TraceError:
                    found_there = []
                own, why = nearest_run(found_there, one.direction, begin, end), str(error)
        if own is None:
            missing = f"the run has no such steps: {why}"
            found.append(RunPair(None, one, missing_metrics(missing), missing))
        else:
            metrics = step_metrics(motions, own, one, alignment.gain, limit)
            part = _part_of_a_step(pairs, own, one, begin, end)
            if part and metrics[-1].run == metrics[-1].measured:
                metrics[-1] = ComparisonMetric.missing("steps", "", part)
            found.append(RunPair(own, one, metrics))
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


def _driven_run(motions: MotionPair, seen: Motion, part: Motion, measured: Run) -> Run:
    """Return the run of steps in a part of the run, whose actuator gives its cycles.

    seen has the samples of the part that are analysed. Raises TraceError.
    """
    if not has_actuator(part.u):
        raise TraceError("its actuator rests there")
    frequency = measured.frequency if measured.steps == 1 else None
    cycles = cycles_of_actuator(part.t, part.u, frequency)
    if len(seen.t) < _SAMPLES * len(cycles.slips):
        raise TraceError(f"fewer than {_SAMPLES} samples a cycle are in common")
    noise = noise_of(motions.measurement.x)
    return analyse_cycles(seen.t, seen.x, seen.u, cycles, noise)


def nearest_run(runs: Sequence[Run], direction: int, begin: float, end: float) -> Run | None:
    """Return the run with most time between begin and end (s), None if there is none."""
    shared = [
        (min(one.end, end) - max(one.start, begin), k)
        for k, one in enumerate(runs)
        if one.direction == direction
    ]
    longest, k = max(shared, default=(0.0, 0))
    return runs[k] if longest > 0.0 else None


def with_left_out(
    pairs: Sequence[RunPair], measured: Sequence[Run], compared: Sequence[Run]
) -> list[RunPair]:
    """Return a pair for each measured run: those compared have theirs, the others are left out."""
    if not measured:
        return list(pairs)
    their = iter(pairs)
    return [
        RunPair(None, one, missing_metrics(why), f"left out: {why}", left_out=True)
        if why
        else next(their)
        for one, why in zip(measured, why_left_out(measured, compared), strict=True)
    ]


def significant(comparisons: int) -> float:
    """Return the standard errors that one of so many differences exceeds by chance.

    That is as rare as one difference beyond `COVERAGE`.
    """
    chance = 2.0 * scipy.special.ndtr(-COVERAGE)
    return float(-scipy.special.ndtri(-0.5 * math.expm1(math.log1p(-chance) / comparisons)))


def missing_metrics(why: str) -> list[ComparisonMetric]:
    """Return the metrics of a run that one of both motions does not show, without values."""
    rows = [ComparisonMetric.missing(row.name, row.unit, why) for row in METRICS]
    return [*rows, ComparisonMetric.missing("steps", "", why)]


def _estimates(steps: Run, spacing: float) -> dict[str, MeasuredValue]:
    """Return each of `METRICS` of a run of steps; spacing (s) is that of its samples."""
    damping_error = ringing_error = math.nan
    if steps.ringing is not None:
        ringing_error, damping_error = (
            steps.ringing.frequency_error, steps.ringing.damping_ratio_error,
        )  # fmt: skip
        if not math.isfinite(ringing_error):  # of swings that are not known the decay is not, too
            damping_error = math.nan
        elif math.isinf(damping_error):
            # It is that of the method, the same for both. Chance moves frequency and decay alike
            # (the Cramer-Rao bounds of a damped oscillation).
            damping_error = ringing_error / steps.ringing_frequency
    # The first and the last slip give the period, each to about two samples.
    return {
        "period": MeasuredValue(steps.period, 2.0 * spacing / max(1, steps.steps - 1)),
        "step size": MeasuredValue(steps.step_size, steps.step_size_error),
        "backstep": MeasuredValue(steps.backstep, steps.backstep_error),
        "ringing frequency": MeasuredValue(steps.ringing_frequency, ringing_error),
        "damping ratio": MeasuredValue(steps.damping_ratio, damping_error),
    }


def step_metrics(
    motions: MotionPair, run: Run, measured: Run, gain: float, limit: float
) -> list[ComparisonMetric]:
    """Return the metrics of one run of steps, and the number of its steps.

    gain is that of lengths of the measurement over those of the run; limit is in standard errors.
    """
    spacing = motions.spacing
    of_run, of_measured = _estimates(run, spacing), _estimates(measured, spacing)
    if motions.period is not None:
        of_run["period"] = MeasuredValue(motions.period, 0.0)
    doubts = dict.fromkeys((*run.doubts, *measured.doubts))
    swings = [one for one in (run.ringing_frequency, measured.ringing_frequency) if one > 0.0]
    folded = max(swings, default=0.0) * spacing > 0.5  # then samples show a slower swing
    counted = doubts.keys() <= {NO_REST}
    metrics = []
    for row in METRICS:
        first, second = of_run[row.name], of_measured[row.name]
        scale = 1.0 / gain if row.scaled else 1.0
        error = math.hypot(first.error, scale * second.error)
        floor = row.floor * (1.0 if row.unit == "m" else abs(first.value))
        why = row.missing if not math.isfinite(first.value + second.value) else ""
        if not why and folded and row.name in ("ringing frequency", "damping ratio"):
            why, error = "the samples are too far apart for the ringing: sample faster", math.inf
        if not why and not math.isfinite(error):
            why = "the record does not tell its uncertainty"
        tolerance = max(limit * error, floor)
        if not why and not counted:  # two motions that are the same may be read as other cycles
            why, tolerance = "not compared: the cycles are not sure, see steps", math.inf
        metrics.append(
            ComparisonMetric(row.name, row.unit, first.value, scale * second.value, tolerance, why)
        )
    own, other = (math.nan, math.nan) if doubts else (run.steps, measured.steps)
    return [*metrics, ComparisonMetric("steps", "", own, other, 0.5, "; ".join(doubts))]
