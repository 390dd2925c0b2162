# SPDX-License-Identifier: Apache-2.0
"""Reasons why a record does not determine a run, in words.

A small standard error does not help if the record cannot determine a number. So each run is checked
independently of the search: is there a rest that separates steps from drift, are there enough
cycles and samples, do the cycles repeat, do they repeat with a part of the period, and is the
distance between the rests the sum of the counted steps?
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stickslip_ros.arrays import Array
from stickslip_ros.motion.settled import settled_from
from stickslip_ros.traces.cycle_fit import CycleFit, fit_cycles
from stickslip_ros.traces.cycles import FASTER, SAMPLES
from stickslip_ros.traces.even_samples import (
    EvenSamples,
    SlipGrid,
    cycles_on_grid,
    fill_gaps,
    mean_cycle,
    phases_of,
    quantum_of,
    sample_cycles,
    without_trend,
)
from stickslip_ros.traces.hum import MAINS
from stickslip_ros.traces.measured_value import MeasuredValue
from stickslip_ros.traces.ringing import Ringing
from stickslip_ros.traces.run_growth import find_shifts, fit_line
from stickslip_ros.traces.squares import Squares


@dataclass(frozen=True)
class DoubtSettings:
    """Limits beyond which a run is not determined."""

    cycles: int = 3  #: two cycles have one distance, which nothing confirms
    rest: float = 0.5  #: periods of rest beside a run that separate its steps from drift
    #: Periods after a run that may hold a rise without a slip, and ringing.
    after: float = 1.2
    apart: tuple[float, float] = (0.05, 0.1)  #: periods before and after a run that are no rest
    short: int = 40  #: samples of a rest that show it, however short; samples of a place in it
    place: int = 8
    places: tuple[int, int] = (4, 20)  #: of a rest, at least and at most
    range: tuple[float, float] = (0.02, 0.98)  #: of such places, from which to which count
    #: Of a step: how far the runner may move in what is called a rest. A missed cycle moves it by
    #: one, drift and hum of a bench by less than a third.
    moved: float = 0.6
    #: Root mean square by which slips may miss even times, in periods and in swings of the ringing:
    #: noise and drift make a half of one or of the other, sweeps of 10 % over a run more than both.
    uneven: tuple[float, float] = (0.004, 0.1)
    #: Logarithm of how many times as likely a first or last cycle is as none, or none as one.
    likely: float = math.log(10.0)
    #: Damping ratio, and samples of a swing, of the contact where no ringing is seen: it follows.
    follows: tuple[float, float] = (0.5, 6.0)
    #: Steps by which the distance between the rests may miss the number of steps: the first cycles
    #: get up to half a step less far than the settled ones.
    miscounted: float = 0.75
    growing: float = 0.02  #: the same, and for each cycle
    confirmed: float = 0.5  #: the same below which that distance confirms the number
    #: Steps that it may lack if the last cycle is one: a rise without a slip gets about as far.
    lacking: float = 0.1
    #: Part of the motion within cycles that differs between neighbours, in the median: noise that
    #: adds up makes a third of it, cycles cut at a wrong period one.
    dissimilarity: float = 0.6
    #: Samples in a row that a record which is cut off stays at its outermost value, and times as
    #: many as at any other: the steps of a converter make such stretches everywhere.
    held: tuple[int, float] = (12, 20.0)
    rounded: float = 4.0  #: steps of the converter that are no move
    stops: float = 0.5  #: of the usual way in so many samples, after which no runner rests at once
    #: Times the step between samples that all but this part keep below, and part by which jumps may
    #: miss whole multiples of the least one: no contact moves its runner so.
    jump: float = 4.0
    moving: float = 0.999
    alike: float = 0.1
    swings: float = 2.5  #: of the ringing, in a shorter period that is one of ringing, not of steps
    mains: float = 0.5  #: periods over a run by which its clock may be off that of the mains
    exact: float = 1e-10  #: noise (m) below which positions are simulated, and rest at one value
    looked_at: int = 64  #: cycles that are tested, from the middle


SETTINGS = DoubtSettings()


def doubts_of(
    even: EvenSamples,
    run: SlipGrid,
    others: list[SlipGrid],
    step: MeasuredValue,
    shorter: float | None,
    ringing: Ringing | None = None,
    given: bool = True,
) -> tuple[str, ...]:
    """Return why a run is not determined; empty if it is.

    others are the other runs of the record, step (m) is that of the run, shorter a shorter
    period (s) at which the run repeats better. It may be hum if no ringing shows its slips, and
    its period was not given. Drift and hum that are known are left out of even.
    """
    found, squares = [], Squares(even)
    repeats = squares.explains(squares.tune(run))
    # Where ringing is seen, the search has asked this.
    free = fit_ends(even, run, others, ringing) if ringing is None else None
    unlikely = free is not None and not (free.explains() or repeats)
    fit = fit_ends(even, run, others, ringing, equal=True)
    if not run.explained or unlikely:
        found.append("no run of equal steps explains the motion")
    found += too_few(run.count, 1.0 / run.period, 1.0 / even.tick)
    before, after = _rests_beside(even, run, others, ringing)
    if before is None and after is None:
        found.append("no rest beside the run, so step and drift cannot be told apart")
    for rest, name in ((before, "before"), (after, "after")):
        moved = 0.0 if rest is None else float(np.diff(np.quantile(rest, SETTINGS.range))[0])
        if moved > SETTINGS.moved * abs(step.value):
            found.append(
                f"the runner moves by {1e9 * moved:.1f} nm {name} the run, about as far as in a "
                "step"
            )
            break
    steps = np.zeros(0) if fit is None else fit.rise - fit.fall
    confirmed = complete = False
    if before is not None and after is not None and step.value:
        distance = run.direction * (float(np.median(after)) - float(np.median(before)))
        uncertain = run.count * abs(step.error / step.value)
        counted = distance / abs(step.value)
        confirmed = abs(counted - run.count) + uncertain < SETTINGS.confirmed
        complete = confirmed and run.count - counted + uncertain < SETTINGS.lacking
        if fit is not None:  # the first steps are other ones
            settled = settled_from(run.count)
            first = (fit.number >= 0) & (fit.number < settled)
            later = (fit.number >= settled) & (fit.number < run.count - 1)
            # All of a fit may rise by a part of the drift.
            usual = float(np.median(steps[later])) if later.any() else abs(step.value)
            distance += float(np.sum(usual - steps[first]))
            counted = distance / abs(step.value)
        missing = SETTINGS.miscounted + SETTINGS.growing * run.count + uncertain
        rise = 0.0 if fit is None else float(np.sum(steps[fit.number == run.count]))
        without_slip = max(rise, 0.0) / abs(step.value)  # which is no step
        if not -missing < counted - run.count < missing + without_slip:
            found.append(
                f"the rests are {counted:.1f} steps apart, but {run.count} cycles are seen"
            )
    if fit is not None and not (unlikely or complete):
        numbers = {run.count}
        for number, odd, seen in zip(fit.number, fit.odds, fit.seen, strict=True):
            if confirmed and number != run.count - 1:
                continue
            if number in (0, run.count - 1) and seen and odd < SETTINGS.likely:
                numbers.add(run.count - 1)
            elif number in (-1, run.count) and seen and odd > -SETTINGS.likely:
                numbers.add(run.count + 1)
        if len(numbers) > 1:  # cycles at an end are hardly told from none
            found.append(" or ".join(map(str, sorted(numbers))) + " steps")
    near = SETTINGS.mains / (run.end - run.begin)
    swings = 0.0 if ringing is None else ringing.frequency
    if not (swings or given) and any(abs(1.0 / run.period - one) < near for one in MAINS):
        found.append("cycles as long as those of the mains, without ringing, may be hum")
    uneven = _unevenness(even, run)
    if uneven > max(SETTINGS.uneven[0] * run.period, even.tick) and (
        uneven * swings > SETTINGS.uneven[1] or not swings
    ):
        found.append(f"the slips miss even times by {100 * uneven / run.period:.2g} % of a period")
    own = 0.0 if repeats else _unlike(even, run)
    if own > SETTINGS.dissimilarity:
        found.append(f"{100 * min(own, 1.0):.0f} % of the motion differs from cycle to cycle")
    elif shorter is not None and not 0.0 < shorter * swings < SETTINGS.swings:
        found.append(f"the motion repeats better at {1.0 / shorter:.6g} Hz")
    return tuple(found)


def too_few(cycles: int, frequency: float, rate: float) -> tuple[str, ...]:
    """Return what is to be said of few cycles, or few samples (rate Hz) in each (frequency Hz)."""
    found = []
    if cycles < SETTINGS.cycles:
        found.append(f"{cycles} cycles; {SETTINGS.cycles} are needed")
    if round(rate / frequency, 1) < SAMPLES:  # as it is printed
        found.append(
            f"{rate:.4g} samples a second are {rate / frequency:.1f} a cycle at {frequency:.6g} "
            f"Hz; {SAMPLES:g} are needed: {FASTER}"
        )
    return tuple(found)


def find_clipping(x: Array, noise: float) -> tuple[str, ...]:
    """Return what is to be said of samples (m) that stay at their end as nowhere else.

    With noise (m), no rest has one value so long; without, no runner comes to rest at once.
    """
    ends = np.flatnonzero(np.diff(x, append=math.nan) != 0.0)  # of stretches of one value
    long = np.diff(ends, prepend=-1)
    outer = np.isin(x[ends], [x.min(), x.max()])
    least, times = SETTINGS.held
    held = outer & (long >= least)
    rounded = quantum_of(x)
    if noise < max(SETTINGS.exact, rounded):
        moved = np.abs(x[least:] - x[:-least])
        before = ends - long - least
        usual = max(float(np.median(moved[moved > 0.0])), SETTINGS.rounded * rounded)
        held &= (before >= 0) & (moved[np.maximum(before, 0)] > SETTINGS.stops * usual)
    else:
        held &= long >= times * int(np.max(long[~outer], initial=1))
    if not held.any():
        return ()
    longest = int(np.max(long[held]))
    return (f"{longest} samples in a row have the record's outermost value: it was cut off there",)


def find_jumps(x: Array) -> tuple[str, ...]:
    """Return what is to be said of jumps by one length between samples (m) that move little else.

    An interferometer that loses count jumps by whole fringes, half its wavelength.
    """
    steps = np.abs(np.diff(x))
    jumps = steps[steps > SETTINGS.jump * np.quantile(steps, SETTINGS.moving)]
    if not len(jumps):
        return ()
    least = float(jumps.min())
    if np.abs(jumps / least - np.rint(jumps / least)).max() > SETTINGS.alike:
        return ()
    size = f"{1e9 * float(np.median(jumps / np.rint(jumps / least))):.4g} nm"
    return (
        f"{len(jumps)} jumps by {size} between samples: if an interferometer lost count there, "
        "--wavelength takes them out",
    )


def _rests_beside(
    even: EvenSamples,
    run: SlipGrid,
    others: list[SlipGrid],
    ringing: Ringing | None,
) -> tuple[Array | None, Array | None]:
    """Return places (m) before and after a run, means over a swing; None without a rest there."""
    begin = max([even.begin, *(one.end + SETTINGS.after * one.period for one in others
                               if one.first < run.first)])  # fmt: skip
    end = min([even.end, *(one.begin for one in others if one.first > run.first)])
    late, (close, soon) = run.end + SETTINGS.after * run.period, SETTINGS.apart
    if run.end + SETTINGS.rest * run.period < end < late + soon * run.period:
        late = run.end + soon * run.period  # nothing but the first period of the rest is seen
    rests = []
    for first, last in ((begin, run.begin - close * run.period), (late, end)):
        long = last - first > min(SETTINGS.rest * run.period, SETTINGS.short * even.tick)
        width = max(SETTINGS.place * even.tick, 0.0 if ringing is None else 1.0 / ringing.frequency)
        count = int(np.clip((last - first) / width, *SETTINGS.places)) if long else 0
        places = even.means(np.linspace(first, last, count + 1)) if long else np.empty(0)
        places = places[np.isfinite(places)]
        rests.append(places if len(places) > 2 else None)
    if rests[0] is None and end - run.end < run.period:
        return None, None  # what follows may be a rise as well, whose slip is not seen any more
    return rests[0], rests[1]


def fit_ends(
    even: EvenSamples,
    run: SlipGrid,
    others: list[SlipGrid],
    ringing: Ringing | None,
    equal: bool = False,
) -> CycleFit | None:
    """Return rises and falls of a run and beyond its ends, by the clock that was found.

    If equal, its cycles but the first and the last one are taken for such.
    """
    if ringing is None:
        damping, samples = SETTINGS.follows
        swing = samples * max(even.tick, run.period / 100.0)
        ringing = Ringing(1.0 / swing, 2.0 * math.pi * damping / swing)
    begin = max([even.begin, *(one.end for one in others if one.first < run.first)])
    end = min([even.end, *(one.begin for one in others if one.first > run.first)])
    return fit_cycles(even, run, ringing, begin, end, tuned=True, equal=equal)


def _unevenness(even: EvenSamples, run: SlipGrid) -> float:
    """Return the root mean square (s) by which settled slips miss even times; nan if unknown."""
    number = sample_cycles(run.count)[settled_from(run.count) :]
    if len(number) < 3:
        return math.nan
    phases = phases_of(even, run.period)
    rows = run.direction * cycles_on_grid(even, run.slips[number], run.period, phases)
    late = find_shifts(rows, mean_cycle(rows), phases, run.period)
    known = np.isfinite(late)
    if known.sum() < 3:
        return math.nan
    slope, about = fit_line(number[known].astype(np.float64), late[known])
    return float(np.std(late[known] - about - slope * number[known]))


def _unlike(even: EvenSamples, run: SlipGrid) -> float:
    """Return what part of the motion differs between neighbouring cycles; nan if unknown."""
    if run.count < SETTINGS.cycles:
        return math.nan
    phases = phases_of(even, run.period)
    phases = phases[phases < 0.0]
    first = max(min(3, run.count - 2), (run.count - SETTINGS.looked_at) // 2)
    # Cut half a cycle away from the slips: a slip between two rows would be in none of them.
    ends = run.slips[first : first + SETTINGS.looked_at] - 0.5 * run.period
    rows = fill_gaps(cycles_on_grid(even, ends[1:], run.period, phases))
    rows = without_trend(rows[np.isfinite(rows).all(axis=1)], phases)
    if len(rows) < 2:
        return math.nan
    chance = even.noise**2 * max(len(phases) * even.tick / run.period, 1.0)
    differing = 0.5 * float(np.median(np.mean((rows[1:] - rows[:-1]) ** 2, axis=1)))
    moving = float(np.mean(rows**2))
    return max(differing - chance, 0.0) / max(moving - chance, 1e-40)
