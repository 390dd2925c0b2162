# SPDX-License-Identifier: Apache-2.0
"""Least squares over all experiments: parameters that they share, clocks of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.identification.curve import CurveFit
from stickslip_ros.measurement.identification.free import WIDTH, FreeParameters, Nuisance
from stickslip_ros.measurement.identification.trace import Seen, Trace
from stickslip_ros.physics.parameters import ParameterError, Parameters
from stickslip_ros.physics.solver import SolverError

#: Residual of parameters that make no contact.
_IMPOSSIBLE = 1e3
#: Differences of a nuisance, in its standard deviations.
_NUISANCE_STEP = 0.02
#: Bounds of starts (us) and of the clock's rate (1e-5).
_STARTS, _RATES = 200.0, 300.0


@dataclass(frozen=True)
class Point:
    """Values of all unknowns, with their residuals."""

    unknowns: Array  #: logarithms of the parameters, nuisances, then the clock of each experiment
    residuals: Array  #: of all experiments in units of their noise, then of the priors
    seen: tuple[Seen, ...]

    @property
    def deviance(self) -> float:
        """Sum of the squares of the residuals."""
        return float(self.residuals @ self.residuals)


class Problem:
    """Experiments and free parameters; unknowns have shape (size,)."""

    def __init__(
        self,
        fits: Sequence[Trace | CurveFit],
        free: FreeParameters,
        nuisances: Sequence[Nuisance] = (),
    ) -> None:
        """Take the experiments as they are; their noise may be learnt on the way."""
        self.fits, self.free, self.nuisances = list(fits), free, tuple(nuisances)
        self.count = len(free.names)
        self.shared = self.count + len(self.nuisances)
        edges = np.cumsum([self.shared, *(fit.clocks for fit in fits)])
        self._clocks = [slice(a, b) for a, b in pairwise(edges.tolist())]
        self.size = int(edges[-1])
        self.low, self.high = np.full(self.size, -_STARTS), np.full(self.size, _STARTS)
        self.low[: self.count], self.high[: self.count] = free.low, free.high
        for k, one in enumerate(self.nuisances, self.count):
            self.low[k], self.high[k] = one.low, one.high
        for own in self._clocks:
            self.low[own][-1:], self.high[own][-1:] = -_RATES, _RATES

    @property
    def traces(self) -> list[Trace]:
        """The traces among the experiments, which come first."""
        return [fit for fit in self.fits if isinstance(fit, Trace)]

    @property
    def tables(self) -> list[CurveFit]:
        """The tables among the experiments."""
        return [fit for fit in self.fits if isinstance(fit, CurveFit)]

    def number(self, name: str) -> int:
        """Return the place of a nuisance among the unknowns. ValueError without it."""
        return self.count + [one.name for one in self.nuisances].index(name)

    def value(self, name: str, unknowns: Array) -> float:
        """Return the value of a nuisance in its unit, 0 without it."""
        known = any(one.name == name for one in self.nuisances)
        return float(unknowns[self.number(name)]) if known else 0.0

    def without(self, names: Sequence[str]) -> Problem:
        """Return the problem without some nuisances."""
        return Problem(self.fits, self.free, [n for n in self.nuisances if n.name not in names])

    def begin(self, theta: Array) -> Array:
        """Return unknowns with nuisances of 0, and the clocks as they were found."""
        return np.concatenate([theta, np.zeros(self.size - len(theta))])

    def clock(self, unknowns: Array, k: int) -> Array:
        """Return the clock of an experiment."""
        return unknowns[self._clocks[k]]

    def applied(self, p: Parameters, unknowns: Array) -> Parameters:
        """Return parameters with the values of the unknowns. ParameterError."""
        p = self.free.applied(p, unknowns[: self.count])
        for one, value in zip(self.nuisances, unknowns[self.count : self.shared], strict=True):
            if one.change is not None:
                p = one.change(p, float(value))
        return p

    def seen(self, unknowns: Array) -> tuple[Seen, ...]:
        """Return the models of all experiments. ParameterError, SolverError."""
        width = self.value(WIDTH, unknowns)
        return tuple(
            fit.model(self.applied(fit.parameters, unknowns), self.clock(unknowns, k), width)
            for k, fit in enumerate(self.fits)
        )

    def point(self, unknowns: Array) -> Point | None:
        """Return the point of unknowns; None if the law makes no contact of them."""
        try:
            return self.point_of(unknowns, self.seen(unknowns))
        except (ParameterError, SolverError):
            return None

    def point_of(self, unknowns: Array, seen: tuple[Seen, ...]) -> Point:
        """Return the point of a model that was already computed, with the noise as known now."""
        rows = [fit.residuals(one) for fit, one in zip(self.fits, seen, strict=True)]
        rows.append(self.free.prior_residuals(unknowns[: self.count]))
        known = unknowns[self.count : self.shared]
        rows.append(np.array([v / n.deviation for n, v in zip(self.nuisances, known, strict=True)]))
        for k, fit in enumerate(self.fits):
            rows.append(fit.clock_weight * self.clock(unknowns, k)[-1:])
        return Point(unknowns, np.concatenate(rows), seen)

    def jacobian(self, at: Point, central: bool = False, held: int | None = None) -> Array:
        """Return the derivatives of the residuals by the unknowns, (residuals, unknowns).

        Differences are one-sided unless central. Those by the unknown number held are 0.
        """
        jacobian = np.zeros((len(at.residuals), self.size))
        columns = [np.zeros((len(seen.x), self.size)) for seen in at.seen]
        for k in range(self.shared):
            if k != held:
                self._differ(at, k, central, columns)
        row = 0
        for k, (fit, seen) in enumerate(zip(self.fits, at.seen, strict=True)):
            own, clock = self._clocks[k], self.clock(at.unknowns, k)
            columns[k][:, own] = fit.clock_derivatives(seen, clock)
            jacobian[row : row + fit.size] = fit.changed(columns[k])
            row += fit.size
        known = self.free.prior_jacobian(at.unknowns[: self.count])
        jacobian[row : row + len(known), : self.count] = known
        row += len(known)
        for k, one in enumerate(self.nuisances):
            jacobian[row + k, self.count + k] = 1.0 / one.deviation
        row += len(self.nuisances)
        for own, fit in zip(self._clocks, self.fits, strict=True):
            if fit.clocks:
                jacobian[row, own.stop - 1] = fit.clock_weight
                row += 1
        if held is not None:
            jacobian[:, held] = 0.0
        return jacobian

    def _differ(self, at: Point, k: int, central: bool, columns: list[Array]) -> None:
        """Fill the column of one shared unknown in the derivatives of the models."""
        if k >= self.count and self.nuisances[k - self.count].change is None:
            for one, fit, seen in zip(columns, self.fits, at.seen, strict=True):
                one[:, k] = fit.width_derivative(seen)
            return
        step = max(fit.step for fit in self.fits)
        if k >= self.count:
            step = _NUISANCE_STEP * self.nuisances[k - self.count].deviation
        looks: list[tuple[float, tuple[Seen, ...]]] = []
        for sign in (1.0, -1.0):
            moved = at.unknowns.copy()
            moved[k] = min(max(moved[k] + sign * step, self.low[k]), self.high[k])
            if moved[k] == at.unknowns[k]:
                continue
            try:
                looks.append((moved[k], self.seen(moved)))
            except (ParameterError, SolverError):
                continue
            if not central:
                break
        looks.append((float(at.unknowns[k]), at.seen))
        if len(looks) == 1:
            return
        (high, upper), (low, lower) = looks[:2]
        for column, more, less in zip(columns, upper, lower, strict=True):
            column[:, k] = np.nan_to_num(more.x - less.x) / (high - low)

    def descend(self, begun: Point, rounds: int, held: int | None = None) -> Point:
        """Return the end of a descent of some rounds; the unknown number held keeps its value."""
        keep = np.array([k for k in range(self.size) if k != held])
        low, high = self.low[keep], self.high[keep]
        inside = 1e-9 * (high - low)
        start = np.clip(begun.unknowns[keep], low + inside, high - inside)
        best = [begun]
        last = [begun]

        def whole(part: Array) -> Array:
            full = begun.unknowns.copy()
            full[keep] = part
            return full

        def residuals(part: Array) -> Array:
            found = self.point(whole(part))
            if found is None:
                return np.full(len(begun.residuals), _IMPOSSIBLE)
            last[0] = found
            if found.deviance < best[0].deviance:
                best[0] = found
            return found.residuals

        def jacobian(part: Array) -> Array:
            at, unknowns = last[0], whole(part)
            if not np.array_equal(at.unknowns, unknowns):
                at = self.point(unknowns) or at
            return self.jacobian(at, held=held)[:, keep]

        options: dict[str, Any] = {"ftol": 1e-6, "xtol": 1e-7, "gtol": 1e-12}
        scipy.optimize.least_squares(
            residuals, start, jacobian, (low, high), x_scale="jac", max_nfev=rounds, **options
        )
        return best[0]

    def covariance(self, jacobian: Array, scale: float = 1.0) -> Array:
        """Return the covariance of all unknowns; very large where they are not determined."""
        size = np.linalg.norm(jacobian, axis=0).clip(1e-30)
        _, values, vectors = np.linalg.svd(jacobian / size, full_matrices=False)
        inverse = (vectors.T / values.clip(1e-9)) / size[:, None]
        return np.asarray(scale * inverse @ inverse.T)
