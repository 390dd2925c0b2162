# SPDX-License-Identifier: Apache-2.0
"""Extends a few cycles to the whole run of similar cycles, and fits their times.

The result is a run of steps if its cycles are similar, advance the runner, and do not only swing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from stickslip_ros.arrays import Array
from stickslip_ros.motion.settled import SETTLING
from stickslip_ros.traces.even_samples import (
    PHASES,
    ROWS,
    EvenSamples,
    SlipGrid,
    cycles_on_grid,
    fill_gaps,
    find_unbroken,
    mean_cycle,
    phases_of,
    row_means,
    sample_cycles,
    similarity,
    without_trend,
)
from stickslip_ros.traces.hum import MAINS, hum_columns
from stickslip_ros.traces.slip_edges import edge_kernel
from stickslip_ros.traces.squares import Squares


@dataclass(frozen=True)
class GrowthSettings:
    """Limits for extending cycles to a run, and for runs of steps; phases are in periods."""

    #: Parts of a period before and after a run that the record may lack of a further cycle.
    lacking: tuple[float, float] = (0.8, 0.3)
    rounds: int = 40  #: of growth at most; each adds up to half its length at either end
    similar: float = 0.5  #: part of the mean cycle that a cycle holds at least; rest holds none
    #: The rise of a cycle, by which it is known: the ringing begins it and the slip ends it.
    rise: tuple[float, float] = (-0.85, -0.04)
    longer: float = 1.4  #: times as long a run is when its period is tuned again
    drifted: float = 0.02  #: periods by which the clock moves over a run that is not settled yet
    tuned: float = 0.3  #: periods over the run by which its period may be off, to either side
    places: int = 31  #: periods tried there
    tuning_cycles: int = 40  #: that tell the period
    slip: int = 25  #: parts of a cycle, one of which a slip takes
    fall: float = 0.2  #: phases about the slip in which the fastest fall is looked for
    refinements: int = 4  #: of the clock, at most
    outlying: float = 4.0  #: times the median distance from a line beyond which slips are left out
    known: float = 0.6  #: part of a cycle that tells how late it is
    late: float = 0.1  #: periods that it is late by, at most
    refined: float = 1e-3  #: periods over the run by which the last refinement moves the clock
    #: Part of the variance of its cycles that the mean cycle leaves unexplained at most.
    dissimilar: float = 0.35
    least_dissimilar: float = 3e-3  #: part that a mean cycle leaves in any case: ringing, noise
    alike: float = 0.85  #: part of the neighbours that count, those most alike
    #: Power of all harmonics but the strongest as part of that one: a sine alone is no step.
    visible: float = 25.0  #: times their chance from which on harmonics are seen
    #: Periods before the first and after the last slip about which there may be a rest; parts of
    #: the motion of a cycle, and of a step, that the runner moves there at most.
    beside: tuple[float, float] = (1.3, 2.3)
    resting: tuple[float, float] = (0.5, 0.2)
    harmonics: float = 0.02
    apart: int = 8  #: largest n for the test whether only every n-th cycle falls at its slip
    about: float = 0.15  #: phases about the slip that show its fall
    none: float = 0.3  #: falls below this part of the others are none
    coarsest: float = 6.0  #: samples of a cycle that show it, at least
    turns: float = 3.0  #: standard errors from which on such a fall is no chance
    clear: float = 6.0  #: standard errors from which on a step is no chance
    hum_seen: float = 5e-3  #: s, from which on hum is separated from the trends of the cycles
    least_step: float = 0.05  #: as part of the ripple within a cycle


SETTINGS = GrowthSettings()

#: Weights of a parabola through five points at the middle one (Savitzky, Golay).
_SMOOTH = np.array([-3.0, 12.0, 17.0, 12.0, -3.0]) / 35.0


def grow_run(even: EvenSamples, seed: SlipGrid) -> SlipGrid | None:
    sign, grid = seed.direction, move_to_fall(even, tune_period(even, seed))
    in_step = grid.count
    for _ in range(SETTINGS.rounds):
        phases = phases_of(even, grid.period)
        reach = max(3, min(grid.count // 2, ROWS))
        before = min(reach, int((grid.begin - even.begin) / grid.period + SETTINGS.lacking[0]))
        after = min(reach, int((even.end - grid.end) / grid.period + SETTINGS.lacking[1]))
        number = np.concatenate(
            [np.arange(-max(before, 0), 0), sample_cycles(grid.count),
             grid.count + np.arange(max(after, 0))]
        )  # fmt: skip
        slips = grid.first + grid.period * number
        rows = sign * cycles_on_grid(even, slips, grid.period, phases)
        inside = (number >= 0) & (number < grid.count)
        mean = mean_cycle(rows[inside][1:] if grid.count > 3 else rows[inside])
        rise = (phases > SETTINGS.rise[0]) & (phases < SETTINGS.rise[1])
        if not np.ptp(mean[rise]) > 0.0:
            return None
        like = similarity(rows[:, rise], mean[rise] - mean[rise].mean())
        known = np.isfinite(like)
        if not known.any():
            return None
        # A cycle that is not known (a gap) counts if those beside it do.
        like = np.interp(number, number[known], like[known], left=0.0, right=0.0)
        first, last = find_unbroken(like > SETTINGS.similar, number, grid.count)
        if last - first < 1:
            return None
        longer = replace(grid, first=grid.first + first * grid.period, count=last - first + 1)
        if longer.count > SETTINGS.longer * in_step:
            longer, in_step = tune_period(even, longer), longer.count
        refined = move_to_fall(even, refine(even, longer))
        drifted = abs(refined.period - grid.period) * longer.count > SETTINGS.drifted * grid.period
        unmoved = longer.count == grid.count and first == 0
        grid = refined
        if unmoved and not drifted:
            break
    return grid


def tune_period(even: EvenSamples, grid: SlipGrid) -> SlipGrid:
    """Return a run with the period near to its own at which its cycles have most in common.

    Cycles of another period are shifted against one another by whole parts of a cycle, as fine as
    its phases are at most: so each is cut from the positions once.
    """
    if grid.count < 3:
        return grid
    phases = phases_of(even, grid.period)
    number: Array = np.linspace(0, grid.count - 1, min(grid.count, SETTINGS.tuning_cycles)).round()
    shares = np.linspace(-SETTINGS.tuned, SETTINGS.tuned, SETTINGS.places)
    late = shares[:, None] / grid.count * (number - 0.5 * (grid.count - 1))  # periods
    finer = math.ceil(PHASES * (phases[1] - phases[0]))
    apart = (phases[1] - phases[0]) / finer
    moved = np.rint(late / apart).astype(np.int64)
    most = int(moved.max())
    first = phases[0] + apart * np.arange(-most, finer * (len(phases) - 1) + most + 1)
    half = 0.5 * (phases[1] - phases[0])
    edges = grid.slips[0] + grid.period * (number[:, None] + first)
    rows = even.means(edges[:, :, None] + grid.period * np.array([-half, half]))[:, :, 0]
    place = most + moved[:, :, None] + finer * np.arange(len(phases))
    cycles = rows[np.arange(len(number))[:, None], place]
    known = np.isfinite(cycles).all(axis=2)
    count = known.sum(axis=1)
    mean = np.where(known[:, :, None], cycles, 0.0).sum(axis=1) / np.maximum(count, 1)[:, None]
    common = np.where(count > 1, without_trend(mean, phases).var(axis=1), 0.0)
    share = float(shares[int(np.argmax(common))]) / grid.count
    middle = 0.5 * (grid.count - 1) * grid.period
    return replace(
        grid, first=float(grid.first - share * middle), period=float(grid.period * (1.0 + share))
    )


def move_to_fall(even: EvenSamples, grid: SlipGrid, within: float = SETTINGS.fall) -> SlipGrid:
    """Return a run whose slips are where its mean cycle falls fastest, within so many periods."""
    phases = phases_of(even, grid.period)
    slips = grid.slips[sample_cycles(grid.count)]
    rows = grid.direction * cycles_on_grid(even, slips, grid.period, phases)
    mean = mean_cycle(rows[1:] if grid.count > 2 else rows)
    width = max(2, len(phases) // SETTINGS.slip)
    # A fall at the end of a cycle is seen from both sides; so the search is about there.
    fall = np.convolve(mean, edge_kernel(width)[::-1], mode="valid")
    place = phases[width : width + len(fall)] - 0.5 * (phases[1] - phases[0])
    near = np.abs(place) < within
    if not near.any():
        return grid
    at = float(place[near][int(np.argmax(fall[near]))])
    return replace(grid, first=grid.first + at * grid.period)


def refine(even: EvenSamples, grid: SlipGrid) -> SlipGrid:
    """Return a run with first slip and period fitted to all of its cycles together.

    Each cycle has its own offset (m), and a shift (s) that brings it onto the mean cycle; the
    shifts lie on a line.
    """
    number = sample_cycles(grid.count)
    for _ in range(SETTINGS.refinements):
        phases = phases_of(even, grid.period)
        slips = grid.slips[number]
        rows = grid.direction * cycles_on_grid(even, slips, grid.period, phases)
        used = number >= (1 if grid.count > 2 else 0)
        mean = mean_cycle(rows[used])
        shift = find_shifts(rows, mean, phases, grid.period)
        good = used & np.isfinite(shift)
        if good.sum() < 2:
            return grid
        slope, about = fit_line(number[good].astype(np.float64), shift[good])
        grid = replace(grid, first=grid.first + about, period=grid.period + slope)
        if abs(slope) * grid.count < SETTINGS.refined * grid.period:
            break
    return grid


def fit_line(x: Array, y: Array) -> tuple[float, float]:
    """Return slope and cut of a line through points, those far off left out."""
    slope, cut = 0.0, float(np.median(y))
    for _ in range(3):
        away = np.abs(y - cut - slope * x)
        near = away <= SETTINGS.outlying * float(np.median(away)) + 1e-30
        middle, level = float(x[near].mean()), float(y[near].mean())
        about = x[near] - middle
        square = float(about @ about)
        slope = float(about @ (y[near] - level)) / square if square > 0.0 else 0.0
        cut = level - slope * middle
    return slope, cut


def find_shifts(rows: Array, mean: Array, phases: Array, period: float) -> Array:
    """Return by how much later (s) than the mean cycle each row is, (cycles,)."""
    smooth = np.convolve(np.pad(mean, 2, mode="edge"), _SMOOTH, mode="valid")
    known = np.isfinite(rows)
    count = np.maximum(known.sum(axis=1, keepdims=True), 1)
    left = np.where(known, rows - mean, 0.0)
    left = np.where(known, left - left.sum(axis=1, keepdims=True) / count, 0.0)
    rate = np.where(known, -np.gradient(smooth, phases * period), 0.0)
    rate = np.where(known, rate - rate.sum(axis=1, keepdims=True) / count, 0.0)
    square = np.sum(rate**2, axis=1)
    enough = (count[:, 0] > SETTINGS.known * len(phases)) & (square > 0.0)
    delay = np.sum(rate * left, axis=1) / np.where(enough, square, 1.0)
    most = SETTINGS.late * period
    return np.where(enough, np.clip(delay, -most, most), np.nan)


def check_run(even: EvenSamples, grid: SlipGrid, given: bool = False) -> SlipGrid | None:
    """Return the run with its step and its significance; None if it is not a run of steps.

    A run of steps has similar cycles, advances the runner, and does not only swing. If its period
    is given, no other period is searched for.
    """
    phases = phases_of(even, grid.period)
    slips = grid.slips[:ROWS]
    rows = grid.direction * cycles_on_grid(even, slips, grid.period, phases)
    rows = fill_gaps(rows)
    first = min(SETTLING, max(1, len(rows) // 2)) if len(rows) > 2 else 0
    later = rows[first:]
    mean = mean_cycle(later)
    within = phases < 0.0  # the last slip is followed by rest
    about = without_trend(later[:, within], phases[within])
    known = np.isfinite(about).all(axis=1)
    about = about[known]
    if len(about) < 2:
        return None
    if grid.period * grid.count > SETTINGS.hum_seen:
        times = (slips[first:, None] + grid.period * phases[within])[known]
        about = about - fit_hum(about, times, phases[within])
    each = np.sort(np.mean(np.diff(about, axis=0) ** 2, axis=1))
    left = 0.5 * float(np.mean(each[: max(1, math.ceil(SETTINGS.alike * len(each)))]))
    samples = grid.period / even.tick
    chance = even.noise**2 * int(np.sum(within)) / samples
    beyond = max(left - chance, 0.0)
    squares = Squares(even)
    if squares.explains(grid):
        beyond = min(beyond, squares.differing(grid) * float(np.var(mean)))
    if beyond > SETTINGS.dissimilar * float(np.var(mean)):
        return None
    steps = np.diff(row_means(rows))
    steps = steps[np.isfinite(steps)]
    step = float(np.median(steps)) if len(steps) else math.nan
    error = even.noise / math.sqrt(samples) / grid.count
    ripple = mean - step * phases
    if not step > max(SETTINGS.clear * error, SETTINGS.least_step * float(np.ptp(ripple))):
        return None
    error = math.sqrt(chance / len(later))
    if not float(np.ptp(ripple)) > 0.0:
        return None
    if not is_no_sine(ripple[phases < 0.0], error) and not _has_rest(even, grid, ripple, step):
        return None
    if not given and not falls_at_all(later, phases):
        return None
    power = float(np.var(ripple))
    dissimilarity = beyond / power
    # The first cycle is what the others are like.
    score = (
        math.log1p(1.0 / (dissimilarity + SETTINGS.least_dissimilar))
        * (grid.count - 1)
        * grid.period
    )
    return replace(grid, step=step, score=score, dissimilarity=dissimilarity)


def fit_hum(rows: Array, times: Array, phases: Array) -> Array:
    """Return the hum of the mains in rows that share a mean and have trends of their own."""
    columns = []
    for wave in hum_columns(times, MAINS):
        column = without_trend(wave, phases)
        columns.append((column - column.mean(axis=0)).ravel())
    design = np.stack(columns, axis=1)
    own = (rows - rows.mean(axis=0)).ravel()
    found, *_ = np.linalg.lstsq(design.T @ design, design.T @ own, rcond=1e-6)
    return np.asarray((design @ found).reshape(rows.shape))


def falls_by_turns(rows: Array, phases: Array, apart: int) -> tuple[Array, float]:
    """Return how far (m) the runner falls at every so-manyth slip from the first, the second, ...

    on, beyond its rise, shape (apart,), least first; and the standard error of one of them.
    """
    before = (phases > -SETTINGS.about) & (phases < 0.0)
    after = (phases > 0.0) & (phases < SETTINGS.about)
    rise = (phases > SETTINGS.about - 1.0) & (phases < -SETTINGS.about)
    slope = float(np.polyfit(phases[rise], mean_cycle(rows)[rise], 1)[0])
    falls = row_means(rows[:, before]) - row_means(rows[:, after]) + SETTINGS.about * slope
    falls = falls[np.isfinite(falls)]
    groups = [falls[k::apart] for k in range(apart)]
    within = sum(float(np.sum((group - group.mean()) ** 2)) for group in groups)
    chance = math.sqrt(within * apart / (len(falls) - apart) / len(falls))
    return np.sort([group.mean() for group in groups]), chance


def falls_at_all(rows: Array, phases: Array) -> bool:
    """Return whether rows fall at their slips, and not only every second, third, ... of them.

    That rows differ by turns is not enough: few samples a cycle lie by turns in swings.
    """
    rows = rows[np.isfinite(rows).all(axis=1)]
    if not falls_by_turns(rows, phases, 1)[0][0] > 0.0:
        return False
    for apart in range(2, min(SETTINGS.apart, len(rows) // 2) + 1):
        (*_, second, first), chance = falls_by_turns(rows, phases, apart)
        if second < SETTINGS.none * first and first - second > SETTINGS.turns * chance:
            return False
    return True


def count_falls(even: EvenSamples, run: SlipGrid) -> int:
    """Return how many times in a cycle the runner falls at even times, nearly as far each time."""
    for falls in range(SETTINGS.apart, 1, -1):
        period = run.period / falls
        if period < SETTINGS.coarsest * even.tick:
            continue
        phases = phases_of(even, period)
        number = np.arange(falls * (min(run.count, ROWS) - 1) + 1, dtype=np.float64)
        slips = run.first + period * number
        rows = run.direction * cycles_on_grid(even, slips, period, phases)
        rows = rows[np.isfinite(rows).all(axis=1)]
        if len(rows) < 2 * falls:
            continue
        (least, *_, most), chance = falls_by_turns(rows, phases, falls)
        if least > max(SETTINGS.none * most, SETTINGS.turns * chance):
            return falls
    return 1


def _has_rest(even: EvenSamples, grid: SlipGrid, ripple: Array, step: float) -> bool:
    """Return whether the axis rests beside the run: it neither swings nor advances there."""
    phases = phases_of(even, grid.period)
    before, after = SETTINGS.beside
    beside = [grid.first - before * grid.period, grid.end + after * grid.period]
    rows = grid.direction * cycles_on_grid(even, np.array(beside), grid.period, phases)
    rows = rows[np.isfinite(rows).all(axis=1)]
    if not len(rows):
        return False
    rows = rows - rows.mean(axis=1, keepdims=True)
    about = phases - phases.mean()
    ahead = np.abs(rows @ about) / float(about @ about)
    swing, advance = SETTINGS.resting
    quiet = np.std(rows, axis=1) < swing * float(np.std(ripple))
    quiet &= ahead < advance * step
    return bool(quiet.any())


def is_no_sine(ripple: Array, error: float) -> bool:
    """Return whether a cycle has more than one harmonic; error (m) is that of its samples."""
    power = np.abs(np.fft.rfft(ripple - ripple.mean())[1:]) ** 2
    first, *others = np.sort(power)[::-1]
    clear = SETTINGS.visible * error**2 * len(ripple)
    return bool(sum(others) > max(SETTINGS.harmonics * first, clear))
