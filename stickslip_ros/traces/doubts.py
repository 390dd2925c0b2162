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
from numpy.typing import NDArray

from stickslip_ros.traces.cycles import FASTER
from stickslip_ros.traces.even_samples import (
    EvenSamples,
    SlipGrid,
    cycles_on_grid,
    fill_gaps,
    phases_of,
    without_trend,
)
from stickslip_ros.traces.hum import MAINS
from stickslip_ros.traces.ringing import Ringing

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DoubtSettings:
    """Limits beyond which a run is not determined."""

    cycles: int = 3  #: two cycles have one distance, which nothing confirms
    samples: float = 10.0  #: of a cycle; with fewer, faster drives look like slower ones
    rest: float = 0.5  #: periods of rest beside a run that separate its steps from drift
    #: Periods after a run that may hold a rise without a slip, and ringing.
    after: float = 1.2
    #: Of a step: how far the runner may move in what is called a rest. A missed cycle moves it by
    #: one, drift and hum of a bench by less than a third.
    moved: float = 0.6
    #: Steps by which the distance between the rests may miss the number of steps: the first cycles
    #: get up to half a step less far than the settled ones.
    miscounted: float = 0.75
    #: Part of the motion within cycles that differs between neighbours, in the median: noise that
    #: adds up makes a third of it, cycles cut at a wrong period one.
    dissimilarity: float = 0.6
    #: Samples in a row that a record which is cut off stays at its outermost value, and times as
    #: many as at any other: the steps of a converter make such stretches everywhere.
    held: tuple[int, float] = (12, 20.0)
    swing: float = 0.03  #: part by which the period of the ringing, seen as a shorter one, is off
    mains: float = 0.5  #: periods over a run by which its clock may be off that of the mains
    exact: float = 1e-11  #: noise (m) below which positions are simulated, and not cut off
    looked_at: int = 64  #: cycles that are tested, from the middle


SETTINGS = DoubtSettings()


def doubts_of(
    even: EvenSamples,
    run: SlipGrid,
    others: list[SlipGrid],
    step: float,
    shorter: float | None,
    ringing: Ringing | None = None,
    given: bool = True,
    settings: DoubtSettings = SETTINGS,
) -> tuple[str, ...]:
    """Return why a run is not determined; empty if it is.

    others are the other runs of the record, step (m) is the size of its steps, shorter a shorter
    period (s) at which the run repeats better. It may be hum if no ringing shows its slips, and
    its period was not given. Drift and hum that are known are left out of even.
    """
    found = []
    if not run.explained:
        found.append("no run of equal steps explains the motion")
    found += too_few(run.count, 1.0 / run.period, 1.0 / even.tick, settings)
    before, after = _rests_beside(even, run, others, ringing, settings)
    if before is None and after is None:
        found.append("no rest beside the run, so step and drift cannot be told apart")
    found += _moved_within(before, after, abs(step), settings)
    if before is not None and after is not None and step:
        distance = run.direction * (float(np.median(after)) - float(np.median(before)))
        counted = distance / abs(step)
        if abs(counted - run.count) > settings.miscounted + 0.02 * run.count:
            found.append(
                f"the rests are {counted:.1f} steps apart, but {run.count} cycles are seen"
            )
    near = settings.mains / (run.end - run.begin)
    swings = 0.0 if ringing is None else ringing.frequency
    if not (swings or given) and any(abs(1.0 / run.period - one) < near for one in MAINS):
        found.append("cycles as long as those of the mains, without ringing, may be hum")
    own = _unlike(even, run, settings)
    if own > settings.dissimilarity:
        found.append(f"{100 * min(own, 1.0):.0f} % of the motion differs from cycle to cycle")
    elif shorter is not None and abs(shorter * swings - 1.0) > settings.swing:
        found.append(f"the motion repeats better at {1.0 / shorter:.6g} Hz")
    return tuple(found)


