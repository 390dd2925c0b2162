# SPDX-License-Identifier: Apache-2.0
"""Pairs each run of steps in a measurement with the same run in the other motion.

The runs of the measurement have the numbers of `analyse`. The alignment gives the place of a run in
the other motion; its own actuator, or its own steps, give its slips. It is then analysed at the
times of the measurement, with the noise of the measurement, by position alone, so that a bias of
the estimators is the same for both. Only if both motions include their actuators, each is analysed
with its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stickslip_ros.measurement.alignment import align
from stickslip_ros.measurement.metrics import missing_metrics, step_metrics
from stickslip_ros.measurement.motion_pair import (
    Alignment,
    ComparisonMetric,
    Fits,
    MotionPair,
    Pairs,
)
from stickslip_ros.traces.analysis import has_actuator, runs_of
from stickslip_ros.traces.cycles import Cycles, TraceError, cycles_of_actuator
from stickslip_ros.traces.even_samples import noise_of
from stickslip_ros.traces.motion import Motion
from stickslip_ros.traces.runs import Run, main_run
from stickslip_ros.traces.step_analysis import analyse_cycles

#: Periods of the drive before the first and after the last slip of a run that belong to it.
_BEFORE, _AFTER = 1.5, 0.98


@dataclass(frozen=True)
class RunPair:
    """One run of steps in both motions; None where a motion does not show it, and why."""

    run: Run | None
    measured: Run | None
    metrics: Sequence[ComparisonMetric]  #: of this run alone
    why_missing: str = ""

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
        return self.why_missing or (f"{differing} differs" if differing else "agrees")


def align_runs(motions: MotionPair, fits: Fits, measured: Sequence[Run]) -> Alignment:
    """Return the alignment by the measured run with most steps. Raises ComparisonError.

    Several runs look alike, so the whole motions are aligned before a run is chosen.
    """
    if not measured:
        return align(motions, fits, None, None)
    main = main_run(measured)
    try:
        if len(measured) == 1:
            found = None if has_actuator(motions.run.u) else motions.found_in_run
            return align(motions, fits, main_run(runs_of(motions.run, found)), main)
        rough = align(motions, fits, None, None)
        part, cycles = _RunSteps(motions, rough).near(main)
        return align(motions, fits, analyse_cycles(part.t, part.x, part.u, cycles), main)
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
    run, measurement = motions.run, motions.measurement
    steps = _RunSteps(motions, alignment)
    exact = has_actuator(run.u) and math.isfinite(measured[0].excitation)
    noise, seen = noise_of(measurement.x), run
    if not exact:
        seen = Motion(run.source, pairs.t, pairs.run)
    found = []
    for one in measured:
        try:
            part, cycles = steps.near(one)
            if exact:
                own = analyse_cycles(part.t, part.x, part.u, cycles)
            else:
                own = _analyse_part(seen, cycles, noise)
        except TraceError as error:
            missing = f"the run has no such steps: {error}"
            found.append(RunPair(None, one, missing_metrics(missing), missing))
        else:
            found.append(RunPair(own, one, step_metrics(motions, seen, own, one, alignment)))
    return found


def _analyse_part(motion: Motion, cycles: Cycles, noise: float) -> Run:
    """Analyse cycles by the samples about them, their ends unknown. Raises TraceError."""
    begin = cycles.slips[0] - _BEFORE * cycles.period
    part = motion.between(begin, cycles.slips[-1] + _AFTER * cycles.period)
    if len(part.t) < 2 * len(cycles.slips):
        raise TraceError("fewer than two samples a cycle are in common")
    cycles = Cycles.even(cycles.slips, cycles.period, cycles.direction)
    return analyse_cycles(part.t, part.x, None, cycles, noise=noise)


class _RunSteps:
    """The steps of the run, wherever a measured run is laid over it."""

    def __init__(self, motions: MotionPair, alignment: Alignment) -> None:
        self._motions, self._run, self._alignment = motions, motions.run, alignment

    def near(self, measured: Run) -> tuple[Motion, Cycles]:
        """Return motion and cycles about a measured run. Raises TraceError.

        The cycles are the run's own: it may be driven faster than the measurement, or not at all.
        """
        first = measured.slips[0] - _BEFORE * measured.period
        last = measured.slips[-1] + _AFTER * measured.period
        begin, end = self._alignment.run_time(np.array([first, last]))
        part = self._run.between(begin, end)
        if has_actuator(self._run.u):
            if not has_actuator(part.u):
                raise TraceError("its actuator rests there")
            frequency = measured.frequency if measured.steps == 1 else None
            return part, cycles_of_actuator(part.t, part.u, frequency)
        found = self._motions.found_in_run
        likely = [one for one in found if one.direction == measured.direction]
        best = max(likely, key=lambda one: min(one.end, end) - max(one.start, begin), default=None)
        if best is None or min(best.end, end) <= max(best.start, begin):
            raise TraceError("none are found there")
        begin, end = best.start - 0.5 * best.period, best.end + _AFTER * best.period
        return replace(self._run.between(begin, end), u=None), best.cycles
