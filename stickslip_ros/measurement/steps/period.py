# SPDX-License-Identifier: Apache-2.0
"""The period of a drive that nobody has told, from the record alone.

In a run of equal steps, x(t + T) - x(t) is the same for every t, whatever the shape of a cycle (the
difference function of A. de Cheveigne and H. Kawahara, J. Acoust. Soc. Am. 111 (2002) 1917). Half
of its variance in a window of T over that of x without a line is 0 in a run, and about 1 in noise.
The period is right where neither a part of it nor a multiple explains as much: the mean motion over
the phase of the right period has the same variance as over that of a multiple of it, and more than
over that of a part of it (A. Schwarzenberg-Czerny, Mon. Not. R. Astron. Soc. 241 (1989) 153).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.steps.record import Level, MeanPosition, Pyramid, Record
from stickslip_ros.measurement.steps.ringing import Ringing
from stickslip_ros.measurement.steps.settings import SETTINGS
from stickslip_ros.measurement.steps.slips import SlipGrid, SlipSizes

#: Samples of a period at the level where it is sought; at the finest level, fewer.
_LAGS, _FEWEST = (32, 64), 4
#: Part of the mean motion that counts as none; length that does, m.
_STILL, _PRECISION = 0.01, 1e-11
#: Samples that are looked at: a longer level is seen in pieces.
_PIECE, _PIECES = 2**13, 8
#: Samples that are laid over each other at most and at least; of them, cycles at most.
_MOST, _LEAST, _CYCLES = 40_000, 40, 600
#: Part of the variance at a period from which on that at a part of it is as good; that at a
#: multiple of it is better by that.
_AS_GOOD = 0.75


def estimate_periods(pyramid: Pyramid) -> list[float]:
    """Return periods (s) with which some of the record repeats, the likeliest first."""
    seen: list[tuple[float, float]] = []
    for number, level in enumerate(pyramid.levels):
        first = _FEWEST if number == 0 else _LAGS[0]
        pieces = [_Sums(one) for one in _pieces_of(level)]
        covered = sum(len(one.x) for one in pieces) / len(level.x)
        for lag in range(first, _LAGS[1]):
            period = lag * level.spacing
            quality = sum(one.repeating(lag) for one in pieces) * level.spacing / covered
            if quality > 0.3 * period:
                seen.append((quality, period))
    seen.sort(reverse=True)
    kept: list[float] = []
    for quality, period in seen:
        if quality < 0.4 * seen[0][0]:
            break
        if all(abs(period / other - 1.0) > 0.15 for other in kept):
            kept.append(period)
    return kept


def _pieces_of(level: Level) -> list[Array]:
    count = len(level.x)
    if count <= _PIECE * _PIECES:
        return [level.x]
    firsts = np.linspace(0, count - _PIECE, _PIECES).astype(int)
    return [level.x[k : k + _PIECE] for k in firsts.tolist()]


class _Sums:
    """Running sums of positions beside their mean: of positions, squares, and times index."""

    def __init__(self, x: Array) -> None:
        self.x = x - x.mean()
        place = np.arange(len(x))
        self.first, self.square, self.slope = (
            np.concatenate([[0.0], np.cumsum(one)])
            for one in (self.x, self.x * self.x, place * self.x)
        )

    def repeating(self, lag: int) -> float:
        """Return the length (samples) of the longest stretch that repeats after a lag (samples)."""
        x = self.x
        if len(x) < 3 * lag:
            return 0.0
        mean, square, slope = (
            one[lag:] - one[:-lag] for one in (self.first, self.square, self.slope)
        )
        drift = float(np.mean(x[lag:] - x[:-lag]))
        change = x[lag:] - x[:-lag] - drift
        first = mean[lag:] - mean[:-lag] - lag * drift
        squares = np.concatenate([[0.0], np.cumsum(change * change)])
        changing = np.maximum(squares[lag:] - squares[:-lag] - first * first / lag, 0.0)
        slope = slope - (np.arange(len(mean)) + 0.5 * (lag - 1)) * mean
        moving = square - mean * mean / lag - slope**2 / (lag * (lag * lag - 1) / 12.0)
        moving = np.minimum(moving[: len(changing)], moving[lag : lag + len(changing)])
        moving = np.maximum(moving, 0.0)  # differences of long sums round to less
        rounding = 4.0 * np.finfo(np.float64).eps * float(self.square[-1])
        still = _STILL * float(np.mean(moving)) + lag * _PRECISION**2 + rounding
        unlike = (0.5 * changing + still) / (moving + still)
        gain = 1.0 - unlike / SETTINGS.change_of_cycles
        total = np.concatenate([[0.0], np.cumsum(gain)])
        edges = np.flatnonzero(
            np.diff(np.concatenate([[False], gain > 0.0, [False]]).astype(np.int8))
        )
        return float(np.max(total[edges[1::2]] - total[edges[::2]], initial=0.0))


def explained_by(record: Record, mean: MeanPosition, grid: SlipGrid) -> Callable[[float], float]:
    """Return what gives the part of the motion in a run that the phase of a period (s) explains."""
    begin, end = grid.slips[min(grid.settling, grid.count - 2)], grid.last
    longest = min(_CYCLES * grid.period, end - begin)
    middle = 0.5 * (begin + end)
    first, last = np.searchsorted(record.t, [middle - 0.5 * longest, middle + 0.5 * longest])
    part = slice(first, min(last, first + _MOST))
    t, half = record.t[part], 0.5 * grid.period
    x = record.x[part] - record.x[0] - mean.between(t - half, t + half)
    x = x - x.mean() if len(x) else x
    total = float(x @ x)

    def of_period(period: float) -> float:
        # Bins finer than samples would hold the same samples over any period, where the sampling
        # keeps step with the drive.
        bins = int(np.clip(period / record.spacing, 4, 64))
        if len(x) < max(_LEAST, 2 * bins) or not total > 0.0:
            return 0.0
        number = (((t - middle) / period % 1.0) * bins).astype(np.int64) % bins
        count = np.bincount(number, minlength=bins)
        sums = np.bincount(number, x, bins)
        between = float(np.sum(sums**2 / np.maximum(count, 1)))
        free = max(len(x) - bins, 1)
        return (between - bins * (total - between) / free) / total

    return of_period


def period_factor(
    record: Record, mean: MeanPosition, pyramid: Pyramid, grid: SlipGrid, ringing: Ringing | None
) -> float:
    """Return by how much the period is too short (2, 3, ...) or too long (1/2, 1/3), else 1."""
    if grid.count < SETTINGS.least_cycles:
        return 1.0
    explained = explained_by(record, mean, grid)
    own = explained(grid.period)
    sizes = SlipSizes(pyramid, grid.slips, grid.period, ringing)
    size, _ = sizes.at(grid.slips[grid.settling :][:_CYCLES])
    for m in (2, 3, 4, 5):
        if len(size) > m:
            groups = [_median(size[j::m]) for j in range(m)]
            differ = max(groups) - min(groups)
            likelier = own < _AS_GOOD * explained(m * grid.period)
            if differ > 1.5 or (differ > SETTINGS.least_amplitude and likelier):
                return float(m)
    for m in (5, 3, 2):
        between = slips_between(sizes, grid, record.spacing, m)
        if between > 0.6:
            return 1.0 / m
        possible = ringing is None or between > 0.5 * SETTINGS.least_amplitude
        if possible and explained(grid.period / m) > _AS_GOOD * own > 0.0:
            return 1.0 / m
    return 1.0


def slips_between(sizes: SlipSizes, grid: SlipGrid, spacing: float, parts: int) -> float:
    """Return the size of slips at parts of a period, 1 where they are as large as those of a run.

    0 where samples so far apart (s) do not resolve these parts.
    """
    if grid.period / parts < 20.0 * spacing:
        return 0.0
    slips = grid.slips[grid.settling :][:_CYCLES][:-1]
    parted = [sizes.at(slips + j * grid.period / parts)[0] for j in range(1, parts)]
    return min(_median(one) for one in parted)


def _median(values: Array) -> float:
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else 0.0
