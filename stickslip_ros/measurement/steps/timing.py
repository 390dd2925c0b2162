# SPDX-License-Identifier: Apache-2.0
"""When the slips of a run begin: an even grid, and how many slips lie on it.

Slips are timed at ever finer levels, each against the mean of all. Where the ringing is known, they
are timed again, and counted, in the place towards which the runner rings, in which a slip is a step
and no swing can be taken for one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.steps.matching import SAMPLES_A_PERIOD, Chain, window_of
from stickslip_ros.measurement.steps.record import (
    Level,
    MeanPosition,
    Pyramid,
    beside_line,
    smooth,
)
from stickslip_ros.measurement.steps.ringing import Ringing, without_ringing
from stickslip_ros.measurement.steps.settings import SETTINGS
from stickslip_ros.simulation.settled import SETTLING

#: Slips of a run that are timed at most: more do not tell period and phase better.
_TIMED = 1500
#: Levels finer than that of the match at which slips are timed; samples of the window.
_FINER, _WINDOW = (0, 2, 4, 6, 20), (4, 24)
#: Largest shift of a slip in a round, samples; rounds at a level.
_SHIFT, _ROUNDS = 1.5, 3
#: Part of the slips that a line has to hold, and how far others are away in robust deviations.
_MOST, _OUTLIER = 0.7, 3.0
#: Swings over which the record is smoothed where ringing is taken out; samples of a swing there.
UNRINGING_SWINGS, _SWING_SAMPLES = 0.1, 24
#: Part of the sampling rate up to which ringing is taken out.
_RESOLVED = 0.25
#: Swings by which slips may have been timed wrongly; from which they are moved though uneven.
_SWINGS_OFF, _CLEARLY_OFF = 3.0, 0.3
#: Slips that are looked for beyond the ends of a run.
_BEYOND = 3
#: Part of a step that may miss between two parts of one run.
_JOINED = 0.3
#: Part of the usual rise in a cycle from which on one belongs to the run.
_RISES = 0.7
#: Part of it that a whole rise may miss, before which a small slip is one.
_WHOLE = 0.1


@dataclass(frozen=True)
class SlipGrid:
    """Even times of the slips of a run."""

    first: float  #: begin of the first slip, s
    period: float  #: s
    count: int
    direction: int
    unevenness: float = 0.0  #: root mean square by which the slips miss even times, s
    #: Amplitudes of the slips before the first one, of the first and last one, and after that.
    end_sizes: tuple[float, float, float, float] = (0.0, 1.0, 1.0, 0.0)

    @property
    def slips(self) -> Array:
        """Begin of each slip, s."""
        return self.first + self.period * np.arange(self.count, dtype=np.float64)

    @property
    def last(self) -> float:
        """Begin of the last slip, s."""
        return self.first + self.period * (self.count - 1)

    @property
    def settling(self) -> int:
        """Slips that are left out as the first ones differ."""
        return min(SETTLING - 1, self.count // 2)

    @property
    def settled(self) -> Array:
        """Slips after the first ones, without the last one if there are more; some of many, s."""
        own = self.slips[self.settling :]
        own = own[:-1] if len(own) > 1 else own
        return own[:: max(1, len(own) // _TIMED)]

    def moved(self, shift: float) -> SlipGrid:
        """Return the grid, later by a shift (s)."""
        return replace(self, first=self.first + shift)


def grid_of(chain: Chain, pyramid: Pyramid) -> SlipGrid:
    """Return the grid of a chain, its slips timed at ever finer levels while they get evener."""
    count = len(chain.slips)
    if count < 2:
        return SlipGrid(float(chain.slips[0]), chain.period, count, chain.direction)
    number = np.unique(np.linspace(0, count - 1, min(count, _TIMED)).astype(int))
    settled = min(SETTLING - 1, count // 2)
    own = chain.slips[number]
    grid = best = _fit_grid(number, own, count, chain.direction, settled)
    coarse = pyramid.number_for(chain.period, SAMPLES_A_PERIOD)
    for finer in sorted({max(coarse - k, 0) for k in _FINER}, reverse=True):
        level = pyramid.levels[finer]
        about = SETTINGS.window_after_slip_periods * grid.period / level.spacing
        window = int(np.clip(about, *_WINDOW))
        for _ in range(_ROUNDS):
            base = own if grid.unevenness > 2.0 * level.spacing else grid.slips[number]
            late = _lateness(level, base, window, settled)
            if late is None:
                break
            own = base + late
            grid = _fit_grid(number, own, count, chain.direction, settled)
            if grid.unevenness < best.unevenness:
                best = grid
    return best


def _lateness(level: Level, times: Array, window: int, settled: int) -> Array | None:
    """Return how much later (s) than the mean one the motion about times is; None if unknown."""
    rows = level.rows(times, window, window)
    good = np.isfinite(rows).all(axis=1)
    if good.sum() < 2:
        return None
    flat = beside_line(rows[good])
    mean = np.mean(flat[min(settled, len(flat) - 1) :], axis=0)
    slope = beside_line(np.gradient(mean))
    late = -((flat - mean) @ slope) / max(float(slope @ slope), 1e-40)
    if (np.abs(late) > _SHIFT).mean() > 1.0 - _MOST:  # these are not the slips of one run
        return None
    found = np.zeros(len(times))
    found[good] = np.clip(late, -_SHIFT, _SHIFT) * level.spacing
    return found


def _fit_grid(number: Array, own: Array, count: int, direction: int, settled: int) -> SlipGrid:
    """Fit even times to slips (s) with their numbers, without a few that miss them."""
    use = number >= min(settled, count - 3)
    if use.sum() < 2:
        use = np.ones(len(own), dtype=bool)
    keep = use
    slope, first = np.polyfit(number[keep], own[keep], 1)
    for _ in range(4):
        miss = np.abs(own - first - slope * number)
        usual = 1.4826 * float(np.median(miss[use]))
        good = use & (miss <= max(_OUTLIER * usual, 1e-9))
        if good.sum() < max(min(3, use.sum()), _MOST * use.sum()):
            break
        keep = good
        slope, first = np.polyfit(number[keep], own[keep], 1)
    miss = (own - first - slope * number)[keep]
    return SlipGrid(float(first), float(slope), count, direction, float(np.sqrt(np.mean(miss**2))))


def retime(pyramid: Pyramid, grid: SlipGrid, ringing: Ringing | None) -> SlipGrid:
    """Return the grid with slips timed without ringing, of which no swing is taken for another."""
    if ringing is None or grid.count < SETTINGS.least_cycles:
        return grid
    level = pyramid.level_for(1.0 / ringing.frequency, _SWING_SAMPLES)
    if ringing.frequency * level.spacing > _RESOLVED:
        return grid
    speed = np.gradient(without_ringing(level, ringing, UNRINGING_SWINGS).x)
    reach = min(_SWINGS_OFF / ringing.frequency, 0.3 * grid.period)
    window = int(reach / level.spacing)
    number = np.unique(np.linspace(0, grid.count - 1, min(grid.count, _TIMED)).astype(int))
    due = grid.slips[number]
    rows = replace(level, x=speed).rows(due, window, window) * grid.direction
    good = np.isfinite(rows).all(axis=1)
    if good.sum() < max(3, _MOST * len(rows)):
        return grid
    own = due.copy()
    own[good] += (np.argmin(rows[good], axis=1) - window) * level.spacing
    found = _fit_grid(number, own, grid.count, grid.direction, grid.settling)
    off = abs(float(np.median(own - due))) * ringing.frequency
    limit = max(grid.unevenness, level.spacing) if off > _CLEARLY_OFF else grid.unevenness
    return found if found.unevenness < limit else grid


class SlipSizes:
    """Amplitudes of slips at any times, where the mean one of a run has 1; without ringing."""

    def __init__(
        self, pyramid: Pyramid, slips: Array, period: float, ringing: Ringing | None
    ) -> None:
        number = pyramid.number_for(period, SAMPLES_A_PERIOD)
        if ringing is not None:
            number = min(number, pyramid.number_for(1.0 / ringing.frequency, 12.0))
        self._level = pyramid.levels[number]
        if ringing is not None and ringing.frequency * self._level.spacing < _RESOLVED:
            self._level = without_ringing(self._level, ringing, 0.6 * UNRINGING_SWINGS)
        self._window = window_of(period, self._level.spacing)
        settled = slips[min(SETTLING - 1, len(slips) // 2) :]
        own = self._rows(settled[:: max(1, len(settled) // _TIMED)])
        own = own[np.isfinite(own).all(axis=1)]
        self._mean = own.mean(axis=0) if len(own) else np.zeros(sum(self._window) + 1)

    def _rows(self, times: Array) -> Array:
        return beside_line(self._level.rows(times, *self._window))

    def at(self, times: Array) -> Array:
        """Return the amplitudes at times (s); nan beyond the record."""
        power = max(float(self._mean @ self._mean), 1e-40)
        return np.asarray(self._rows(times) @ self._mean / power)


def count_slips(
    pyramid: Pyramid, mean: MeanPosition, grid: SlipGrid, ringing: Ringing | None
) -> SlipGrid:
    """Return the grid with the slips that are there, no more and no less.

    A slip at an end may be smaller than the others, but the runner rises before it as always.
    """
    low = np.arange(-_BEYOND, min(grid.count, 8))
    high = np.arange(max(grid.count - 8, 0), grid.count + _BEYOND)
    number = np.unique(np.concatenate([low, high]))
    due = grid.first + grid.period * number
    size = SlipSizes(pyramid, grid.slips, grid.period, ringing).at(due)
    rises = _rises(mean, grid.settled, grid.period)
    usual = float(rises.mean()) if rises.any() else math.nan
    rise = _rises(mean, due, grid.period) / usual
    size = np.where(size < SETTINGS.least_amplitude, _judged(size, rise), size)
    seen = dict(zip(number.tolist(), size.tolist(), strict=True))

    def there(k: int) -> bool:
        return seen.get(k, 0.0) > SETTINGS.least_amplitude  # nan is no slip

    first, last = 0, grid.count - 1
    while there(first - 1):
        first -= 1
    while first == 0 <= last - 1 and not there(first):
        first += 1
    while there(last + 1):
        last += 1
    while last > max(grid.count - 3, first) and not there(last):
        last -= 1
    ends = tuple(seen.get(k, math.nan) for k in (first - 1, first, last, last + 1))
    return replace(
        grid, first=grid.first + first * grid.period, count=last - first + 1,
        end_sizes=ends,  # type: ignore[arg-type]
    )  # fmt: skip


def _rises(mean: MeanPosition, slips: Array, period: float) -> Array:
    """Return how far (m) the runner gets in the cycles before slips (s), but for their ends."""
    late = mean.between(slips - 0.15 * period, slips - 0.02 * period)
    return np.asarray(late - mean.between(slips - 0.9 * period, slips - 0.75 * period))


def _judged(size: Array, rise: Array) -> Array:
    """Return the sizes of slips that are small, or 0 or 1 where the rise before them is clear."""
    slip = (size > 0.5 * SETTINGS.least_amplitude) & (np.abs(rise - 1.0) < _WHOLE)
    none = (size < SETTINGS.least_amplitude) & (np.abs(rise) < 1.0 - _RISES)
    return np.where(slip, 1.0, np.where(none, 0.0, size))


def join_grids(mean: MeanPosition, grids: Sequence[SlipGrid]) -> list[SlipGrid]:
    """Join runs that go on in phase, between which the runner goes as far as with all the slips."""
    ordered = sorted(grids, key=lambda one: one.first)
    joined = list(ordered[:1])
    for grid in ordered[1:]:
        before = joined[-1]
        slots = (grid.first - before.last) / before.period
        number = round(slots)
        if (
            before.direction != grid.direction
            or abs(grid.period / before.period - 1.0) > SETTINGS.largest_gap_change
            or number < 1
            or abs(slots - number) > SETTINGS.largest_gap_change
            or max(before.count, grid.count) < 2
        ):
            joined.append(grid)
            continue
        longer = max(before, grid, key=lambda one: one.count)
        ends = np.array([longer.first, longer.last, before.last, grid.first])
        begin, end, left, right = mean.between(ends - longer.period, ends)
        step = (end - begin) / (longer.count - 1)
        if step and abs((right - left) / step - number) < _JOINED * max(1.0, 0.1 * number):
            count = before.count + grid.count + number - 1
            period = (grid.last - before.first) / (count - 1)
            joined[-1] = replace(
                longer, first=before.first, period=period, count=count,
                end_sizes=(*before.end_sizes[:2], *grid.end_sizes[2:]),
            )  # fmt: skip
        else:
            joined.append(grid)
    return joined


def steepest_fall(fold: Array, inside: NDArray[np.bool_]) -> int:
    """Return where positions at even times fall most, at the finest scale that noise allows."""
    noise = 1.4826 * float(np.median(np.abs(np.diff(fold, 2)))) / math.sqrt(6.0)
    at, width = 0, 1.5
    while width < len(fold) / 20:
        slope = smooth(fold, width, 1)
        slope = np.where(inside, slope - np.median(slope), 0.0)
        at = int(np.argmin(slope))
        # The noise of this derivative of a Gaussian mean; fifteen times it is no chance.
        if -slope[at] > 15.0 * noise * math.sqrt(1.0 / (4.0 * math.sqrt(math.pi) * width**3)):
            break
        width *= 1.5
    return at
