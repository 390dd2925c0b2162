# SPDX-License-Identifier: Apache-2.0
"""How much of a motion runs of steps leave unexplained: by which runs are compared.

All positions of the record count, those in runs, in rests, and of what no run explains yet; so runs
of any period and length can be compared, those that overlap, too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.arrays import Array
from stickslip_ros.traces.even_samples import EvenSamples, SlipGrid
from stickslip_ros.traces.hum import MAINS, hum_columns


@dataclass(frozen=True)
class SquaresSettings:
    """How finely a motion is looked at, and what is slow."""

    samples: int = 24_000  #: of the record at most; of more, neighbours are averaged
    slow: int = 3  #: order of the polynomial that a run may be bent by
    hum_seen: float = 5e-3  #: s, from which on hum is no part of it
    cells: int = 48  #: of a cycle in which polynomial and hum are told from its shape
    fine: int = 128  #: cells of a cycle at most that are finer than its samples
    together: int = 4  #: samples of all cycles in such a cell, at least
    parts: int = 64  #: of the record that count alike, however much is left in each
    open: float = 1e-8  #: part of the motion that is open without noise, too
    least: int = 3  #: of a cycle, in which its shape is drawn
    shown: float = 8.0  #: samples of a cycle, with fewer of which runs are not compared
    cycles: int = 500  #: of a run at most that tell whether it repeats, from its middle
    chance: float = 1e-3  #: of a run where there is none
    #: Periods over a run by which the clock of few samples a cycle is off at most, as it is found
    #: and as it is looked at more closely; places tried there.
    off: tuple[float, float] = (0.05, 0.0025)
    tried: int = 41
    fewest: float = 2.5  #: samples of a cycle that tell its period, if those of all cycles do
    few: float = 24.0  #: samples of a cycle, with fewer of which those of all cycles count together
    differing: float = 0.1  #: part of their motion that may differ if such cycles explain it
    moved: int = 4  #: cycles by which the ends of a run are moved at most


SETTINGS = SquaresSettings()


class Squares:
    """A motion, and what runs, the rests beside them and hum leave of it."""

    def __init__(self, even: EvenSamples) -> None:
        self.even = even

    @cached_property
    def _seen(self) -> EvenSamples:
        even = self.even
        while len(even.x) > SETTINGS.samples:
            even = even.halved
        return even

    @cached_property
    def _t(self) -> Array:
        even = self._seen
        return np.asarray(even.begin + even.tick * np.flatnonzero(even.known), np.float64)

    @cached_property
    def _rows(self) -> Array:
        """Positions (m) and hum of 1 m, (1 + n, samples)."""
        even = self._seen
        hums = even.end - even.begin > SETTINGS.hum_seen
        hum = hum_columns(self._t, MAINS) if hums else []
        return np.vstack((even.x[even.known] - even.x[0], *hum))

    def left(self, runs: Sequence[SlipGrid]) -> float:
        """Return the logarithm of the mean square (m^2) that is left, its mean over the record.

        In a run, all cycles share a shape, beside a slow polynomial. Each position is told by those
        at the same phase of the other cycles: of two, one tells the other, and many tell each more
        exactly, so a multiple of a period leaves more than itself. A rest is a straight line.
        """
        runs = sorted(runs, key=lambda one: one.first)
        edges = np.searchsorted(self._t, [at for run in runs for at in (run.begin, run.end)])
        edges = np.maximum.accumulate(np.concatenate(([0], edges, [len(self._t)])))
        blocks, told, spans = [], [], []
        for k, part in enumerate(slice(*pair) for pair in pairwise(edges)):
            t: Array = self._t[part]
            run = runs[k // 2] if k % 2 else None
            order = SETTINGS.slow if run else 1
            if len(t) <= order + 1:
                continue
            place = 2.0 * (t - t[0]) / (t[-1] - t[0]) - 1.0
            own = np.polynomial.legendre.legvander(place, order).T
            rows = np.vstack((self._rows[:, part], own[1:] if run else own))
            told.append(rows if run is None else self._without_shape(rows, t, run))
            blocks.append(rows)
            spans.append((part, run))
        shared = len(self._rows)
        columns = np.vstack((
            np.hstack([one[:shared] for one in told]),
            scipy.linalg.block_diag(*[one[shared:] for one in told]),
        ))  # fmt: skip
        slow = _fit_first(columns)
        left, at = [], shared - 1
        for rows, (part, run) in zip(blocks, spans, strict=True):
            last = at + len(rows) - shared
            place = rows[0] - slow[: shared - 1] @ rows[1:shared] - slow[at:last] @ rows[shared:]
            at = last
            left.append(place if run is None else self._unlike(place, self._t[part], run))
        squares = np.concatenate(left) ** 2
        least = SETTINGS.open * float(np.var(self._rows[0])) + 1e-40
        means = np.add.reduceat(
            squares, np.arange(0, len(squares), -(-len(squares) // SETTINGS.parts))
        )
        return float(np.mean(np.log(means * SETTINGS.parts / len(squares) + least)))

    def _without_shape(self, rows: Array, t: Array, run: SlipGrid) -> Array:
        """Return rows at times (s) of a run without what all cycles share at a phase."""
        most = int(np.clip(run.period / self._seen.tick, SETTINGS.least, SETTINGS.cells))
        cell = (np.mod((t - run.begin) / run.period, 1.0) * most).astype(np.int64)
        number = np.maximum(np.bincount(cell, minlength=most), 1)
        shapes = [(np.bincount(cell, row, most) / number)[cell] for row in rows]
        return np.asarray(rows - np.stack(shapes))

    def _unlike(self, place: Array, t: Array, run: SlipGrid) -> Array:
        """Return what of the places (m) at times (s) of a run other cycles do not tell, at best.

        Fine cells draw its shape exactly, coarse ones tell it by more samples.
        """
        turn = (t - run.begin) / run.period
        cycle = np.clip(turn.astype(np.int64), 0, run.count - 1)
        cells = max(int(run.period / self._seen.tick), SETTINGS.least)
        if self.samples_few(run):  # they lie at other phases in each cycle, and draw it more finely
            cells = max(cells, min(len(t) // SETTINGS.together, SETTINGS.fine))
        best, left = place, math.inf
        while cells >= SETTINGS.least:
            at = np.mod(turn, 1.0) * cells
            key = cycle * (cells + 1) + np.minimum(at.astype(np.int64), cells - 1)
            part = at - np.floor(at)
            size, shape = run.count * (cells + 1), (run.count, cells + 1)
            number = np.bincount(key, 1.0 - part, size) + np.bincount(key + 1, part, size)
            sums = np.bincount(key, (1.0 - part) * place, size)
            sums += np.bincount(key + 1, part * place, size)
            number, sums = number.reshape(shape), sums.reshape(shape)
            others = number.sum(axis=0) - number
            mean = ((sums.sum(axis=0) - sums) / np.where(others > 0.0, others, 1.0)).ravel()
            away = place - (1.0 - part) * mean[key] - part * mean[key + 1]
            if float(away @ away) < left:
                best, left = away, float(away @ away)
            cells //= 2
        return best

    def resolves(self, run: SlipGrid) -> bool:
        """Return whether the samples, averaged in a long record, show the cycles of a run."""
        return run.period >= SETTINGS.shown * self._seen.tick

    def repeats(self, run: SlipGrid) -> float:
        """Return the logarithm of how many times as likely a run is with a shape as without one.

        The best of many periods and slips that are tried, about as many as samples, is so by
        chance: a run is no chance above 0. Samples of its own tell, however long the record is; of
        a run that they do not show, nothing does.
        """
        own, run = self._own(run)
        if own is None:
            return math.inf
        place, alone = own._told_apart(run)
        before, after = float(np.mean(place**2)), float(np.mean(alone**2))
        least = SETTINGS.open * before + 1e-40
        apart = math.log((before + least) / (after + least))
        return 0.5 * len(place) * apart - math.log(len(self._t) / SETTINGS.chance)

    def samples_few(self, run: SlipGrid) -> bool:
        """Return whether so few samples show a cycle that those of all cycles count together."""
        return run.period < SETTINGS.few * self.even.tick

    def tune(self, run: SlipGrid) -> SlipGrid:
        """Return a run of few samples a cycle with the period at which its cycles tell most.

        They lie at other phases in each cycle, so neighbours differ; all cycles tell the shape.
        """
        if not self.samples_few(run):
            return run
        own, part = self._own(run)
        if own is None:
            return run
        period = part.period
        for reach in SETTINGS.off:
            late = np.linspace(-reach, reach, SETTINGS.tried) / part.count
            tried = [part.about_middle(one) for one in (period * (1.0 + late)).tolist()]
            left = [float(np.sum(own._told_apart(one)[1] ** 2)) for one in tried]
            period = tried[int(np.argmin(left))].period
        return run.about_middle(period)

    def shorter_part(self, run: SlipGrid) -> float | None:
        """Return the part (s) of a period of few samples by which cycles tell each other better.

        None if none does: ringing between the samples hides no whole part of its period.
        """
        if not self.samples_few(run):
            return None
        most = int(run.period / (SETTINGS.fewest * self.even.tick))
        parts = [
            replace(run, period=run.period / n, count=run.count * n) for n in range(1, most + 1)
        ]
        best = min(parts, key=lambda one: self.differing(self.tune(one)), default=run)
        return best.period if best.period < run.period else None

    def differing(self, run: SlipGrid) -> float:
        """Return which part of the motion of a run its other cycles do not tell, noise apart."""
        own, run = self._own(run)
        if own is None:
            return math.nan
        before, after = (
            float(np.mean(one**2)) - self.even.noise**2 for one in own._told_apart(run)
        )
        return max(after, 0.0) / max(before, 1e-40)

    def explains(self, run: SlipGrid) -> bool:
        """Return whether cycles of few samples tell each other, which their ringing hides."""
        return self.samples_few(run) and self.differing(run) < SETTINGS.differing

    def _own(self, run: SlipGrid) -> tuple[Squares | None, SlipGrid]:
        """Return the motion in a run, or in its middle; None if no samples show it."""
        count = min(run.count, SETTINGS.cycles)
        middle = run.first + (run.count - count) // 2 * run.period
        run = replace(run, first=middle, count=count)
        first, last = (
            round((at - self.even.begin) / self.even.tick) for at in (run.begin, run.end)
        )
        inside = slice(max(first, 0), max(last, 0) + 1)
        x, known = self.even.x[inside], self.even.known[inside]
        if known.sum() <= SETTINGS.slow + 3:
            return None, run
        begin = self.even.begin + self.even.tick * inside.start
        return Squares(replace(self.even, begin=begin, x=x, known=known)), run

    def _told_apart(self, run: SlipGrid) -> tuple[Array, Array]:
        """Return a run's motion (m) without what is slow, and what other cycles do not tell."""
        part = slice(*np.searchsorted(self._t, [run.begin, run.end]))
        t: Array = self._t[part]
        place = 2.0 * (t - t[0]) / (t[-1] - t[0]) - 1.0
        slow = np.polynomial.legendre.legvander(place, SETTINGS.slow).T
        rows = np.vstack((self._rows[:, part], slow))
        left = []
        for told in (rows, self._without_shape(rows, t, run)):
            left.append(rows[0] - _fit_first(told) @ rows[1:])
        return left[0], self._unlike(left[1], t, run)

    def settle_ends(self, run: SlipGrid, others: Sequence[SlipGrid]) -> SlipGrid:
        """Return a run with as many cycles, of some more or fewer at its ends, as leave least.

        others are the other runs, which it may not reach into. As it is if samples do not show it.
        """
        if not self.resolves(run):
            return run
        earlier = (one.end for one in others if one.end < run.first)
        begin = max([self.even.begin - 0.5 * run.period, *earlier])
        end = min([self.even.end, *(one.begin for one in others if one.begin > run.end)])
        least = self.left([*others, run])
        for _ in range(SETTINGS.moved):
            near = [
                replace(run, first=run.first + more * run.period, count=run.count + last - more)
                for more, last in ((1, 0), (0, -1), (-1, 0), (0, 1))
            ]
            near = [one for one in near if one.count > 1 and begin <= one.begin and one.end <= end]
            found = [self.left([*others, one]) for one in near]
            if not found or min(found) >= least:
                break
            run, least = near[int(np.argmin(found))], min(found)
        return run


def _fit_first(rows: Array) -> Array:
    """Return how much of each of the other rows the first one holds, by least squares."""
    products = rows @ rows.T
    return np.asarray(np.linalg.lstsq(products[1:, 1:], products[1:, 0], rcond=1e-10)[0])
