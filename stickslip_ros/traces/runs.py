# SPDX-License-Identifier: Apache-2.0
"""The runs of a measurement, from rest to rest, each with its steps and their uncertainty."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.traces.cycles import FoundCycles, TraceError
from stickslip_ros.traces.evenly import EvenSamples, even_samples
from stickslip_ros.traces.run_search import Course, cycles_on_grid, phases_of, search_runs
from stickslip_ros.traces.slip_onset import find_onset
from stickslip_ros.traces.step_analysis import StepAnalysis, analyse_cycles, ringing_after
from stickslip_ros.traces.steps import settled_from

Array = NDArray[np.float64]

#: Samples in which runs are looked for; of more, neighbours are averaged.
_MOST = 2**21
#: Periods of a run, from its begin and after its end, that its own analysis sees.
_BEFORE, _AFTER = 0.5, 0.98
#: Periods of ringing that a cycle holds at least for it to tell where the slips begin; by so many
#: the slips may begin earlier than they seem to.
_SWINGS, _EARLIER = 3.0, 1.3


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
    analysis: StepAnalysis  #: cycle by cycle

    def as_json(self) -> dict[str, Any]:
        """Return the numbers of the run, SI units; nan where a thing cannot be measured."""
        steps = self.analysis.backsteps[settled_from(self.steps) : max(self.steps - 1, 1)]
        seen = steps[np.isfinite(steps)]
        error = float(np.std(seen, ddof=1)) / math.sqrt(len(seen)) if len(seen) > 1 else math.nan
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
            "scatter": float(np.std(self.analysis.step_sizes[self.first_cycle :])),
            "backstep": self.analysis.backstep,
            "backstep_error": error,
            "ringing_frequency": self.analysis.ringing_frequency,
            "damping_ratio": self.analysis.damping_ratio,
            "mean_speed": self.step_size * self.frequency,
        }


def find_runs(t: Array, x: Array, period: float | None = None) -> list[Run]:
    """Return the runs of steps in a measurement, none where there are no steps.

    t (s) increases, x is in m, both (samples,); period (s) is that of the drive where it is known.
    """
    if len(t) < 32 or not np.ptp(x) > 0.0:
        return []
    even = even_samples(t, x, _MOST)
    courses = [
        replace(one, first=float(one.first), period=float(one.period), count=int(one.count))
        for one in search_runs(even, period)
    ]
    return [_run(t, x, even, course, courses) for course in courses]


def main_run(runs: list[Run]) -> Run:
    """Return the run with most cycles. TraceError where there is none."""
    if not runs:
        raise TraceError("the trace shows no steps")
    return max(runs, key=lambda one: one.steps)


def _run(t: Array, x: Array, even: EvenSamples, course: Course, courses: list[Course]) -> Run:
    last = min([even.end] + [one.begin for one in courses if one.first > course.end])
    after = min(course.end + _AFTER * course.period, last)
    part = slice(*np.searchsorted(t, [course.begin - _BEFORE * course.period, after]))
    course = _with_onset(t[part], x[part], course)
    analysis = analyse_cycles(t[part], x[part], None, _cycles_of(course))
    first = settled_from(course.count)
    size, error = _step_size(even, course, first)
    if not math.isfinite(size):
        size, error = abs(analysis.step_size), math.nan
    sized = course.direction * size
    return Run(
        start=course.begin,
        end=course.end,
        frequency=1.0 / course.period,
        direction=course.direction,
        steps=course.count,
        step_size=sized,
        step_size_error=error,
        first_cycle=first,
        analysis=replace(analysis, step_size=sized) if math.isfinite(error) else analysis,
    )


def _cycles_of(course: Course) -> FoundCycles:
    slips = course.slips
    return FoundCycles(course.period, course.direction, slips - course.period, slips, slips)


def _with_onset(t: Array, x: Array, course: Course) -> Course:
    """Return a run whose slips are where they begin, not in the middle of the fall.

    The ringing tells: the fall is its first swing. Unchanged where none is seen.
    """
    ringing = ringing_after(t, x, _cycles_of(course))
    if ringing is None or ringing.frequency * course.period < _SWINGS:
        return course
    forward = course.direction * x
    onset = find_onset(t, forward, course.slips, course.period, ringing, before=_EARLIER)
    return replace(course, first=course.first + onset.shift)


def _step_size(even: EvenSamples, course: Course, first: int) -> tuple[float, float]:
    """Return the step size (m) of the settled cycles and its standard error (m).

    It is the slope of a line through the mean positions of the cycles, which all of their samples
    tell. nan for fewer than two cycles.
    """
    phases = phases_of(even, course.period)
    phases = phases[phases < 0.0]
    slips = course.slips[max(first - 1, 0) :]
    rows = course.direction * cycles_on_grid(even, slips, course.period, phases)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a cycle within a gap has no mean
        whole = np.isfinite(rows).mean(axis=1) > 0.999
        level = np.nanmean(rows, axis=1)
    number = np.arange(len(rows), dtype=np.float64)[whole]
    level = level[whole]
    if len(level) < 2:
        return math.nan, math.nan
    about = number - number.mean()
    square = float(about @ about)
    slope = float(about @ level) / square
    chance = even.noise**2 * even.tick / course.period
    left = level - level.mean() - slope * about
    scatter = float(left @ left) / (len(level) - 2) if len(level) > 2 else 0.0
    # The period is known from the slips: to a part of a sample each, and they lie on a line.
    slips_seen = max(course.count - 1, 2)
    late = even.tick * min(1.0, 3.0 * even.noise / max(float(np.ptp(rows[-1])), 1e-30) + 0.02)
    stretched = late / course.period * math.sqrt(12.0 / slips_seen**3)
    rise = float(np.nanmax(rows[-1]) - np.nanmin(rows[-1]))
    return slope, math.hypot(math.sqrt(max(chance, scatter) / square), rise * stretched)
