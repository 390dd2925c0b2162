# SPDX-License-Identifier: Apache-2.0
"""Least squares over all experiments: parameters that they share, clocks of their own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from stickslip_ros.arrays import Array
from stickslip_ros.identification.curve import CurveFit
from stickslip_ros.identification.free import FreeParameters
from stickslip_ros.identification.settings import DESCENT
from stickslip_ros.identification.trace_fit import BinnedModel, TraceFit
from stickslip_ros.parameters import ParameterError
from stickslip_ros.solver import SolverError


@dataclass(frozen=True)
class Point:
    """Values of all unknowns, with their residuals."""

    unknowns: Array  #: logarithms of the parameters, then the clock of each experiment
    residuals: Array  #: of all experiments in units of their noise, then of the priors
    seen: tuple[BinnedModel, ...]
    bases: tuple[Array, ...]

    @property
    def deviance(self) -> float:
        """Sum of the squares of the residuals."""
        return float(self.residuals @ self.residuals)


class Problem:
    """Experiments and free parameters; unknowns have shape (parameters + clocks,)."""

    def __init__(self, fits: Sequence[TraceFit | CurveFit], free: FreeParameters) -> None:
        """Take the experiments as they are; their noise may be learnt on the way."""
        self.fits, self.free = list(fits), free
        edges = np.cumsum([len(free.names), *(fit.clocks for fit in fits)])
        self._clocks = [slice(a, b) for a, b in pairwise(edges.tolist())]
        self.size = int(edges[-1])

    @property
    def traces(self) -> list[tuple[int, TraceFit]]:
        """The traces among the experiments, with their numbers."""
        return [(k, fit) for k, fit in enumerate(self.fits) if isinstance(fit, TraceFit)]

    @property
    def is_stated(self) -> bool:
        """Whether tables state all deviations, so that none is estimated from residuals."""
        return all(isinstance(fit, CurveFit) and fit.is_stated for fit in self.fits)

    def begin(self, theta: Array) -> Array:
        """Return unknowns with the clocks as they were found."""
        return np.concatenate([theta, np.zeros(self.size - len(theta))])

    def clock(self, unknowns: Array, k: int) -> Array:
        """Return the clock of an experiment."""
        return unknowns[self._clocks[k]]

    def _seen(self, unknowns: Array) -> tuple[BinnedModel, ...]:
        theta = unknowns[: len(self.free.names)]
        return tuple(
            fit.model(self.free.applied(fit.parameters, theta), self.clock(unknowns, k))
            for k, fit in enumerate(self.fits)
        )

    def point(self, unknowns: Array) -> Point | None:
        """Return the point of unknowns; None if the law makes no contact of them."""
        try:
            seen = self._seen(unknowns)
        except (ParameterError, SolverError):
            return None
        return self.point_of(unknowns, seen)

    def point_of(self, unknowns: Array, seen: tuple[BinnedModel, ...]) -> Point:
        """Return the point of a model that was already computed, with the noise as known now."""
        parts = [fit.residuals(one) for fit, one in zip(self.fits, seen, strict=True)]
        known = self.free.prior_residuals(unknowns[: len(self.free.names)])
        clocks = [
            fit.clock_weight * float(self.clock(unknowns, k)[-1:].sum())
            for k, fit in enumerate(self.fits)
        ]
        residuals = np.concatenate([*(one for one, _ in parts), known, clocks])
        return Point(unknowns, residuals, seen, tuple(basis for _, basis in parts))

    def derivatives(self, at: Point, changes: Sequence[Array]) -> Array:
        """Return the derivatives of the residuals for changes of each model, (residuals,)."""
        found = np.zeros(len(at.residuals))
        own = zip(self.fits, changes, at.bases, strict=True)
        changed = np.concatenate([fit.projected(change, basis) for fit, change, basis in own])
        found[: len(changed)] = changed
        return found

    def jacobian(self, at: Point) -> Array:
        """Return the derivatives of the residuals by the unknowns, (residuals, unknowns)."""
        count = len(self.free.names)
        jacobian = np.zeros((len(at.residuals), self.size))
        for column in range(count):
            jacobian[:, column] = self.derivatives(at, self._slopes(at, column))
        known = self.free.prior_jacobian(at.unknowns[:count])
        row, last = 0, len(at.residuals) - len(self.fits)
        jacobian[last - len(known) : last, :count] = known
        for k, (fit, seen, basis) in enumerate(zip(self.fits, at.seen, at.bases, strict=True)):
            slopes = fit.clock_derivatives(seen, self.clock(at.unknowns, k))
            own = jacobian[row : row + fit.size, self._clocks[k]]
            own[:] = fit.projected(slopes, basis)
            jacobian[last + k, self._clocks[k]][-1:] = fit.clock_weight
            row += fit.size
        return jacobian

    def _slopes(self, at: Point, column: int) -> list[Array]:
        """Return the derivatives of the models by one logarithm."""
        sides, step = [], max(fit.step for fit in self.fits)
        for sign in (1.0, -1.0):
            moved = at.unknowns.copy()
            moved[column] += sign * step
            try:
                sides.append((sign, self._seen(moved)))
            except (ParameterError, SolverError):
                sides.append((0.0, at.seen))
        (a, upper), (b, lower) = sides
        width = (a - b) * step or 1.0
        return [(u.x - v.x) / width for u, v in zip(upper, lower, strict=True)]

    def step(
        self, unknowns: Array, columns: Sequence[int], solve: Callable[[list[int]], Array]
    ) -> Array:
        """Return the least squares step in some columns, without unknowns that are at a bound.

        Cutting a step at a bound would leave the other unknowns with a step that belongs to the
        uncut one.
        """
        columns, count = list(columns), len(self.free.names)
        while True:
            step = np.zeros(self.size)
            step[columns] = solve(columns)
            theta, way = unknowns[:count], step[:count]
            out = ((theta <= self.free.low) & (way < 0.0)) | (
                (theta >= self.free.high) & (way > 0.0)
            )
            held = set(np.flatnonzero(out).tolist())
            if not held:
                return step
            columns = [column for column in columns if column not in held]

    def bounded(self, unknowns: Array) -> Array:
        """Return unknowns with the parameters within their bounds."""
        count = len(self.free.names)
        unknowns = unknowns.copy()
        unknowns[:count] = np.clip(unknowns[:count], self.free.low, self.free.high)
        return unknowns


def descend(problem: Problem, start: Point, rounds: int) -> Point:
    """Descend by Levenberg-Marquardt steps for a number of rounds; return the best point."""
    damping, at = DESCENT.damping, start
    for _ in range(rounds):
        jacobian = problem.jacobian(at)
        normal, slope = jacobian.T @ jacobian, jacobian.T @ at.residuals
        before = at.deviance
        for _ in range(DESCENT.tries):
            found = _take_step(problem, at, normal, slope, damping)
            if found is not None and found.deviance < at.deviance:
                at, damping = found, damping / DESCENT.easier
                break
            damping *= DESCENT.harder
        if before - at.deviance < max(DESCENT.converged, 1e-7 * before):
            break
    return at


def descend_from(
    problem: Problem,
    starts: Sequence[Point],
    rounds: int,
    progress: Callable[[int, Point], None] = lambda done, best: None,
) -> list[Point]:
    """Descend from several starts, the best ones for more rounds; return the ends.

    progress is called with the number of finished starts and the best end so far.
    """
    ends: list[Point] = []
    for start in starts:
        ends.append(descend(problem, start, DESCENT.short))
        progress(len(ends), min(ends, key=lambda one: one.deviance))
    count = len(problem.free.names)
    followed: list[Array] = []
    for k in sorted(range(len(ends)), key=lambda k: ends[k].deviance):
        theta = ends[k].unknowns[:count]
        if all(np.abs(theta - other).max() > DESCENT.near for other in followed):
            followed.append(theta)
            ends[k] = descend(problem, ends[k], rounds)
        if len(followed) == DESCENT.followed:
            break
    return ends


def _take_step(
    problem: Problem, at: Point, normal: Array, slope: Array, damping: float
) -> Point | None:
    diagonal = np.diag(normal)
    damped = normal + np.diag(damping * (diagonal + 1e-9 * float(diagonal.max())))

    def solve(some: list[int]) -> Array:
        return np.asarray(-np.linalg.solve(damped[np.ix_(some, some)], slope[some]))

    step = problem.step(at.unknowns, range(problem.size), solve)
    count = len(problem.free.names)
    longest = float(np.abs(step[:count]).max(initial=0.0))
    step *= min(1.0, DESCENT.stride / max(longest, 1e-30))
    return problem.point(problem.bounded(at.unknowns + step))