def too_few(
    cycles: int, frequency: float, rate: float, settings: DoubtSettings = SETTINGS
) -> tuple[str, ...]:
    """Return what is to be said of few cycles, or few samples (rate Hz) in each (frequency Hz)."""
    found = []
    if cycles < settings.cycles:
        found.append(f"{cycles} cycles; {settings.cycles} are needed")
    if rate / frequency < settings.samples:
        found.append(
            f"{rate:.4g} samples a second are {rate / frequency:.1f} a cycle at {frequency:.6g} "
            f"Hz; {settings.samples:g} are needed: {FASTER}"
        )
    return tuple(found)


def find_clipping(even: EvenSamples, settings: DoubtSettings = SETTINGS) -> tuple[str, ...]:
    """Return what is to be said of a record that stays at its end as nowhere else."""
    ends = np.flatnonzero(np.diff(even.x, append=math.nan) != 0.0)  # of stretches of one value
    long = np.diff(ends, prepend=-1)
    outer = np.isin(even.x[ends], [even.x.min(), even.x.max()])
    longest = int(np.max(long[outer], initial=0))
    if even.noise < settings.exact or longest < settings.held[0]:
        return ()
    if longest < settings.held[1] * int(np.max(long[~outer], initial=1)):
        return ()
    return (f"{longest} samples in a row have the record's outermost value: it was cut off there",)


def _rests_beside(
    even: EvenSamples,
    run: SlipGrid,
    others: list[SlipGrid],
    ringing: Ringing | None,
    settings: DoubtSettings,
) -> tuple[Array | None, Array | None]:
    """Return places (m) before and after a run, means over a swing; None without a rest there."""
    begin = max([even.begin, *(one.end + settings.after * one.period for one in others
                               if one.first < run.first)])  # fmt: skip
    end = min([even.end, *(one.begin for one in others if one.first > run.first)])
    late = run.end + settings.after * run.period
    if run.end + settings.rest * run.period < end < late + 0.1 * run.period:
        late = run.end + 0.1 * run.period  # nothing but the first period of the rest is seen
    rests = []
    for first, last in ((begin, run.begin - 0.05 * run.period), (late, end)):
        long = last - first > settings.rest * run.period or last - first > 40 * even.tick
        width = max(8 * even.tick, 0.0 if ringing is None else 1.0 / ringing.frequency)
        count = int(np.clip((last - first) / width, 4, 100)) if long else 0
        places = even.means(np.linspace(first, last, count + 1)) if long else np.empty(0)
        places = places[np.isfinite(places)]
        rests.append(places if len(places) > 2 else None)
    return rests[0], rests[1]


def _moved_within(
    before: Array | None, after: Array | None, step: float, settings: DoubtSettings
) -> list[str]:
    """Return the doubt about rests in which the runner moves like in steps; else empty."""
    for rest, name in ((before, "before"), (after, "after")):
        if rest is not None:
            moved = float(np.quantile(rest, 0.98) - np.quantile(rest, 0.02))
            if moved > settings.moved * step:
                return [
                    f"the runner moves by {1e9 * moved:.1f} nm {name} the run, about as far as in "
                    "a step"
                ]
    return []


def _unlike(even: EvenSamples, run: SlipGrid, settings: DoubtSettings) -> float:
    """Return what part of the motion differs between neighbouring cycles; nan if unknown."""
    if run.count < settings.cycles:
        return math.nan
    phases = phases_of(even, run.period)
    phases = phases[phases < 0.0]
    first = max(min(3, run.count - 2), (run.count - settings.looked_at) // 2)
    # Cut half a cycle away from the slips: a slip between two rows would be in none of them.
    ends = run.slips[first : first + settings.looked_at] - 0.5 * run.period
    rows = fill_gaps(cycles_on_grid(even, ends[1:], run.period, phases))
    rows = without_trend(rows[np.isfinite(rows).all(axis=1)], phases)
    if len(rows) < 2:
        return math.nan
    chance = even.noise**2 * max(len(phases) * even.tick / run.period, 1.0)
    differing = 0.5 * float(np.median(np.mean((rows[1:] - rows[:-1]) ** 2, axis=1)))
    moving = float(np.mean(rows**2))
    return max(differing - chance, 0.0) / max(moving - chance, 1e-40)
