# SPDX-License-Identifier: Apache-2.0
"""Where a measurement shows runs of steps: how many cycles, how long, which way.

At every slip the runner falls back, at even distances, while on the whole it gets ahead. Falls at
even distances (:mod:`slip_edges`) are candidates; they grow to whole runs (:mod:`run_growth`),
which are steps if their cycles look alike and get ahead (:mod:`run_checks`). Ringing makes falls
of its own. So it is measured where the runner rings down, taken out, and the search is done again;
of both, the runs are taken that rises, falls and ringing explain best (:mod:`slip_train`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.traces.cycle_rows import Course
from stickslip_ros.traces.evenly import EvenSamples
from stickslip_ros.traces.ringing import Ringing, fit_ringing
from stickslip_ros.traces.run_checks import judged
from stickslip_ros.traces.run_growth import grown
from stickslip_ros.traces.slip_edges import COARSEST, edges_in
from stickslip_ros.traces.slip_train import BLURRED, Train, fit_train, without_ringing

Array = NDArray[np.float64]

#: Is called with what is looked for next.
Report = Callable[[str], object]
#: Runs looked for in vain are looked for again; without that, so many reports are made.
REPORTS = 5

#: A run of a shorter period is preferred to one that explains so much more.
_RIVAL, _ALIKE = 0.6, 0.015
#: Part by which a period that is seen may be off one that is known; so many periods at most that
#: adds up to over the run, or so great a part for the clocks.
_KNOWN, _APART, _CLOCKS = 0.05, 0.5, 2e-3
#: Least step as part of the largest of all runs.
_SMALLEST = 0.1
#: Candidates looked at.
_CANDIDATES = 16
#: The runner rings down from so many periods after the last slip on, from so late (s) at most, for
#: so long (s); slips of slow drives that count, too; samples at least.
_RINGS_FROM, _LATE, _RINGS, _TOLD_FROM, _FEWEST = (0.1, 1.1), 3e-4, 5e-3, 8, 16
#: What swings more slowly (Hz) is hum; frequencies of one ringing are the same to this part.
_HUMMING, _SAME = 350.0, 0.03
#: Times that runs are looked for, those that explained nothing left out.
_SEARCHES = 3
#: Fits of a run whose number of cycles changes; the clock is fitted again if it does by this part.
_ROUNDS, _TUNED = 6, 0.3
#: A shorter period is looked for where ringing blurs, or where so many times the noise is left.
_UNTOLD = 4.0
#: Periods that hold up to so many cycles, or this many of which are one, are tried.
_FACTORS, _LONGEST = (2, 3, 4, 5), 12


def quiet(stage: str) -> None:
    """Report nothing."""


def search_runs(
    even: EvenSamples, period: float | None = None, report: Report = quiet
) -> list[Course]:
    """Return the runs in the order of time; the period (s) of some of them where it is known."""
    report("falls")
    edges = _edges(even, period)
    seen: list[Course] = []  # in vain so far
    refuted: list[Course] = []
    for _ in range(_SEARCHES):
        report("runs")
        now = _search(even, edges, period, refuted=refuted)
        if not now:
            break
        ringing = _ringing_down(even, now)
        seen = seen or [replace(one, explained=ringing is None) for one in now]
        if ringing is not None:
            chosen = _explained(even, now, ringing, period, report)
            if chosen:
                return sorted((one.course for one in chosen), key=lambda one: one.first)
        refuted += now
    return seen


def _explained(
    even: EvenSamples,
    seen: list[Course],
    ringing: Ringing,
    period: float | None,
    report: Report,
) -> list[Train]:
    """Return the runs that explain the motion, among those seen and those behind the ringing."""
    report("cycles")
    trains = _all_counted(even, seen, ringing, period)
    report("runs behind the ringing")
    sawtooth = without_ringing(even, ringing)
    edges = _edges(sawtooth, period)
    trains += _all_counted(even, _search(sawtooth, edges, period), ringing, period)
    chosen = _best_apart(trains, [])
    report("other runs")
    for other in _other_periods(chosen, period):  # other runs have the same drive, most likely
        for samples in (even, sawtooth):
            known = [one.course for one in chosen]
            found = _search(samples, _edges(samples, other), other, known)
            more = [one for one in found if one not in known]
            chosen += _best_apart(_all_counted(even, more, ringing, other, known), chosen)
    return chosen


def _best_apart(trains: list[Train], chosen: list[Train]) -> list[Train]:
    """Return the runs that explain most and overlap neither each other nor those chosen."""
    kept: list[Train] = []
    for train in sorted(trains, key=_worth, reverse=True):
        if not any(_overlap(train.course, other.course) for other in [*chosen, *kept]):
            kept.append(train)
    return kept


def _other_periods(trains: list[Train], period: float | None) -> list[float]:
    """Return the periods (s) of runs that were not known."""
    periods = [] if period is None else [period]
    for train in trains:
        own = train.course.period
        if all(abs(own / other - 1.0) > _KNOWN for other in periods):
            periods.append(own)
    return periods if period is None else periods[1:]


def _ringing_down(even: EvenSamples, courses: list[Course]) -> Ringing | None:
    """Return the ringing after the runs that most of them agree on."""
    found = []
    for course in courses:
        following = [one.begin for one in courses if one.first > course.end]
        rest = min([even.end, *following])
        ends = [course.end + min(late * course.period, _LATE) for late in _RINGS_FROM]
        windows = [[even.between(begin, min(begin + _RINGS, rest))] for begin in ends]
        if course.period > _RINGS:
            begins = course.slips[-_TOLD_FROM - 1 : -1] + _LATE
            windows.append([even.between(one, one + 0.9 * _RINGS) for one in begins])
        for window in windows:
            one = fit_ringing([part for part in window if len(part[0]) > _FEWEST])
            if one is not None and one.frequency > _HUMMING and one.decay > 0.0:
                found.append(one)

    def like(one: Ringing) -> int:
        return sum(abs(one.frequency / other.frequency - 1.0) < _SAME for other in found)

    return max(found, key=like, default=None)


def _worth(train: Train) -> float:
    """Return how much of the motion a run explains, for how long."""
    duration = train.course.end - train.course.begin
    return duration * math.log(train.whole / max(train.left, train.chance))


def _all_counted(
    even: EvenSamples,
    courses: list[Course],
    ringing: Ringing,
    period: float | None,
    known: Sequence[Course] = (),
) -> list[Train]:
    """Return the runs with their cycles counted, each looked at as far as the next ones."""
    every = [*courses, *known]
    first = [_counted(even, one, every, ringing, period) for one in courses]
    now = [*(one.course for one in first if one is not None), *known]
    again = list(first)
    for k, train in enumerate(first):
        others = [
            old for j, old in enumerate(courses)
            if j != k and ((new := first[j]) is None or _moved(old, new.course))
        ]  # fmt: skip
        if others:
            seen = courses[k] if train is None else train.course
            again[k] = _counted(even, seen, now, ringing, period)
    return [one for one in again if one is not None]


def _moved(one: Course, other: Course) -> bool:
    """Return whether begin or end of a run are no more where they were."""
    least = 0.3 * one.period
    return abs(one.begin - other.begin) > least or abs(one.end - other.end) > least


def _counted(
    even: EvenSamples, course: Course, courses: list[Course], ringing: Ringing, period: float | None
) -> Train | None:
    """Return a run with as many cycles as rise and fall alike; None if they do not."""
    begin = max([even.begin, *(one.end for one in courses if one.end < course.first)])
    end = min([even.end, *(one.begin for one in courses if one.first > course.end)])
    known = period is not None and _near(course, period)
    if known and period is not None:
        course = replace(course, period=period)
    else:
        course = _longer(even, course, ringing, begin, end)
    train = _settled_count(even, course, ringing, begin, end, known)
    if train is None and known:  # as it was seen: its period speaks for it
        train = fit_train(even, course, ringing, begin, end, known)
        return None if train is None else replace(train, course=replace(course, explained=False))
    if train is None or known:
        return train
    blurred = train.ringing.frequency * train.course.period < BLURRED
    for factor in _FACTORS if blurred or train.left > _UNTOLD * train.chance else ():
        shorter = train.course.period / factor
        if shorter < COARSEST * even.tick:
            break
        trial = replace(
            train.course, first=train.course.begin + shorter, period=shorter,
            count=factor * train.course.count,
        )  # fmt: skip
        again = _settled_count(even, trial, train.ringing, begin, end)
        if again is not None and again.falls_alike(factor):
            return again
    return train


def _longer(
    even: EvenSamples, course: Course, ringing: Ringing, begin: float, end: float
) -> Course:
    """Return a run with a longer period, if only every second, third, ... of its cycles falls."""
    train = fit_train(even, course, ringing, begin, end)
    if train is None:
        return course
    longer = (train.every(factor) for factor in range(2, min(course.count // 2, _LONGEST) + 1))
    return next((one for one in longer if one is not None), course)


def _settled_count(
    even: EvenSamples,
    course: Course,
    ringing: Ringing,
    begin: float,
    end: float,
    known: bool = False,
) -> Train | None:
    train, fitted = None, 0
    for _ in range(_ROUNDS):
        tuned = abs(course.count - fitted) < _TUNED * fitted
        train = fit_train(even, course, ringing, begin, end, known, tuned)
        if train is None:
            return None
        first, last = train.extent()
        if last - first < 1:
            return None
        if not tuned:
            fitted = course.count
        before, course = course, train.course
        course = replace(course, first=course.first + first * course.period, count=last - first + 1)
        if course.count == before.count and first == 0:
            break
        ringing = train.ringing
    return train if train is not None and train.explains() else None


def _edges(even: EvenSamples, period: float | None) -> list[Course]:
    """Return falls at even distances, of runs forward and backward."""
    return [one for sign in (1, -1) for one in edges_in(even, sign, period)]


def _search(
    even: EvenSamples,
    edges: list[Course],
    period: float | None,
    known: Sequence[Course] = (),
    refuted: Sequence[Course] = (),
) -> list[Course]:
    """Return the runs in the order of time; the period (s) of some of them where it is known."""
    found = list(known)
    if period is not None:
        near = [replace(one, period=period) for one in edges if _near(one, period)]
        _find_all(even, near, found, period, refuted)
    if not known:
        _find_all(even, edges, found, None, refuted)
    largest = max((one.step for one in found), default=0.0)
    kept = [
        one
        for one in found
        if one.step > _SMALLEST * largest and not any(_rings(one, other) for other in found)
    ]
    return sorted(kept, key=lambda one: one.first)


def _find_all(
    even: EvenSamples,
    edges: list[Course],
    found: list[Course],
    period: float | None,
    refuted: Sequence[Course],
) -> None:
    """Add to the runs found those that the edges are part of; of that period (s) if it is given."""
    seeds: list[Course] = []

    @cache
    def whole(seed: Course) -> Course | None:
        course = _checked(even, seed, period is not None)
        return None if course is None or any(_same(course, one) for one in refuted) else course

    for seed in sorted(edges, key=lambda one: -one.energy):
        if not any(_same(seed, other) for other in seeds):
            seeds.append(seed)
    while True:
        seeds = [seed for seed in seeds if not any(_overlap(seed, other) for other in found)]
        course = _best_of(even, seeds[:_CANDIDATES], found, period, whole)
        if course is None:
            return
        found.append(course)


def _best_of(
    even: EvenSamples,
    seeds: list[Course],
    found: list[Course],
    period: float | None,
    whole: Callable[[Course], Course | None],
) -> Course | None:
    """Return the run that one of the seeds is part of and that explains most.

    whole tells the whole run that a seed is part of.
    """
    courses: list[Course] = []

    def consider(seed: Course) -> None:
        course = whole(seed)
        if course is None or any(_overlap(course, other) for other in found):
            return
        if period is None or _near(course, period):
            courses.append(course)

    for seed in seeds:
        if not any(_same(seed, other) for other in courses):
            consider(seed)
    if not courses:
        return None
    best = max(courses, key=lambda one: one.energy)
    # Ringing may repeat after a part of the period, and so do long cycles after several of them.
    for factor in (1.0 / 3.0, 0.5, 2.0, 3.0) if period is None else ():
        count = round(best.count / factor)
        if count >= 2 and factor * best.period > COARSEST * even.tick:
            consider(replace(best, period=factor * best.period, count=count))
    best = max(courses, key=lambda one: one.energy)
    # What repeats after a time repeats after twice that time, too.
    rivals = [
        one
        for one in courses
        if _overlap(one, best)
        and one.period < best.period
        and one.energy > _RIVAL * best.energy
        and one.unlike < 1.5 * best.unlike + _ALIKE
    ]
    return min(rivals, key=lambda one: one.period, default=best)


def _near(course: Course, period: float) -> bool:
    """Return whether a run may be of a period (s): of many cycles, the last ones would show it."""
    return abs(course.period / period - 1.0) < min(_KNOWN, max(_APART / course.count, _CLOCKS))


def _rings(one: Course, other: Course) -> bool:
    """Return whether one is nothing but the ringing after the last slip of another run."""
    after = one.begin - other.end
    return one.period < 0.5 * other.period and -other.period < after < 2.0 * other.period


def _same(one: Course, other: Course) -> bool:
    """Return whether two are of one direction and period and lie about one another."""
    if one.direction != other.direction or abs(one.period / other.period - 1.0) > 0.03:
        return False
    return bool(one.begin < other.end and other.begin < one.end)


def _overlap(one: Course, other: Course) -> bool:
    """Return whether two runs share more than half a cycle of the longer period."""
    common = min(one.end, other.end) - max(one.begin, other.begin)
    return common > 0.5 * min(max(one.period, other.period), one.end - one.begin)


def _checked(even: EvenSamples, seed: Course, known: bool) -> Course | None:
    """Return the whole run that a candidate is part of; None if it is none."""
    course = grown(even, seed)
    return None if course is None else judged(even, course, known)
