# SPDX-License-Identifier: Apache-2.0
"""Tests whether residuals are more than noise, and finds the effect that explains them best.

An effect of the model that would lower the deviance by more than chance (`effects`) is one. Four
more tests use the whitened residuals. Averaged over the phases of the drive cycle, they must not
differ by more than chance: otherwise the model lacks a part of each cycle. Nor must they differ in
each third of the run, because the residuals of a changing axis change their sign. And the means of
cycles must not differ: otherwise, too, the axis changed during the run. And they must not be far
larger in motion than at rest, where the sensor alone makes them. All tests compare variances (F),
at a significance that chance reaches once in thousands of measurements.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.arrays import Array
from stickslip_ros.identification.curve import CurveFit
from stickslip_ros.identification.effects import SeenEffect
from stickslip_ros.identification.fit import Misfit
from stickslip_ros.identification.least_squares import Point, Problem
from stickslip_ros.identification.settings import MISFIT
from stickslip_ros.identification.trace_fit import CLOCK, TraceFit
from stickslip_ros.reporting import format_si


def misfit_of(problem: Problem, best: Point, effects: Sequence[SeenEffect]) -> Misfit | None:
    """Return the residuals that are more than noise, None if there are none.

    effects are those of the fit, the largest first.
    """
    runs: list[tuple[_Finding, _Finding, _Finding]] = []
    loud: list[_Finding] = []
    row = 0
    for k, fit in enumerate(problem.fits):
        rows = slice(row, row + fit.size)
        row = rows.stop
        if isinstance(fit, CurveFit):
            continue
        clock = problem.clock(best.unknowns, k)
        loud += _in_motion(fit, best.residuals[rows][: len(fit.kept)], fit.cycles(clock))
        starts = fit.starts + CLOCK * clock[:-1]
        for run, start in zip(fit.experiment.runs, starts.tolist(), strict=True):
            place = (fit.bins.t - start) * run.frequency
            inside = (place >= 0.0) & (place < abs(run.steps)) & (fit.kept > 0.0)
            cycles = abs(run.steps)
            if cycles < MISFIT.fewest or np.count_nonzero(inside) < MISFIT.bins * cycles:
                continue
            white = best.residuals[rows][: len(inside)][inside]
            left = fit.unprojected(best.seen[k])[inside]
            source, period = fit.experiment.motion.source, 1.0 / run.frequency
            within = _within_cycle(white, left, place[inside], period, problem.size, source)
            along = _along_run(white, left, place[inside], problem.size)
            runs.append((within, along, _between_cycles(white, left, place[inside])))
    found = [*(one for three in runs for one in three), *loud]
    if not runs:
        return None
    probability = min(1.0, *(one.chance * len(found) for one in found))
    clear = [one for one in effects if one.clear]
    if not (probability < MISFIT.chance or clear):
        return None
    within, along, between = max(runs, key=lambda three: sum(one.size for one in three))
    text = "; ".join([within.text, along.text, between.text, *(one.text for one in loud)])
    changed = between.size > MISFIT.changed * within.size
    if changed or along.size > MISFIT.part_changed * within.size:
        text += ", so the axis changed during the run: its preload, its track or its load"
    if clear and clear[0].effect.cure:
        return Misfit(
            f"{text}; {clear[0].effect.text} explains it: {clear[0].effect.cure}", probability
        )
    beyond = max(sum(max(one.beyond for one in three) for three in runs), 1e-9)
    named = [
        f"{one.effect.text} would take up {100.0 * min(one.fall / beyond, 1.0):.0f} % of it"
        for one in effects[: MISFIT.named]
        if one.clear or one.fall > MISFIT.takes_up * beyond
    ]
    causes = ", or ".join(named) or "no single effect of the model takes it up"
    return Misfit(f"{text}; {causes}", probability)


@dataclass(frozen=True)
class _Finding:
    """One test: how likely by chance, the squares beyond it, how large (m), and in words."""

    chance: float
    beyond: float
    size: float
    text: str


def _chance_of_means(white: Array, group: NDArray[np.int64], fitted: int) -> tuple[float, float]:
    """Return how likely means of groups differ as much by chance, and their squares beyond it."""
    _, group = np.unique(group, return_inverse=True)
    count = np.bincount(group)
    means = np.bincount(group, white) / count
    between = float(np.sum(count * (means - white.mean()) ** 2))
    within = float(np.sum((white - means[group]) ** 2))
    free, left = max(len(count) - 1 - fitted, 1), len(white) - len(count)
    if left < 1 or within <= 0.0:
        return 1.0, 0.0
    chance = float(scipy.stats.f.sf(between / free / (within / left), free, left))
    return chance, max(between - free * within / left, 0.0)


def _within_cycle(
    white: Array, left: Array, place: Array, period: float, fitted: int, source: str
) -> _Finding:
    phase, count = _phases(place)
    chance, beyond = _chance_of_means(white, phase, min(fitted, count // MISFIT.per_fitted))
    number = np.maximum(np.bincount(phase, minlength=count), 1)
    means = np.bincount(phase, left, minlength=count) / number
    size = float(np.sqrt(np.mean(means**2)))
    worst = int(np.argmax(means**2))
    after = (worst + 0.5) / count
    where = (
        f"{format_si(after * period, 's', 3)} after the slip"
        if after < 0.5
        else f"{format_si((1.0 - after) * period, 's', 3)} before the slip"
    )
    text = (
        f"{source}: {format_si(size, 'm', 2)} (root mean square) that repeats with the drive is "
        f"not noise; it is largest, {format_si(float(abs(means[worst])), 'm', 2)}, {where}"
    )
    return _Finding(chance, beyond, size, text)


def _phases(place: Array) -> tuple[NDArray[np.int64], int]:
    """Return the phase of the cycle that each bin belongs to, and how many there are."""
    cycles = math.ceil(float(place.max()))
    count = int(np.clip(len(place) // cycles, *MISFIT.phases))
    return np.minimum((np.mod(place, 1.0) * count).astype(np.int64), count - 1), count


def _along_run(white: Array, left: Array, place: Array, fitted: int) -> _Finding:
    phase, count = _phases(place)
    cycles = math.ceil(float(place.max()))
    parts = min(MISFIT.parts, cycles // MISFIT.of_a_part)
    if parts < 2:
        return _Finding(1.0, 0.0, 0.0, "the run is too short to show a change")
    group = phase + count * np.minimum(place / cycles * parts, parts - 1).astype(np.int64)
    chance, beyond = _chance_of_means(white, group, min(fitted, count // MISFIT.per_fitted))
    whole, own = (
        (np.bincount(one, left) / np.maximum(np.bincount(one), 1))[one] for one in (phase, group)
    )
    # Noise makes means of parts differ, too.
    noise = float(np.sum((left - own) ** 2)) / max(len(left) - count * parts, 1)
    power = float(np.mean((own - whole) ** 2)) - noise * count * (parts - 1) / len(left)
    size = math.sqrt(max(power, 0.0))
    text = f"parts of the run differ in that by {format_si(size, 'm', 2)}"
    return _Finding(chance, beyond, size, text)


def _between_cycles(white: Array, left: Array, place: Array) -> _Finding:
    cycle = place.astype(np.int64)
    chance, beyond = _chance_of_means(white, cycle, 2)
    means = np.bincount(cycle, left) / np.maximum(np.bincount(cycle), 1)
    worst = int(np.argmax(np.abs(means)))
    text = (
        f"the means of cycles are up to {format_si(float(abs(means[worst])), 'm', 2)} off "
        f"(cycle {worst + 1})"
    )
    return _Finding(chance, beyond, float(np.sqrt(np.mean(means**2))), text)


def _in_motion(fit: TraceFit, white: Array, cycle: Array) -> list[_Finding]:
    """Return how much larger residuals are in motion than at rest, if that is more than chance."""
    kept = fit.kept > 0.0
    moving, still = white[kept & np.isfinite(cycle)], white[kept & np.isnan(cycle)]
    if min(len(moving), len(still)) < MISFIT.at_rest:
        return []
    # Where it rests, a sensor that rounds makes no noise.
    step = np.abs(np.diff(fit.experiment.motion.x))
    rounding = float(np.min(step[step > 0.0])) ** 2 / (12.0 * fit.noise.size**2)
    ratio = float(np.mean(moving**2)) / (float(np.mean(still**2)) + rounding)
    chance = float(scipy.stats.f.sf(ratio / MISFIT.louder**2, len(moving), len(still)))
    text = f"the noise is {math.sqrt(ratio):.2g} times that at rest"
    return [_Finding(chance, 0.0, 0.0, text)] if chance < MISFIT.chance else []
