# SPDX-License-Identifier: Apache-2.0
"""The runs of steps of both motions in pairs, with their metrics, and which of them differ.

The runs of the measurement have the numbers of `analyse`. The alignment gives the place of a run in
the other motion; its own actuator, or its own steps, give its slips. It is then analysed at the
times of the measurement, with the noise of the measurement, by position alone, so that a bias of
the estimators is the same for both. Only if both motions include their actuators, each is analysed
with its own.

A value differs if the two are further apart than the tolerance: so many standard uncertainties of
the difference that chance exceeds one of all metrics in 0.3 % of comparisons (Šidák, J. Am. Stat.
Assoc. 62 (1967) 626), and never less than what the fits themselves can resolve. The uncertainty
comes from the scatter between settled cycles, for ringing from its fit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.arrays import Array
from stickslip_ros.measurement.alignment import align, align_starts
from stickslip_ros.measurement.metric_rows import METRICS
from stickslip_ros.measurement.motion_pair import Alignment, Fits, MotionPair, Pairs
from stickslip_ros.measurement.step_count import nearest_run, step_counts
from stickslip_ros.motion.motion import Motion
from stickslip_ros.reporting import format_si
from stickslip_ros.traces.analysis import analyse_grid, has_actuator, runs_of, why_left_out
from stickslip_ros.traces.cycles import Cycles, TraceError, cycles_of_actuator
from stickslip_ros.traces.even_samples import SlipGrid, noise_of, resample_evenly
from stickslip_ros.traces.joint_fit import fit_steps
from stickslip_ros.traces.measured_value import COVERAGE, MeasuredValue
from stickslip_ros.traces.ringing import Ringing
from stickslip_ros.traces.runs import Run, main_run
from stickslip_ros.traces.step_analysis import analyse_cycles

#: Amplitudes vary if the actuator's deflections vary by this part, over this many kinds of cycles.
_VARIED, _AMPLITUDES = 0.1, 3
#: Part of a period by which cycles are not the same.
_UNLIKE = 0.1
#: Part of a period by which slips of both may be apart and be the same.
_MET = 0.25
#: Fewest steps, as part of the deflection, that count as clear for the 0-amplitude.
_CLEAR = 0.1
#: Periods of the drive before the first and after the last slip of a run that belong to it.
_BEFORE, _AFTER = 1.5, 0.98
#: Periods before and after a slip between which the deflection of its cycle lies; decimals (m) to
#: which deflections are the same.
_DEFLECTED, _SAME = (0.9, 0.1), 10


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
        return self.why_missing or (f"{differing} differs" if differing else "agrees")


def align_runs(motions: MotionPair, fits: Fits, measured: Sequence[Run]) -> Alignment:
    """Return the alignment by the measured run with most steps. Raises ComparisonError.

    Several runs look alike, so the whole motions are aligned before a run is chosen.
    """
    if not measured:
        return align(motions, fits, None, None)
    main = main_run(measured)
    try:
        begun = align_starts(motions, measured) if fits.offset else None
        if begun is None and len(measured) == 1:
            found = None if has_actuator(motions.run.u) else motions.found_in_run
            return align(motions, fits, main_run(runs_of(motions.run, found)), main)
        part, cycles = _steps_near(motions, begun or align(motions, fits, None, None), main)
        own = analyse_cycles(part.t, part.x, part.u, cycles)
        return align(motions, fits, own, main, begun)
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
    exact = has_actuator(run.u) and math.isfinite(measured[0].excitation)
    noise, seen = noise_of(measurement.x), run
    limit = significant(len(METRICS) * len(measured))
    if not exact:
        seen = Motion(run.source, pairs.t, pairs.run)
    found = []
    for k, one in enumerate(measured):
        first, second, why = step_counts(motions, alignment, measured, k)
        count = ComparisonMetric("steps", "", first, second, 0.5, why)
        try:
            part, cycles = _steps_near(motions, alignment, one)
            if exact:
                own = analyse_cycles(part.t, part.x, part.u, cycles)
            else:  # by the samples about them, the ends of the cycles unknown
                slips = cycles.slips
                # Where the periods differ, slips apart are no errors of the search.
                alike = abs(one.period / cycles.period - 1.0) * one.steps < _MET
                if alike and len(slips) != one.steps:
                    # It has missed the first one, say, or counted one after the last.
                    slips = slips[match_slips(slips, cycles.period, one, alignment)[1]]
                    if not len(slips):
                        raise TraceError("its steps are at other times")
                    if len(slips) < one.steps:
                        there = alignment.measurement_time(slips)
                        one = _with_slips(measurement, measured, one, there)
                nearest, same = match_slips(slips, cycles.period, one, alignment)
                if alike and same.any() and math.isfinite(alignment.offset_error):
                    # Where ringing makes the search find slips late, both are judged alike.
                    late = alignment.run_time(one.slips)[nearest] - slips
                    slips = slips + float(np.median(late[same]))
                cycles = Cycles.even(slips, cycles.period, cycles.direction)
                begin = cycles.slips[0] - _BEFORE * cycles.period
                part = seen.between(begin, cycles.slips[-1] + _AFTER * cycles.period)
                if len(part.t) < 2 * len(cycles.slips):
                    raise TraceError("fewer than two samples a cycle are in common")
                own = analyse_cycles(part.t, part.x, None, cycles, noise=noise)
        except TraceError as error:
            missing = f"the run has no such steps: {error}"
            found.append(RunPair(None, one, missing_metrics(missing, count), missing))
        else:
            metrics = step_metrics(motions, seen, own, one, alignment, limit)
            found.append(RunPair(own, one, [*metrics, count]))
    return found


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


def match_slips(
    slips: Array, period: float, measured: Run, alignment: Alignment
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the measured slip nearest to each slip (s) of the run, and whether it is the same."""
    there = alignment.run_time(measured.slips)
    nearest = np.searchsorted(0.5 * (there[1:] + there[:-1]), slips)
    return nearest, np.abs(there[nearest] - slips) < _MET * period


