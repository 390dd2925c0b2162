# SPDX-License-Identifier: Apache-2.0
"""Where to begin: when each run began, and differential evolution on a few hundred samples.

The sum of squares of a trace has many local minima, so a descent from a guess ends in a wrong one.
The clock need not be known: a column of the velocity takes up small errors of it.

When each run of a measurement began: models laid over it at many shifts.

Weak damping and hum shift the start found from the steps alone by a part of a period, far more
than the period of ringing that least squares can correct. Stiffness and damping of the contact are
roughly known from the ringing; of the other constants it is enough if some of the random draws fit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.arrays import Array
from stickslip_ros.identification.curve import CurveFit
from stickslip_ros.identification.experiment import Stepping
from stickslip_ros.identification.free import FreeParameters
from stickslip_ros.identification.settings import SEARCH
from stickslip_ros.identification.trace_fit import CLOCK, TraceFit
from stickslip_ros.model import Plant
from stickslip_ros.model.derivations import sigma_0_of_ringing, sigma_1_of_decay
from stickslip_ros.parameters import ParameterError, Parameters
from stickslip_ros.solver import SolverError


@dataclass(frozen=True)
class Placed:
    """A run laid over the measurement."""

    left: float  #: sum of squares that is left, m^2
    start: float  #: s
    steps: int


class Window:
    """The bins about one run, with a basis of the errors of the sensor."""

    def __init__(self, fit: TraceFit, k: int) -> None:
        """Take the bins between the middles of the rests about run k."""
        self._experiment = fit.experiment
        self.run: Stepping = fit.experiment.runs[k]
        starts, runs = fit.starts, fit.experiment.runs
        ends = [s + abs(run.steps) / run.frequency for s, run in zip(starts, runs, strict=True)]
        begin = 0.5 * (ends[k - 1] + starts[k]) if k > 0 else -math.inf
        end = 0.5 * (ends[k] + starts[k + 1]) if k + 1 < len(runs) else math.inf
        sure = fit.experiment.unsure
        begin, end = max(begin, sure[0]), min(end, sure[1])
        bins = fit.bins
        some = bins.some((bins.t >= begin) & (bins.t <= end), SEARCH.laid_bins)
        self.t, self._x, self._basis = some.t, some.x, some.of_sensor()

    def placed(self, p: Parameters, start: float, reach: float, steps: int) -> Placed:
        """Return the best place within reach (s) of a start (s). ParameterError, SolverError."""
        ringing = max(Plant.of(p).ringing_frequency, SEARCH.least_ringing * self.run.frequency)
        only = replace(
            self._experiment, runs=(Stepping(0.0, steps, self.run.frequency),), beyond=False
        )
        first, last = float(self.t[0]) - start - reach, float(self.t[-1]) - start + reach
        count = int(min((last - first) * SEARCH.density * ringing, SEARCH.most_samples))
        grid = np.linspace(first, last, max(count, 2))
        x, _ = only.simulate(p, np.zeros(1), grid)
        number = int(min(2.0 * reach * SEARCH.shifts * ringing, SEARCH.most_shifts)) // 2 * 2 + 1
        shifts = np.linspace(-reach, reach, number)
        best = Placed(math.inf, start, steps)
        for some in np.array_split(shifts, max(1, number // SEARCH.at_once)):
            seen = np.interp(self.t[:, None] - start - some, grid, x)
            left = self._x[:, None] - seen
            left -= self._basis @ (self._basis.T @ left)
            sums = np.sum(left * left, axis=0)
            k = int(np.argmin(sums))
            if sums[k] < best.left:
                best = Placed(float(sums[k]), start + float(some[k]), steps)
        return best


def place_runs(fit: TraceFit, sets: Sequence[Parameters]) -> None:
    """Move the starts of an experiment's runs to where one of some models fits best.

    Hum may have made a step more or less; the numbers of steps are corrected, too.
    """
    runs = list(fit.experiment.runs)
    far = SEARCH.far if fit.experiment.doubtful else 0.0
    for k, run in enumerate(fit.experiment.runs):
        window, begun = Window(fit, k), Placed(math.inf, float(fit.starts[k]), run.steps)
        places = [(_best(window, [begun], p, far), p) for p in sets]
        best, p = min(
            places, key=lambda one: one[0].left, default=(begun, fit.experiment.parameters)
        )
        if not math.isfinite(best.left):
            continue
        # Other runs that may look the same: a step more or less, at the start or the end.
        sign, period = 1 if best.steps > 0 else -1, 1.0 / run.frequency
        begun_otherwise = [
            Placed(math.inf, best.start + shift * period, best.steps + sign * more)
            for shift, more in ((0, 1), (0, -1), (-1, 1), (1, -1), (-1, 0), (1, 0))
            if abs(best.steps) + more > 0
        ]
        others = _best(window, begun_otherwise, p, 0.0)
        if others.left < SEARCH.clearly_better * best.left:
            best = others
        fit.starts[k] = best.start
        runs[k] = replace(run, start=best.start, steps=best.steps)
    fit.take(replace(fit.experiment, runs=tuple(runs), doubtful=False))


def clock_of(fit: TraceFit, p: Parameters) -> Array:
    """Return the clock that aligns a model best with the runs, in the form of `TraceFit`."""
    clock = np.zeros(fit.clocks)
    for k, run in enumerate(fit.experiment.runs):
        begun = Placed(math.inf, float(fit.starts[k]), run.steps)
        best = _best(Window(fit, k), [begun], p, 0.0)
        clock[k] = (best.start - begun.start) / CLOCK
    return clock


def _best(window: Window, begun: Sequence[Placed], p: Parameters, far: float) -> Placed:
    """Return the best shift of a model near given starts, within far periods of the drive.

    It is the first start if the model makes no contact.
    """
    period = 1.0 / window.run.frequency
    try:
        ringing = Plant.of(p).ringing_frequency
        near = max(SEARCH.swings / max(ringing, window.run.frequency), SEARCH.periods * period)
        reach = max(min(near, SEARCH.within * period), far * period)
        found = [window.placed(p, one.start, reach, one.steps) for one in begun]
    except (ParameterError, SolverError):
        return begun[0]
    return min([begun[0], *found], key=lambda one: one.left)


_NONE = np.zeros(0)


class CoarseFit:
    """One experiment, evaluated in a few bins."""

    def __init__(self, fit: TraceFit) -> None:
        """Choose bins outside of slips, within the first cycles of the first run."""
        # The low-pass of a sensor takes longer than the axis, and hardly moves an optimum.
        known = fit.parameters.replace(sensor_bandwidth=None)
        self.experiment = replace(fit.experiment, parameters=known)
        self._starts = fit.starts
        run, (begin, end), bins = fit.experiment.runs[0], fit.experiment.unsure, fit.bins
        begin = max(begin, run.start - 1.0 / run.frequency)
        end = min(end, run.start + SEARCH.cycles / run.frequency)
        slip, slip_end = fit.experiment.slip
        since = np.mod(bins.t - run.start - slip_end, 1.0 / run.frequency)
        until = 1.0 / run.frequency - (slip_end - slip) - since
        outside = (since > SEARCH.guard) & (until > SEARCH.guard)
        self._bins = bins.some((bins.t >= begin) & (bins.t <= end) & outside, SEARCH.bins)
        self._basis = self._bins.of_sensor()

    def cost(self, p: Parameters) -> float:
        """Return the sum of squares that a model leaves. ParameterError, SolverError."""
        # The middle of a bin is near enough to its mean here, at half the cost.
        x, speed = self.experiment.simulate(p, self._starts, self._bins.t)
        left, speed = (
            one - self._basis @ (self._basis.T @ one) for one in (self._bins.x - x, speed)
        )
        shift = float(left @ speed) / max(float(speed @ speed), 1e-30)
        rest = left - shift * speed
        cost, ringing = float(rest @ rest) / SEARCH.noise**2, self.experiment.ringing
        if ringing is not None:
            plant = Plant.of(p)
            decay = (plant.contact.sigma_1 + plant.contact.sigma_2) / (2.0 * plant.mass)
            frequency = max(plant.ringing_frequency, 1e-3 * ringing.frequency)
            cost += (math.log(frequency / ringing.frequency) / SEARCH.frequency) ** 2
            cost += (math.log(max(decay, 1e-9) / ringing.decay) / SEARCH.decay) ** 2
        return cost


def search(
    fits: Sequence[TraceFit],
    curves: Sequence[CurveFit],
    free: FreeParameters,
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
    looks = [CoarseFit(fit) for fit in fits]

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
        tol=SEARCH.tolerance,
        atol=SEARCH.agree,
        polish=False,
        seed=random,
        callback=after,
    )
    handed: list[Array] = []
    for k in np.argsort(found.population_energies, kind="stable"):
        member = np.asarray(found.population[k])
        if all(np.abs(member - other).max() > SEARCH.distinct for other in handed):
            handed.append(member)
        if len(handed) == SEARCH.handed_on:
            break
    return handed


def _population(
    fits: Sequence[TraceFit], free: FreeParameters, random: np.random.Generator
) -> Array:
    """Return random members, half of them such as the ringing asks for."""
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
        "sigma_0": (sigma_0, 2.0 * SEARCH.frequency),
        "sigma_1": (sigma_1_of_decay(seen.ringing.decay, mass), SEARCH.decay),
    }
    half = slice(1, count // 2)
    for name, (value, width) in wanted.items():
        if name in free.names and value > 0.0:
            k = free.names.index(name)
            near = np.log(value) + width * random.standard_normal(count // 2 - 1)
            members[half, k] = np.clip(near, free.low[k], free.high[k])
    return members
