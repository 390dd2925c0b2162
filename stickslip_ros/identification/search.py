# SPDX-License-Identifier: Apache-2.0
"""Where to begin: differential evolution on a few hundred samples and on the ringing.

The sum of squares of a trace has many local minima, so a descent from a guess ends in a wrong one.
The clock need not be known: a column of the velocity takes up small errors of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.identification.bins import Bins
from stickslip_ros.identification.curve import CurveFit
from stickslip_ros.identification.experiment import Experiment
from stickslip_ros.identification.free import Free
from stickslip_ros.identification.run_starts import place_runs
from stickslip_ros.identification.settings import SEARCH
from stickslip_ros.identification.trace_fit import TraceFit
from stickslip_ros.model import Plant
from stickslip_ros.model.derivations import sigma_0_of_ringing, sigma_1_of_decay
from stickslip_ros.parameters import ParameterError, Parameters
from stickslip_ros.solver import SolverError

Array = NDArray[np.float64]

_NONE = np.zeros(0)


class Look:
    """One experiment, looked at in a few bins."""

    def __init__(self, fit: TraceFit) -> None:
        """Choose bins outside of slips, within the first cycles of the first run."""
        self.experiment = fit.experiment
        self._starts = fit.starts
        self._bins = _some(fit.experiment, fit.bins)
        self._basis = self._bins.of_sensor()

    def cost(self, p: Parameters) -> float:
        """Return the sum of squares that a model leaves. ParameterError, SolverError."""
        follower = self.experiment.simulation(p, self._starts)
        # The middle of a bin is near enough to its mean here, at half the cost.
        x, speed = follower.sample(self._bins.t)
        left, speed = (
            one - self._basis @ (self._basis.T @ one) for one in (self._bins.x - x, speed)
        )
        shift = float(left @ speed) / max(float(speed @ speed), 1e-30)
        rest = left - shift * speed
        return float(rest @ rest) / SEARCH.noise**2 + self._ringing_cost(follower.plant)

    def _ringing_cost(self, plant: Plant) -> float:
        ringing = self.experiment.ringing
        if ringing is None:
            return 0.0
        decay = (plant.contact.sigma_1 + plant.contact.sigma_2) / (2.0 * plant.mass)
        frequency = max(plant.ringing_frequency, 1e-3 * ringing.frequency)
        return (math.log(frequency / ringing.frequency) / SEARCH.frequency) ** 2 + (
            math.log(max(decay, 1e-9) / ringing.decay) / SEARCH.decay
        ) ** 2


def _some(experiment: Experiment, bins: Bins) -> Bins:
    begin, end = experiment.unsure
    run = experiment.runs[0]
    begin = max(begin, run.start - 1.0 / run.frequency)
    end = min(end, run.start + (SEARCH.cycles) / run.frequency)
    p = experiment.parameters.drive
    slip = p.amplitude / p.slewrate * 1e-6
    away = np.mod((bins.t - run.start) * run.frequency, 1.0) / run.frequency
    kept = (bins.t >= begin) & (bins.t <= end)
    kept &= (away > SEARCH.guard) & (away < 1.0 / run.frequency - slip - SEARCH.guard)
    return bins.some(kept, SEARCH.bins)


def search(
    fits: Sequence[TraceFit],
    curves: Sequence[CurveFit],
    free: Free,
    seed: int,
    progress: Callable[[int, int, Array], None] = lambda done, of, best: None,
) -> list[Array]:
    """Return logarithms of parameters to descend from, the best ones first.

    progress is called with generations done, of how many, and the best logarithms so far.
    """
    random = np.random.default_rng(seed)
    members = _population(fits, free, random)
    for fit in fits:
        some = members[: len(members) // 2]
        place_runs(fit, [free.applied(fit.experiment.parameters, one) for one in some])
    looks = [Look(fit) for fit in fits]

    def cost(theta: Array) -> float:
        total = float(np.sum(free.prior_residuals(theta) ** 2))
        try:
            for curve in curves:
                left, _ = curve.residuals(curve.model(free.applied(curve.parameters, theta), _NONE))
                total += float(left @ left)
            return total + sum(
                look.cost(free.applied(look.experiment.parameters, theta)) for look in looks
            )
        except (ParameterError, SolverError):
            return SEARCH.impossible

    done = 0

    def after(best: Array, convergence: float) -> None:
        nonlocal done
        done += 1
        progress(done, SEARCH.generations, best)

    found = scipy.optimize.differential_evolution(
        cost,
        list(zip(free.low, free.high, strict=True)),
        init=members,
        maxiter=SEARCH.generations,
        tol=0.01,
        atol=SEARCH.agree,
        polish=False,
        seed=random,
        callback=after,
    )
    return _distinct(np.asarray(found.population), np.asarray(found.population_energies))


def _distinct(population: Array, costs: Array) -> list[Array]:
    handed: list[Array] = []
    for member in population[np.argsort(costs, kind="stable")]:
        if all(np.abs(member - other).max() > SEARCH.distinct for other in handed):
            handed.append(member)
        if len(handed) == SEARCH.handed_on:
            break
    return handed


def _population(fits: Sequence[TraceFit], free: Free, random: np.random.Generator) -> Array:
    """Return members by lot, half of them such as the ringing asks for."""
    count = SEARCH.members * len(free.names)
    members = random.uniform(free.low, free.high, (count, len(free.names)))
    members[0] = free.start
    seen = next((fit.experiment for fit in fits if fit.experiment.ringing), None)
    if seen is None or seen.ringing is None:
        return members
    mass = Plant.of(free.applied(seen.parameters, free.start)).mass
    spring = seen.parameters.runner.spring or 0.0
    sigma_0 = sigma_0_of_ringing(seen.ringing.frequency, mass, seen.ringing.decay) - spring
    wanted = {
        "sigma_0": (sigma_0, SEARCH.near_sigma_0),
        "sigma_1": (sigma_1_of_decay(seen.ringing.decay, mass), SEARCH.near_sigma_1),
    }
    half = slice(1, count // 2)
    for name, (value, width) in wanted.items():
        if name in free.names and value > 0.0:
            k = free.names.index(name)
            near = np.log(value) + width * random.standard_normal(count // 2 - 1)
            members[half, k] = np.clip(near, free.low[k], free.high[k])
    return members