def _with_slips(measurement: Motion, runs: Sequence[Run], run: Run, slips: Array) -> Run:
    """Return a measured run with some of its slips (s) alone, as the search would have found it."""
    grids = [
        SlipGrid(float(at[0]), one.period, len(at), one.direction, abs(one.step_size), 0.0)
        for one in runs
        for at in (slips if one is run else one.slips,)
    ]
    even = resample_evenly(measurement.t, measurement.x, len(measurement.t))
    estimates, _ = fit_steps(even, grids, [one.ringing for one in runs])
    k = next(k for k, one in enumerate(runs) if one is run)
    grid = grids[k]
    part = measurement.between(grid.begin - 0.5 * run.period, grid.end + _AFTER * run.period)
    return replace(analyse_grid(part.t, part.x, grid, estimates[k]), doubts=run.doubts)


def _steps_near(motions: MotionPair, alignment: Alignment, measured: Run) -> tuple[Motion, Cycles]:
    """Return motion and cycles of the run where a measured run lies over it. Raises TraceError.

    The cycles are the run's own: it may be driven faster than the measurement, or not at all.
    """
    first = measured.slips[0] - _BEFORE * measured.period
    last = measured.slips[-1] + _AFTER * measured.period
    begin, end = alignment.run_time(np.array([first, last]))
    part = motions.run.between(begin, end)
    if has_actuator(motions.run.u):
        if not has_actuator(part.u):
            raise TraceError("its actuator rests there")
        frequency = measured.frequency if measured.steps == 1 else None
        return part, cycles_of_actuator(part.t, part.u, frequency)
    best = nearest_run(motions.found_in_run, measured.direction, begin, end)
    if best is None:
        raise TraceError("none are found there")
    begin, end = best.start - 0.5 * best.period, best.end + _AFTER * best.period
    return replace(motions.run.between(begin, end), u=None), best.cycles


def significant(comparisons: int) -> float:
    """Return the standard errors that one of so many differences exceeds by chance.

    That is as rare as one difference beyond `COVERAGE`.
    """
    chance = 2.0 * scipy.special.ndtr(-COVERAGE)
    return float(-scipy.special.ndtri(-0.5 * math.expm1(math.log1p(-chance) / comparisons)))


def missing_metrics(why: str, count: ComparisonMetric | None = None) -> list[ComparisonMetric]:
    """Return the metrics of a run that one of both motions does not show, without values.

    count is that of the steps, where it is known.
    """
    metrics = [ComparisonMetric.missing(row.name, row.unit, why) for row in METRICS]
    return [*metrics, count or ComparisonMetric.missing("steps", "", why)]


def _estimates(
    motion: Motion,
    steps: Run,
    deflection: Array | str,
    same_method: bool,
    gain: float = 1.0,
    period: float | None = None,
) -> dict[str, MeasuredValue | str]:
    """Return what each of `METRICS` is for a run of steps in one of both motions, or why not.

    motion has the samples that the steps are analysed at, deflection (m) is that of the actuator in
    each cycle, or why it tells nothing. If both have their backstep by the same method, its error
    cancels. gain is that of the lengths over those of the run, period (s) that of its parameters.
    """
    ringing, backstep = steps.ringing or Ringing(math.nan, math.nan), steps.mean_backstep
    damping_error = ringing.damping_ratio_error
    if math.isinf(damping_error):
        # It is that of the method, the same for both. Chance moves frequency and decay alike (the
        # Cramer-Rao bounds of a damped oscillation).
        damping_error = ringing.frequency_error / ringing.frequency
    zero: MeasuredValue | str = deflection if isinstance(deflection, str) else zero_crossing(
        deflection, single_steps(steps) / gain)  # fmt: skip
    if isinstance(zero, MeasuredValue) and not math.isfinite(zero.value):
        zero = f"fewer than {_AMPLITUDES} clear steps of different amplitude"
    # The first and the last slip give the period, each to about two samples.
    period_error = 2.0 * motion.spacing / max(1, steps.steps - 1)
    return {
        "period": MeasuredValue(period or steps.period, period_error),
        "step size": steps.mean_step,
        "backstep": MeasuredValue(backstep.value, backstep.chance) if same_method else backstep,
        "ringing frequency": MeasuredValue(ringing.frequency, ringing.frequency_error),
        "damping ratio": MeasuredValue(ringing.damping_ratio, damping_error),
        "0-amplitude": zero,
    }


