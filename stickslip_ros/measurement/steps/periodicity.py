# SPDX-License-Identifier: Apache-2.0
"""Whether the period of a run is that of the drive, or a part or a multiple of it.

The mean motion over the phase of the right period has the same variance as over that of a multiple
of it, and more than over that of a part of it, whatever the sampling and the noise (an analysis of
variance, A. Schwarzenberg-Czerny, Mon. Not. R. Astron. Soc. 241 (1989) 153).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.steps.record import MeanPosition, Pyramid, Record
from stickslip_ros.measurement.steps.ringing import Ringing
from stickslip_ros.measurement.steps.settings import SETTINGS
from stickslip_ros.measurement.steps.timing import SlipGrid, SlipSizes

#: Samples that are laid over each other, at most and at least; of them, cycles at most.
_MOST, _LEAST, _CYCLES = 40_000, 40, 600
#: Bins of a period, at least and at most; one a sample of a cycle, as finer ones would hold the
#: same samples over any period where the sampling keeps step with the drive.
_BINS = (4, 64)
#: Part of the variance at a period from which on that at a part of it is as good; that at a
#: multiple of it is better by that.
_AS_GOOD = 0.75
#: Samples of a part of a period that are coarse; part of the variance that makes it possible.
_COARSE, _POSSIBLE = 16.0, 0.3
#: Amplitude between slips that is one, where there are so many samples a period.
_SLIP_BETWEEN, _RESOLVED = 0.75, 20.0
#: Multiples and parts that are asked for.
_MULTIPLES, _PARTS = (2, 3, 4, 5), (5, 3, 2)


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
        bins = int(np.clip(period / record.spacing, *_BINS))
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
    slips = grid.slips[grid.settling :][:_CYCLES]
    size = sizes.at(slips)
    for m in _MULTIPLES:
        if len(size) > m:
            groups = [_median(size[j::m]) for j in range(m)]
            differ = max(groups) - min(groups) > SETTINGS.least_amplitude
            if differ and own < _AS_GOOD * explained(m * grid.period):
                return float(m)
    for m in _PARTS:
        between = min(_median(sizes.at(slips[:-1] + j * grid.period / m)) for j in range(1, m))
        resolved = grid.period / m > _RESOLVED * record.spacing
        if resolved and between > _SLIP_BETWEEN:
            return 1.0 / m
        possible = ringing is None or between > 0.5 * SETTINGS.least_amplitude
        if possible and explained(grid.period / m) > _AS_GOOD * own > 0.0:
            return 1.0 / m
    return 1.0


def possible_part(record: Record, mean: MeanPosition, grid: SlipGrid) -> int:
    """Return the part of a period that coarse samples may show as well, 1 if none.

    A ringing that single cycles sample too coarsely looks different in each of them.
    """
    explained = explained_by(record, mean, grid)
    own = explained(grid.period)
    for m in _PARTS:
        coarse = grid.period / m < _COARSE * record.spacing
        if coarse and explained(grid.period / m) > _POSSIBLE * own:
            return m
    return 1


def _median(values: Array) -> float:
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else 0.0
