# SPDX-License-Identifier: Apache-2.0
"""Slips by their likeness to the mean slip, and chains of them at even distances.

The mean slip in a window is a template. Its least-squares amplitude beside a straight line is near
1 at slips and 0 elsewhere, whatever the drift. Slips of one sign at even distances make a chain;
the template comes anew from the longest one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.steps.record import (
    Level,
    MeanPosition,
    Pyramid,
    beside_line,
    smooth,
)
from stickslip_ros.measurement.steps.search import FEWEST_SAMPLES, Candidate
from stickslip_ros.measurement.steps.settings import SETTINGS
from stickslip_ros.simulation.settled import SETTLING

#: Samples of a period at which slips are matched.
SAMPLES_A_PERIOD = 200
#: The same where noise hides single samples; variance of noise over that of a slip where it does.
_NOISY_SAMPLES, _NOISE_IN_SLIP = 25.0, 0.2
#: How many times the template is made; part by which a period changes that needs another level.
_ROUNDS, _OTHER_LEVEL = 4, 0.2
#: Slips that a chain grows by at once, and places of a slip that are tried, as parts of a period.
_BLOCKS, _SHIFTS = (16, 4), 0.04
#: Part of them that have to be like slips; within which their mean is.
_ALIKE, _MEAN = 0.7, (0.6, 1.5)
#: Neighbours of a slip on either side that the first template is the mean of.
_NEIGHBOURS = 2
#: Cycles that show whether the runner gets on evenly; part of a step by which a median may differ.
#: Quantiles of the way in a cycle; steps and robust deviations by which these may differ.
_EVEN_CYCLES, _UNEVEN_STEPS = 6, 0.3
_OUTER, _FAR_STEPS, _FAR_SCATTER = (0.08, 0.92), 0.5, 4.0
#: Slips of a chain whose distance tells where the next ones are.
_RECENT = 40


@dataclass(frozen=True)
class Chain:
    """Slips of one direction at even distances."""

    slips: Array  #: s
    direction: int  #: of the steps
    period: float  #: s

    @property
    def duration(self) -> float:
        """Time (s) from the first slip to the last."""
        return (len(self.slips) - 1) * self.period

    @property
    def settled(self) -> Array:
        """Slips (s) that are like each other."""
        return self.slips[min(SETTLING - 1, len(self.slips) // 2) :]


def window_of(period: float, spacing: float) -> tuple[int, int]:
    """Return how many samples before and after a slip are matched."""
    before = round(SETTINGS.window_before_slip_periods * period / spacing)
    after = round(SETTINGS.window_after_slip_periods * period / spacing)
    return max(3, before), max(2, after)


def match_chains(pyramid: Pyramid, candidate: Candidate, excerpt: float = 0.0) -> list[Chain]:
    """Return the chains of slips with about the period of a candidate.

    excerpt (s) limits the time around the candidate's stretch that is looked at; 0: all of it.
    """
    period, samples = candidate.period, float(SAMPLES_A_PERIOD)
    level = _level_for(pyramid, period, candidate, excerpt, samples)
    template, direction = _first_template(level, candidate, 0)
    if _is_noisy(level, template):
        samples = _NOISY_SAMPLES
        level = _level_for(pyramid, period, candidate, excerpt, samples)
        template, direction = _first_template(level, candidate, _NEIGHBOURS)
    chains: list[Chain] = []
    for turn in range(_ROUNDS):
        slips, sizes = find_slips(level, template, period)
        gaps = np.diff(slips)[np.sign(sizes[1:]) == np.sign(sizes[:-1])]
        if not len(gaps):
            return []
        ordered = np.sort(gaps)
        near = 1.0 + SETTINGS.largest_gap_change
        alike = np.searchsorted(ordered, ordered * near) - np.searchsorted(ordered, ordered / near)
        usual_gap = ordered[int(np.argmax(alike))]
        usual = gaps[np.abs(gaps / usual_gap - 1.0) < SETTINGS.largest_gap_change]
        new = float(np.median(usual))
        chains = _chains_of(slips, sizes, new, direction)
        chains = [one for one in chains if _goes_its_way(level, one)]
        if not chains:
            return []
        if abs(new / period - 1.0) > _OTHER_LEVEL:
            level = _level_for(pyramid, new, candidate, excerpt, samples)
        same = abs(new / period - 1.0) < 1e-4
        period, longest = new, max(chains, key=lambda one: len(one.slips))
        template = longest.direction * direction * mean_slip(level, longest.settled, period)
        if same and turn > 0:
            break
    return _grown(level, template, period, direction, chains)


def _is_noisy(level: Level, template: Array) -> bool:
    """Return True if single samples show more noise than motion about a slip."""
    noise = 1.4826 * float(np.median(np.abs(np.diff(level.x, 2)))) / np.sqrt(6.0)
    return bool(noise**2 > _NOISE_IN_SLIP * float(np.var(beside_line(template))))


def _level_for(
    pyramid: Pyramid, period: float, candidate: Candidate, excerpt: float, samples: float
) -> Level:
    level = pyramid.level_for(period, samples)
    if not excerpt:
        return level
    middle = 0.5 * (candidate.begin + candidate.end)
    return level.excerpt(middle - 0.5 * excerpt, middle + 0.5 * excerpt)


def _first_template(level: Level, candidate: Candidate, neighbours: int) -> tuple[Array, int]:
    """Return the slip of median depth in the stretch of a candidate, and the way of the steps.

    It is the mean of so many neighbours on either side, too, which has less noise; the period is
    not known well enough for more.
    """
    x, lag = level.x, round(candidate.period / level.spacing)
    begin, end = (
        round((one - level.start) / level.spacing) for one in (candidate.begin, candidate.end)
    )
    begin, end = max(begin, 0), min(end, len(x))
    end = max(end, min(begin + lag + 1, len(x)))
    begin = max(min(begin, end - lag - 1), 0)
    change = x[begin + lag : end] - x[begin : end - lag] if end > begin + lag else np.zeros(0)
    direction = -1 if len(change) and change.mean() < 0.0 else 1
    before, after = window_of(candidate.period, level.spacing)
    speed = direction * np.gradient(smooth(x, max(1.0, 0.004 * lag)))
    inside = np.arange(begin + before + 1, max(end - after - 1, begin + before + 2))
    inside = inside[inside < len(x)] if (inside < len(x)).any() else np.array([len(x) // 2])
    parts = np.array_split(inside, max(1, round(len(inside) / max(lag, 1))))
    falls = sorted(
        (int(one[np.argmin(speed[one])]) for one in parts if len(one)), key=lambda k: speed[k]
    )
    at = level.start + level.spacing * falls[len(falls) // 2]
    number = np.arange(-neighbours, neighbours + 1)
    near = np.asarray(at + candidate.period * number, np.float64)
    near = near[(near > candidate.begin) & (near < candidate.end)]
    return mean_slip(level, near if len(near) else np.array([at]), candidate.period), direction


def single_slip(pyramid: Pyramid, period: float) -> Chain:
    """Return the steepest fall of a record as a chain of one slip, for a given period (s)."""
    level = pyramid.level_for(period, SAMPLES_A_PERIOD)
    x = level.x
    edge = max(1, min(len(x) // 10, round(0.5 * period / level.spacing)))
    direction = 1 if x[-edge:].mean() >= x[:edge].mean() else -1
    speed = direction * np.gradient(smooth(x, 1.0))
    return Chain(np.array([level.start + level.spacing * int(np.argmin(speed))]), direction, period)


def mean_slip(level: Level, slips: Array, period: float) -> Array:
    """Return the mean motion (m) about slips (s) in the window that is matched."""
    before, after = window_of(period, level.spacing)
    rows = level.rows(slips[:: max(1, len(slips) // 2000)], before, after)
    rows = rows[np.isfinite(rows).all(axis=1)]
    if not len(rows):
        return np.zeros(before + 1 + after)
    return np.asarray(np.mean(rows - rows.mean(axis=1, keepdims=True), axis=0))


def amplitudes(x: Array, template: Array) -> tuple[Array, Array]:
    """Return the least-squares amplitude of a template at each place, and its likeness."""
    width = len(template)
    if len(x) < width:
        return np.zeros(0), np.zeros(0)
    unit = width * (width * width - 1) / 12.0
    shape = beside_line(template)
    power = max(float(shape @ shape), 1e-40)
    x = x - x.mean()
    method = "fft" if width > 64 else "direct"
    size = scipy.signal.correlate(x, shape, "valid", method=method) / power
    number = np.arange(len(x))
    mean, square, slope = (_moving(one, width) for one in (x, x * x, number * x))
    slope -= (np.arange(len(mean)) + 0.5 * (width - 1)) * mean
    left = np.maximum(square - mean * mean / width - slope * slope / unit, 1e-40)
    return size, np.minimum(size * size * power / left, 1.0)


def _moving(values: Array, width: int) -> Array:
    sums = np.concatenate([[0.0], np.cumsum(values)])
    return np.asarray(sums[width:] - sums[:-width])


def find_slips(level: Level, template: Array, period: float) -> tuple[Array, Array]:
    """Return times (s) of what is like a template, and the amplitudes."""
    amplitude, likeness = amplitudes(level.x, template)
    size = np.abs(amplitude)
    good = (likeness > SETTINGS.least_likeness) & (size > SETTINGS.least_amplitude)
    good &= size < SETTINGS.largest_amplitude
    peak = np.flatnonzero(good[1:-1] & (size[1:-1] >= size[:-2]) & (size[1:-1] > size[2:])) + 1
    rank = np.argsort(-likeness[peak] * np.minimum(size[peak], 1.0 / size[peak]), kind="stable")
    apart = SETTINGS.least_distance_periods * period / level.spacing
    taken, kept = np.zeros(len(size), dtype=bool), []
    for k in peak[rank].tolist():
        if not taken[k]:
            taken[max(0, int(k - apart)) : int(k + apart) + 1] = True
            kept.append(k)
    at = np.sort(np.array(kept, dtype=np.int64))
    low, middle, high = size[at - 1], size[at], size[at + 1]
    bend = np.minimum(low - 2.0 * middle + high, -1e-12)
    before, _ = window_of(period, level.spacing)
    shift = np.clip(0.5 * (low - high) / bend, -0.5, 0.5)
    return level.start + level.spacing * (at + before + shift), amplitude[at]


def _chains_of(slips: Array, sizes: Array, period: float, direction: int) -> list[Chain]:
    """Return the chains in slips (s) with their sizes; direction: that of positive ones."""
    chains: list[Chain] = []
    signs = np.sign(sizes).astype(int)
    first, gap = 0, period
    for k in range(1, len(slips) + 1):
        if k < len(slips) and signs[k] == signs[k - 1]:
            now = slips[k] - slips[k - 1]
            if abs(now / gap - 1.0) < SETTINGS.largest_gap_change:
                gap = now
                continue
        if k - first >= 2:
            mean = (slips[k - 1] - slips[first]) / (k - 1 - first)
            chains.append(Chain(slips[first:k], int(signs[first]) * direction, float(mean)))
        first, gap = k, period
    return chains


def _goes_its_way(level: Level, chain: Chain) -> bool:
    """Return True if the runner gets forward in the direction that the slips say."""
    at = np.rint((chain.slips[[0, -1]] - level.start) / level.spacing).astype(int)
    first, last = level.x[np.clip(at, 0, len(level.x) - 1)]
    return bool(chain.direction * (last - first) > 0.0)


def _grown(
    level: Level, template: Array, period: float, direction: int, chains: list[Chain]
) -> list[Chain]:
    """Return chains with the slips before and after that only several together show.

    Noise hides single slips of a long run; the mean amplitude of some in a row is clear.
    """
    amplitude, _ = amplitudes(level.x, template)
    if not len(amplitude):
        return chains
    before, _ = window_of(period, level.spacing)
    kept: list[Chain] = []
    for chain in sorted(chains, key=lambda one: -len(one.slips)):
        if any(_overlap(chain, other) for other in kept):
            continue
        if len(chain.slips) >= SETTINGS.least_cycles:
            own = Level(chain.direction * direction * amplitude, level.spacing,
                        level.start + before * level.spacing)  # fmt: skip
            others = list(kept)
            chain = _grow(own, _grow(own, chain, 1, others), -1, others)
        kept.append(chain)
    return sorted(kept, key=lambda one: float(one.slips[0]))


def _overlap(chain: Chain, other: Chain) -> bool:
    half = 0.5 * other.period
    return bool(chain.slips[-1] > other.slips[0] - half and chain.slips[0] < other.slips[-1] + half)


def _grow(amplitude: Level, chain: Chain, way: int, others: list[Chain]) -> Chain:
    """Return a chain with further slips after it (way 1) or before it (-1)."""
    slips = chain.slips[::way].tolist()
    shift_count = max(1, round(_SHIFTS * chain.period / amplitude.spacing))
    shifts = amplitude.spacing * np.arange(-shift_count, shift_count + 1)
    limits = [one.slips[0] for one in others] if way > 0 else [one.slips[-1] for one in others]
    limit = min((way * one for one in limits if way * (one - slips[-1]) > 0.0), default=np.inf)
    block = 0
    while block < len(_BLOCKS):
        recent = slips[-_RECENT:]
        gap = (recent[-1] - recent[0]) / (len(recent) - 1)
        due = recent[-1] + gap * np.arange(1, _BLOCKS[block] + 1)
        places = (due[:, None] + shifts - amplitude.start) / amplitude.spacing
        size = np.interp(places, np.arange(len(amplitude.x)), amplitude.x, left=0.0, right=0.0)
        best = int(np.argmax(size.mean(axis=0)))
        own = size[:, best]
        like = (own > SETTINGS.least_amplitude) & (own < SETTINGS.largest_amplitude)
        first, last = own[: len(own) // 4].mean(), own[-len(own) // 4 :].mean()
        clear = like.mean() > _ALIKE and all(
            _MEAN[0] < one < _MEAN[1] for one in (own.mean(), first, last)
        )
        if clear and way * due[-1] < limit - 0.5 * abs(gap):
            slips += (due + shifts[best]).tolist()
        else:
            block += 1
    found = np.array(slips[::way])
    return replace(chain, slips=found, period=float((found[-1] - found[0]) / (len(found) - 1)))


def cycle_rows(pyramid: Pyramid, chain: Chain) -> Array:
    """Return the settled cycles of a chain beside straight lines, (cycles, samples)."""
    level = pyramid.level_for(chain.period, 32)
    half = int(0.5 * chain.period / level.spacing)
    settled = chain.settled[:-1] if len(chain.settled) > 1 else chain.settled  # it runs into rest
    rows = level.rows(settled[:2000], half, half)
    rows = rows[np.isfinite(rows).all(axis=1)]
    return beside_line(rows) if len(rows) else rows


def alternation(rows: Array) -> float:
    """Return what part of the motion in cycles, (cycles, n), differs between every m-th ones.

    It does where the period is a part of that of the drive, such as a swing of the ringing.
    """
    if len(rows) < 4:
        return 0.0
    mean, worst = rows.mean(axis=0), 0.0
    power = max(float(mean @ mean), 1e-40)
    for m in range(2, min(8, len(rows) // 2 + 1)):
        groups = [rows[j::m] for j in range(m)]
        means = [one.mean(axis=0) for one in groups]
        within = sum(
            float(np.sum((one - own) ** 2)) for one, own in zip(groups, means, strict=True)
        )
        within /= len(rows) - m
        between = sum(
            len(one) * float(np.sum((own - mean) ** 2))
            for one, own in zip(groups, means, strict=True)
        )
        worst = max(worst, (between - within * (m - 1)) / len(rows) / power)
    return worst


def change_of_cycles(rows: Array) -> float:
    """Return what part of the motion in cycles, (cycles, n), differs from the mean one."""
    if len(rows) < 2:
        return 0.0
    mean = rows.mean(axis=0)
    power = max(float(mean @ mean), 1e-40)
    own = float(np.median(np.sum((rows - mean) ** 2, axis=1))) / power
    return own * len(rows) / (len(rows) - 1)


def gets_on_evenly(mean: MeanPosition, chain: Chain) -> bool:
    """Return True if the runner gets about as far in every cycle, or too few are known.

    In a train of swings, it gets on with the rise of the drive, and falls back in a few of them.
    """
    slips = chain.settled
    if len(slips) < _EVEN_CYCLES:
        return True
    step = np.diff(mean.between(slips[:-1], slips[1:]))
    usual, average = float(np.median(step)), float(np.mean(step))
    scatter = 1.4826 * float(np.median(np.abs(step - usual)))
    chance = 3.0 * scatter / np.sqrt(len(step))
    if abs(usual - average) > _UNEVEN_STEPS * abs(average) + chance:
        return False
    away = np.abs(np.quantile(step, _OUTER) - usual).max()
    return bool(away < _FAR_STEPS * abs(average) + _FAR_SCATTER * scatter)


def has_slips(rows: Array) -> bool:
    """Return False if cycles, (cycles, n), are sinusoids, or fade as ringing does."""
    if len(rows) < 2:
        return True
    mean = rows.mean(axis=0)
    power = max(float(mean @ mean), 1e-40)
    size, half = rows @ mean / power, len(rows) // 2
    first, last = float(np.median(size[:half])), float(np.median(size[half:]))
    if min(first, last) < SETTINGS.least_persistence * max(first, last):
        return False
    turn = np.linspace(0.0, 2.0 * np.pi, len(mean))
    waves = beside_line(np.stack([np.cos(turn), np.sin(turn)]))
    size, *_ = np.linalg.lstsq(waves.T, mean, rcond=None)
    return float(np.sum((mean - size @ waves) ** 2)) > SETTINGS.least_overtones * power


@dataclass(frozen=True)
class _Trial:
    """Chains by one period, and how well they explain the record."""

    period: float
    coverage: float  #: s
    alternation: float
    change: float  #: part of the motion that differs from cycle to cycle
    chains: list[Chain]
    candidate: Candidate


class PeriodChoice:
    """The choice of the period among candidates and their parts."""

    _PARTS = (1, 2, 3)
    #: Samples that a trial sees at most, about its stretch.
    _EXCERPT_SAMPLES = 2**15

    def __init__(self, pyramid: Pyramid, mean: MeanPosition, given: float | None) -> None:
        self._pyramid, self._mean, self._given = pyramid, mean, given
        self._trials: list[_Trial] = []
        self._excerpt = 0.0  # s

    def chains(self, candidates: list[Candidate]) -> list[Chain]:
        """Return the chains that explain the record best; none where no slips are seen."""
        if candidates:
            level = self._pyramid.level_for(candidates[0].period, SAMPLES_A_PERIOD)
            longest = max(one.period for one in candidates)
            self._excerpt = max(self._EXCERPT_SAMPLES * level.spacing, 8.0 * longest)
        for one in candidates:
            if self._given is not None:
                self._attempt(replace(one, period=self._given))
                continue
            for part in self._PARTS:
                self._attempt(replace(one, period=one.period / part))
        if not self._trials:
            return []
        for _ in range(3 if self._given is None else 0):
            best = self._best()
            for part in self._PARTS[1:]:
                self._attempt(replace(best.candidate, period=best.period / part))
            if self._best().period > 0.8 * best.period:
                break
        best = self._best()
        found = self._found(replace(best.candidate, period=best.period), 0.0)
        return found or best.chains

    def _found(self, candidate: Candidate, excerpt: float) -> list[Chain]:
        chains = match_chains(self._pyramid, candidate, excerpt)
        chains = [one for one in chains if len(one.slips) >= SETTINGS.least_cycles]
        if self._given is not None:
            near = SETTINGS.largest_gap_change
            chains = [one for one in chains if abs(one.period / self._given - 1.0) < near]
        return [
            one
            for one in chains
            if has_slips(cycle_rows(self._pyramid, one)) and gets_on_evenly(self._mean, one)
        ]

    def _attempt(self, candidate: Candidate) -> None:
        if candidate.period < FEWEST_SAMPLES * self._pyramid.levels[0].spacing:
            return
        if any(abs(candidate.period / one.candidate.period - 1.0) < 0.01 and
               candidate.begin == one.candidate.begin for one in self._trials):  # fmt: skip
            return
        found = self._found(candidate, self._excerpt)
        if found:
            longest = max(found, key=lambda one: len(one.slips))
            rows = cycle_rows(self._pyramid, longest)
            coverage = sum(one.duration for one in found)
            self._trials.append(_Trial(
                longest.period, coverage, alternation(rows), change_of_cycles(rows), found,
                candidate,
            ))  # fmt: skip

    def _best(self) -> _Trial:
        most = max(one.coverage for one in self._trials)
        good = [one for one in self._trials if one.coverage > SETTINGS.least_coverage * most]
        least, noise = (min(getattr(one, key) for one in good) for key in ("alternation", "change"))
        good = [
            one
            for one in good
            if one.alternation < least + SETTINGS.largest_alternation * (0.3 + 3.0 * noise)
        ]
        least = min(one.change for one in good) + SETTINGS.largest_change_above_least
        good = [one for one in good if one.change < least]
        shortest = min(one.period for one in good)
        return max(
            (one for one in good if one.period < 1.2 * shortest), key=lambda one: one.coverage
        )
