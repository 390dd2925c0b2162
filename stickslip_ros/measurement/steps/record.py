# SPDX-License-Identifier: Apache-2.0
"""A measured position without what converters and counters add to it, and its averages."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import ArrayLike, NDArray

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.errors import StickslipError
from stickslip_ros.measurement.steps.noise import noise_of, quantum_of, without_spikes

#: What helps against too few samples in a cycle.
FASTER = "sample faster (a bag: raise publish_rate, or stickslip bag resimulate)"
#: Samples of a record at least.
FEWEST_SAMPLES = 32
#: Samples that stay at the outermost value where a record is cut off, times any other such stretch,
#: and part of the usual move in so many samples before, as no runner stops at once.
_HELD_SAMPLES, _HELD_TIMES, _STOPS = 12, 20.0, 0.5
#: Part of the moves between samples that turn, above which they are noise; a smooth motion of many
#: samples turns far less often.
_NOISY = 0.35
#: Jumps of a fringe counter at most; times the next smaller move; times the usual move; part of one
#: jump by which another may miss a multiple of it.
_JUMPS, _CLEAR_JUMP, _LARGE_JUMP, _ODD_JUMP = 6, 2.0, 30.0, 0.1
#: Samples of an even record at most, and of the coarsest average at least.
_MOST_SAMPLES, _COARSEST = 2**24, 64


class TraceError(StickslipError, ValueError):
    """The trace cannot be analysed; the message says what is missing."""


class ImplausibleError(TraceError):
    """No axis moves so: a unit or a column is another one."""


@dataclass(frozen=True)
class FringeJump:
    """A jump of an interferometer that lost count."""

    t: float  #: s
    fringes: int


@dataclass(frozen=True)
class Record:
    """A position over increasing time, (samples,), and what was taken out of it."""

    t: Array  #: s
    x: Array  #: m
    spikes: int = 0  #: samples left out
    cut_samples: int = 0  #: samples at the end of the range of the sensor
    resolution: float = 0.0  #: step of the converter, m; 0 where none is seen
    jumps: tuple[FringeJump, ...] = ()
    fringe: float = 0.0  #: length of a jump, m

    @cached_property
    def spacing(self) -> float:
        """Median time (s) between samples."""
        return float(np.median(np.diff(self.t)))

    @property
    def duration(self) -> float:
        """Time (s) from the first sample to the last."""
        return float(self.t[-1] - self.t[0])

    def between_pauses(self) -> list[Record]:
        """Return the parts that pauses separate, which last as long as much of what was sampled."""
        gaps = np.diff(self.t)
        pauses = np.flatnonzero(gaps > self.spacing * max(0.25 * len(gaps), 100.0)) + 1
        edges = [0, *pauses.tolist(), len(self.t)]
        parts = [
            replace(self, t=self.t[a:b], x=self.x[a:b], jumps=tuple(
                one for one in self.jumps if self.t[a] < one.t < self.t[b - 1]
            ))
            for a, b in pairwise(edges)
            if b - a >= FEWEST_SAMPLES and np.ptp(self.x[a:b]) > 0.0
        ]  # fmt: skip
        return parts or [self]


def check_count(samples: int) -> None:
    """Raise TraceError for a record of too few samples."""
    if samples < FEWEST_SAMPLES:
        raise TraceError(
            f"the trace has {samples} samples; at least {FEWEST_SAMPLES} are needed: record a "
            f"longer one, or {FASTER}"
        )


def check_samples(t: ArrayLike, x: ArrayLike) -> tuple[Array, Array, Array]:
    """Return times (s) in order and positions (m), both (samples,), and stray times left out.

    A stray time is further from the others than these are from each other. Raises TraceError where
    the shapes differ, there are too few samples, or the runner does not move.
    """
    time, position = np.asarray(t, dtype=np.float64), np.asarray(x, dtype=np.float64)
    if position.shape != time.shape or time.ndim != 1:
        raise TraceError(f"position has shape {position.shape}; it has to be {time.shape[:1]}")
    finite = np.isfinite(time) & np.isfinite(position)
    time, position = time[finite], position[finite]
    check_count(len(time))
    if not (np.diff(time) > 0.0).all():
        time, first = np.unique(time, return_index=True)
        position = position[first]
    outer = max(1, len(time) // 100)
    apart = np.diff(time) > time[-1 - outer] - time[outer]
    near = np.ones(len(time), dtype=bool)
    near[: int(np.flatnonzero(apart[:outer]).max(initial=-1)) + 1] = False
    near[len(time) - int(np.flatnonzero(apart[::-1][:outer]).max(initial=-1)) - 1 :] = False
    strays, time, position = time[~near], time[near], position[near]
    check_count(len(time))
    if not np.ptp(position) > 0.0:
        raise TraceError("the runner does not move in the trace")
    return time, position, strays


def clean_record(t: Array, x: Array) -> Record:
    """Return the record of times (s) and positions (m) without spikes, jumps and cut parts."""
    kept = without_spikes(x, noise_of(x))
    t, x = t[kept], x[kept]
    resolution = quantum_of(x)
    held = _held_samples(x, resolution)
    record = Record(t[~held], x[~held], int((~kept).sum()), int(held.sum()), resolution)
    return _without_jumps(record)


def _held_samples(x: Array, resolution: float) -> NDArray[np.bool_]:
    """Return which samples (m) lie within a stretch at the end of the range of the sensor."""
    held = np.zeros(len(x), dtype=bool)
    last = np.flatnonzero(np.diff(x, append=math.nan) != 0.0)  # of stretches of one value
    length = np.diff(last, prepend=-1)
    outer = (x[last] == x.max()) | (x[last] == x.min())
    usual_length = int(length[~outer].max(initial=1))
    long = np.flatnonzero(outer & (length >= max(_HELD_SAMPLES, _HELD_TIMES * usual_length)))
    if not len(long):
        return held
    moved = np.abs(x[_HELD_SAMPLES:] - x[:-_HELD_SAMPLES])
    moves = np.diff(x)
    moves = moves[moves != 0.0]
    turns = float(np.mean(moves[1:] * moves[:-1] < 0.0)) if len(moves) > 1 else 0.0
    usual, usual_move = (
        max(float(np.median(one)) if len(one) else 0.0, 4.0 * resolution)
        for one in (moved[moved > 0.0], np.abs(moves))
    )
    noisy = turns > _NOISY and resolution == 0.0  # then no rest has one value
    for k in long:
        first, after = last[k] - length[k] + 1, last[k]
        before = first - _HELD_SAMPLES
        beside = moved[max(before - _HELD_SAMPLES, 0) : max(before + 1, 0)]
        stops = float(np.max(beside, initial=0.0)) > _STOPS * usual
        soon = slice(after, after + 3)  # from rest, it takes a part of a swing to get as fast
        starts = first == 0 and resolution > 0.0  # without noise, a rest before steps has one value
        leaves = starts and len(x[soon]) > 2 and abs(np.ptp(x[soon])) > usual_move
        if noisy or stops or leaves:
            held[first + 1 : after] = True
    return held


def _without_jumps(record: Record) -> Record:
    """Return a record without jumps by multiples of one length, if a few stand out."""
    x, moves = record.x, np.abs(np.diff(record.x))
    if len(moves) < 4 * _JUMPS:
        return record
    largest = np.argpartition(moves, -_JUMPS - 1)[-_JUMPS - 1 :]
    moves = np.diff(x)
    for k in largest:  # beside what the runner does there
        near = moves[max(k - 4, 0) : k + 5]
        moves[k] -= float(np.median(near))
    size = np.abs(moves[largest])
    order = np.argsort(-size)
    largest, size = largest[order], size[order]
    usual = float(np.median(np.abs(moves)))
    count = next(
        (
            m
            for m in range(_JUMPS, 0, -1)
            if size[m - 1] > max(_CLEAR_JUMP * size[m], _LARGE_JUMP * usual)
        ),
        0,
    )
    if not count:
        return record
    at = np.sort(largest[:count])
    fringes = moves[at] / size[count - 1]
    whole = np.rint(fringes)
    if np.abs(fringes - whole).max() > _ODD_JUMP * np.abs(whole).max():
        return record
    fringe = float(np.mean(np.abs(moves[at] / whole)))
    shift = np.zeros(len(x))
    shift[at + 1] = whole * fringe
    between = 0.5 * (record.t[at] + record.t[at + 1])
    jumps = tuple(FringeJump(float(t), int(n)) for t, n in zip(between, whole, strict=True))
    return replace(record, x=x - np.cumsum(shift), jumps=jumps, fringe=fringe)


class MeanPosition:
    """Means of the position over any stretches of time; gaps are bridged by straight lines."""

    def __init__(self, record: Record) -> None:
        self._t, self._x = record.t, record.x - record.x[0]
        areas = 0.5 * (self._x[1:] + self._x[:-1]) * np.diff(record.t)
        self._area = np.concatenate([[0.0], np.cumsum(areas)])

    def between(self, begin: Array, end: Array) -> Array:
        """Return the mean position (m, the first sample has 0) from begin to end (s)."""
        return (self._up_to(np.asarray(end)) - self._up_to(np.asarray(begin))) / (end - begin)

    def _up_to(self, t: Array) -> Array:
        k = np.clip(np.searchsorted(self._t, t) - 1, 0, len(self._t) - 2)
        since = t - self._t[k]
        slope = (self._x[k + 1] - self._x[k]) / (self._t[k + 1] - self._t[k])
        return np.asarray(self._area[k] + self._x[k] * since + 0.5 * slope * since * since)


@dataclass(frozen=True)
class Level:
    """The position at even times, each a mean of 1, 2, 4, ... samples."""

    x: Array  #: m
    spacing: float  #: s
    start: float  #: time of the first of them, s

    def rows(self, times: Array, before: int, after: int) -> Array:
        """Return the samples about times (s), (times, before + 1 + after); nan beyond the ends."""
        places = (times - self.start) / self.spacing
        at = places[:, None] + np.arange(-before, after + 1)
        k = np.floor(at).astype(np.int64)
        inside = (k >= 0) & (k < len(self.x) - 1)
        k = np.clip(k, 0, len(self.x) - 2)
        part = at - k
        found = self.x[k] * (1.0 - part) + self.x[k + 1] * part
        return np.where(inside, found, math.nan)

    def at(self, times: Array) -> Array:
        """Return the positions (m) nearest to times (s)."""
        number = np.rint((times - self.start) / self.spacing)
        return self.x[np.clip(number, 0, len(self.x) - 1).astype(np.int64)]


class Pyramid:
    """A record at even times, averaged over 1, 2, 4, ... samples."""

    def __init__(self, record: Record) -> None:
        spacing = record.spacing
        count = int(min(record.duration / spacing + 1.0 + 1e-6, _MOST_SAMPLES))
        spacing = max(spacing, record.duration / count)
        even = record.t[0] + spacing * np.arange(count)
        x = np.interp(even, record.t, record.x - record.x[0])
        self.levels = [Level(x, spacing, float(record.t[0]))]
        while len(x) >= _COARSEST:
            last = self.levels[-1]
            x = x[: len(x) // 2 * 2].reshape(-1, 2).mean(axis=1)
            start = last.start + 0.5 * last.spacing
            self.levels.append(Level(x, 2.0 * last.spacing, start))

    def number_for(self, time: float, samples: float) -> int:
        """Return the number of the coarsest level with so many samples in a time (s), or more."""
        times = max(time / self.levels[0].spacing / samples, 1.0)
        return min(math.floor(math.log2(times)), len(self.levels) - 1)

    def level_for(self, time: float, samples: float) -> Level:
        """Return the coarsest level with so many samples in a time (s), or more."""
        return self.levels[self.number_for(time, samples)]


def beside_line(rows: Array) -> Array:
    """Return rows, (..., n), without their straight lines."""
    place = np.arange(rows.shape[-1]) - 0.5 * (rows.shape[-1] - 1)
    rows = rows - rows.mean(axis=-1, keepdims=True)
    return np.asarray(rows - (rows @ place)[..., None] * place / (place @ place))


def smooth(x: Array, width: float, order: int = 0) -> Array:
    """Return the derivative of an order of x, smoothed over a width in samples."""
    return np.asarray(scipy.ndimage.gaussian_filter1d(x, width, order=order, mode="nearest"))
