# SPDX-License-Identifier: Apache-2.0
"""A measurement on even times, its spikes left out and its noise known; cycles as rows of it.

The cycles of a run are laid over one another as rows of mean positions about the same phases.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.arrays import Array

#: A spike differs from the median of its neighbours by this many times the noise, and by this many
#: times the difference of all but a hundredth of the samples; and by this many times that of three
#: quarters of those beside it.
_SPIKE, _USUAL, _ALONE = 8.0, 3.0, 4.0
_NEIGHBOURS, _ALL_BUT_FEW, _MOST_BESIDE = 5, 0.99, 0.75
#: Least differences within which most neighbours are on a coarse converter; part of one by which
#: they may miss whole numbers of it, as printed.
_COARSE, _WHOLE = 20.0, 0.1
#: Samples from which noise is estimated; length of a gap in usual sample distances.
_LOOKED_AT, _GAP = 2**20, 4.0
#: Samples of one spectrum of the noise; times the noise beside its lines that is no noise alone.
_STRETCH_OF_NOISE, _LINE = 1024, 1.5
#: Fewest samples that show noise; fewest means that neighbours are averaged to; times as many even
#: times as samples at most.
_SHORT, _MEANS, _FINER = 8, 16, 4


@dataclass(frozen=True)
class EvenSamples:
    """Positions on even times; x and known have the shape (samples,)."""

    begin: float  #: time of the first one, s
    tick: float  #: time between two, s
    x: Array  #: m
    known: NDArray[np.bool_]  #: false within a gap of the measurement
    noise: float  #: standard deviation of x by chance, m

    @cached_property
    def halved(self) -> EvenSamples:
        """The means of every two neighbours."""
        count = len(self.x) // 2 * 2
        return EvenSamples(
            self.begin + 0.5 * self.tick,
            2.0 * self.tick,
            self.x[:count].reshape(-1, 2).mean(axis=1),
            np.asarray(self.known[:count].reshape(-1, 2).all(axis=1)),
            self.noise / math.sqrt(2.0),
        )

    @cached_property
    def _sums(self) -> tuple[Array, NDArray[np.int64]]:
        """Sums of x and numbers of unknown samples before each sample and after the last."""
        return (
            np.concatenate(([0.0], np.cumsum(self.x - self.x[0]))),
            np.concatenate(([0], np.cumsum(~self.known))),
        )

    def means(self, edges: Array) -> Array:
        """Return the mean positions (m) between times (s, (..., n)), (..., n - 1).

        A sample counts for the time around it. nan outside the measurement and within gaps.
        """
        sums, gaps = self._sums
        place = (edges - self.begin) / self.tick + 0.5
        inside = (place >= 0.0) & (place <= len(self.x))
        index = np.clip(place.astype(np.int64), 0, len(self.x) - 1)
        total = sums[index] + (place - index) * (self.x[index] - self.x[0])
        found = np.diff(total, axis=-1) / np.diff(place, axis=-1) + self.x[0]
        good = inside[..., 1:] & inside[..., :-1]
        if gaps[-1]:
            good &= (np.diff(gaps[index], axis=-1) == 0) & self.known[index[..., 1:]]
        return np.where(good, found, np.nan)

    def between(self, begin: float, end: float) -> tuple[Array, Array]:
        """Return times (s, from 0) and positions (m) of the samples from begin to end (s)."""
        first = max(0, math.ceil((begin - self.begin) / self.tick))
        x = self.x[first : max(first, math.floor((end - self.begin) / self.tick) + 1)]
        return np.asarray(self.tick * np.arange(len(x))), x

    @property
    def end(self) -> float:
        """Time of the last sample, s."""
        return self.begin + self.tick * (len(self.x) - 1)


def robust_std(x: Array) -> float:
    """Return the standard deviation by the median deviation, which outliers hardly change."""
    return 1.4826 * float(np.median(np.abs(x - np.median(x))))


def quantum_of(x: Array) -> float:
    """Return the step (m) of a converter that samples are whole multiples of; 0 where none is seen.

    It is the least difference of neighbours, if they differ by few of it, which hides the noise;
    neighbours on a straight line differ by one alone.
    """
    apart = np.diff(x[:_LOOKED_AT])
    apart = apart[apart != 0.0]
    if not len(apart):
        return 0.0
    least = float(np.abs(apart).min())
    steps = apart / least
    few = steps[np.abs(steps) < _COARSE]
    whole = np.rint(few)
    seen = 2 * len(few) > len(apart) and len(np.unique(whole)) > 1
    return least if seen and (np.abs(few - whole) < _WHOLE).all() else 0.0


def rounding_of(x: Array, noise: float) -> float:
    """Return the error (m) that all samples of one place share as a converter rounds them alike.

    Noise (m) beyond that of rounding makes it differ from sample to sample.
    """
    alike = quantum_of(x) / math.sqrt(12.0)
    return alike * alike / max(noise, alike) if alike > 0.0 else 0.0


def noise_of(x: Array) -> float:
    """Return the standard deviation (m) of the noise of a sample, that of rounding at least."""
    return max(_scatter_of(x), quantum_of(x) / math.sqrt(12.0))


def _scatter_of(x: Array) -> float:
    if len(x) < _SHORT:
        return 0.0
    if len(x) > _LOOKED_AT:  # stretches of neighbouring samples from all over
        count = _LOOKED_AT // _STRETCH_OF_NOISE
        starts = np.linspace(0, len(x) - _STRETCH_OF_NOISE, count).astype(np.int64)
        x = np.concatenate([x[k : k + _STRETCH_OF_NOISE] for k in starts])
    third = np.diff(x, 3)  # removes smooth motion; its variance is 20 times that of the noise
    usual = robust_std(third) / math.sqrt(20.0)
    # Ringing of two to four samples a swing is no smooth motion, but few lines of the spectrum.
    width = min(len(third), _STRETCH_OF_NOISE)
    window = np.hanning(width + 2)[1:-1]
    parts = third[: len(third) // width * width].reshape(-1, width) * window
    power = np.mean(np.abs(np.fft.rfft(parts)) ** 2, axis=0) / float(window @ window)
    upper = slice(len(power) // 2, None)
    white = (2.0 * np.sin(np.pi * np.fft.rfftfreq(width))) ** 6
    median_of_mean = (1.0 - 1.0 / (9.0 * len(parts))) ** 3  # of powers of chance, as parts of it
    floor = math.sqrt(float(np.median(power[upper] / white[upper])) / median_of_mean)
    return floor if _LINE * floor < usual else usual


def correlation_time(left: Array) -> float:
    """Return the integrated autocorrelation time of rows, in rows, 1 or more.

    The sum ends at five times what it has come to (A. Sokal, Monte Carlo Methods in Statistical
    Mechanics, 1989).
    """
    count = len(left)
    size = scipy.fft.next_fast_len(2 * count, real=True)
    spectrum = scipy.fft.rfft(left - left.mean(), size)
    correlation = scipy.fft.irfft(np.abs(spectrum) ** 2, size)[:count]
    if not correlation[0] > 0.0:
        return 1.0
    total = np.cumsum(2.0 * correlation / correlation[0]) - 1.0
    window = np.arange(count) >= 5.0 * np.maximum(total, 1.0)
    return max(1.0, float(total[int(np.argmax(window))] if window.any() else total[-1]))


def without_spikes(x: Array, noise: float) -> NDArray[np.bool_]:
    """Return which samples (m) with such noise (m) are no spikes, shape (samples,).

    A spike is alone: beside the first swing after a slip, others are nearly as large.
    """
    middle = scipy.ndimage.median_filter(x, size=_NEIGHBOURS, mode="nearest")
    away = np.abs(x - middle)
    sample = away[:: max(1, len(away) // _LOOKED_AT)]
    usual = max(_SPIKE * robust_std(sample), _USUAL * float(np.quantile(sample, _ALL_BUT_FEW)))
    far = np.flatnonzero(away > max(usual, _SPIKE * noise))
    beside = np.delete(np.arange(-_NEIGHBOURS, _NEIGHBOURS + 1), _NEIGHBOURS)
    others = away[np.clip(far[:, None] + beside, 0, len(x) - 1)]
    alone = away[far] > _ALONE * np.quantile(others, _MOST_BESIDE, axis=1)
    return ~np.isin(np.arange(len(x)), far[alone])


def resample_evenly(t: Array, x: Array, most: int, noise: float | None = None) -> EvenSamples:
    """Return the measurement at no more than a given number of even times.

    t (s) increases, x is in m, both (samples,). Of more samples, neighbours are averaged. noise (m)
    is that of a sample where it is known.
    """
    noise, apart = noise_of(x) if noise is None else noise, np.diff(t)
    usual = float(np.median(apart))
    # Traces are denser in the slips, by far: that fine a grid would be needless elsewhere.
    tick = max(usual, float(t[-1] - t[0]) / (_FINER * len(t)))
    every = math.ceil((t[-1] - t[0]) / tick / most)
    if every > 1 and len(t) >= every * _MEANS:
        count = len(t) // every * every
        t = t[:count].reshape(-1, every).mean(axis=1)
        x = x[:count].reshape(-1, every).mean(axis=1)
        noise, tick, apart = noise / math.sqrt(every), every * tick, np.diff(t)
    count = int((t[-1] - t[0]) / tick) + 1
    grid = t[0] + tick * np.arange(count)
    known = np.ones(count, dtype=bool)
    for gap in np.flatnonzero(apart > _GAP * max(tick, float(np.median(apart)))):
        known[slice(*np.searchsorted(grid, [t[gap], t[gap + 1]], side="right"))] = False
    even = np.interp(grid, t, x)
    return EvenSamples(float(t[0]), tick, even, known, noise)


#: Phases of a mean cycle at most, and at least; part of a period after the slip that belongs to a
#: cycle, too; part of a row that is known if its gaps are filled.
PHASES, _FEWEST, _PHASES_BEYOND, _KNOWN = 200, 8, 0.25, 0.75
#: Cycles that are used, and consecutive cycles in each stretch of them.
ROWS, _STRETCH = 128, 16


@dataclass(frozen=True)
class SlipGrid:
    """Cycles of one run on a grid of slips: slip k begins about first + k period."""

    first: float  #: slip of the first cycle, s
    period: float  #: s
    count: int  #: cycles
    direction: int  #: +1 or -1
    step: float  #: how far it gets in a cycle, about, m; positive
    score: float  #: how clear it is
    dissimilarity: float = (
        0.0  #: part of the motion within cycles that is not the same in the next one
    )
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

    def about_middle(self, period: float) -> SlipGrid:
        """Return the run with another period (s), about its middle."""
        late = 0.5 * (self.count - 1) * (self.period - period)
        return replace(self, first=self.first + late, period=period)


def phases_of(even: EvenSamples, period: float, most: int = PHASES) -> Array:
    """Return phases from one slip (-1) to a little after the next (0), in periods."""
    count = int(np.clip(period / even.tick, _FEWEST, most))
    return np.asarray((np.arange(math.ceil((1.0 + _PHASES_BEYOND) * count)) + 0.5) / count - 1.0)


def cycles_on_grid(even: EvenSamples, slips: Array, period: float, phases: Array) -> Array:
    """Return the mean positions (m) about phases, (cycles, phases); nan where not known."""
    half = 0.5 * (phases[1] - phases[0])
    edges = np.append(phases - half, phases[-1] + half)
    return even.means(slips[:, None] + period * edges[None, :])


def sample_cycles(count: int, most: int = ROWS) -> NDArray[np.int64]:
    """Return the numbers of representative cycles: all, or stretches at even distances."""
    if count <= most:
        return np.arange(count)
    starts = np.linspace(0, count - _STRETCH, most // _STRETCH).astype(np.int64)
    return np.asarray(np.unique(starts[:, None] + np.arange(_STRETCH)))


def find_unbroken(
    good: NDArray[np.bool_], number: NDArray[np.int64], count: int
) -> tuple[int, int]:
    """Return the first and the last number of the good cycles about the middle one; 0, -1 if none.

    number are those of the cycles looked at, of which 0 to count - 1 are in the run so far.
    """
    inside = np.flatnonzero(good & (number >= 0) & (number < count))
    if not len(inside):
        return 0, -1
    middle = int(inside[np.argmin(np.abs(number[inside] - count // 2))])
    bad = np.flatnonzero(~good)
    first = int(np.max(bad[bad < middle], initial=-1)) + 1
    last = int(np.min(bad[bad > middle], initial=len(good))) - 1
    return int(number[first]), int(number[last])


def mean_cycle(rows: Array) -> Array:
    """Return the median row minus its mean, (phases,)."""
    if not len(rows):
        return np.zeros(rows.shape[1])
    ordered = np.sort(rows - row_means(rows)[:, None], axis=0)  # nan comes last
    count = np.isfinite(ordered).sum(axis=0)[None, :]
    low, high = (
        np.take_along_axis(ordered, np.maximum(k, 0), 0)[0] for k in ((count - 1) // 2, count // 2)
    )
    common = 0.5 * (low + high)
    known = np.isfinite(common)
    return np.where(known, common - (common[known].mean() if known.any() else 0.0), 0.0)


def row_means(rows: Array) -> Array:
    """Return the mean of each row without nan, (cycles,); nan for a row of nan."""
    known = np.isfinite(rows)
    count = known.sum(axis=1)
    total = np.where(known, rows, 0.0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def similarity(rows: Array, mean: Array) -> Array:
    """Return how much of the mean cycle each row holds, (cycles,); nan of rows not known."""
    known = np.isfinite(rows)
    share = np.where(known, mean, 0.0)
    count = np.maximum(known.sum(axis=1, keepdims=True), 1)
    share = np.where(known, share - share.sum(axis=1, keepdims=True) / count, 0.0)
    square = np.sum(share**2, axis=1)
    projected = np.sum(np.where(known, rows, 0.0) * share, axis=1)
    enough = (square > 0.5 * float(mean @ mean)) & (square > 0.0)
    return np.where(enough, projected / np.where(enough, square, 1.0), np.nan)


def fill_gaps(rows: Array) -> Array:
    """Return rows with straight lines over short gaps."""
    result = rows.copy()
    place = np.arange(rows.shape[1])
    for row in result:
        known = np.isfinite(row)
        if _KNOWN * len(row) < known.sum() < len(row):
            row[~known] = np.interp(place[~known], place[known], row[known])
    return result


def without_trend(rows: Array, phases: Array) -> Array:
    """Return rows without a straight line of their own each; nan where not all is known."""
    about = phases - phases.mean()
    slope = (rows @ about) / float(about @ about)
    return np.asarray(rows - rows.mean(axis=1, keepdims=True) - slope[:, None] * about)
