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
from stickslip_ros.identification.trace_fit import TraceFit
from stickslip_ros.model import Plant
from stickslip_ros.model.derivations import sigma_0_of_ringing, sigma_1_of_decay
from stickslip_ros.parameters import ParameterError, Parameters
from stickslip_ros.solver import SolverError
from stickslip_ros.traces.hum import MAINS, hum_columns

Array = NDArray[np.float64]

#: Bins and cycles of an experiment that are looked at; noise (m) that is assumed; guard after a
#: slip, s.
_LOOKED_AT, _CYCLES, _NOISE, _GUARD = 360, 8, 3e-9, 5e-6
#: How well frequency and decay of the ringing are taken to be known, as parts of them.
_FREQUENCY, _DECAY = 0.02, 0.7
#: Members for each parameter, generations; what sets that make no contact cost; spread of the
#: costs at which all members lie about one minimum, and the descents may begin.
_MEMBERS, _GENERATIONS, _IMPOSSIBLE, _AGREE = 15, 100, 1e12, 3.0
#: How far members lie about what the ringing asks for, as logarithms.
_NEAR = {"sigma_0": 0.04, "sigma_1": 0.7}
_NONE = np.zeros(0)
#: Members are distinct if a logarithm differs by that much; so many are handed on.
_DISTINCT, _HANDED_ON = 0.2, 6


class Look:
    """One experiment, looked at in a few bins."""

    def __init__(self, fit: TraceFit) -> None:
        """Choose bins outside of slips, within the first cycles of the first run."""
        self.experiment = fit.experiment
        self._starts = fit.starts
        self._bins = _some(fit.experiment, fit.bins)
        t = self._bins.t
        place = (t - t.mean()) / max(float(np.ptp(t)), 1e-12)
        span = float(np.ptp(t))
        # Less than a period of the mains is a slow drift.
        hum = hum_columns(t, MAINS) if span > 1.0 / min(MAINS) else [place**2, place**3]
        self._basis, _ = np.linalg.qr(np.column_stack([np.ones_like(t), place, *hum]))

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
        return float(rest @ rest) / _NOISE**2 + self._ringing_cost(follower.plant)

    def _ringing_cost(self, plant: Plant) -> float:
        ringing = self.experiment.ringing
        if ringing is None:
            return 0.0
        decay = (plant.contact.sigma_1 + plant.contact.sigma_2) / (2.0 * plant.mass)
        frequency = max(plant.ringing_frequency, 1e-3 * ringing.frequency)
        return (math.log(frequency / ringing.frequency) / _FREQUENCY) ** 2 + (
            math.log(max(decay, 1e-9) / ringing.decay) / _DECAY
        ) ** 2


def _some(experiment: Experiment, bins: Bins) -> Bins:
    begin, end = experiment.unsure
    run = experiment.runs[0]
    begin = max(begin, run.start - 1.0 / run.frequency)
    end = min(end, run.start + (_CYCLES + 0.5) / run.frequency)
    p = experiment.parameters.drive
    slip = p.amplitude / p.slewrate * 1e-6
    away = np.mod((bins.t - run.start) * run.frequency, 1.0) / run.frequency
    kept = (bins.t >= begin) & (bins.t <= end)
    kept &= (away > _GUARD) & (away < 1.0 / run.frequency - slip - _GUARD)
    which = np.flatnonzero(kept)
    if len(which) > _LOOKED_AT:
        which = which[np.linspace(0, len(which) - 1, _LOOKED_AT).astype(np.int64)]
    chosen = np.zeros(len(bins.t), dtype=bool)
    chosen[which] = True
    return bins.only(chosen)


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
            return _IMPOSSIBLE

    done = 0

    def after(best: Array, convergence: float) -> None:
        nonlocal done
        done += 1
        progress(done, _GENERATIONS, best)

    found = scipy.optimize.differential_evolution(
        cost,
        list(zip(free.low, free.high, strict=True)),
        init=members,
        maxiter=_GENERATIONS,
        tol=0.01,
        atol=_AGREE,
        polish=False,
        seed=random,
        callback=after,
    )
    return _distinct(np.asarray(found.population), np.asarray(found.population_energies))


def _distinct(population: Array, costs: Array) -> list[Array]:
    handed: list[Array] = []
    for member in population[np.argsort(costs, kind="stable")]:
        if all(np.abs(member - other).max() > _DISTINCT for other in handed):
            handed.append(member)
        if len(handed) == _HANDED_ON:
            break
    return handed


def _population(fits: Sequence[TraceFit], free: Free, random: np.random.Generator) -> Array:
    """Return members by lot, half of them such as the ringing asks for."""
    count = _MEMBERS * len(free.names)
    members = random.uniform(free.low, free.high, (count, len(free.names)))
    members[0] = free.start
    seen = next((fit.experiment for fit in fits if fit.experiment.ringing), None)
    if seen is None or seen.ringing is None:
        return members
    mass = Plant.of(free.applied(seen.parameters, free.start)).mass
    spring = seen.parameters.runner.spring or 0.0
    wanted = {
        "sigma_0": sigma_0_of_ringing(seen.ringing.frequency, mass, seen.ringing.decay) - spring,
        "sigma_1": sigma_1_of_decay(seen.ringing.decay, mass),
    }
    half = slice(1, count // 2)
    for name, value in wanted.items():
        if name in free.names and value > 0.0:
            k = free.names.index(name)
            near = np.log(value) + _NEAR[name] * random.standard_normal(count // 2 - 1)
            members[half, k] = np.clip(near, free.low[k], free.high[k])
    return members
