# SPDX-License-Identifier: Apache-2.0
"""Each run of steps in a measurement beside the same run in the other motion, both read alike.

The measurement shows its runs. In the other motion a run is where the alignment puts it; there its
own actuator, or its own steps, say when it slips. Both are then analysed at the same instants, with
the noise of the measurement, by position alone: an estimator that is biased is so on both sides.
Only where both motions hold their actuators, each is analysed by its own, without loss.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stickslip_ros.measurement.alignment import align
from stickslip_ros.measurement.comparison_metric import ComparisonMetric
from stickslip_ros.measurement.motion_pair import Alignment, Fits, MotionPair, Pairs
from stickslip_ros.traces.cycles import Cycles, TraceError, find_cycles
from stickslip_ros.traces.evenly import noise_of
from stickslip_ros.traces.motion import Motion
from stickslip_ros.traces.runs import Run, find_runs
from stickslip_ros.traces.step_analysis import StepAnalysis, analyse_cycles, analyse_steps

#: Periods of the drive before the first and after the last slip of a run that belong to it.
_BEFORE, _AFTER = 1.5, 0.98


@dataclass(frozen=True)
class MeasuredRun:
    """One run of steps of a measurement."""

    steps: StepAnalysis
    found: Run | None = None  #: as it was found by position, without drift and hum


@dataclass(frozen=True)
class RunPair:
    """One run of steps in both motions; None where a motion does not show it, and why."""

    run: StepAnalysis | None
    measured: StepAnalysis | None
    run_seen: Motion  #: the samples that the run is analysed at
    measured_seen: Motion  #: the same of the measurement
    found: Run | None = None  #: the measured run as it was found by position
    why_missing: str = ""
    metrics: Sequence[ComparisonMetric] = ()  #: of this run alone

    @property
    def name(self) -> str:
        """Where the run is, for people."""
        if self.measured is None:
            return "whole measurement"
        way = "forward" if self.measured.direction > 0 else "backward"
        return f"run at {self.measured.starts[0]:.4g} s, {way}, {len(self.measured.slips)} steps"

    @property
    def verdict(self) -> str:
        """What of it differs, in words."""
        differing = ", ".join(metric.name for metric in self.metrics if metric.differs)
        return self.why_missing or (f"{differing} differs" if differing else "agrees")


def has_actuator(motion: Motion) -> bool:
    """Return True if a motion holds the deflection of an actuator that moves."""
    return motion.u is not None and bool(np.ptp(motion.u) > 0.0)


def measured_runs(motion: Motion, runs: Sequence[Run] | None = None) -> list[MeasuredRun]:
    """Return the runs of a motion in the order of time; runs are those that were looked for."""
    if has_actuator(motion):
        try:
            return [MeasuredRun(analyse_steps(motion.t, motion.x, motion.u))]
        except TraceError:  # it steps both ways, or shows no whole cycle: its position may
            runs = None
    found = find_runs(motion.t, motion.x) if runs is None else runs
    return [MeasuredRun(one.analysis, one) for one in found]


def align_runs(motions: MotionPair, fits: Fits, measured: Sequence[MeasuredRun]) -> Alignment:
    """Return the alignment by the measured run with most steps. Raises ComparisonError.

    Several runs look alike, so all of the motions lie on one another before one of them is chosen.
    """
    if not measured:
        return align(motions, fits, None, None)
    main = max(measured, key=lambda one: len(one.steps.slips)).steps
    try:
        if len(measured) == 1:
            return align(motions, fits, _only_steps(motions.run), main)
        rough = align(motions, fits, None, None)
        t, x, u, cycles = _RunSteps(motions.run, rough).near(main)
        return align(motions, fits, analyse_cycles(t, x, u, cycles), main)
    except TraceError:
        return align(motions, fits, None, main)


def pair_runs(
    motions: MotionPair, measured: Sequence[MeasuredRun], alignment: Alignment, pairs: Pairs
) -> list[RunPair]:
    """Return each measured run beside that of the run, both analysed at the instants of pairs.

    Without measured runs, one pair that says so.
    """
    run, measurement = motions.run, motions.measurement
    if not measured:
        missing = "the measurement has no steps"
        return [RunPair(None, None, run, measurement, None, missing)]
    steps = _RunSteps(run, alignment)
    exact = has_actuator(run) and measured[0].found is None
    noise, seen, sensed = noise_of(measurement.x), run, measurement
    if not exact:
        seen = Motion(run.source, pairs.t, pairs.run)
        if not motions.on_measurement:
            clock = alignment.measurement_time(pairs.t)
            sensed = Motion(measurement.source, clock, pairs.measured)
    found = []
    for one in measured:
        own, theirs, missing = None, one.steps, ""
        try:
            if sensed is not measurement:
                theirs = _read(sensed, _by_position(theirs), noise)
            near = steps.near(one.steps)
            own = analyse_cycles(*near) if exact else _read(seen, _by_position(near[3]), noise)
        except TraceError as error:
            missing = f"the run has no such steps: {error}"
        found.append(RunPair(own, theirs, seen, sensed, one.found, missing))
    return found


def _only_steps(run: Motion) -> StepAnalysis:
    """Return the steps of a motion with one run. Raises TraceError."""
    found = measured_runs(run)
    if not found:
        raise TraceError("no steps are found")
    return max(found, key=lambda one: len(one.steps.slips)).steps


def _by_position(cycles: StepAnalysis | Cycles) -> Cycles:
    """Return cycles as they are known without the actuator: the slip has no end of its own."""
    slips, period = cycles.slips, cycles.period
    return Cycles(period, cycles.direction, slips - period, slips, slips)


def _read(motion: Motion, cycles: Cycles, noise: float) -> StepAnalysis:
    """Return the steps of cycles, from the samples about them. Raises TraceError."""
    begin = cycles.slips[0] - _BEFORE * cycles.period
    part = motion.between(begin, cycles.slips[-1] + _AFTER * cycles.period)
    if len(part.t) < 2 * len(cycles.slips):
        raise TraceError("fewer than two samples a cycle are in common")
    return analyse_cycles(part.t, part.x, None, cycles, noise=noise)


class _RunSteps:
    """The steps of the run, wherever a measured run is laid over it."""

    def __init__(self, run: Motion, alignment: Alignment) -> None:
        self._run, self._alignment = run, alignment
        self._found: list[Run] | None = None  # of a run without an actuator

    def near(
        self, measured: StepAnalysis
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None, Cycles]:
        """Return time (s), position (m), actuator (m) and cycles about a measured run. TraceError.

        The cycles are the run's own: it may be driven faster than the measurement, or not at all.
        """
        first = measured.slips[0] - _BEFORE * measured.period
        last = measured.slips[-1] + _AFTER * measured.period
        begin, end = self._alignment.run_time(np.array([first, last]))
        part = self._run.between(begin, end)
        if has_actuator(self._run):
            if part.u is None or not len(part.t) or not np.ptp(part.u) > 0.0:
                raise TraceError("its actuator rests there")
            frequency = 1.0 / measured.period if len(measured.slips) == 1 else None
            return part.t, part.x, part.u, find_cycles(part.t, part.x, part.u, frequency, None)
        if self._found is None:
            self._found = find_runs(self._run.t, self._run.x)
        likely = [one for one in self._found if one.direction == measured.direction]
        best = max(likely, key=lambda one: min(one.end, end) - max(one.start, begin), default=None)
        if best is None or min(best.end, end) <= max(best.start, begin):
            raise TraceError("none are found there")
        part = self._run.between(
            best.start - 0.5 / best.frequency, best.end + 0.98 / best.frequency
        )
        return part.t, part.x, None, _by_position(best.analysis)
