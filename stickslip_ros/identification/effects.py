# SPDX-License-Identifier: Apache-2.0
"""What the parameters leave out or tell wrongly, to first order about the optimum of a fit.

Each effect is a further column of the Jacobian. It shows itself by the part that the free
parameters cannot take up: the deviance falls with it (score test). The part that they take up moves
them. An effect that would move them out of their intervals without showing is named: the values
hold only with what the parameters say of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.arrays import Array
from stickslip_ros.identification.free import LAG
from stickslip_ros.identification.least_squares import Point, Problem
from stickslip_ros.identification.settings import MISFIT, SEARCH
from stickslip_ros.model.friction import contact_of
from stickslip_ros.parameters import ParameterError, Parameters
from stickslip_ros.reporting import CONFIDENCE
from stickslip_ros.solver import SolverError


class Effect(NamedTuple):
    """Something that the motion may have and the parameters do not."""

    name: str  #: parameter that expresses it
    text: str  #: for people
    tenth: str  #: a part of 0.1 of it, or all of it, in words
    change: Callable[[Parameters, float], Parameters]
    cure: str = ""  #: of one that is there or not, and passes for constants of the contact


#: All effects that are tried.
EFFECTS = (
    Effect(
        "slewrate", "another slewrate (a slower amplifier)", "10 % more slewrate",
        lambda p, part: p.replace(slewrate=p.drive.slewrate * (1.0 + part))),
    Effect(
        LAG, "a lag of the amplifier", "a lag of 0.3 µs",
        lambda p, part: p.replace(amplifier_bandwidth=p.actuator.amplifier_bandwidth
                            or 1.0 / (2.0 * math.pi * SEARCH.lag_start)),
        "identify again with --fit-lag"),
    Effect(
        "sensor_bandwidth", "a slow sensor", "a sensor of 100 kHz",
        lambda p, part: p.replace(sensor_bandwidth=p.sensor.sensor_bandwidth
                                  or MISFIT.sensor_bandwidth),
        "set sensor_bandwidth in the parameters, the intervals do not hold without it"),
    Effect(
        "gain", "another gain of the actuator", "10 % more gain",
        lambda p, part: p.replace(gain=p.actuator.gain * (1.0 + part))),
    Effect(
        "sigma_2", "viscous friction (sigma_2)", "a sigma_2 of 10 % of sigma_1",
        lambda p, part: p.replace(sigma_2=p.friction.sigma_2 + part * p.friction.sigma_1)),
    Effect(
        "mass", "another mass", "10 % more mass",
        lambda p, part: p.replace(mass=p.runner.mass * (1.0 + part))),
    Effect(
        "preload", "another preload", "10 % more preload",
        lambda p, part: p.replace(preload=p.friction.preload * (1.0 + part))),
    Effect(
        "force", "a force on the runner", "a force of 1 % of the preload",
        lambda p, part: p.replace(force=p.runner.force + 0.1 * part * p.friction.preload)),
    Effect(
        "z_ss", "a larger z_ss", "10 % more z_ss",
        lambda p, part: p.replace(z_ss=contact_of(p.friction).z_ss * (1.0 + part))),
)  # fmt: skip


@dataclass(frozen=True)
class SeenEffect:
    """An effect as a fit shows it."""

    effect: Effect
    fall: float  #: of the deviance with as much of it as is likeliest, all else following
    clear: bool  #: whether chance makes as large a fall in one of a thousand fits at most
    given: str  #: what as much as `tenth` of it would change without showing, in words


def effects_of(problem: Problem, best: Point) -> list[SeenEffect]:
    """Return all effects that the law can have and that are not fitted, the largest fall first."""
    free, count = problem.free.names, len(problem.free.names)
    basis, triangle = np.linalg.qr(problem.jacobian(best))
    inverse = np.linalg.pinv(triangle, rcond=1e-12)
    scale = best.deviance / max(len(best.residuals) - problem.size, 1)
    errors = np.sqrt(scale * np.sum(inverse[:count] ** 2, axis=1))
    least = scale * float(scipy.stats.chi2.isf(MISFIT.chance / len(EFFECTS), 1))
    found = []
    for effect in EFFECTS:
        slope = None if effect.name in free else _slope(problem, best, effect)
        if slope is None:
            continue
        inside = basis.T @ slope
        outside = slope - basis @ inside
        power, along = float(outside @ outside), float(outside @ best.residuals)
        tenth = 1.0 if effect.cure else 0.1
        none = power <= 1e-12 * float(slope @ slope)
        # None is quicker than at once.
        fall = 0.0 if none or (effect.cure and along > 0.0) else along**2 / power
        moved, given = -tenth * (inverse @ inside)[:count], ""
        if tenth**2 * power < least:
            given = ", ".join(
                f"{name} {100.0 * by:+.2g} %"
                for name, by, error in zip(free, moved.tolist(), errors.tolist(), strict=True)
                if abs(by) > CONFIDENCE * error and name != LAG
            )
        found.append(SeenEffect(effect, fall, fall > least, given))
    return sorted(found, key=lambda one: -one.fall)


def _slope(problem: Problem, best: Point, effect: Effect) -> Array | None:
    """Return the derivatives of the residuals by a part, None if the law cannot have the effect."""
    step = max(fit.step for fit in problem.fits)

    def seen(part: float) -> list[Array] | None:
        theta, found = best.unknowns[: len(problem.free.names)], []
        try:
            for k, fit in enumerate(problem.fits):
                p = effect.change(problem.free.applied(fit.parameters, theta), part)
                found.append(fit.model(p, problem.clock(best.unknowns, k)).x)
        except (ParameterError, SolverError):
            return None
        return found

    if effect.cure:
        step = 1.0
    more = seen(step)
    if more is None:
        return None
    less, width = None if effect.cure else seen(-step), 2.0 * step
    if less is None:  # there is no less than none
        less, width = [one.x for one in best.seen], step
    changes = [(a - b) / width for a, b in zip(more, less, strict=True)]
    return problem.derivatives(best, changes)
