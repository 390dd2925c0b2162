# SPDX-License-Identifier: Apache-2.0
"""Tests whether residuals are more than noise, and names what would explain them.

What repeats with the drive stands in the harmonics of the drive, noise as much beside them (F
test). Where a record shows rest, the residuals in motion must not be far larger than there, where
the sensor alone makes them. And nothing that the parameters leave out may lower the deviance by
more than chance: each effect is a further column of the Jacobian, to first order about the optimum
of a fit (score test), and says how large it is. The part of the column that the free parameters
take up moves them: an effect that would move them out of their intervals without showing is named,
for the values hold only with what the parameters say of it.

Effects that show are weighed by their fall of the deviance and by how often a bench has them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import pairwise

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.reporting import format_si
from stickslip_ros.measurement.identification.fit import Misfit
from stickslip_ros.measurement.identification.free import LAG, WIDTH, Nuisance, lag_of_amplifier
from stickslip_ros.measurement.identification.intervals import RISE, Surroundings
from stickslip_ros.measurement.identification.problem import Problem
from stickslip_ros.measurement.identification.trace import WIDTH as SQUARE
from stickslip_ros.measurement.identification.trace import Trace
from stickslip_ros.measurement.steps.noise import quantum_of
from stickslip_ros.physics.model import Plant
from stickslip_ros.physics.model.friction import contact_of
from stickslip_ros.physics.parameters import ParameterError, Parameters
from stickslip_ros.physics.solver import SolverError

#: Chance of a misfit where there is none, over all effects.
CHANCE = 1e-3
#: Lowest bins of a spectrum that are left out: wander and hum are known from few others.
SLOWEST = 2.5
#: Part of an effect's column below which the parameters take it up whole.
_TAKEN_UP = 1e-6
#: Effects that show which are fitted, the largest; rounds of that; deviation of such an unknown in
#: its largest size; difference of the deviance up to which two are about as likely: 5 % and 95 %.
_FITTED, _ROUNDS, _ANY, _AS_LIKELY = 6, 15, 30.0, 5.9
#: Ratio of residuals in motion to those at rest that sensors may have; blocks of a rest at least.
_LOUDER, _AT_REST = 1.4, 100
#: Bins in and beside the harmonics without which a band is not tested.
_IN, _BESIDE = 4, 8


@dataclass(frozen=True)
class Effect:
    """Something that the motion may have and the parameters do not."""

    name: str  #: parameter that expresses it
    text: str  #: for people; {} stands for its size
    unit: float  #: change that the column is computed for
    #: Parameters with the effect; ParameterError where the law has none, None where they have it.
    change: Callable[[Parameters, float], Parameters | None] | None
    size: Callable[[float], str]  #: how large it is, in words
    only_more: bool = False  #: whether there is no less of it than none
    given: str = ""  #: what is told to matter where it would not show, in words
    amount: float = 0.1  #: how much that is, at most where {} stands for it
    cure: str = ""
    most: float = 1.0  #: size beyond which it is no cause, whatever it explains
    rare: float = 0.0  #: fall of the deviance that it has to be better by than what is usual
    after: float | None = None  #: part of the steps after which it is there, at once


def _percent(size: float) -> str:
    return f"{100.0 * size:+.2g} %"


def _share(size: float) -> str:
    return f"{100.0 * size:.2g} %"


#: Change of the preload, as a part of it, that columns of another one are computed for.
_LOADED = 0.01


def _loaded(p: Parameters, part: float) -> Parameters:
    """Return parameters at another preload: stiffness and breakaway follow it (Eq. 13, 14)."""
    shares = {"preload": 1.0, "sigma_0": 1.0 / 3.0, "z_ba": 0.5}
    values = {name: p.value(name) for name in shares}
    changed = {name: v * (1.0 + part * shares[name]) for name, v in values.items() if v}
    return p.replace(**changed)


def _lagging(p: Parameters, microseconds: float) -> Parameters | None:
    change = lag_of_amplifier().change
    if p.actuator.amplifier_bandwidth is not None or change is None:
        return None
    return change(p, microseconds)


def _creeping(p: Parameters, part: float) -> Parameters | None:
    return None if p.actuator.creep else p.replace(creep=part)


def _with_hysteresis(p: Parameters, part: float) -> Parameters | None:
    if p.actuator.actuator != "linear":
        return None
    return p.replace(actuator="hysteresis", hysteresis=part)


def _with_contacts(p: Parameters, spread: float) -> Parameters | None:
    if p.friction.contacts > 1:
        return None
    return p.replace(contacts=2, contact_spread=spread)


#: All effects that are tried; those without a change of parameters are of the sensor or the run.
EFFECTS = (
    Effect(
        "slewrate", "another slewrate (a slower amplifier; {})", 0.01,
        lambda p, part: p.replace(slewrate=p.drive.slewrate * (1.0 + part)), _percent,
        given="10 % more slewrate"),
    Effect(
        LAG, "a lag of the amplifier ({})", 0.3, _lagging,
        lambda size: format_si(1e-6 * size, "s", 2), only_more=True, given="a lag of {}",
        amount=1.0, most=20.0, cure="identify again with --fit-lag"),
    Effect(
        WIDTH, "a slow sensor ({})", 1.0, None,
        lambda size: f"{1.0 / (2.0 * math.pi * math.sqrt(max(size, 1e-9) * SQUARE)):.2g} Hz",
        only_more=True, given="a sensor of {}", amount=16.0, most=1e3,
        cure="set sensor_bandwidth in the parameters, or --samples mean"),
    Effect(
        "gain", "another gain of the actuator, or amplitude ({})", 1e-3,
        lambda p, part: p.replace(gain=p.actuator.gain * (1.0 + part)), _percent,
        given="10 % more gain", most=0.2),
    Effect("tilt", "another scale of the sensor, or its angle ({})", 1.0, None, _percent, most=0.2),
    Effect("creep", "creep of the actuator ({} a decade)", 0.002, _creeping, _share,
           only_more=True, cure="set creep in the parameters"),
    Effect("hysteresis", "hysteresis of the actuator ({})", 0.01, _with_hysteresis, _share,
           only_more=True, cure="set actuator: hysteresis in the parameters", most=0.3),
    Effect("drift", "a preload that changes during the record ({})", _LOADED, None, _percent,
           most=0.5),
    *(Effect(f"change {part}", f"a change of the preload after {part} of the steps ({{}})", _LOADED,
             None, _percent, most=0.5, after=k / 8)
      for k, part in enumerate(("1/8", "1/4", "3/8", "1/2", "5/8", "3/4", "7/8"), 1)),
    Effect(
        "sigma_2", "viscous friction (sigma_2; {} of sigma_1)", 0.01,
        lambda p, part: p.replace(sigma_2=p.friction.sigma_2 + part * p.friction.sigma_1), _percent,
        only_more=True, given="a sigma_2 of 10 % of sigma_1"),
    Effect(
        "mass", "another mass, or a payload ({})", 1e-3,
        lambda p, part: p.replace(mass=p.runner.mass * (1.0 + part)), _percent,
        given="10 % more mass"),
    Effect(
        "preload", "another preload ({})", 1e-3,
        lambda p, part: p.replace(preload=p.friction.preload * (1.0 + part)), _percent,
        given="10 % more preload"),
    Effect(
        "force", "a force on the runner ({} of the preload)", 0.001,
        lambda p, part: p.replace(force=p.runner.force + part * p.friction.preload), _percent,
        most=0.1, rare=10.0),
    Effect(
        "z_ss", "another z_ss ({})", 0.01,
        lambda p, part: p.replace(z_ss=contact_of(p.friction).z_ss * (1.0 + part)), _percent,
        given="10 % more z_ss"),
    Effect("contacts", "a second contact (distances spread by {})", 0.05, _with_contacts, _share,
           only_more=True),
)  # fmt: skip


@dataclass(frozen=True)
class SeenEffect:
    """An effect as a fit shows it."""

    effect: Effect
    fall: float  #: of the deviance with as much of it as is likeliest, all else following
    amount: float  #: how much that is, in its own measure
    clear: bool  #: whether chance makes as large a fall in one of a thousand fits at most
    given: str  #: what a usual amount of it would change without showing, in words

    @property
    def text(self) -> str:
        """The effect with its size, and its cure."""
        found = self.effect.text.format(self.effect.size(self.amount))
        return f"{found}: {self.effect.cure}" if self.effect.cure else found


def effects_of(around: Surroundings, allowed: Sequence[str] = ()) -> list[SeenEffect]:
    """Return all effects that are not fitted, the largest fall of the deviance first.

    Those that the intervals allow for are left out, too.
    """
    problem, best = around.problem, around.best
    basis, triangle = np.linalg.qr(around.jacobian)
    inverse = np.linalg.pinv(triangle, rcond=1e-12)[: problem.count]
    enough = math.sqrt(RISE) * around.deviations[: problem.count]
    least = around.scale * float(scipy.stats.chi2.isf(CHANCE / len(EFFECTS), 1))
    heard = np.ones(len(best.residuals))
    row = 0
    for fit in problem.fits:  # what is slower than the drive is known no better than wander and hum
        if isinstance(fit, Trace):
            f, _ = fit.beside()
            slow = np.tile(f < SLOWEST * f[0], 2)
            heard[row : row + len(slow)][slow] = 0.0
        row += fit.size
    found: list[SeenEffect] = []
    loaded = cache(partial(_difference, around, change=_loaded, unit=_LOADED))  # of an experiment
    for effect in EFFECTS:
        known = effect.name in (*problem.free.names, *allowed)
        slope = None if known else _slope(around, effect, loaded)
        if slope is None:
            continue
        inside = basis.T @ slope
        outside = (slope - basis @ inside) * heard
        power, along = float(outside @ outside), float(outside @ best.residuals)
        shows = power > _TAKEN_UP * float(slope @ slope)
        amount = -along / power if shows else 0.0
        fall = along**2 / power if shows and not (effect.only_more and amount < 0.0) else 0.0
        given, tried = "", effect.amount
        if "{}" in effect.given and power > 0.0:  # as much as just does not show
            tried = min(tried, 0.99 * math.sqrt(least / power))
        if effect.given and tried**2 * power < least:
            moved = zip(problem.free.names, -tried * (inverse @ inside), enough, strict=True)
            parts = [f"{name} {_percent(by)}" for name, by, far in moved if abs(by) > far]
            would = f"{effect.given.format(effect.size(tried))} would not show"
            given = f"{would}: {', '.join(parts)}" if parts else ""
        found.append(SeenEffect(effect, fall, amount, fall > least, given))
    return sorted(found, key=lambda one: -one.fall)


def causes_of(around: Surroundings, effects: Sequence[SeenEffect]) -> list[SeenEffect]:
    """Return what may explain a misfit, the likeliest first, three at most.

    Effects of the parameters that show are fitted with all else, for far off the first order says
    little; others count as they show.
    """
    clear = [one for one in effects if one.clear]
    tried = [(one, one) for one in clear if not one.effect.change]
    fitted = [one for one in clear if one.effect.change][:_FITTED]
    tried += [(one, _fitted(around, one)) for one in fitted]
    found = [
        fit
        for one, fit in tried
        if fit.fall > 0.5 * one.fall and abs(fit.amount) <= one.effect.most
    ]
    likely = {one.effect.name: one.fall / around.scale - one.effect.rare for one in found}
    best = max(likely.values(), default=0.0)
    found = [one for one in found if likely[one.effect.name] > best - _AS_LIKELY]
    return sorted(found, key=lambda one: -likely[one.effect.name])[:3]


def _fitted(around: Surroundings, one: SeenEffect) -> SeenEffect:
    """Return an effect with its fall and amount where it is fitted with all other unknowns."""
    problem, effect, best = around.problem, one.effect, around.best
    change = effect.change
    if change is None:
        return one

    def changed(p: Parameters, units: float) -> Parameters:
        return change(p, units * effect.unit) or p

    most = effect.most / effect.unit
    free = Nuisance(effect.name, effect.unit, _ANY * most, 0.0 if effect.only_more else -most, most,
                    changed)  # fmt: skip
    wider = Problem(problem.fits, problem.free, [*problem.nuisances, free])
    at = one.amount / effect.unit
    at = at if abs(at) < most else math.copysign(1.0, at)  # far off, the first order says nothing
    begun = wider.point(np.insert(best.unknowns, problem.shared, at))
    if begun is None:
        return one
    end = wider.descend(begun, _ROUNDS)
    amount = effect.unit * float(end.unknowns[problem.shared])
    return replace(one, fall=best.deviance - end.deviance, amount=amount)


def _slope(
    around: Surroundings, effect: Effect, loaded: Callable[[int], Array | None]
) -> Array | None:
    """Return the derivatives of the residuals by the size of an effect, None if there is none.

    loaded gives how another preload moves the model of an experiment, by its number.
    """
    rows = []
    try:
        for k, fit in enumerate(around.problem.fits):
            seen = around.best.seen[k]
            if effect.change is not None:
                column = _difference(around, k, effect.change, effect.unit, not effect.only_more)
            elif not isinstance(fit, Trace):
                column = np.zeros_like(seen.x)
            elif effect.name == WIDTH:
                slow = fit.parameters.sensor.sensor_bandwidth
                column = None if slow else fit.width_derivative(seen)
            elif effect.name == "tilt":
                column = seen.x
            else:
                column = _changing(fit, loaded(k), effect.after)
            if column is None:
                return None
            rows.append(fit.changed(np.nan_to_num(column) / effect.unit))
    except (ParameterError, SolverError):
        return None
    found = np.concatenate(rows)
    return np.concatenate([found, np.zeros(len(around.best.residuals) - len(found))])


def _difference(
    around: Surroundings,
    k: int,
    change: Callable[[Parameters, float], Parameters | None],
    unit: float,
    both: bool = False,
) -> Array | None:
    """Return how a change of the parameters moves the model of an experiment, m."""
    problem, unknowns = around.problem, around.best.unknowns
    fit, clock, width = (
        problem.fits[k], problem.clock(unknowns, k), problem.value(WIDTH, unknowns),
    )  # fmt: skip
    p = problem.applied(fit.parameters, unknowns)
    more = change(p, unit)
    if more is None:
        return None
    less = change(p, -unit) if both else None  # what is taken up whole leaves no second order
    other = fit.model(less, clock, width) if less else around.best.seen[k]
    return (fit.model(more, clock, width).x - other.x) / (1.0 + both)


def _changing(trace: Trace, column: Array | None, after: float | None) -> Array | None:
    """Return the column of a change that comes with time, or at once after a part of the steps."""
    if column is None:
        return None
    last = trace.experiment.runs[-1]
    lasts = float(trace.starts[-1] - trace.starts[0]) + last.end - last.start
    place = np.clip((trace.blocks.t - trace.starts[0]) / lasts, 0.0, 1.0)
    if after is not None:
        place = np.where(place > after, 1.0, 0.0)
    return np.cumsum(np.diff(column, prepend=column[0]) * place)


# -- what is more than noise


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
    lowest = min(found, key=lambda one: one.chance, default=None)
    probability = min(1.0, lowest.chance * len(found)) if lowest else 1.0
    if not (probability < CHANCE or any(one.clear for one in effects)):
        return None
    sources = ", ".join(
        fit.experiment.motion.source if isinstance(fit, Trace) else fit.curve.source
        for fit in problem.fits
    )
    text = f"{sources}: the residuals are small, but more than noise"
    if lowest and probability < CHANCE:
        text = lowest.text
    causes = causes_of(around, effects)
    if not causes:
        return Misfit(f"{text}; no single effect of the model takes it up", probability)
    size = causes[0].fall / around.scale
    names = ", or ".join(one.text for one in causes)
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
