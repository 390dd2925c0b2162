# SPDX-License-Identifier: Apache-2.0
"""The runs of a measurement, from rest to rest, each with its steps and their uncertainty."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.traces.backstep import folded_backstep
from stickslip_ros.traces.cycle_rows import Course
from stickslip_ros.traces.cycles import Cycles, TraceError
from stickslip_ros.traces.doubts import doubts_of
from stickslip_ros.traces.evenly import EvenSamples, even_samples
from stickslip_ros.traces.joint_fit import Disturbances, Steps, fit_steps
from stickslip_ros.traces.ringing import Ringing
from stickslip_ros.traces.run_search import REPORTS, Report, quiet, search_runs
from stickslip_ros.traces.slip_onset import find_onset, some_cycles
from stickslip_ros.traces.step_analysis import StepAnalysis, analyse_cycles, ringing_after
from stickslip_ros.traces.steps import settled_from

Array = NDArray[np.float64]

#: Reports of a search for steps.
STAGES = REPORTS + 1
#: Samples in which runs are looked for; of more, neighbours are averaged.
_MOST = 2**21
#: Periods of a run, from its begin and after its end, that its own analysis sees.
_BEFORE, _AFTER = 0.5, 0.98
#: Periods of ringing that a cycle holds at least to show where the slips begin; by so many
#: the slips may begin earlier than they seem to.
_SWINGS, _EARLIER = 3.0, 1.3
#: Cycles that the mean slip comes from at most, samples of one at least, points of it at most.
_MEAN_OF, _SEEN, _GRID = 200, 8, 1000
#: What swings more slowly (Hz) is hum.
_HUMMING = 350.0
#: Steps change if the means of two halves are so many standard deviations apart.
_CHANGED = 4.0
#: The last slip may be off by so many periods of ringing before the onsets give the period.
_SWUNG = 0.5


@dataclass(frozen=True)
class Run:
    """Steps between two rests, or between two changes of the drive."""

    start: float  #: begin of the first cycle, s
    end: float  #: end of the last slip, s
    frequency: float  #: Hz
    direction: int  #: +1 or -1
    steps: int  #: cycles
    step_size: float  #: of the settled cycles, with the sign of the direction, m
    step_size_error: float  #: its standard error, m
    first_cycle: int  #: the first of the cycles, from 0, that the step size comes from
    explained: bool  #: whether equal steps with ringing explain the motion; a guess if not
    analysis: StepAnalysis  #: cycle by cycle
    backstep_error: float = math.nan  #: standard error of the mean backstep, method included, m
    doubts: tuple[str, ...] = ()  #: why the steps are not determined, in words; none if they are

    @property
    def determined(self) -> bool:
        """Whether the record holds what is said of the run."""
        return not self.doubts

    def as_json(self) -> dict[str, Any]:
        """Return the numbers of the run, SI units; nan where a thing cannot be measured."""
        return {
            "start": self.start,
            "end": self.end,
            "frequency": self.frequency,
            "direction": self.direction,
            "steps": self.steps,
            "step_size": self.step_size,
            "step_size_error": self.step_size_error,
            "from_cycle": self.first_cycle + 1,
            "to_cycle": self.steps,
            "explained": self.explained,
            "determined": self.determined,
            "doubts": list(self.doubts),
            "scatter": float(np.std(self.analysis.step_sizes[self.first_cycle :])),
            "backstep": self.analysis.backstep,
            "backstep_error": self.backstep_error,
            "ringing_frequency": self.analysis.ringing_frequency,
            "damping_ratio": self.analysis.damping_ratio,
            "mean_speed": self.step_size * self.frequency,
        }


@dataclass(frozen=True)
class FoundSteps:
    """What a measurement shows: its runs, and what it holds beside the motion."""

    runs: list[Run]
    disturbances: Disturbances


def find_runs(t: Array, x: Array, period: float | None = None) -> list[Run]:
    """Return the runs of steps in a measurement, none where there are no steps.

    t (s) increases, x is in m, both (samples,); period (s) is that of the drive where it is known.
    """
    return find_steps(t, x, period).runs


def find_steps(
    t: Array, x: Array, period: float | None = None, report: Report = quiet
) -> FoundSteps:
    """Return the runs in a measurement, and its drift and hum; arguments as of `find_runs`.

    report is called with what is looked for, `STAGES` times or more.
    """
    if len(t) < 32 or not np.ptp(x) > 0.0:
        return FoundSteps([], Disturbances())
    even = even_samples(t, x, _MOST)
    seen = [
        replace(one, first=float(one.first), period=float(one.period), count=int(one.count))
        for one in search_runs(even, period, report)
    ]
    report("steps")
    parts = [_part(t, even, one, seen) for one in seen]
    courses, ringings = [], []
    for part, one in zip(parts, seen, strict=True):
        course, ringing = _with_onset(t[part], x[part], one)
        courses.append(course)
        ringings.append(ringing)
    steps, disturbances = fit_steps(even, courses, ringings)
    runs = []
    for part, course, step in zip(parts, courses, steps, strict=True):
        run = _run(t[part], x[part], course, step)
        others = [one for one in courses if one is not course]
        runs.append(replace(run, doubts=doubts_of(even, course, others, run.step_size)))
    return FoundSteps(runs, disturbances)


def after_slip(t: Array, x: Array, run: Run) -> tuple[Array, Array]:
    """Return times (s) about the slip and the displacement (m) there, mean of the settled cycles.

    t (s) and x (m) are the measurement, (samples,). Positive is the direction of the run. Empty
    where there are too few samples; at most half a period of the drive, eight of the ringing.
    """
    period, ringing = 1.0 / run.frequency, run.analysis.ringing_frequency
    swing = 1.0 / ringing if ringing > 0.0 else 0.05 * period
    slips = run.analysis.slips[run.first_cycle : run.first_cycle + _MEAN_OF]
    begin, end = -min(swing, 0.2 * period), min(8.0 * swing, 0.5 * period)
    inside = [slice(*np.searchsorted(t, [slip + begin, slip + end])) for slip in slips]
    parts = [(t[one] - slip, x[one]) for one, slip in zip(inside, slips, strict=True)]
    parts = [(since, place) for since, place in parts if len(since) > _SEEN]
    if not parts:
        return np.empty(0), np.empty(0)
    grid = np.linspace(begin, end, min(_GRID, int(np.median([len(one[0]) for one in parts]))))
    rows = [np.interp(grid, since, place) for since, place in parts]
    before = np.mean([row - np.interp(0.0, grid, row) for row in rows], axis=0)
    return grid, np.asarray(run.direction * before)


def main_run(runs: list[Run]) -> Run:
    """Return the run with most cycles. TraceError where there is none."""
    if not runs:
        raise TraceError("the trace shows no steps")
    return max(runs, key=lambda one: one.steps)


def _part(t: Array, even: EvenSamples, course: Course, courses: list[Course]) -> slice:
    """Return the samples that the analysis of a run sees, those of the next run left out."""
    last = min([even.end] + [one.begin for one in courses if one.first > course.end])
    after = min(course.end + _AFTER * course.period, last)
    return slice(*np.searchsorted(t, [course.begin - _BEFORE * course.period, after]))


def _run(t: Array, x: Array, course: Course, step: Steps) -> Run:
    analysis = analyse_cycles(t, x, None, _cycles_of(course))
    if math.isfinite(step.size):
        analysis = replace(analysis, step_size=course.direction * step.size)
    low, error = folded_backstep(t, course.direction * x, analysis)
    analysis = replace(analysis, backstep=low)
    return Run(
        start=course.begin,
        end=course.end,
        frequency=1.0 / course.period,
        direction=course.direction,
        steps=course.count,
        step_size=analysis.step_size,
        step_size_error=math.hypot(step.error, _change_of(analysis.step_sizes)),
        first_cycle=settled_from(course.count),
        explained=course.explained,
        analysis=analysis,
        backstep_error=error,
    )


def _change_of(steps: Array) -> float:
    """Return by how much (m) the mean of the settled steps changes within a run, beyond chance.

    Creep and wear change the steps, and which of them the mean stands for is open.
    """
    kept = steps[settled_from(len(steps)) :]
    half = len(kept) // 2
    if half < 2:
        return 0.0
    first, last = kept[:half], kept[-half:]
    change = abs(float(np.mean(last) - np.mean(first)))
    chance = math.sqrt((float(np.var(first, ddof=1)) + float(np.var(last, ddof=1))) / half)
    return 0.5 * change if change > _CHANGED * chance else 0.0


def _cycles_of(course: Course) -> Cycles:
    slips = course.slips
    return Cycles(course.period, course.direction, slips - course.period, slips, slips)


def _with_onset(t: Array, x: Array, course: Course) -> tuple[Course, Ringing | None]:
    """Return a run whose slips are where they begin, not in the middle of the fall; its ringing.

    The ringing shows it: the fall is its first swing. Unchanged where none is seen.
    """
    ringing = ringing_after(t, x, _cycles_of(course))
    if ringing is None or ringing.frequency < _HUMMING:
        return course, None
    if ringing.frequency * course.period < _SWINGS:
        return course, ringing
    drift = course.count > 2
    t, x = some_cycles(t, x, course.slips, course.period)
    try:
        onset = find_onset(
            t, course.direction * x, course.slips, course.period, ringing,
            drift=drift, middle=course.first, before=_EARLIER,
        )  # fmt: skip
    except np.linalg.LinAlgError:  # nothing follows the slips
        return course, ringing
    late = abs(onset.drift) * (course.count - 1) * course.period
    slower = onset.drift if late * ringing.frequency < _SWUNG else 0.0
    period = course.period * (1.0 + slower)
    return replace(course, first=course.first + onset.shift, period=period), ringing
