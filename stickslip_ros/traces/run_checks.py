# SPDX-License-Identifier: Apache-2.0
"""Whether cycles that look alike are steps."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.traces.cycle_rows import (
    ROWS,
    Course,
    cycles_on_grid,
    filled,
    mean_cycle,
    phases_of,
    row_means,
    without_trend,
)
from stickslip_ros.traces.evenly import EvenSamples
from stickslip_ros.traces.hum import MAINS, hum_columns

Array = NDArray[np.float64]

#: Part of the variance of its cycles that the mean cycle of a run leaves unexplained at most.
_UNLIKE = 0.35
#: First cycles that may differ from the later ones; least part that a mean cycle leaves.
_TRANSIENT, _BEST = 7, 3e-3
#: Least power of all harmonics but the strongest as part of that one.
_HARMONICS = 0.02
#: Every so many cycles at most are looked at for being alike; part of the motion in which they are
#: more so than others.
_APART, _ALTERNATE = 8, 0.01
#: Duration (s) of a run from which on hum is separated from its trends.
_HUM_SEEN = 5e-3
#: Least step as part of the ripple.
_LEAST_STEP = 0.05


def judged(even: EvenSamples, course: Course, given: bool = False) -> Course | None:
    """Return the run with its step and how clear it is; None if it is none.

    Its later cycles look alike, it gets ahead, and it does more than swing. If its period is given,
    no other is looked for.
    """
    phases = phases_of(even, course.period)
    slips = course.slips[:ROWS]
    rows = course.direction * cycles_on_grid(even, slips, course.period, phases)
    rows = filled(rows)
    first = min(_TRANSIENT, max(1, len(rows) // 2)) if len(rows) > 2 else 0
    later = rows[first:]
    mean = mean_cycle(later)
    within = phases < 0.0  # the last slip is followed by rest
    about = without_trend(later[:, within], phases[within])
    known = np.isfinite(about).all(axis=1)
    about = about[known]
    if len(about) < 2:
        return None
    if course.period * course.count > _HUM_SEEN:
        times = (slips[first:, None] + course.period * phases[within])[known]
        about = about - _hum_in(about, times, phases[within])
    each = np.sort(np.mean(np.diff(about, axis=0) ** 2, axis=1))
    left = 0.5 * float(np.mean(each[: max(1, math.ceil(0.85 * len(each)))]))
    samples = course.period / even.tick
    chance = even.noise**2 * int(np.sum(within)) / samples
    beyond = max(left - chance, 0.0)
    if beyond > _UNLIKE * float(np.var(mean)):
        return None
    steps = np.diff(row_means(rows))
    steps = steps[np.isfinite(steps)]
    step = float(np.median(steps)) if len(steps) else math.nan
    error = even.noise / math.sqrt(samples) / course.count
    ripple = mean - step * phases
    if not step > max(6.0 * error, _LEAST_STEP * float(np.ptp(ripple))):
        return None
    error = math.sqrt(chance / len(later))
    if not float(np.ptp(ripple)) > 0.0:
        return None
    if not _is_no_sine(ripple[phases < 0.0], error) and not _rests(even, course, ripple, step):
        return None
    if not given and _alternate(about, phases[within]):
        return None
    power = float(np.var(ripple))
    unlike = beyond / power
    # The first cycle is what the others are like.
    energy = math.log1p(1.0 / (unlike + _BEST)) * (course.count - 1) * course.period
    return replace(course, step=step, energy=energy, unlike=unlike)


def _hum_in(rows: Array, times: Array, phases: Array) -> Array:
    """Return the hum of the mains in rows that share a mean and have trends of their own."""
    columns = []
    for wave in hum_columns(times, MAINS):
        column = without_trend(wave, phases)
        columns.append((column - column.mean(axis=0)).ravel())
    design = np.stack(columns, axis=1)
    own = (rows - rows.mean(axis=0)).ravel()
    found, *_ = np.linalg.lstsq(design, own, rcond=1e-3)
    return np.asarray((design @ found).reshape(rows.shape))


def _alternate(rows: Array, phases: Array) -> bool:
    """Return whether every second, third, ... row is more like one another than all are."""
    inner = (phases > -0.95) & (phases < -0.04)  # a slip lies between samples now so, now so
    about = rows[:, inner]
    width = about.shape[1] // 20  # ringing too fast for the phases is sampled by chance
    if width > 1:
        about = np.asarray(scipy.ndimage.uniform_filter1d(about, width, axis=1))
    about = without_trend(about, phases[inner])
    total = float(np.sum((about - about.mean(axis=0)) ** 2))
    for apart in range(2, min(_APART, len(rows) // 2) + 1):
        groups = [about[k::apart] for k in range(apart)]
        within = sum(float(np.sum((group - group.mean(axis=0)) ** 2)) for group in groups)
        between = (total - within) / (apart - 1)
        chance = within / (len(rows) - apart)
        clear = total - within > max(0.3 * total, _ALTERNATE * float(np.sum(about**2)))
        if clear and between > 6.0 * chance:
            return True
    return False


def _rests(even: EvenSamples, course: Course, ripple: Array, step: float) -> bool:
    """Return whether the axis rests beside the run: it neither swings as there nor gets ahead."""
    phases = phases_of(even, course.period)
    beside = [course.first - 1.3 * course.period, course.end + 2.3 * course.period]
    rows = course.direction * cycles_on_grid(even, np.array(beside), course.period, phases)
    rows = rows[np.isfinite(rows).all(axis=1)]
    if not len(rows):
        return False
    rows = rows - rows.mean(axis=1, keepdims=True)
    about = phases - phases.mean()
    ahead = np.abs(rows @ about) / float(about @ about)
    quiet = (np.std(rows, axis=1) < 0.5 * float(np.std(ripple))) & (ahead < 0.2 * step)
    return bool(quiet.any())


def _is_no_sine(ripple: Array, error: float) -> bool:
    """Return whether a cycle has more than one harmonic; error (m) is that of its samples."""
    power = np.abs(np.fft.rfft(ripple - ripple.mean())[1:]) ** 2
    first, *others = np.sort(power)[::-1]
    clear = 25.0 * error**2 * len(ripple)
    return bool(sum(others) > max(_HARMONICS * first, clear))
