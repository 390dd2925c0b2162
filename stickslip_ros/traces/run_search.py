# SPDX-License-Identifier: Apache-2.0
"""Finds the runs of steps in a measurement: their cycles, period and direction.

The runner falls back at every slip, at regular times, while it advances on average. Regular falls
(:mod:`slip_edges`) are candidates. They are extended to whole runs (:mod:`run_growth`), which are
runs of steps if their cycles are similar and advance. Ringing causes falls as well. So the ringing
after the runs is measured and removed, and the search is repeated. Of both results, the runs are
taken that rises, falls and ringing explain best (:mod:`cycle_fit`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.traces.cycle_fit import CycleFit, fit_cycles, without_ringing
from stickslip_ros.traces.even_samples import EvenSamples, SlipGrid, robust_std
from stickslip_ros.traces.folding import shorter_period
from stickslip_ros.traces.hum import HUMMING
from stickslip_ros.traces.ringing import Ringing, Window, fit_ringing
from stickslip_ros.traces.run_growth import check_run, grow_run
from stickslip_ros.traces.slip_edges import COARSEST, edge_kernel, find_edges
from stickslip_ros.traces.squares import Squares


@dataclass(frozen=True)
class RunSearchSettings:
    """Limits of the search for runs, and of the choice among runs that explain a motion."""

    candidates: int = 16  #: chains of falls that are tried, the most significant ones
    longest: int = 6  #: and those of most falls
    #: A run of a shorter period is preferred if it explains this part of the motion at least, and
    #: its cycles differ by at most so many times as much and this more: a period also repeats
    #: after twice its time.
    rival: float = 0.6
    rival_differs: tuple[float, float] = (1.5, 0.015)
    #: By how much less a run has to leave of the motion, in the logarithm of its mean square, to be
    #: preferred to one whose cycles are more similar.
    clearly: float = 0.7
    same_chain: float = 0.03  #: part by which periods of chains of falls differ that are one
    same_period: float = 0.05  #: part by which a period that is seen may be off one that is known
    off: float = 0.5  #: periods at most that this difference adds up to over a run
    clocks: float = 2e-3  #: part by which clocks differ, which is tolerated over any run
    smallest: float = 0.1  #: least step as part of the largest of all runs
    rings_from: tuple[float, float] = (0.1, 1.1)  #: periods after the last slip: ringing, or a rise
    late: float = 3e-4  #: s, from so late at most: slow drives have long periods
    #: Periods within which the slips of slow drives are sought; slips, and falls about each, that
    #: are tried; standard deviations by which they fall together where that is no chance.
    around: float = 0.1
    tried: tuple[int, int] = (12, 5)
    clear: float = 8.0
    uneven: float = 1.5  #: samples by which such slips may be
    between: tuple[float, float] = (0.1, 0.9)  #: part of a cycle that rings, where no rest does
    rings_for: float = 5e-3  #: s, in which ringing dies away
    slow_slips: int = 8  #: last slips of a slow drive, after each of which the ringing dies away
    samples: int = 16  #: that ringing is fitted to, at least
    same_ringing: float = 0.03  #: part to which frequencies of one ringing are the same
    rounds: int = 6  #: fits of a run whose number of cycles changes
    recounted: float = 0.3  #: part by which that changes before the clock is fitted again
    samples_a_swing: float = 8.0  #: samples of the ringing, with fewer of which it passes for noise
    all_but_noise: float = 1.5  #: times the noise up to which a fit leaves nothing to look for
    beside: float = 1.0  #: periods beside a run that its ringing, or a rise, may move the runner
    places: int = 40  #: at which the runner is looked at beyond, as for other runs


SETTINGS = RunSearchSettings()

#: Called with the name of each stage of the search.
Report = Callable[[str], object]
#: Number of reports of a search that is not repeated.
REPORTS = 5


def report_nothing(stage: str) -> None:
    """Report nothing."""


def search_runs(
    even: EvenSamples, period: float | None = None, report: Report = report_nothing
) -> list[SlipGrid]:
    """Return the runs in the order of time; the period (s) of some of them where it is known."""
    report("falls")
    edges = list(find_edges(even, period))
    report("runs")
    seen: list[SlipGrid] = []
    fits: list[CycleFit] = []
    ringing = None
    # Runs of other periods than one that is known are looked for where something is left.
    for others in (True,) if period is None else (False, True):
        before, seen = seen, _search(even, edges, period, others=others)
        if seen and seen == before:
            continue
        report("cycles")
        ringing = fit_ringing_down(even, seen)
        fits = [] if ringing is None else _count_all(even, seen, ringing, period)
        chosen = choose_apart(fits, [])
        if fits and len(chosen) == len(seen) and do_explain_all(even, chosen):
            return sorted((one.grid for one in chosen), key=lambda one: one.first)
    if ringing is None:
        return seen
    report("runs behind the ringing")
    sawtooth = without_ringing(even, ringing)
    edges = list(find_edges(sawtooth, period))
    fits += _count_all(even, _search(sawtooth, edges, period), ringing, period)
    chosen = choose_apart(fits, [])
    report("other runs")
    periods = [] if period is None else [period]
    for own in [] if do_explain_all(even, chosen) else [one.grid.period for one in chosen]:
        if all(abs(own / other - 1.0) > SETTINGS.same_period for other in periods):
            periods.append(own)
    # Other runs have the same drive, most likely.
    for other in periods if period is None else periods[1:]:
        for samples in (even, sawtooth):
            known = [one.grid for one in chosen]
            found = _search(samples, list(find_edges(samples, other)), other, known)
            more = [one for one in found if one not in known]
            chosen += choose_apart(_count_all(even, more, ringing, other, known), chosen)
    grids = sorted((one.grid for one in chosen), key=lambda one: one.first)
    squares = Squares(even)
    return grids or [replace(one, explained=squares.explains(squares.tune(one))) for one in seen]


def do_explain_all(even: EvenSamples, fits: list[CycleFit]) -> bool:
    """Return True if fits leave little but noise, at no longer a period than the motion has.

    Beside their runs, the runner has to move less than in the smallest step that counts.
    """
    if not fits or any(fit.residual > SETTINGS.all_but_noise * fit.noise for fit in fits):
        return False
    if any(fit.ringing.frequency * even.tick * SETTINGS.samples_a_swing > 1.0 for fit in fits):
        return False
    if any(shorter_period(even, fit.grid) is not None for fit in fits):
        return False
    runs = sorted((fit.grid for fit in fits), key=lambda one: one.first)
    begins = [even.begin, *(one.end + SETTINGS.beside * one.period for one in runs)]
    ends = [*(one.begin - SETTINGS.beside * one.period for one in runs), even.end]
    least = SETTINGS.smallest * max(one.step for one in runs)
    for begin, end in zip(begins, ends, strict=True):
        if end - begin > SETTINGS.beside * max(one.period for one in runs):
            places = even.means(np.linspace(begin, end, SETTINGS.places))
            if not np.fmax.reduce(places) - np.fmin.reduce(places) < least:  # nan in a gap
                return False
    return True


def choose_apart(fits: list[CycleFit], chosen: list[CycleFit]) -> list[CycleFit]:
    """Return the runs that explain most and overlap neither each other nor those chosen."""

    def weigh(fit: CycleFit) -> float:  # by how much of the motion it explains, and for how long
        duration = fit.grid.end - fit.grid.begin
        return duration * math.log(fit.spread / max(fit.residual, fit.noise))

    kept: list[CycleFit] = []
    for fit in sorted(fits, key=weigh, reverse=True):
        if not any(do_overlap(fit.grid, other.grid) for other in [*chosen, *kept]):
            kept.append(fit)
    return kept


def fit_ringing_down(even: EvenSamples, grids: list[SlipGrid]) -> Ringing | None:
    """Return the ringing after the runs that most of them agree on."""

    def add(window: list[Window]) -> None:
        one = fit_ringing([part for part in window if len(part[0]) > SETTINGS.samples])
        if one is not None and one.frequency > HUMMING and one.decay > 0.0:
            found.append(one)

    found: list[Ringing] = []
    for grid in grids:
        rest = min([even.end, *(one.begin for one in grids if one.first > grid.end)])
        for late in SETTINGS.rings_from:
            begin = grid.end + min(late * grid.period, SETTINGS.late)
            add([even.between(begin, min(begin + SETTINGS.rings_for, rest))])
        if grid.period > SETTINGS.rings_for:
            begins = grid.slips[-SETTINGS.slow_slips - 1 : -1] + SETTINGS.late
            last = SETTINGS.between[1] * SETTINGS.rings_for
            add([even.between(one, one + last) for one in begins])
    for grid in grids if not found else ():  # the record ends with the last slip, say
        period = grid.period
        early, late = (part * period for part in SETTINGS.between)
        add([even.between(one + early, one + late) for one in grid.slips[:-1]])
    alike = [
        sum(abs(one.frequency / other.frequency - 1.0) < SETTINGS.same_ringing for other in found)
        for one in found
    ]
    return found[int(np.argmax(alike))] if found else None


def place_on_falls(even: EvenSamples, grid: SlipGrid) -> SlipGrid:
    """Return a run with the even times at which it falls farthest, to a sample.

    The mean cycle of a slow drive has far fewer phases than samples, and hum that nearly repeats
    with it pulls its clock. Unchanged where the falls do not stand out of the motion about them.
    """
    reach, width = (round(s / even.tick) for s in (SETTINGS.around * grid.period, SETTINGS.late))
    slips, most = SETTINGS.tried
    number = np.unique(np.linspace(0, grid.count - 1, slips).astype(int))
    middle = np.rint((grid.slips[number] - even.begin) / even.tick).astype(int)
    inside = (middle >= reach + width) & (middle <= len(even.x) - reach - width)
    number, middle = number[inside], middle[inside]
    if width < 2 or reach < 4 * width or len(number) < 3:
        return grid
    beside, kernel = np.arange(-reach - width, reach + width), edge_kernel(width)[::-1]
    parts = grid.direction * (even.x[middle[:, None] + beside] - even.x[middle][:, None])
    fall = np.array([np.convolve(part, kernel, mode="valid") for part in parts])
    fall /= robust_std(fall) + 1e-30
    peaks = [scipy.signal.find_peaks(row, distance=width)[0] for row in fall]
    peaks = [one[np.argsort(-row[one])[:most]] for one, row in zip(peaks, fall, strict=True)]
    of = np.repeat(np.arange(len(peaks)), [len(one) for one in peaks])
    place, height = np.concatenate(peaks), fall[of, np.concatenate(peaks)]
    place, turn = place + middle[of] - reach, number[of]
    # Of lines through any two falls, the one that most others lie on, by how far they fall.
    a, b = np.nonzero(turn - turn[:, None] > 0.5 * (number[-1] - number[0]))
    slope = (place[b] - place[a]) / (turn[b] - turn[a])
    late = (place[a] - slope * turn[a])[:, None] + slope[:, None] * turn - place
    along = np.abs(late) <= SETTINGS.uneven
    total = along @ height
    if not np.max(total, initial=0.0) > SETTINGS.clear * math.sqrt(len(number)):
        return grid
    chosen = along[int(np.argmax(total))]
    apart, first = even.tick * np.polyfit(turn[chosen], place[chosen], 1)
    return replace(grid, first=even.begin + float(first), period=float(apart))


def _count_all(
    even: EvenSamples,
    grids: list[SlipGrid],
    ringing: Ringing,
    period: float | None,
    known: Sequence[SlipGrid] = (),
) -> list[CycleFit]:
    """Return the runs with all cycles that rise and fall alike, each up to its neighbours."""
    fits = []
    for grid in grids:
        others = [*grids, *known]
        begin = max([even.begin, *(one.end for one in others if one.end < grid.first)])
        end = min([even.end, *(one.begin for one in others if one.first > grid.end)])
        is_known = period is not None and may_have_period(grid, period)
        if is_known and period is not None:
            grid = replace(grid, period=period)
        seen = fit_cycles(even, grid, ringing, begin, end, is_known)
        fit = _settle_count(even, seen, begin, end, is_known)
        if fit is None and is_known and seen is not None:  # its period speaks for it
            fit = replace(seen, grid=replace(grid, explained=False))
        fits += [] if fit is None else [fit]
    return fits


def _settle_count(
    even: EvenSamples, fit: CycleFit | None, begin: float, end: float, known: bool
) -> CycleFit | None:
    """Return the fit with as many cycles as rise and fall alike; None if it explains nothing."""
    fitted = 0 if fit is None else fit.grid.count  # cycles when the clock was fitted
    for _ in range(SETTINGS.rounds):
        if fit is None:
            return None
        first, last = fit.extent()
        if last - first < 1:
            return None
        grid, count = fit.grid, last - first + 1
        if count == grid.count and first == 0:
            break
        grid = replace(grid, first=grid.first + first * grid.period, count=count)
        tuned = abs(count - fitted) < SETTINGS.recounted * fitted
        fitted = fitted if tuned else count
        fit = fit_cycles(even, grid, fit.ringing, begin, end, known, tuned)
    return fit if fit is not None and fit.explains() else None


def _search(
    even: EvenSamples,
    edges: list[SlipGrid],
    period: float | None,
    known: Sequence[SlipGrid] = (),
    others: bool = True,
) -> list[SlipGrid]:
    """Return the runs in the order of time; the period (s) of some of them where it is known.

    Runs of others than that period are looked for, too, unless some runs are known.
    """
    found = list(known)
    if period is not None:
        near = [replace(one, period=period) for one in edges if may_have_period(one, period)]
        _find_all(even, near, found, period)
    if others and not known:
        _find_all(even, edges, found, None)
    largest = max((one.step for one in found), default=0.0)
    kept = [one for one in found if one.step > SETTINGS.smallest * largest]
    return sorted((place_on_falls(even, one) for one in kept), key=lambda one: one.first)


def _find_all(
    even: EvenSamples,
    edges: list[SlipGrid],
    found: list[SlipGrid],
    period: float | None,
) -> None:
    """Add to the runs found those that the edges are part of; of that period (s) if it is given.

    Edges are extended to whole runs; of these, that is taken which explains most of the motion.
    """

    grids: list[SlipGrid] = []
    squares = Squares(even)

    @cache
    def whole(seed: SlipGrid) -> SlipGrid | None:
        grid, given = grow_run(even, seed), period is not None
        if grid is None or (run := check_run(even, grid, given)) is not None:
            return grid and run
        tuned = squares.tune(grid)
        return None if tuned is grid else check_run(even, tuned, given)

    def consider(seed: SlipGrid) -> None:
        grid = whole(seed)
        if grid is None or any(do_overlap(grid, other) for other in found):
            return
        if period is None or may_have_period(grid, period):
            grids.append(grid)

    apart = [one for one in edges if not any(do_overlap(one, run) for run in found)]
    highest = sorted(apart, key=lambda one: -one.score)
    # The highest falls may be those of whole runs back and forth; many even ones are no chance.
    longest = sorted(highest, key=lambda one: -one.count)
    while True:
        seeds: list[SlipGrid] = []
        for chains, most in ((highest, SETTINGS.candidates), (longest, SETTINGS.longest)):
            most += len(seeds)
            for one in chains:
                if len(seeds) == most:
                    break
                if not any(are_same(one, other) for other in seeds):
                    seeds.append(one)
        grids.clear()
        for seed in seeds:
            if not any(are_same(seed, other) for other in grids):
                consider(seed)
        if not grids:
            return
        best = max(grids, key=lambda one: one.score)
        # Ringing may repeat after a part of the period, and so do long cycles after several of
        # them.
        for factor in (1.0 / 3.0, 0.5, 2.0, 3.0) if period is None else ():
            count = round(best.count / factor)
            if count >= 2 and factor * best.period > COARSEST * even.tick:
                consider(replace(best, period=factor * best.period, count=count))
        best = max(grids, key=lambda one: one.score)
        # A motion with a period also repeats after twice the period.
        times, more = SETTINGS.rival_differs
        rivals = [
            one
            for one in grids
            if do_overlap(one, best)
            and one.period < best.period
            and one.score > SETTINGS.rival * best.score
            and one.dissimilarity < times * best.dissimilarity + more
        ]
        best = min(rivals, key=lambda one: one.period, default=best)
        # But a run that leaves far less of the motion, whatever its period, is more likely.
        left = cache(lambda one: squares.left([*found, one]))
        other = min(grids, key=left)
        if squares.resolves(best) and left(other) < left(best) - SETTINGS.clearly:
            best, other = (squares.settle_ends(one, found) for one in (best, other))
            best = other if left(other) < left(best) - SETTINGS.clearly else best
        found.append(best)
        highest, longest = (
            [one for one in chains if not do_overlap(one, best)] for chains in (highest, longest)
        )


def may_have_period(grid: SlipGrid, period: float) -> bool:
    """Return whether a run may be of a period (s): of many cycles, the last ones would show it."""
    return abs(grid.period / period - 1.0) < min(
        SETTINGS.same_period, max(SETTINGS.off / grid.count, SETTINGS.clocks)
    )


def are_same(one: SlipGrid, other: SlipGrid) -> bool:
    """Return whether two are of one direction and period and lie about one another."""
    alike = abs(one.period / other.period - 1.0) <= SETTINGS.same_chain
    about = one.begin < other.end and other.begin < one.end
    return bool(one.direction == other.direction and alike and about)


def do_overlap(one: SlipGrid, other: SlipGrid) -> bool:
    """Return whether two runs share more than half a cycle of the longer period."""
    common = min(one.end, other.end) - max(one.begin, other.begin)
    return common > 0.5 * min(max(one.period, other.period), one.end - one.begin)
