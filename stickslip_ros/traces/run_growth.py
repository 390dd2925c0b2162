# SPDX-License-Identifier: Apache-2.0
"""From a few cycles to the whole run: how far cycles go on that look like them, and their clock."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.traces.cycle_rows import (
    ROWS,
    Course,
    cycles_on_grid,
    likeness,
    mean_cycle,
    phases_of,
    some_cycles,
    without_trend,
)
from stickslip_ros.traces.evenly import EvenSamples
from stickslip_ros.traces.slip_edges import edge_kernel

Array = NDArray[np.float64]

#: Part of the mean cycle that counts as a cycle.
_HALF = 0.5
#: Weights of a parabola through five points at the middle one (Savitzky, Golay).
_SMOOTH = np.array([-3.0, 12.0, 17.0, 12.0, -3.0]) / 35.0


def grown(even: EvenSamples, seed: Course) -> Course | None:
    sign, course = seed.direction, _at_the_fall(even, _in_step(even, seed))
    in_step = course.count
    for _ in range(40):
        phases = phases_of(even, course.period)
        reach = max(3, min(course.count // 2, ROWS))
        before = min(reach, int((course.begin - even.begin) / course.period + 0.8))
        after = min(reach, int((even.end - course.end) / course.period + 0.3))
        number = np.concatenate(
            [np.arange(-max(before, 0), 0), some_cycles(course.count),
             course.count + np.arange(max(after, 0))]
        )  # fmt: skip
        slips = course.first + course.period * number
        rows = sign * cycles_on_grid(even, slips, course.period, phases)
        inside = (number >= 0) & (number < course.count)
        mean = mean_cycle(rows[inside][1:] if course.count > 3 else rows[inside])
        rise = (phases > -0.85) & (phases < -0.04)
        if not np.ptp(mean[rise]) > 0.0:
            return None
        like = likeness(rows[:, rise], mean[rise] - mean[rise].mean())
        first, last = _extent(like, number, course.count)
        if last - first < 1:
            return None
        grown = replace(course, first=course.first + first * course.period, count=last - first + 1)
        if grown.count > 1.4 * in_step:
            grown, in_step = _in_step(even, grown), grown.count
        refined = _at_the_fall(even, refine(even, grown))
        drifted = abs(refined.period - course.period) * grown.count > 0.02 * course.period
        unmoved = grown.count == course.count and first == 0
        course = refined
        if unmoved and not drifted:
            break
    return course


def _in_step(even: EvenSamples, course: Course) -> Course:
    """Return a run with the period near to its own at which its cycles have most in common."""
    if course.count < 3:
        return course
    phases = phases_of(even, course.period)
    number: Array = np.linspace(0, course.count - 1, min(course.count, 40)).round()
    middle = 0.5 * (course.count - 1)
    best, most = course, -1.0
    for share in np.linspace(-0.3, 0.3, 31):
        period = course.period * (1.0 + share / course.count)
        first = course.first + (course.period - period) * middle
        rows = cycles_on_grid(even, first + period * number, period, phases)
        rows = without_trend(rows[np.isfinite(rows).all(axis=1)], phases)
        common = float(np.var(rows.mean(axis=0))) if len(rows) > 1 else 0.0
        if common > most:
            best, most = replace(course, first=first, period=period), common
    return best


def _at_the_fall(even: EvenSamples, course: Course) -> Course:
    """Return a run whose slips are where its mean cycle falls fastest."""
    phases = phases_of(even, course.period)
    slips = course.slips[some_cycles(course.count)]
    rows = course.direction * cycles_on_grid(even, slips, course.period, phases)
    mean = mean_cycle(rows[1:] if course.count > 2 else rows)
    width = max(2, len(phases) // 25)
    # A fall at the end of a cycle is seen from both sides; so the search is about there.
    fall = np.convolve(mean, edge_kernel(width)[::-1], mode="valid")
    place = phases[width : width + len(fall)] - 0.5 * (phases[1] - phases[0])
    near = np.abs(place) < 0.2
    if not near.any():
        return course
    at = float(place[near][int(np.argmax(fall[near]))])
    return replace(course, first=course.first + at * course.period)


def _extent(like: Array, number: NDArray[np.int64], count: int) -> tuple[int, int]:
    """Return numbers of the first and the last cycle of the unbroken run about the middle."""
    # A cycle that is not known (a gap) counts if those beside it do.
    known = np.isfinite(like)
    if not known.any():
        return 0, -1
    good = np.interp(number, number[known], like[known], left=0.0, right=0.0) > _HALF
    inside = np.flatnonzero(good & (number >= 0) & (number < count))
    if not len(inside):
        return 0, -1
    middle = int(inside[np.argmin(np.abs(number[inside] - count // 2))])
    bad = np.flatnonzero(~good)
    first = int(np.max(bad[bad < middle], initial=-1)) + 1
    last = int(np.min(bad[bad > middle], initial=len(good))) - 1
    return int(number[first]), int(number[last])


def refine(even: EvenSamples, course: Course) -> Course:
    """Return a run with first slip and period fitted to all of its cycles together.

    Each cycle has a place of its own (m) and is shifted by so much (s) that it lies on the mean
    cycle; the shifts lie on a line.
    """
    number = some_cycles(course.count)
    for _ in range(4):
        phases = phases_of(even, course.period)
        slips = course.slips[number]
        rows = course.direction * cycles_on_grid(even, slips, course.period, phases)
        used = number >= (1 if course.count > 2 else 0)
        mean = mean_cycle(rows[used])
        shift = _shifts(rows, mean, phases, course.period)
        good = used & np.isfinite(shift)
        if good.sum() < 2:
            return course
        slope, about = _line_through(number[good].astype(np.float64), shift[good])
        course = replace(course, first=course.first + about, period=course.period + slope)
        if abs(slope) * course.count < 1e-3 * course.period:
            break
    return course


def _line_through(x: Array, y: Array) -> tuple[float, float]:
    """Return slope and cut of a line through points, those far off left out."""
    slope, cut = 0.0, float(np.median(y))
    for _ in range(3):
        away = np.abs(y - cut - slope * x)
        near = away <= 4.0 * float(np.median(away)) + 1e-30
        middle, level = float(x[near].mean()), float(y[near].mean())
        about = x[near] - middle
        square = float(about @ about)
        slope = float(about @ (y[near] - level)) / square if square > 0.0 else 0.0
        cut = level - slope * middle
    return slope, cut


def _shifts(rows: Array, mean: Array, phases: Array, period: float) -> Array:
    """Return by how much later (s) than the mean cycle each row is, (cycles,)."""
    smooth = np.convolve(np.pad(mean, 2, mode="edge"), _SMOOTH, mode="valid")
    known = np.isfinite(rows)
    count = np.maximum(known.sum(axis=1, keepdims=True), 1)
    left = np.where(known, rows - mean, 0.0)
    left = np.where(known, left - left.sum(axis=1, keepdims=True) / count, 0.0)
    rate = np.where(known, -np.gradient(smooth, phases * period), 0.0)
    rate = np.where(known, rate - rate.sum(axis=1, keepdims=True) / count, 0.0)
    square = np.sum(rate**2, axis=1)
    enough = (count[:, 0] > 0.6 * len(phases)) & (square > 0.0)
    delay = np.sum(rate * left, axis=1) / np.where(enough, square, 1.0)
    return np.where(enough, np.clip(delay, -0.1 * period, 0.1 * period), np.nan)
