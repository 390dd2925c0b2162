# SPDX-License-Identifier: Apache-2.0
"""What the parameters leave out or tell wrongly, to first order about the optimum of a fit.

Each effect is a further column of the Jacobian. It shows itself by the part that the free
parameters cannot take up: the deviance falls with it (score test), and says how large it is. The
part that they take up moves them. An effect that would move them out of their intervals without
showing is named: the values hold only with what the parameters say of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.reporting import format_si
from stickslip_ros.measurement.identification.free import LAG, WIDTH, lag_of_amplifier
from stickslip_ros.measurement.identification.intervals import RISE, Surroundings
from stickslip_ros.measurement.identification.problem import Problem
from stickslip_ros.measurement.identification.trace import WIDTH as SQUARE
from stickslip_ros.measurement.identification.trace import Seen, Trace
from stickslip_ros.physics.model.friction import contact_of
from stickslip_ros.physics.parameters import ParameterError, Parameters
from stickslip_ros.physics.solver import SolverError

#: Chance of a misfit where there is none, over all effects.
CHANCE = 1e-3
#: Lowest bins of a spectrum that are left out: wander and hum are known from few others.
SLOWEST = 2.5
#: Part of an effect's column below which the parameters take it up whole.
_TAKEN_UP = 1e-6


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
    costly: bool = False  #: whether it is tried only where something else shows
    most: float = 1.0  #: size beyond which it is no cause, whatever it explains


def _percent(size: float) -> str:
    return f"{100.0 * size:+.2g} %"


def _share(size: float) -> str:
    return f"{100.0 * size:.2g} %"


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
        given="10 % more gain"),
    Effect("tilt", "another scale of the sensor, or its angle ({})", 1.0, None, _percent),
    Effect("creep", "creep of the actuator ({} a decade)", 0.002, _creeping, _share,
           only_more=True, cure="set creep in the parameters"),
    Effect("hysteresis", "hysteresis of the actuator ({})", 0.01, _with_hysteresis, _share,
           only_more=True, cure="set actuator: hysteresis in the parameters"),
    Effect("drift", "a preload that changes during the run ({})", 0.01, None, _percent),
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
        lambda p, part: p.replace(force=p.runner.force + part * p.friction.preload), _percent),
    Effect(
        "z_ss", "another z_ss ({})", 0.01,
        lambda p, part: p.replace(z_ss=contact_of(p.friction).z_ss * (1.0 + part)), _percent,
        given="10 % more z_ss"),
    Effect("contacts", "a second contact (distances spread by {})", 0.05, _with_contacts, _share,
           only_more=True, costly=True),
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
    def is_cause(self) -> bool:
        """Whether it shows, and is no larger than it can be."""
        return self.clear and abs(self.amount) <= self.effect.most

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
    fitted = {*problem.free.names, *allowed}
    basis, triangle = np.linalg.qr(around.jacobian)
    inverse = np.linalg.pinv(triangle, rcond=1e-12)[: problem.count]
    errors = around.deviations[: problem.count]
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
    for effect in EFFECTS:
        if effect.costly and not any(one.clear for one in found):
            continue
        slope = None if effect.name in fitted else _slope(problem, around, effect)
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
            moved = (-tried * (inverse @ inside)).tolist()
            given = ", ".join(
                f"{name} {100.0 * by:+.2g} %"
                for name, by, error in zip(problem.free.names, moved, errors.tolist(), strict=True)
                if abs(by) > math.sqrt(RISE) * error
            )
            given = (
                f"{effect.given.format(effect.size(tried))} would not show: {given}"
                if given
                else ""
            )
        found.append(SeenEffect(effect, fall, amount, fall > least, given))
    return sorted(found, key=lambda one: -one.fall)


def _slope(problem: Problem, around: Surroundings, effect: Effect) -> Array | None:
    """Return the derivatives of the residuals by the size of an effect, None if there is none."""
    unknowns, rows = around.best.unknowns, []
    try:
        for k, fit in enumerate(problem.fits):
            seen = around.best.seen[k]
            if effect.change is not None:
                column = _difference(
                    problem, unknowns, k, effect.change, effect.unit, not effect.only_more
                )
            elif isinstance(fit, Trace):
                column = _of_run(problem, fit, seen, unknowns, k, effect)
            else:
                column = np.zeros_like(seen.x)
            if column is None:
                return None
            rows.append(fit.changed(np.nan_to_num(column) / effect.unit))
    except (ParameterError, SolverError):
        return None
    found = np.concatenate(rows)
    return np.concatenate([found, np.zeros(len(around.best.residuals) - len(found))])


def _difference(
    problem: Problem,
    unknowns: Array,
    k: int,
    change: Callable[[Parameters, float], Parameters | None],
    unit: float,
    both: bool = False,
) -> Array | None:
    """Return how a change of the parameters moves the model of an experiment, m."""
    fit = problem.fits[k]
    p, clock, width = (
        problem.applied(fit.parameters, unknowns), problem.clock(unknowns, k),
        problem.width(unknowns),
    )  # fmt: skip
    more, less = change(p, unit), p
    if more is None:
        return None
    if both:  # so that what the parameters take up whole leaves no second order
        less = change(p, -unit) or p
    return (fit.model(more, clock, width).x - fit.model(less, clock, width).x) / (1.0 + both)


def _of_run(
    problem: Problem, trace: Trace, seen: Seen, unknowns: Array, k: int, effect: Effect
) -> Array | None:
    """Return the column of an effect of the sensor, or of the run as a whole."""
    if effect.name == WIDTH:
        return None if trace.parameters.sensor.sensor_bandwidth else trace.width_derivative(seen)
    if effect.name == "tilt":
        return seen.x
    column = _difference(problem, unknowns, k, _loaded, effect.unit)
    if column is None:
        return None
    place = np.clip((trace.blocks.t - trace.starts[0]) / _duration(trace), 0.0, 1.0)
    return np.cumsum(np.diff(column, prepend=column[0]) * place)


def _duration(trace: Trace) -> float:
    """Return the time (s) from the first start to the end of the last run."""
    last = trace.experiment.runs[-1]
    return float(trace.starts[-1] - trace.starts[0]) + abs(last.steps) / last.frequency
