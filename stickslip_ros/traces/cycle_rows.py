# SPDX-License-Identifier: Apache-2.0
"""Cycles of a run laid over one another: as rows of mean positions about the same phases."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.traces.evenly import EvenSamples

Array = NDArray[np.float64]

#: Phases of a mean cycle at most; part of a period after the slip that belongs to a cycle, too.
_PHASES, _BEYOND = 200, 0.25
#: Cycles that are looked at, in stretches of so many.
ROWS, _STRETCH = 320, 16


@dataclass(frozen=True)
class Course:
    """Cycles of one run on a grid of slips: slip k begins about first + k period."""

    first: float  #: slip of the first cycle, s
    period: float  #: s
    count: int  #: cycles
    direction: int  #: +1 or -1
    step: float  #: how far it gets in a cycle, about, m; positive
    energy: float  #: how clear it is
    unlike: float = 0.0  #: part of the motion within cycles that is not the same in the next one
    explained: bool = True  #: False where rises, falls and ringing of one period do not explain it

    @property
    def slips(self) -> Array:
        """Where the slips are, s, (cycles,)."""
        return self.first + self.period * np.arange(self.count, dtype=np.float64)

    @property
    def begin(self) -> float:
        """Begin of the first cycle, s."""
        return self.first - self.period

    @property
    def end(self) -> float:
        """Slip of the last cycle, s."""
        return self.first + self.period * (self.count - 1)


def phases_of(even: EvenSamples, period: float) -> Array:
    """Return phases from one slip (-1) to a little after the next (0), in periods."""
    count = int(np.clip(period / even.tick, 8, _PHASES))
    return np.asarray((np.arange(math.ceil((1.0 + _BEYOND) * count)) + 0.5) / count - 1.0)


def cycles_on_grid(even: EvenSamples, slips: Array, period: float, phases: Array) -> Array:
    """Return the mean positions (m) about phases, (cycles, phases); nan where not known."""
    half = 0.5 * (phases[1] - phases[0])
    edges = np.append(phases - half, phases[-1] + half)
    return even.means(slips[:, None] + period * edges[None, :])


def some_cycles(count: int) -> NDArray[np.int64]:
    """Return numbers of cycles that stand for all of them: all, or stretches at even distances."""
    if count <= ROWS:
        return np.arange(count)
    starts = np.linspace(0, count - _STRETCH, ROWS // _STRETCH).astype(np.int64)
    return np.asarray(np.unique(starts[:, None] + np.arange(_STRETCH)))


def mean_cycle(rows: Array) -> Array:
    """Return what rows have in common, without its mean, (phases,)."""
    common = _medians(rows - row_means(rows)[:, None])
    known = np.isfinite(common)
    return np.where(known, common - (common[known].mean() if known.any() else 0.0), 0.0)


def row_means(rows: Array) -> Array:
    """Return the mean of what is known of each row, (cycles,); nan where nothing is."""
    known = np.isfinite(rows)
    count = known.sum(axis=1)
    total = np.where(known, rows, 0.0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _medians(rows: Array) -> Array:
    """Return the median of what is known of each column, (phases,); nan where nothing is."""
    if not len(rows):
        return np.full(rows.shape[1], np.nan)
    ordered = np.sort(rows, axis=0)  # what is not known comes last
    count = np.isfinite(rows).sum(axis=0)[None, :]
    pair = [
        np.take_along_axis(ordered, np.maximum(k, 0), 0)[0] for k in ((count - 1) // 2, count // 2)
    ]
    return np.asarray(0.5 * (pair[0] + pair[1]))


def likeness(rows: Array, mean: Array) -> Array:
    """Return how much of the mean cycle each row holds, (cycles,); nan of rows not known."""
    known = np.isfinite(rows)
    share = np.where(known, mean, 0.0)
    count = np.maximum(known.sum(axis=1, keepdims=True), 1)
    share = np.where(known, share - share.sum(axis=1, keepdims=True) / count, 0.0)
    square = np.sum(share**2, axis=1)
    projected = np.sum(np.where(known, rows, 0.0) * share, axis=1)
    enough = (square > 0.5 * float(mean @ mean)) & (square > 0.0)
    return np.where(enough, projected / np.where(enough, square, 1.0), np.nan)


def filled(rows: Array) -> Array:
    """Return rows with straight lines over short gaps."""
    filled = rows.copy()
    place = np.arange(rows.shape[1])
    for row in filled:
        known = np.isfinite(row)
        if 0.75 * len(row) < known.sum() < len(row):
            row[~known] = np.interp(place[~known], place[known], row[known])
    return filled


def without_trend(rows: Array, phases: Array) -> Array:
    """Return rows without a straight line of their own each; nan where not all is known."""
    about = phases - phases.mean()
    slope = (rows @ about) / float(about @ about)
    return np.asarray(rows - rows.mean(axis=1, keepdims=True) - slope[:, None] * about)
