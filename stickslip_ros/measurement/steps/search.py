# SPDX-License-Identifier: Apache-2.0
"""Candidates for the period of a drive, by the difference function.

In a run of equal steps, x(t + T) - x(t) is the same for every t, whatever the shape of a cycle (the
difference function of A. de Cheveigne and H. Kawahara, J. Acoust. Soc. Am. 111 (2002) 1917). Half
of its variance in a window of T over that of x without a line is 0 in a run, and about 1 in noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip_ros.measurement.steps.record import Level, Pyramid
from stickslip_ros.measurement.steps.settings import SETTINGS

#: Samples of a period at the level where it is sought; at the finest level, fewer.
_LAGS, FEWEST_SAMPLES = (32, 64), 4
#: Part of the mean motion that counts as none; length that does, m.
_STILL, _PRECISION = 0.01, 1e-11
#: Candidates at most, and part by which they differ.
_CANDIDATES, _APART = 5, 0.15
#: Samples that are looked at: a longer level is seen in pieces.
_PIECE, _PIECES = 2**13, 8


@dataclass(frozen=True)
class Candidate:
    """A period and the stretch of time that repeats best with it."""

    period: float  #: s
    begin: float  #: s
    end: float  #: s
    quality: float = 0.0  #: time that repeats, s


def search_periods(pyramid: Pyramid) -> list[Candidate]:
    """Return candidates for the period, the best first; none where nothing repeats."""
    seen: list[Candidate] = []
    for number, level in enumerate(pyramid.levels):
        first = FEWEST_SAMPLES if number == 0 else _LAGS[0]
        pieces = [_Sums(one) for one in _pieces_of(level)]
        covered = sum(len(one.x) for one in pieces) / len(level.x)
        for lag in range(first, _LAGS[1]):
            found = [_repeating_stretch(one, lag) for one in pieces]
            best = max(found, key=lambda one: one.quality)
            quality = sum(one.quality for one in found) / covered
            if quality > SETTINGS.shortest_stretch_periods * best.period:
                seen.append(Candidate(best.period, best.begin, best.end, quality))
    seen.sort(key=lambda one: -one.quality)
    kept: list[Candidate] = []
    for one in seen:
        if one.quality < SETTINGS.least_quality_of_best * seen[0].quality:
            break
        if all(abs(one.period / other.period - 1.0) > _APART for other in kept):
            kept.append(one)
    return kept[:_CANDIDATES]


def stretch_of(pyramid: Pyramid, period: float) -> Candidate:
    """Return the stretch that repeats best with a given period (s)."""
    level = pyramid.level_for(period, _LAGS[0])
    lag = round(period / level.spacing)
    found = [_repeating_stretch(_Sums(one), lag) for one in _pieces_of(level)]
    best = max(found, key=lambda one: one.quality)
    return Candidate(period, best.begin, best.end, best.quality)


def _pieces_of(level: Level) -> list[Level]:
    count = len(level.x)
    if count <= _PIECE * _PIECES:
        return [level]
    firsts = np.linspace(0, count - _PIECE, _PIECES).astype(int)
    return [
        Level(level.x[k : k + _PIECE], level.spacing, level.start + k * level.spacing)
        for k in firsts.tolist()
    ]


class _Sums:
    """Running sums of a level beside its mean: of positions, squares, and times index."""

    def __init__(self, level: Level) -> None:
        self.level, self.x = level, level.x - level.x.mean()
        place = np.arange(len(self.x))
        self.first, self.square, self.slope = (
            np.concatenate([[0.0], np.cumsum(one)])
            for one in (self.x, self.x * self.x, place * self.x)
        )


def _repeating_stretch(sums: _Sums, lag: int) -> Candidate:
    """Return the longest stretch that repeats after a lag (samples), with its quality."""
    level = sums.level
    x, period = sums.x, lag * level.spacing
    nothing = Candidate(period, level.start, level.start)
    if len(x) < 3 * lag:
        return nothing
    mean, square, slope = (one[lag:] - one[:-lag] for one in (sums.first, sums.square, sums.slope))
    drift = float(np.mean(x[lag:] - x[:-lag]))
    change = x[lag:] - x[:-lag] - drift
    first = mean[lag:] - mean[:-lag] - lag * drift
    squares = np.concatenate([[0.0], np.cumsum(change * change)])
    changing = np.maximum(squares[lag:] - squares[:-lag] - first * first / lag, 0.0)
    slope = slope - (np.arange(len(mean)) + 0.5 * (lag - 1)) * mean
    moving = square - mean * mean / lag - slope**2 / (lag * (lag * lag - 1) / 12.0)
    moving = np.minimum(moving[: len(changing)], moving[lag : lag + len(changing)])
    moving = np.maximum(moving, 0.0)  # differences of long sums round to less
    rounding = 4.0 * np.finfo(np.float64).eps * float(sums.square[-1])
    still = _STILL * float(np.mean(moving)) + lag * _PRECISION**2 + rounding
    unlike = (0.5 * changing + still) / (moving + still)
    good = unlike < SETTINGS.largest_change_of_cycles
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(np.int8)))
    if not len(edges):
        return nothing
    total = np.concatenate([[0.0], np.cumsum(SETTINGS.largest_change_of_cycles - unlike)])
    begins, ends = edges[::2], edges[1::2]
    value = total[ends] - total[begins]
    k = int(np.argmax(value))
    quality = float(value[k]) / SETTINGS.largest_change_of_cycles * level.spacing
    begin = level.start + begins[k] * level.spacing
    return Candidate(
        period, begin, begin + (ends[k] - begins[k] + 2 * lag - 1) * level.spacing, quality
    )
