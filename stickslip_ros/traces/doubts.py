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

from stickslip_ros.traces.even_samples import (
    EvenSamples,
    SlipGrid,
    cycles_on_grid,
    fill_gaps,
    phases_of,
    without_trend,
)

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
    #: A part of the period repeats as well as the period if its differences are at most this many
    #: times as large, plus this part of the motion: ringing near to step makes 0.4 to 3 %.
    as_well: tuple[float, float] = (1.5, 0.002)
    #: Motion within parts of a period, relative to that of noise: below this ratio, noise hides
    #: whether the parts repeat.
    visible: float = 2.0
    parts: tuple[int, ...] = (2, 3, 4, 5, 6, 7)  #: parts of a period that are tested
    exact: float = 1e-11  #: noise (m) below which positions are simulated, and do not drift
    looked_at: int = 64  #: cycles that are tested, from the middle


SETTINGS = DoubtSettings()


def doubts_of(
    even: EvenSamples,
    run: SlipGrid,
    others: list[SlipGrid],
    step: float,
    settings: DoubtSettings = SETTINGS,
) -> tuple[str, ...]:
    """Return why a run is not determined; empty if it is.

    others are the other runs of the record, step (m) is the size of its steps.
    """
    found = []
    if not run.explained:
        found.append("no run of equal steps explains the motion")
    if run.count < settings.cycles:
        found.append(f"{run.count} cycles; {settings.cycles} are needed")
    samples = run.period / even.tick
    if samples < settings.samples:
        found.append(f"{samples:.1f} samples a cycle; {settings.samples:g} are needed")
    before, after = _rests_beside(even, run, others, settings)
    if before is None and after is None and even.noise > settings.exact:
        found.append("no rest beside the run, so step and drift cannot be told apart")
    found += _moved_within(before, after, abs(step), settings)
    if before is not None and after is not None and step:
        distance = run.direction * (float(np.median(after)) - float(np.median(before)))
        counted = distance / abs(step)
        if abs(counted - run.count) > settings.miscounted + 0.02 * run.count:
            found.append(
                f"the rests are {counted:.1f} steps apart, but {run.count} cycles are seen"
            )
    return tuple(found + _repeats(even, run, settings))


def _rests_beside(
    even: EvenSamples, run: SlipGrid, others: list[SlipGrid], settings: DoubtSettings
) -> tuple[Array | None, Array | None]:
    """Return places (m) before and after a run, (n,) each; None without a rest there."""
    begin = max([even.begin, *(one.end + settings.after * one.period for one in others
                               if one.first < run.first)])  # fmt: skip
    end = min([even.end, *(one.begin for one in others if one.first > run.first)])
    late = run.end + settings.after * run.period
    if run.end + settings.rest * run.period < end < late + 0.1 * run.period:
        late = run.end + 0.1 * run.period  # nothing but the first period of the rest is seen
    rests = []
    for first, last in ((begin, run.begin - 0.05 * run.period), (late, end)):
        long = last - first > settings.rest * run.period or last - first > 40 * even.tick
        count = int(np.clip((last - first) / even.tick / 8, 4, 100)) if long else 0
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


def _repeats(even: EvenSamples, run: SlipGrid, settings: DoubtSettings) -> list[str]:
    """Return the doubt about cycles that do not repeat, or repeat more often than counted."""
    if run.count < settings.cycles:
        return []
    own = _unlike(even, run, 1, settings)
    if own > settings.dissimilarity:
        return [f"{100 * min(own, 1.0):.0f} % of the motion differs from cycle to cycle"]
    times, more = settings.as_well
    for part in settings.parts:
        if _unlike(even, run, part, settings) <= times * own + more:
            return [f"the cycles repeat {part} times as often as {1.0 / run.period:.6g} Hz"]
    return []


def _unlike(even: EvenSamples, run: SlipGrid, part: int, settings: DoubtSettings) -> float:
    """Return the difference of neighbouring parts, with cycles cut in parts; nan if unknown."""
    period = run.period / part
    if period < 4.0 * even.tick:
        return math.nan
    phases = phases_of(even, period)
    phases = phases[phases < 0.0]
    first = max(min(3, run.count - 2), (run.count - settings.looked_at) // 2)
    last = min(run.count, first + settings.looked_at)
    # Cut half a part away from the slips: a slip between two rows would be in none of them.
    ends = np.asarray(run.begin + period * (np.arange(first * part, last * part) + 0.5), np.float64)
    rows = fill_gaps(cycles_on_grid(even, ends[1:], period, phases))
    rows = without_trend(rows[np.isfinite(rows).all(axis=1)], phases)
    if len(rows) < 2:
        return math.nan
    chance = even.noise**2 * max(len(phases) * even.tick / period, 1.0)
    differing = 0.5 * float(np.median(np.mean((rows[1:] - rows[:-1]) ** 2, axis=1)))
    if part > 1:  # one slip among several rows is none of the median
        differing = 0.5 * float(np.mean((rows[1:] - rows[:-1]) ** 2))
    moving = float(np.mean(rows**2))
    if part > 1 and moving < settings.visible * chance:
        return math.nan
    return max(differing - chance, 0.0) / max(moving - chance, 1e-40)
