# SPDX-License-Identifier: Apache-2.0
"""A run as the response of an elastic contact to straight rises and to falls at the slips.

Between two slips the runner follows an equilibrium position y of its contact,

    x'' + 2 delta (x' - y') + omega_0^2 (x - y) = 0,

in which y rises with the actuator and falls at every slip. So x is a sum of responses, linear in
the rise and the fall of each cycle. Rises and falls identify the cycles: all cycles rise alike, and
a rest does not rise. Ringing looks like cycles in x, but here it is part of the responses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.arrays import Array
from stickslip_ros.motion.settled import SETTLING
from stickslip_ros.traces.even_samples import (
    EvenSamples,
    SlipGrid,
    find_unbroken,
    robust_std,
)
from stickslip_ros.traces.hum import MAINS, USUAL, hum_columns
from stickslip_ros.traces.ringing import PUSH, Ringing


@dataclass(frozen=True)
class CycleFitSettings:
    """How rises, falls and ringing are fitted to the cycles of a run, and when they explain it."""

    cells: int = 100  #: of a cycle at most: finer ones cost time and do not improve rise and fall
    cycles: int = 40  #: that one fit takes at most, the first and the last ones of a long run
    tuning: int = 16  #: cycles that the clock is fitted to
    cut: float = 0.1  #: periods before and after a slip in which a long run is not cut in two
    lead: float = 1.5  #: periods before its first slip that belong to a run
    tail: float = 0.3  #: periods after the last slip that tell the clock of many cycles
    beyond: int = 2  #: cycles fitted beyond either end of a run, which must not rise
    shared: float = 0.99  #: part of its neighbour's noise that a cell has at most
    exact: float = 1e-3  #: part of the motion that no fit explains: slips are not instant
    seen: float = 0.1  #: part of a period after a slip from which on its fall is seen
    alone: int = 6  #: cycles from which on those beyond are not needed for the clock
    least: int = 32  #: known cells, at least
    reach: float = 0.5  #: periods about its own in which the clock is sought where ringing blurs
    swings: float = 2.0  #: the same in periods of the ringing where it does not
    places: float = 0.08  #: periods of the ringing between two places that are tried
    telling: int = 8  #: cycles that choose among the places
    #: Part by which rise and fall of the first and the last cycles may differ from the others: a
    #: first one has no ringing before it, and a drive that stops within a cycle bends the rise.
    end: float = 0.15
    few: int = 4  #: cycles, of which the first and the last one, too, tell what is usual
    unlike: float = 0.1  #: part of the cycles that rises or falls by any part of what is usual
    left: float = 4.0  #: times the noise that a fit leaves at most
    left_of_fall: float = 0.25  #: or this part of the falls
    uneven: float = 0.35  #: rises of one drive differ by less than this part in the median
    #: Part by which cycles within a run differ: the first ones, later ones.
    equal: tuple[float, float] = (0.3, 0.05)
    step: float = 10.0  #: of rises and falls beforehand, as part of the spread of the motion
    rest: float = 1e-6  #: standard deviation of the place beforehand, m
    drift: float = 3e-7  #: standard deviation of the drift beforehand, m/s, as on a bench
    hum_seen: float = 3e-3  #: s, from which on hum is separated from a trend
    #: By how much first slip and period (the latter over all cycles; in periods), frequency of the
    #: ringing (as a part) and logarithm of its decay may be corrected, and units of each.
    corrections: tuple[float, float, float, float] = (0.1, 0.2, 0.01, 0.3)
    units: tuple[float, float, float, float] = (0.1, 0.1, 0.01, 1.0)
    low_pass: float = 0.1  #: standard deviation of the low-pass, in periods of the ringing
    thinned: float = 0.15  #: distance of samples behind it, in the same
    dense: float = 100.0  #: samples in a swing that it needs at most
    support: float = 8.0  #: standard deviations of the low-pass that are looked at
    gone: float = 40.0  #: decays after which nothing of the ringing is left but rounding


SETTINGS = CycleFitSettings()

#: How the clock is fitted: few steps bring it to a part of its error.
_DESCENT = {"diff_step": 1e-2, "max_nfev": 6, "xtol": 1e-4, "ftol": 1e-4}
#: Error of the clock of a known period, s/s.
CLOCK = 5e-4
#: Ringing blurs the clock of the slips where fewer of its periods fit into a cycle.
BLURRED = 12.0


@dataclass(frozen=True)
class CycleFit:
    """A run, with rise and fall of each cycle, including those fitted beyond its ends."""

    grid: SlipGrid
    ringing: Ringing
    number: NDArray[np.int64]  #: of the cycles, from 0 at the first one of the run
    rise: Array  #: m, (cycles,), positive in the direction of the run
    fall: Array  #: m, (cycles,)
    seen: NDArray[np.bool_]  #: whether the fall is, (cycles,)
    errors: Array  #: standard errors of rise and fall, m, (2, cycles)
    residual: float  #: root mean square of what the fit leaves, m
    noise: float  #: the same of the noise, m
    spread: float  #: root mean square of the motion but for its mean, m

    @cached_property
    def odds(self) -> Array:
        """Logarithm of how many times as likely each cycle is as none, by its rise and its fall.

        Most cycles rise and fall as the others do, but for their scatter, some by any part of that
        (ringing in step with the drive); none does neither. A rise alone, of any part of one where
        the drive stopped, is no step, but only a last one can be: the next cycle follows a slip.
        """
        count = self.grid.count
        ends = int(count > SETTINGS.few)  # they differ most
        inner = (self.number >= ends) & (self.number < count - ends)
        if not inner.any():
            return np.zeros(len(self.number))
        exists, none, parts = [], [], []
        for sizes, errors in zip((self.rise, self.fall), self.errors, strict=True):
            usual = float(np.median(sizes[inner]))
            error = np.hypot(errors, SETTINGS.end * usual)
            alike = np.maximum(error, math.hypot(robust_std(sizes[inner]), SETTINGS.end * usual))
            others = np.hypot(alike, 0.5 * usual)
            exists.append(
                np.logaddexp(
                    math.log(1.0 - SETTINGS.unlike) + _log_normal(sizes - usual, alike),
                    math.log(SETTINGS.unlike) + _log_normal(sizes - usual, others),
                )
            )
            none.append(_log_normal(sizes, error))
            parts.append(_log_part(sizes, error, usual))
        rises, falls = exists[0] - none[0], exists[1] - none[1]
        stopped = exists[0] - np.logaddexp(none[0], parts[0]) + math.log(2.0)
        known = np.where(self.number < count - 1, rises, stopped) + falls
        return np.where(self.seen, known, rises)

    def extent(self) -> tuple[int, int]:
        """Return numbers of the first and the last cycle that are more likely than none."""
        inside = (self.number >= 0) & (self.number < self.grid.count)
        both = self.rise[inside], self.fall[inside]
        if not (inside.any() and all(np.median(one) > 0.0 for one in both)):
            return 0, -1
        return find_unbroken(self.odds > 0.0, self.number, self.grid.count)

    def explains(self) -> bool:
        """Return True if all cycles rise alike and the residuals are little more than noise."""
        inside = (self.number >= 0) & (self.number < self.grid.count)
        if not inside.any():
            return False
        fall, rise = float(np.median(self.fall[inside])), self.rise[inside]
        if self.residual > max(SETTINGS.left * self.noise, SETTINGS.left_of_fall * fall):
            return False
        middle = float(np.median(rise))
        return float(np.median(np.abs(rise - middle))) < SETTINGS.uneven * middle


def _log_normal(x: Array, width: Array) -> Array:
    width = np.maximum(width, np.finfo(float).tiny)  # 0 where nothing is left
    return -0.5 * (x / width) ** 2 - np.log(width)


def _log_part(x: Array, width: Array, most: float) -> Array:
    """Return the same for any part of a size, each as likely."""
    width = np.maximum(width, np.finfo(float).tiny)
    part = scipy.special.ndtr((most - x) / width) - scipy.special.ndtr(-x / width)
    tiny = np.finfo(float).tiny
    return np.log(np.maximum(part, tiny) * math.sqrt(2.0 * math.pi) / max(abs(most), tiny))


def without_ringing(even: EvenSamples, ringing: Ringing) -> EvenSamples:
    """Return where the runner would be at rest on its contact: a sawtooth with straight flanks."""
    omega_0 = math.hypot(2.0 * math.pi * ringing.frequency, ringing.decay)
    while even.tick * ringing.frequency * SETTINGS.dense < 1.0 and len(even.x) > SETTINGS.dense:
        even = even.halved
    width = max(SETTINGS.low_pass / ringing.frequency / even.tick, 1.0)

    def rest_of(x: Array) -> Array:
        place, rate, acceleration = (
            scipy.ndimage.gaussian_filter1d(x, width, order=order) / even.tick**order
            for order in (0, 1, 2)
        )
        return np.asarray(place + (2.0 * ringing.decay * rate + acceleration) / omega_0**2)

    impulse = np.zeros(2 * int(SETTINGS.support * width) + 3)
    impulse[len(impulse) // 2] = 1.0
    every = max(1, int(SETTINGS.thinned / SETTINGS.low_pass * width))
    return EvenSamples(
        even.begin,
        even.tick * every,
        rest_of(even.x - even.x[0])[::every] + even.x[0],
        even.known[::every],
        even.noise * float(np.linalg.norm(rest_of(impulse))),
    )


def fit_cycles(
    even: EvenSamples,
    grid: SlipGrid,
    ringing: Ringing,
    begin: float,
    end: float,
    known: bool = False,
    tuned: bool = False,
    equal: bool = False,
) -> CycleFit | None:
    """Fit rise and fall of the cycles of a run, and of some beyond its ends.

    begin and end (s) limit the samples; None if there are too few. The times of the slips and the
    ringing are fitted, too, unless tuned; a known period may be off by the error of a clock. If
    equal, the cycles between the first and the last one are taken for such. Of a long run, the
    first and the last cycles are fitted.
    """
    parts = split_parts(even, grid, begin, end, SETTINGS.cycles)
    if not _enough(parts):
        return None
    if not tuned:
        grid, ringing = _tune(even, parts, grid, ringing, (begin, end), known)
    parts = [replace(part, hums=not equal) for part in parts]
    alike = _fit_alike(parts[0], grid, ringing)
    fits = [_fit_each(part, grid, ringing, alike, equal) for part in parts]
    cells = [len(residuals) for *_, residuals in fits]
    number = np.concatenate([part.number for part in parts])
    sizes = np.concatenate([rises_and_falls for rises_and_falls, *_ in fits], axis=1)
    errors = np.concatenate([errors for _, errors, _ in fits], axis=1)

    def total(squares: list[float]) -> float:
        return math.sqrt(float(np.average(squares, weights=cells)))

    # Cycles from the begin and to the end of the record: of one whose slip is not in it, a rise is.
    before, after = (
        np.concatenate(
            [sign * (p.number - (p.edges[at] - grid.first) / grid.period) for p in parts]
        )
        for sign, at in ((1.0, 0), (-1.0, -1))
    )
    slip = after > -SETTINGS.seen
    return CycleFit(
        grid, ringing, number[slip], sizes[0, slip], sizes[1, slip],
        np.minimum(before, after)[slip] > SETTINGS.seen,
        errors[:, slip],
        total([float(np.mean(residuals**2)) for *_, residuals in fits]),
        total([part.noise**2 for part in parts]),
        total([part.spread**2 for part in parts]),
    )  # fmt: skip


@dataclass(frozen=True)
class _Stretch:
    """Cycles fitted together, with their mean positions in cells of time."""

    number: NDArray[np.int64]  #: of the cycles
    edges: Array  #: of the cells, s, (cells + 1,)
    x: Array  #: m, (cells,), nan where not known
    noise: float  #: standard deviation of x by noise, m
    spread: float  #: standard deviation of x, m
    hums: bool = True  #: whether there may be hum

    @cached_property
    def slow(self) -> tuple[Array, list[float]]:
        """Place, drift and hum at the cells; the standard deviation of each beforehand, SI."""
        t = 0.5 * (self.edges[1:] + self.edges[:-1])
        hum = hum_columns(t, MAINS) if self.hums and t[-1] - t[0] > SETTINGS.hum_seen else []
        columns = np.stack([np.ones_like(t), t - t[0], *hum], axis=1)
        return columns, [SETTINGS.rest, SETTINGS.drift, *[USUAL] * len(hum)]


def split_parts(
    even: EvenSamples, grid: SlipGrid, begin: float, end: float, most: int
) -> list[_Stretch]:
    """Return a run in one part; of more cycles than that, the first and the last ones."""
    beyond = SETTINGS.beyond
    if grid.count <= most:
        return [_part(even, grid, np.arange(-beyond, grid.count + beyond), begin, end)]
    half, inner = most // 2, SETTINGS.cut * grid.period
    head = np.arange(-beyond, half + 1)  # the last one rises and is cut off before its fall
    tail = np.arange(grid.count - half + 1, grid.count + beyond)
    return [
        _part(even, grid, head, begin, grid.first + half * grid.period - inner),
        _part(even, grid, tail, grid.first + (tail[0] - 1) * grid.period + inner, end),
    ]


def _enough(parts: list[_Stretch]) -> bool:
    return all(
        len(part.number) > 1 and np.isfinite(part.x).sum() >= SETTINGS.least for part in parts
    )


def _part(
    even: EvenSamples, grid: SlipGrid, number: NDArray[np.int64], begin: float, end: float
) -> _Stretch:
    slips = grid.first + grid.period * number
    seen = (slips > begin) & (slips - grid.period < end)
    number, slips = number[seen], slips[seen]
    if not len(slips):
        return _Stretch(number, np.zeros(1), np.zeros(0), 0.0, 0.0)
    tick = max(even.tick, grid.period / SETTINGS.cells)
    first = max(begin, float(slips[0]) - SETTINGS.lead * grid.period)
    edges = np.arange(first, min(end, float(slips[-1]) + grid.period), tick)
    noise = even.noise / math.sqrt(tick / even.tick)
    x = even.means(edges)
    spread = float(np.nanstd(x)) if np.isfinite(x).any() else 1.0
    return _Stretch(number, edges, x, max(noise, SETTINGS.exact * spread), spread)


def _unknowns(
    part: _Stretch, grid: SlipGrid, ringing: Ringing
) -> tuple[Array, list[float], Array, Array]:
    """Return what all cycles share (cells, n), how wide it is, and answers (cycles, cells) to each.

    Answers are those to a rise and to a fall of 1 m.
    """
    slips = np.asarray(grid.first + grid.period * part.number)
    rises, falls = responses_of(part.edges, slips, grid.period, ringing)
    slow, widths = part.slow
    before = ringing.columns(0.5 * (part.edges[1:] + part.edges[:-1]) - part.edges[0])
    step, sign = SETTINGS.step * part.spread, grid.direction
    return np.hstack((slow, before)), [*widths, step, step], sign * rises, -sign * falls


def _fit_alike(part: _Stretch, grid: SlipGrid, ringing: Ringing) -> tuple[float, Array, Array]:
    """Fit the rise that all cycles of a run share, and the falls (m); return what is left (m), too.

    By ridge regression; cycles beyond the run do not rise.
    """
    inside = (part.number >= 0) & (part.number < grid.count)
    known = np.isfinite(part.x)
    shared, widths, rises, falls = _unknowns(part, grid, ringing)
    columns = np.hstack((shared, rises[inside].sum(axis=0)[:, None], falls[inside].T))
    width = np.append(widths, np.full(1 + int(inside.sum()), SETTINGS.step * part.spread))
    design, wanted = columns[known] * width, part.x[known] - float(np.nanmean(part.x))
    normal = design.T @ design + part.noise**2 * np.eye(len(width))
    found = np.linalg.solve(normal, design.T @ wanted)
    sizes = (found * width)[len(widths) :]
    return float(sizes[0]), sizes[1:], wanted - design @ found


def _fit_each(
    part: _Stretch,
    grid: SlipGrid,
    ringing: Ringing,
    alike: tuple[float, Array, Array],
    equal: bool,
) -> tuple[Array, Array, Array]:
    """Fit rise and fall of each cycle (m, (2, cycles)); return their errors and what is left, too.

    Half of the common rise is the prior of every cycle, of those beyond the run, too. But if equal,
    those within the run have a rise and a fall in common, but for a part.
    """
    known = np.isfinite(part.x)
    shared, widths, rises, falls = _unknowns(part, grid, ringing)
    common, common_falls, residuals = alike
    half, fall = 0.5 * abs(common), abs(float(np.median([*common_falls] or [0.0])))
    one = np.zeros(len(part.number))
    if equal:
        one[(part.number > 0) & (part.number < grid.count - 1)] = 1.0
    prior = np.where(one, 0.0, half)
    part_of = np.where(part.number < SETTLING, *SETTINGS.equal)
    wanted = (part.x - float(np.nanmean(part.x)) - prior @ rises)[known]
    of_one = np.where(one, 2.0 * part_of * half, half), np.where(one, part_of * fall, 2.0 * fall)
    all_of = [SETTINGS.step * part.spread * float(equal)] * 2
    width = np.concatenate((widths, *of_one, all_of))
    design = np.hstack((shared, rises.T, falls.T, (one @ rises)[:, None], (one @ falls)[:, None]))
    design = design[known] * width
    each = np.eye(2 * len(one), 2 * len(one) + 2)
    each[: len(one), -2], each[len(one) :, -1] = one, one
    each = each * width[len(widths) :]

    def solve(design: Array, wanted: Array, noise: float) -> tuple[Array, Array]:
        inverse = np.linalg.inv(design.T @ design + noise**2 * np.eye(len(width)))
        return inverse @ (design.T @ wanted), np.asarray(noise**2 * inverse, np.float64)

    found, _ = solve(design, wanted, max(part.noise, float(np.std(residuals))))
    left = wanted - design @ found
    # But for what neighbouring cells share, their noise is white (D. Cochrane, G. Orcutt, Journal
    # of the American Statistical Association 44 (1949) 32).
    same = min(max(float(left[1:] @ left[:-1] / (left @ left)), 0.0), SETTINGS.shared)
    noise = max(part.noise, float(np.std(left))) * math.sqrt(1.0 - same**2)
    found, chance = solve(design[1:] - same * design[:-1], wanted[1:] - same * wanted[:-1], noise)
    inner = slice(len(widths), None)
    errors: Array = np.sqrt(np.einsum("ia,ab,ib->i", each, chance[inner, inner], each))
    sizes = (each @ found[inner]).reshape(2, -1) + np.stack((prior, np.zeros(len(one))))
    return sizes, errors.reshape(2, -1), left


def responses_of(
    edges: Array, slips: Array, period: float, ringing: Ringing
) -> tuple[Array, Array]:
    """Return the mean answers between edges (s) to a rise and a drop of 1, each (cycles, cells).

    They are differences of integrals, so a cell may be longer than a swing.
    """
    pole = complex(-ringing.decay, 2.0 * math.pi * ringing.frequency)
    push = PUSH * ringing.decay / pole.imag
    width = np.diff(edges)

    since = np.maximum(edges - np.concatenate(([slips[0] - period], slips))[:, None], 0.0)
    swing = np.full(since.shape, -1.0 / pole)  # long after, nothing rings
    swing[since == 0.0] = 0.0
    rings = (since > 0.0) & (since * ringing.decay < SETTINGS.gone)
    swing[rings] = (np.exp(pole * since[rings]) - 1.0) / pole
    fallen = since[1:] - ((1.0 + 1j * push) * swing[1:]).real
    risen = 0.5 * since**2 - swing.imag / pole.imag
    lengths = np.diff(slips, prepend=slips[0] - period)[:, None]
    rises = np.diff(risen[:-1] - risen[1:], axis=1) / lengths / width
    return rises, np.diff(fallen, axis=1) / width


def _tune(
    even: EvenSamples,
    parts: list[_Stretch],
    grid: SlipGrid,
    ringing: Ringing,
    span: tuple[float, float],
    known: bool,
) -> tuple[SlipGrid, Ringing]:
    """Fit the times of the slips and the ringing; span (s) limits the samples."""

    def tune(near: SlipGrid) -> tuple[SlipGrid, Ringing, float]:
        begin, end = span
        if swings >= BLURRED and near.count >= SETTINGS.alone:  # surely cycles of the run
            begin, end = max(begin, near.begin), min(end, near.end + SETTINGS.tail * near.period)
        few = split_parts(even, near, begin, end, SETTINGS.tuning)
        trial = _fit_clock(few if _enough(few) else parts, near, ringing, known)
        return *trial, float(np.std(_fit_alike(parts[0], *trial)[2]))

    swings = ringing.frequency * grid.period
    if swings < BLURRED:
        return tune(search_clock(parts[0], grid, ringing))[:2]
    found = tune(grid)
    if len(parts) > 1 and (moved := shift_by_swings(parts, *found[:2])) != found[0]:
        found = tune(moved)
    if found[2] > SETTINGS.left * parts[0].noise:  # by a period of the ringing off, perhaps
        found = min(found, tune(search_clock(parts[0], grid, ringing)), key=lambda one: one[2])
    return found[:2]


def shift_by_swings(parts: list[_Stretch], grid: SlipGrid, ringing: Ringing) -> SlipGrid:
    """Return the run with the clock a period of the ringing off at either end, if that leaves less.

    A period that is a little off adds up to one over a long run.
    """
    off = []
    for part in (parts[0], parts[-1]):
        trials = [replace(grid, first=grid.first + k / ringing.frequency) for k in (0, -1, 1)]
        best = min(trials, key=lambda one: _squares(part, one, ringing))
        off.append(best.first - grid.first)
    apart = (off[1] - off[0]) / max(grid.count - 1, 1)
    return replace(grid, first=grid.first + off[0], period=grid.period + apart)


def search_clock(part: _Stretch, grid: SlipGrid, ringing: Ringing) -> SlipGrid:
    """Return the run with the clock, of some about its own, that leaves least."""
    last = grid.first + grid.period * (part.number[0] + SETTINGS.telling)
    seen = part.edges < last
    number = part.number[: SETTINGS.telling]
    few = replace(part, number=number, edges=part.edges[seen], x=part.x[seen[1:]])
    swings = ringing.frequency * grid.period
    apart = SETTINGS.places / swings
    count = int((SETTINGS.reach if swings < BLURRED else SETTINGS.swings / swings) / apart)
    trials = [
        replace(grid, first=grid.first + k * apart * grid.period) for k in range(-count, count + 1)
    ]
    if len(trials) == 1 or np.isfinite(few.x).sum() < SETTINGS.least:
        return grid
    return min(trials, key=lambda one: _squares(few, one, ringing))


def _squares(part: _Stretch, grid: SlipGrid, ringing: Ringing) -> float:
    return float(np.sum(_fit_alike(part, grid, ringing)[2] ** 2))


def _fit_clock(
    parts: list[_Stretch], grid: SlipGrid, ringing: Ringing, known: bool
) -> tuple[SlipGrid, Ringing]:
    """Return the run and its ringing with the clock that leaves least.

    All parts count: an error of the period adds up from the first cycle to the last.
    """
    cycles = max(float(parts[-1].number[-1] - parts[0].number[0]), 1.0)
    most, units = np.array(SETTINGS.corrections), np.array(SETTINGS.units)
    if known:
        most[1] = min(most[1], cycles * CLOCK)
    most /= units

    def trial(by: Array) -> tuple[SlipGrid, Ringing]:
        late, longer, higher, steeper = (by * units).tolist()
        moved = replace(
            grid,
            first=grid.first + late * grid.period,
            period=grid.period * (1.0 + longer / cycles),
        )
        decay = ringing.decay * math.exp(steeper)
        return moved, Ringing(ringing.frequency * (1.0 + higher), decay)

    def left(by: Array) -> Array:
        return np.concatenate([_fit_alike(part, *trial(by))[2] / part.noise for part in parts])

    found = scipy.optimize.least_squares(left, 0.0 * most, bounds=(-most, most), **_DESCENT)
    return trial(found.x)