def step_metrics(
    motions: MotionPair, seen: Motion, run: Run, measured: Run, alignment: Alignment, limit: float
) -> list[ComparisonMetric]:
    """Return the metrics of one run of steps, lengths and times of the measurement made comparable.

    seen has the samples that the run is analysed at, limit is in standard errors.
    """
    deflections = _deflections(motions.run, run, measured, alignment)
    same = run.mean_backstep.method == measured.mean_backstep.method
    of_run = _estimates(seen, run, deflections[0], same, period=motions.period)
    of_measured = _estimates(motions.measurement, measured, deflections[1], same, alignment.gain)
    metrics = []
    for row in METRICS:
        first, second = of_run[row.name], of_measured[row.name]
        if isinstance(first, str) or isinstance(second, str):
            why = first if isinstance(first, str) else str(second)
            metrics.append(ComparisonMetric.missing(row.name, row.unit, why))
            continue
        scale = 1.0 / alignment.gain if row.scaled else 1.0
        error = math.hypot(first.error, scale * second.error)
        floor = row.floor * (1.0 if row.unit == "m" else abs(first.value))
        tolerance = max(limit * error, floor)
        why = row.missing if not math.isfinite(first.value + second.value) else ""
        if not why and not math.isfinite(error):
            why = "too few cycles to tell its uncertainty"
        metrics.append(
            ComparisonMetric(row.name, row.unit, first.value, scale * second.value, tolerance, why)
        )
    return metrics


def _deflections(
    motion: Motion, run: Run, measured: Run, alignment: Alignment
) -> tuple[Array | str, Array | str]:
    """Return the run's deflections (m) in each cycle of both, or why they tell no 0-amplitude."""
    deflection = deflections_of(motion, run)
    why = ""
    if not np.nanmax(deflection, initial=0.0) > 0.0:
        why = "the run does not hold the actuator's deflection"
    elif np.nanmin(deflection) > (1.0 - _VARIED) * np.nanmax(deflection):
        why = "the amplitude does not vary"
    elif abs(measured.period - run.period) > _UNLIKE * run.period:
        why = "run and measurement have other periods"
    if why:
        return why, why
    places = np.searchsorted(run.slips, alignment.run_time(measured.slips) - 0.5 * run.period)
    return deflection, np.append(deflection, math.nan)[places]


def deflections_of(motion: Motion, steps: Run) -> Array:
    """Return the actuator's deflection (m, peak to peak) in each cycle; nan in a cut one."""
    found = []
    for slip in steps.slips:
        first, last = slip - _DEFLECTED[0] * steps.period, slip + _DEFLECTED[1] * steps.period
        u = motion.between(first, last).u
        whole = motion.t[0] <= first and last <= motion.t[-1]
        found.append(np.ptp(u) if u is not None and len(u) and whole else math.nan)
    return np.array(found)


def single_steps(steps: Run) -> Array:
    """Return the sizes of steps (m); nan where a slip before was too small to be seen."""
    single = steps.slips - steps.starts < (1.0 + _UNLIKE) * steps.period
    return np.where(single, np.abs(steps.step_sizes), math.nan)


def zero_crossing(deflection: Array, step: Array) -> MeasuredValue:
    """Return the deflection (m) at which a line through the steps (m) of the cycles crosses zero.

    Both are (cycles,); steps that are a small part of their deflection lie on no line and are left
    out. nan where fewer than three deflections are left.
    """
    clear = np.isfinite(deflection) & np.isfinite(step) & (step >= _CLEAR * deflection)
    deflection, step = deflection[clear], step[clear]
    if len(np.unique(np.round(deflection, _SAME))) < _AMPLITUDES:
        return MeasuredValue(math.nan, math.nan)
    (slope, cut), covariance = np.polyfit(deflection, step, 1, cov="unscaled")
    zero = -cut / slope
    scatter = float(np.std(step - slope * deflection - cut, ddof=2))
    gradient = np.array([cut / slope**2, -1.0 / slope])
    return MeasuredValue(float(zero), scatter * math.sqrt(float(gradient @ covariance @ gradient)))
