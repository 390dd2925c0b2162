# SPDX-License-Identifier: Apache-2.0
"""Tests whether residuals are more than noise, and names the effect that explains them best.

What repeats with the drive stands in the harmonics of the drive, noise as much beside them (F
test). Where a record shows rest, the residuals in motion must not be far larger than there, where
the sensor alone makes them. And no effect of the model may lower the deviance by more than chance
(`effects`): it is named with its size.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.reporting import format_si
from stickslip_ros.measurement.identification.effects import CHANCE, SeenEffect
from stickslip_ros.measurement.identification.fit import Misfit
from stickslip_ros.measurement.identification.intervals import Surroundings
from stickslip_ros.measurement.identification.trace import Trace
from stickslip_ros.measurement.steps.noise import quantum_of
from stickslip_ros.physics.model import Plant

#: Ratio of residuals in motion to those at rest that sensors may have; blocks of a rest at least.
_LOUDER, _AT_REST = 1.4, 100
#: Bins in and beside the harmonics without which a band is not tested.
_IN, _BESIDE = 4, 8
#: Part of the largest fall of the deviance from which on a second effect is named, too.
_SECOND = 0.5


@dataclass(frozen=True)
class _Finding:
    """One test: how likely by chance, and in words."""

    chance: float
    text: str


def misfit_of(around: Surroundings, effects: Sequence[SeenEffect]) -> Misfit | None:
    """Return the residuals that are more than noise, None if there are none.

    effects are those of the fit, the largest first.
    """
    problem, best = around.problem, around.best
    found: list[_Finding] = []
    row = 0
    for k, fit in enumerate(problem.fits):
        if isinstance(fit, Trace):
            left = fit.left(best.seen[k])
            ringing = Plant.of(problem.applied(fit.parameters, best.unknowns)).ringing_frequency
            found += _harmonics(fit, best.residuals[row : row + fit.size], left, ringing)
            found += _in_motion(fit, left, fit.cycles(problem.clock(best.unknowns, k)))
        row += fit.size
    clear = [one for one in effects if one.clear]
    lowest = min(found, key=lambda one: one.chance, default=None)
    probability = min(1.0, lowest.chance * len(found)) if lowest else 1.0
    if not (probability < CHANCE or clear):
        return None
    sources = ", ".join(
        fit.experiment.motion.source if isinstance(fit, Trace) else fit.curve.source
        for fit in problem.fits
    )
    text = f"{sources}: the residuals are small, but more than noise"
    if lowest and probability < CHANCE:
        text = lowest.text
    causes = [one for one in clear if one.is_cause]
    if not causes:
        return Misfit(f"{text}; no single effect of the model takes it up", probability)
    names = causes[0].text
    if len(causes) > 1 and causes[1].fall > _SECOND * causes[0].fall:
        names += f", or {causes[1].text}"
    size = causes[0].fall / around.scale
    own = float(scipy.stats.chi2.sf(size, 1))
    return Misfit(f"{text}; the deviance falls by {size:.0f} with {names}", min(probability, own))


def _harmonics(trace: Trace, white: Array, left: Array, ringing: float) -> Iterator[_Finding]:
    """Yield how much louder the harmonics of the drive are than the bins beside them, in bands."""
    f, away = trace.beside()
    power = 0.5 * (white[: len(f)] ** 2 + white[len(f) : 2 * len(f)] ** 2)
    squares = np.abs(np.fft.rfft(left)[1:]) ** 2
    drive = min(run.frequency for run in trace.experiment.runs)
    edges = [0.5 * drive, 0.5 * ringing, 2.0 * ringing, 6.0 * ringing]
    for low, high in pairwise(edges):
        inside = (f >= low) & (f < high)
        on, off = inside & ~away, inside & away
        if on.sum() < _IN or off.sum() < _BESIDE:
            continue
        # What is fitted takes power away, and the noise is no louder than was learnt.
        ratio = float(np.mean(power[on])) / max(float(np.mean(power[off])), 1.0)
        chance = float(scipy.stats.f.sf(ratio, 2 * on.sum(), 2 * off.sum()))
        size = math.sqrt(2.0 * float(np.sum(squares[on]))) / len(left)
        yield _Finding(
            chance,
            f"{trace.experiment.motion.source}: {format_si(size, 'm', 2)} (root mean square) that "
            f"repeats with the drive between {low:.3g} and {high:.3g} Hz is not noise",
        )


def _in_motion(trace: Trace, left: Array, cycle: Array) -> Iterator[_Finding]:
    """Yield how much larger differences of residuals are in motion than at rest."""
    steps, full = np.diff(left), trace.blocks.full[1:] & trace.blocks.full[:-1]
    moving, still = steps[full & np.isfinite(cycle[1:])], steps[full & np.isnan(cycle[1:])]
    if min(len(moving), len(still)) < _AT_REST:
        return
    # Where it rests, a sensor that rounds makes no noise.
    rounding = quantum_of(trace.experiment.motion.x) ** 2 / (6.0 * trace.blocks.count)
    ratio = float(np.mean(moving**2)) / max(float(np.mean(still**2)) + rounding, 1e-30)
    chance = float(scipy.stats.f.sf(ratio / _LOUDER**2, len(moving) / 2, len(still) / 2))
    source = trace.experiment.motion.source
    yield _Finding(chance, f"{source}: the noise is {math.sqrt(ratio):.2g} times that at rest")
