# SPDX-License-Identifier: Apache-2.0
"""When the slips of runs begin, for a known period of the drive.

The mean slip in a window is a template; its least-squares amplitude beside a straight line is near
1 at slips and 0 elsewhere, whatever the drift. A run is where the amplitudes at even times, each
less one half, add up to most: that is the likelier of slips and none in white noise. Its slips are
timed against the mean of all. Where the ringing is known, they are timed again, and counted, in the
place towards which the runner rings, in which a slip is a step and no swing can be taken for one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.steps.noise import robust_std
from stickslip_ros.measurement.steps.record import Level, Pyramid, Record, beside_line, smooth
from stickslip_ros.measurement.steps.ringing import Ringing, without_ringing
from stickslip_ros.measurement.steps.settings import SETTINGS
from stickslip_ros.simulation.settled import SETTLING

#: Samples of a period at which slips are matched; fewer where it may be off by some parts of it.
_SAMPLES_A_PERIOD, _ESTIMATED_SAMPLES = 200, 25
#: Periods before and after a slip that are matched; part of one by which a slip may be off.
_WINDOW, _OFF = (0.35, 0.12), 0.03
#: Cycles in a row that the first template may come from; how many times one is made; runs at most.
_IN_A_ROW, _ROUNDS, _MOST_RUNS = (2, 4, 8, 16, 32, 64), 3, 60
#: Slips of a run that are timed at most: more do not tell period and phase better; samples of a
#: period in each round, and of the window; largest shift, samples; part of the slips that a line
#: has to hold.
_TIMED, _TIMED_SAMPLES, _TIMED_WINDOW, _SHIFT, _HELD = (
    1500,
    (200, 200, 800, 3200),
    (4, 24),
    1.5,
    0.7,
)
#: Swings over which the record is smoothed where ringing is taken out; samples of a swing there;
#: part of the sampling rate up to which it is.
_SMOOTH, _SWING_SAMPLES, _RESOLVED = 0.1, 24, 0.25
#: Periods beyond the ends of a run in which further slips are looked for; slips that may be missing
#: of those that were sent.
_BEYOND, _MISSING = 8, 3


@dataclass(frozen=True)
class SlipGrid:
    """Even times of the slips of a run."""

    first: float  #: begin of the first slip, s
    period: float  #: s
    count: int
    direction: int
    unevenness: float = 0.0  #: root mean square by which the slips miss even times, s
    seen: float = 0.0  #: half of the number of slips that are clear, less that of those missing
    sent: int = 0  #: steps that were sent, with their sign; 0 if unknown
    sureness: float = math.inf  #: logarithm of how much likelier this count is than others

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
        slips = self.slips[self.settling :]
        slips = slips[:-1] if len(slips) > 1 else slips
        return slips[:: max(1, len(slips) // _TIMED)]

    @property
    def timed(self) -> NDArray[np.int64]:
        """Numbers of the slips that are timed, some of many."""
        places = np.linspace(0, self.count - 1, min(self.count, _TIMED))
        return np.unique(places.astype(np.int64))

    def part(self, first: int, last: int) -> SlipGrid:
        """Return the grid from one slip to another one, by their numbers from 0; both included."""
        return replace(self, first=self.first + first * self.period, count=last - first + 1)


def find_grids(
    pyramid: Pyramid,
    period: float,
    ringing: Ringing | None = None,
    near: float = SETTINGS.period_error,
    taken: Sequence[SlipGrid] = (),
) -> list[SlipGrid]:
    """Return the slips of all runs with a period (s), but for a part near it, in the order of time.

    Ringing that is known is taken out before, as that of quick drives hides their slips. taken are
    runs of other periods, whose time is left out.
    """
    samples = _SAMPLES_A_PERIOD if near <= SETTINGS.period_error else _ESTIMATED_SAMPLES
    level = unrung(pyramid.level_for(period, samples), ringing, period)
    slips, direction = _loudest_slips(level, period, taken)
    template, grids = _mean_slip(level, slips, period), list[SlipGrid]()
    for _ in range(2 * _ROUNDS if len(slips) else 0):
        amplitude = _amplitudes(level, template, period)
        for other in taken:
            _leave_out(amplitude, other)
        main = _likeliest_grid(amplitude, level, period, direction, near)
        if main is None:
            return []
        template = main.direction * direction * _mean_slip(level, main.settled, period)
        same = bool(grids) and abs(main.period / period - 1.0) < 1e-4
        period, grids = main.period, [main]
        if same:
            break
    while grids and len(grids) < _MOST_RUNS:
        _leave_out(amplitude, grids[-1])
        main = _likeliest_grid(amplitude, level, period, direction, near)
        if main is None:
            break
        grids.append(main)
    return sorted(grids, key=lambda one: one.first)


def _leave_out(amplitude: Level, grid: SlipGrid) -> None:
    """Set the amplitudes in the time of a run to 0."""
    begin, end = (
        max(round((at - amplitude.start) / amplitude.spacing), 0)
        for at in (grid.first - 0.9 * grid.period, grid.last + 0.9 * grid.period)
    )
    amplitude.x[begin : end + 1] = 0.0


def _loudest_slips(level: Level, period: float, taken: Sequence[SlipGrid]) -> tuple[Array, int]:
    """Return the slips (s) of the cycles in a row that have most in common, and their direction.

    They are judged by what differs between them over what they have in common (an analysis of
    variance), so that neither noise nor hum stands out, nor a few large moves.
    """
    length = max(round(period / level.spacing), 2)
    number = np.arange(int(len(level.x) * level.spacing / period), dtype=np.float64)
    starts = level.start + period * number
    if len(starts) < 2:
        return np.zeros(0), 1
    rows = level.rows(starts, 0, length - 1)
    rows = beside_line(np.nan_to_num(rows, nan=float(level.x[-1])))
    for other in taken:
        inside = (starts > other.first - other.period - period) & (starts < other.last + period)
        rows[inside] = 0.0
    sums = np.concatenate([np.zeros((1, length)), np.cumsum(rows, axis=0)])
    power = np.concatenate([[0.0], np.cumsum(np.sum(rows**2, axis=1))])
    best = 0.0, 0, 2
    for count in (one for one in _IN_A_ROW if one <= len(rows)):
        common = np.sum((sums[count:] - sums[:-count]) ** 2, axis=1) / count
        differ = np.maximum(power[count:] - power[:-count] - common, 0.0) / (count - 1)
        ratio = common / (differ + 0.01 * max(float(common.max()), 1e-40))
        k = int(np.argmax(ratio))
        best = max(best, (float(ratio[k]), k, count), key=lambda one: one[0])
    _, first, count = best
    mean = (sums[first + count] - sums[first]) / count
    way = level.at(starts[[first, first + count - 1]])
    direction = -1 if way[1] < way[0] else 1
    inside = np.repeat([False, True, False], length)
    fall = steepest_fall(direction * np.tile(mean, 3), inside) % length
    return starts[first : first + count] + fall * level.spacing, direction


def steepest_fall(fold: Array, inside: NDArray[np.bool_]) -> int:
    """Return where positions at even times fall most, at the finest scale that noise allows."""
    noise = robust_std(np.diff(fold, 2)) / math.sqrt(6.0)
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


def _window(period: float, spacing: float) -> tuple[int, int]:
    """Return how many samples before and after a slip are matched."""
    before, after = (round(part * period / spacing) for part in _WINDOW)
    return max(3, before), max(2, after)


def _mean_slip(level: Level, slips: Array, period: float) -> Array:
    """Return the mean motion (m) about slips (s) in the window that is matched; 0 without any."""
    rows = beside_line(level.rows(slips, *_window(period, level.spacing)))
    rows = rows[np.isfinite(rows).all(axis=1)]
    return np.sum(rows, axis=0) / max(len(rows), 1)


def _amplitudes(level: Level, template: Array, period: float) -> Level:
    """Return the least-squares amplitudes of a template beside a line, by the time of its slip."""
    before, _ = _window(period, level.spacing)
    if len(level.x) < len(template):
        return Level(np.zeros(1), level.spacing, level.start)
    method = "fft" if len(template) > 64 else "direct"
    found = scipy.signal.correlate(level.x - level.x.mean(), template, "valid", method=method)
    found /= max(float(template @ template), 1e-40)
    return Level(found, level.spacing, level.start + before * level.spacing)


def _likeliest_grid(
    amplitude: Level, level: Level, period: float, direction: int, near: float
) -> SlipGrid | None:
    """Return the run that is likeliest in amplitudes of slips; None where there is none.

    direction is that of positive amplitudes, level the position. The period (s) is refined.
    """
    least, given, found = SETTINGS.least_cycles, period, None
    start = amplitude.start
    for _ in range(2 * _ROUNDS):
        count = int((amplitude.start + len(amplitude.x) * amplitude.spacing - start) / period)
        if count < 1:
            return None
        starts = start + period * np.arange(count, dtype=np.float64)
        phases = max(round(period / amplitude.spacing), 1)
        seen = np.nan_to_num(amplitude.rows(starts, 0, phases - 1))
        parts = []
        for sign in (1, -1):
            likelier, phase, first, last = _likeliest_part(sign * seen)
            due = starts[first : last + 1] + phase * amplitude.spacing
            # Where it rings, a swing away motions look like slips of the other direction.
            way = level.at(due[-1:]) - level.at(due[:1]) if len(due) else np.zeros(1)
            if float(way[0]) * sign * direction > 0.0:
                parts.append((likelier, sign, due))
        likelier, sign, due = max(parts, default=(0.0, 1, starts), key=lambda one: one[0])
        if likelier < 0.4 * least or len(due) < least:
            return None
        reach = max(round(_OFF * period / amplitude.spacing), 1)
        about = sign * np.nan_to_num(amplitude.rows(due, reach, reach))
        clear = np.flatnonzero(about.max(axis=1) > 0.5)
        if len(clear) < 2:
            return None
        late = (np.argmax(about, axis=1) - reach) * amplitude.spacing
        slope, begin = np.polyfit(clear, (due + late)[clear], 1)
        if abs(slope / given - 1.0) > near + 0.5 * _OFF / len(due):
            return None
        same = found is not None and found.count == len(due) and abs(slope / period - 1.0) < 1e-5
        found = SlipGrid(float(begin), float(slope), len(due), sign * direction, seen=likelier)
        if same:
            break
        period = found.period
        start = found.first - math.ceil((found.first - amplitude.start) / period) * period
    return found


def _likeliest_part(seen: Array) -> tuple[float, int, int, int]:
    """Return how likely slips are in the best part of a phase, the phase, first and last cycle.

    seen are the amplitudes of cycles by phase, (cycles, phases).
    """
    gain = np.clip(seen, -0.5, 1.0) - 0.5
    total = np.concatenate([np.zeros((1, seen.shape[1])), np.cumsum(gain, axis=0)])
    rise = total - np.minimum.accumulate(total, axis=0)
    last, phase = np.unravel_index(int(np.argmax(rise)), rise.shape)
    first = int(np.argmin(total[: last + 1, phase]))
    return float(rise[last, phase]), int(phase), first, int(last) - 1


def single_slip(pyramid: Pyramid, period: float) -> SlipGrid:
    """Return the steepest fall of a record as a run of one slip, for a given period (s)."""
    level = pyramid.level_for(period, _SAMPLES_A_PERIOD)
    edge = max(1, min(len(level.x) // 10, round(0.5 * period / level.spacing)))
    direction = 1 if level.x[-edge:].mean() >= level.x[:edge].mean() else -1
    fall = int(np.argmin(direction * smooth(level.x, 1.0, 1)))
    return SlipGrid(level.start + level.spacing * fall, period, 1, direction)


def timed(pyramid: Pyramid, grid: SlipGrid) -> SlipGrid:
    """Return the grid with its slips timed against the mean of all."""
    if grid.count < 2:
        return grid
    due, found = grid.slips[grid.timed], list[SlipGrid]()
    for samples in _TIMED_SAMPLES:
        level = pyramid.level_for(grid.period, samples)
        window = int(np.clip(_WINDOW[1] * grid.period / level.spacing, *_TIMED_WINDOW))
        rows = level.rows(due, window, window)
        good = np.isfinite(rows).all(axis=1)
        if good.sum() < 2:
            break
        flat = beside_line(rows[good])
        mean = np.mean(flat[min(grid.settling, len(flat) - 1) :], axis=0)
        slope = beside_line(np.gradient(mean))
        late = -((flat - mean) @ slope) / max(float(slope @ slope), 1e-40)
        if (np.abs(late) > _SHIFT).mean() > 1.0 - _HELD:  # these are not the slips of one run
            break
        due = due.copy()
        due[good] += np.clip(late, -_SHIFT, _SHIFT) * level.spacing
        found.append(_fit_grid(due, grid))
    return min(found, key=lambda one: one.unevenness, default=grid)


def _fit_grid(times: Array, grid: SlipGrid) -> SlipGrid:
    """Fit even times to the timed slips (s) of a grid, without a few that miss them."""
    number = grid.timed
    use = number >= min(grid.settling, grid.count - 3)
    use = use if use.sum() > 1 else np.ones(len(times), dtype=bool)
    good = use
    for _ in range(5):
        keep = good
        slope, first = np.polyfit(number[keep], times[keep], 1)
        miss = np.abs(times - first - slope * number)
        good = use & (miss <= max(3.0 * 1.4826 * float(np.median(miss[use])), 1e-9))
        if good.sum() < max(min(3, use.sum()), _HELD * use.sum()):
            break
    uneven = float(np.sqrt(np.mean(miss[keep] ** 2)))
    return replace(grid, first=float(first), period=float(slope), unevenness=uneven)


def retimed(pyramid: Pyramid, grid: SlipGrid, ringing: Ringing | None) -> SlipGrid:
    """Return the grid with slips timed without ringing, of which no swing is taken for another."""
    if ringing is None or grid.count < SETTINGS.least_cycles:
        return grid
    level = pyramid.level_for(min(ringing.swing, grid.period), _SWING_SAMPLES)
    if ringing.frequency * level.spacing > _RESOLVED:
        return grid
    speed = np.gradient(unrung(level, ringing, grid.period).x)
    window = int(min(3.0 / ringing.frequency, 0.3 * grid.period) / level.spacing)
    due = grid.slips[grid.timed]
    rows = replace(level, x=speed).rows(due, window, window) * grid.direction
    good = np.isfinite(rows).all(axis=1)
    if good.sum() < max(3, _HELD * len(rows)):
        return grid
    late = (np.argmin(rows, axis=1) - window) * level.spacing * good
    found, common = _fit_grid(due + late, grid), float(np.median(late[good]))
    # By 0.3 swings, it was another one; in a part of the slips, where the period was wrong.
    other = float(np.quantile(np.abs(late - common), 0.75)) * ringing.frequency > 0.3
    limit = max(grid.unevenness, level.spacing) if other else grid.unevenness
    return found if found.unevenness < limit else replace(grid, first=grid.first + common)


class SlipSizes:
    """Sizes of slips at any times, and of the rises before them, without ringing.

    The mean ones of a run have 1.
    """

    def __init__(
        self, pyramid: Pyramid, slips: Array, period: float, ringing: Ringing | None
    ) -> None:
        level = pyramid.level_for(period, _SAMPLES_A_PERIOD)
        if ringing is not None:
            fine = pyramid.level_for(ringing.swing, 0.5 * _SWING_SAMPLES)
            level = min(level, fine, key=lambda one: one.spacing)
        self._level, self._period = unrung(level, ringing, period, 0.6), period
        # The rise before a slip is that from nine tenths of a cycle before it to just before it.
        self._late, self._long = 0.03 * period, max(int(0.87 * period / level.spacing), 2)
        settled = slips[min(SETTLING - 1, len(slips) // 2) :]
        settled = settled[:: max(1, len(settled) // _TIMED)]
        self._mean = _mean_slip(self._level, settled, period)
        rises = self._rises(settled)
        self._usual = float(np.nanmean(rises)) if np.isfinite(rises).any() else math.nan

    def _rises(self, times: Array) -> Array:
        rows = self._level.rows(times - self._late, self._long, 0)
        part = max(self._long // 6, 1)
        return np.asarray(rows[:, -part:].mean(axis=1) - rows[:, :part].mean(axis=1))

    def at(self, times: Array) -> tuple[Array, Array]:
        """Return the sizes of slips and of rises at times (s); nan beyond the record."""
        power = max(float(self._mean @ self._mean), 1e-40)
        rows = self._level.rows(times, *_window(self._period, self._level.spacing))
        return beside_line(rows) @ self._mean / power, self._rises(times) / (
            self._usual or math.nan
        )


def unrung(level: Level, ringing: Ringing | None, period: float, part: float = 1.0) -> Level:
    """Return positions without ringing, where it is known and resolved.

    They are smoothed over a part of what the swings allow, and of the period (s).
    """
    if ringing is None or ringing.frequency * level.spacing > _RESOLVED:
        return level
    return without_ringing(level, ringing, part * min(_SMOOTH, 0.08 * ringing.frequency * period))


def counted(
    pyramid: Pyramid, grid: SlipGrid, ringing: Ringing | None, free: tuple[float, float]
) -> list[SlipGrid]:
    """Return the runs in a grid, with the slips that are there, no more and no less.

    There is a slip where it is likelier than none by its size and by the rise before it: one at an
    end may be smaller than the others, but the runner rises before it as always. Where it neither
    rises nor slips, the grid holds two runs. free (s) is the time that no other run has.
    """
    due, likelier, seen = _likelier(pyramid, grid, ringing, _BEYOND)
    likelier = np.where((due < free[0]) | (due > free[1]), -math.inf, likelier)
    there = seen & (likelier > 0.0)
    first, last = _BEYOND, _BEYOND + grid.count - 1
    first += int(not there[first] and first < last)
    while last > max(_BEYOND + grid.count - 3, first) and not there[last]:
        last -= 1
    while first > 0 and there[first - 1]:
        first -= 1
    while last + 1 < len(there) and there[last + 1]:
        last += 1
    pauses = np.flatnonzero(likelier[first:last] < -2.2 * SETTINGS.sure) + first
    sure = np.where(there, likelier, -likelier)  # a rise whose slip is not seen leaves it open
    sure[~seen & (likelier <= 0.0)] = math.inf
    found = []
    for begin, end in pairwise([first - 1, *pauses.tolist(), last + 1]):
        if end - begin > 1:
            ends = sure[[max(begin, 0), begin + 1, end - 1, min(end, len(sure) - 1)]]
            part = grid.part(begin + 1 - _BEYOND, end - 1 - _BEYOND)
            found.append(replace(part, sureness=float(ends.min())))
    return found


def as_sent(pyramid: Pyramid, record: Record, grid: SlipGrid, ringing: Ringing | None) -> SlipGrid:
    """Return the grid with as many slips as were sent, if the record may hold them.

    It may where none that is added is clearly none, and none that is left out is clearly one.
    """
    count = grid.sent * grid.direction
    if count == grid.count:
        return replace(grid, sureness=math.inf)
    if count < 1 or abs(count - grid.count) > _MISSING:
        return grid
    due, likelier, _ = _likelier(pyramid, grid, ringing, _MISSING)
    inside = np.zeros(len(due), dtype=bool)
    inside[_MISSING : _MISSING + grid.count] = True
    slack, possible = 0.05 * grid.period, list[tuple[float, int]]()
    for first in range(len(due) - count + 1):
        sent = np.zeros(len(due), dtype=bool)
        sent[first : first + count] = True
        if (
            due[first] - grid.period > record.t[0] - slack
            and due[first + count - 1] < record.t[-1] + slack
            and likelier[sent & ~inside].min(initial=math.inf) > -SETTINGS.sure
            and likelier[inside & ~sent].max(initial=-math.inf) < SETTINGS.sure
        ):
            possible.append((float(likelier[sent].sum()), first - _MISSING))
    if not possible:
        return grid
    _, first = max(possible)
    return replace(grid.part(first, first + count - 1), sureness=math.inf)


def _likelier(
    pyramid: Pyramid, grid: SlipGrid, ringing: Ringing | None, beyond: int
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return even times (s), some beyond each end, and by how much slips are likelier than none.

    The logarithms are those of normal sizes of slips and rises, of which none has 0 and one has 1.
    What lies beyond the record tells nothing: the last value is which times are within it.
    """
    due = grid.first + grid.period * np.arange(-beyond, grid.count + beyond, dtype=np.float64)
    found = SlipSizes(pyramid, grid.slips, grid.period, ringing).at(due)
    slips, rises = (
        (np.clip(np.nan_to_num(size, nan=0.5), -0.5, 1.5) - 0.5)
        / np.fmax(robust_std(size[beyond : beyond + grid.count]), least) ** 2
        for size, least in zip(found, (SETTINGS.slip_scatter, SETTINGS.rise_scatter), strict=True)
    )
    likelier = slips + rises
    # A drive may end with a rise, but none begins with one that no slip ends, nor without one.
    first = slice(0, beyond + grid.count // 2)
    likelier[first] += np.where((rises > 0.0) & (slips < 0.0), -slips, 0.0)[first]
    likelier[:beyond] = np.where(rises < 0.0, np.minimum(likelier, rises), likelier)[:beyond]
    return due, likelier, np.isfinite(found[0])
