# SPDX-License-Identifier: Apache-2.0
"""The settled cycles of a run laid over each other, and the rests beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.steps.record import MeanPosition, Record
from stickslip_ros.measurement.steps.settings import SETTINGS
from stickslip_ros.measurement.steps.slips import SlipGrid, steepest_fall

#: Cycles of a fold at most; parts of a period before and after the slip.
_CYCLES, _BEFORE, _AFTER = 400, 0.5, 0.99
#: Bins of a fold at most, samples of one at least, samples of a fold at least.
_BINS, _IN_BIN, FEWEST_SAMPLES = 6000, 4, 40

Rest = tuple[float, float]  #: begin and end, s


@dataclass(frozen=True)
class Fold:
    """Positions of the settled cycles in the direction of the steps, over the time after the slip.

    Beside the mean from a period before the slip to one after it, which takes steps, drift and slow
    hum out.
    """

    t: Array  #: s, increasing
    x: Array  #: m
    cycles: int

    @property
    def enough(self) -> bool:
        """Whether there are samples enough to see a slip in."""
        return len(self.t) >= FEWEST_SAMPLES

    def binned(self) -> tuple[Array, Array]:
        """Return mean times (s) and positions (m) in bins of a few samples."""
        span = float(self.t[-1] - self.t[0])
        width = max(span / _BINS, min(_IN_BIN, self.cycles) * span / len(self.t))
        number = np.floor((self.t - self.t[0]) / width).astype(np.int64)
        count = np.bincount(number)
        some = count > 0
        t, x = (np.bincount(number, one)[some] / count[some] for one in (self.t, self.x))
        return t, x


def fold_cycles(record: Record, mean: MeanPosition, grid: SlipGrid) -> Fold:
    """Return the settled cycles of a run over each other."""
    return fold_slips(record, mean, grid.settled, grid.period, grid.direction)


def fold_slips(
    record: Record, mean: MeanPosition, slips: Array, period: float, direction: int
) -> Fold:
    """Return the cycles about slips (s) over each other."""
    slips = slips[:: max(1, len(slips) // _CYCLES)]
    about = mean.between(slips - period, slips + period) + record.x[0]
    begins = np.searchsorted(record.t, slips - _BEFORE * period)
    ends = np.searchsorted(record.t, slips + _AFTER * period)
    parts = [slice(b, e) for b, e in zip(begins.tolist(), ends.tolist(), strict=True)]
    t = np.concatenate([record.t[one] - slip for one, slip in zip(parts, slips, strict=True)])
    x = np.concatenate([record.x[one] - place for one, place in zip(parts, about, strict=True)])
    order = np.argsort(t, kind="stable")
    return Fold(t[order], direction * x[order], len(slips))


def move_to_fall(record: Record, mean: MeanPosition, grid: SlipGrid) -> SlipGrid:
    """Return the grid with slips at the steepest fall of their cycle."""
    fold = fold_cycles(record, mean, grid)
    if not fold.enough:
        return grid
    t, x = fold.binned()
    inside = (t > -0.45 * grid.period) & (t < 0.5 * grid.period)
    return replace(grid, first=grid.first + float(t[steepest_fall(x, inside)]))


def way_between(mean: MeanPosition, before: Rest, after: Rest, period: float) -> float:
    """Return how far (m) the runner goes from a rest to another one.

    The place in each is the mean over half a period (s) beside the run between them.
    """
    near = 0.5 * period
    begins = np.array([max(before[0], before[1] - near), after[0]])
    ends = np.array([before[1], min(after[1], after[0] + near)])
    first, last = mean.between(begins, ends)
    return float(last - first)


def find_rests(
    grids: Sequence[SlipGrid], begin: float, end: float
) -> list[tuple[Rest | None, Rest | None]]:
    """Return the rests (s) before and after each run in a record; grids are in order of time."""
    found = []
    after_slip, before_rise = SETTINGS.rest_after_slip_periods, SETTINGS.rest_before_rise_periods
    for k, grid in enumerate(grids):
        low = begin if k == 0 else grids[k - 1].last + after_slip * grids[k - 1].period
        high = end
        if k + 1 < len(grids):
            high = grids[k + 1].first - (1.0 + before_rise) * grids[k + 1].period
        before = low, grid.first - (1.0 + before_rise) * grid.period
        after = grid.last + after_slip * grid.period, high
        least = SETTINGS.shortest_rest_periods * grid.period
        rests = [one if one[1] - one[0] > least else None for one in (before, after)]
        found.append((rests[0], rests[1]))
    return found
