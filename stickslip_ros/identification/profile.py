# SPDX-License-Identifier: Apache-2.0
"""Intervals by profile likelihood, and freedoms that the measurements leave.

The curvature at the optimum misleads if the deviance rises unevenly. The profile holds a parameter
at a value and fits all others, until the deviance has risen by the 95 % quantile of chi squared.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.arrays import Array
from stickslip_ros.identification.fit import Profile
from stickslip_ros.identification.free import LAG, value_at
from stickslip_ros.identification.least_squares import Point, Problem
from stickslip_ros.identification.settings import DESCENT


def deviations_of(information: Array) -> Array:
    """Return the standard deviations of the logarithms; very large for undetermined ones."""
    size = np.sqrt(np.maximum(np.diag(information), 1e-6))
    scaled = information / np.outer(size, size) + 1e-12 * np.eye(len(size))
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(scaled))) / size)


class BetterOptimum(Exception):
    """A profile has come below the optimum."""

    def __init__(self, point: Point) -> None:
        """Keep the better point."""
        super().__init__()
        self.point = point


class Profiler:
    """Profiles about one optimum."""

    def __init__(self, problem: Problem, best: Point, stops: bool = True) -> None:
        """Compute the Jacobian that all profiles use; a better optimum stops them, or not."""
        self.problem, self.best, self._stops = problem, best, stops
        self.jacobian = problem.jacobian(best)
        self.count = len(problem.free.names)
        free = max(len(best.residuals) - problem.size, 1)
        self.scale = best.deviance / free
        #: Rise of the deviance, in units of the scale, at the ends of a 95 % interval: 3.84 for
        #: many residuals.
        self.rise = float(scipy.stats.f.ppf(DESCENT.level, 1, free))
        if problem.is_stated:
            # A good fit by chance does not make deviations smaller than the table states.
            self.scale = max(self.scale, 1.0)
            self.rise = float(scipy.stats.chi2.ppf(DESCENT.level, 1))

    def information(self) -> Array:
        """Return the information of the logarithms, clocks projected out, (parameters,) * 2."""
        own, clocks = self.jacobian[:, : self.count], self.jacobian[:, self.count :]
        if clocks.shape[1]:
            basis, _ = np.linalg.qr(clocks)
            own = own - basis @ (basis.T @ own)
        return own.T @ own / self.scale

    def profile(self, k: int) -> Profile:
        """Return the profile of one parameter. Raises BetterOptimum."""
        deviation = float(deviations_of(self.information())[k])
        width = min(math.sqrt(self.rise) * deviation, 1.0)
        low, seen_below = self._side(k, -width)
        high, seen_above = self._side(k, width)
        at = self.best.unknowns[k]
        looks = sorted([*seen_below, (float(at), 0.0), *seen_above])
        name, (theta, rise) = self.problem.free.names[k], np.array(looks).T
        values = np.array([value_at(name, one) for one in theta])
        ends = [None if math.isinf(one) else value_at(name, one) or None for one in (low, high)]
        return Profile(name, values, rise, ends[0], ends[1], self.rise)

    def _side(self, k: int, first: float) -> tuple[float, list[tuple[float, float]]]:
        """Return the end of the interval on one side, and all evaluated points."""
        sign, step = math.copysign(1.0, first), abs(first)
        at, goal = self.best.unknowns, math.sqrt(self.rise)
        free = self.problem.free
        limit = (at[k] - free.low[k]) if sign < 0.0 else (free.high[k] - at[k])
        limit = min(limit, DESCENT.furthest)
        below, above = (0.0, 0.0), (math.inf, math.inf)  # distance, root of the rise
        looks: list[tuple[float, float]] = []
        start = at
        for _ in range(DESCENT.profile_looks):
            step = min(step, limit)
            found = self._held(k, float(at[k] + sign * step), start)
            rise = math.inf if found is None else (found.deviance - self.best.deviance) / self.scale
            root = math.sqrt(max(rise, 0.0))
            if found is not None:
                looks.append((float(at[k] + sign * step), rise))
                if rise < -DESCENT.better_optimum and self._stops:
                    raise BetterOptimum(found)
                if root <= goal:
                    start = found.unknowns
            if abs(rise - self.rise) < DESCENT.end_accuracy * self.rise:
                step += (goal - root) * (step - below[0]) / (root - below[1])
                return float(at[k] + sign * step), looks
            if root < goal:
                if step >= limit:
                    return sign * math.inf, looks
                below = max(below, (step, root))
                if above[1] > DESCENT.steep * goal:
                    above = (math.inf, math.inf)  # all else may not have followed so far at once
            else:
                above = min(above, (step, root))
            step = _next(below, above, goal)
        return sign * math.inf if math.isinf(above[0]) else float(at[k] + sign * above[0]), looks

    def _held(self, k: int, value: float, start: Array) -> Point | None:
        """Return the best point with one parameter held at a value, None if there is none."""
        kept = [j for j in range(self.problem.size) if j != k]
        # All else follows the optimum's own slopes first.
        moved = self.jacobian[:, k] * (value - start[k])
        unknowns = start + self._solve_step(start, kept, self.jacobian, moved)
        unknowns[k] = value
        at = self.problem.point(self.problem.bounded(unknowns))
        if at is None:
            unknowns = start.copy()
            unknowns[k] = value
            at = self.problem.point(self.problem.bounded(unknowns))
            if at is None:
                return None
        jacobian, place = self.jacobian, self.best
        for _ in range(DESCENT.held_rounds):
            step = self._solve_step(at.unknowns, kept, jacobian, at.residuals)
            gain = float(
                at.residuals @ at.residuals - np.sum((at.residuals + jacobian @ step) ** 2)
            )
            tries = (self.problem.bounded(at.unknowns + part * step) for part in DESCENT.parts)
            better = None
            if not gain < DESCENT.held_converged * self.scale * self.rise:
                points = filter(None, map(self.problem.point, tries))
                better = next((one for one in points if one.deviance < at.deviance), None)
            if better is not None:
                at = better
            elif place is at:  # only slopes taken here tell that this is the end
                break
            else:
                jacobian, place = self.problem.jacobian(at), at
        return at

    def _solve_step(
        self, unknowns: Array, columns: Sequence[int], jacobian: Array, residuals: Array
    ) -> Array:
        """Return the step in some of the unknowns that takes most of the residuals away."""

        def solve(some: list[int]) -> Array:
            return np.asarray(-np.linalg.lstsq(jacobian[:, some], residuals, rcond=1e-10)[0])

        return self.problem.step(unknowns, columns, solve)

    def correlations(self) -> Array:
        """Return the correlations of the logarithms, (parameters,) * 2."""
        covariance = np.linalg.pinv(self.information(), rcond=1e-12, hermitian=True)
        size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        return covariance / np.outer(size, size)

    def unknown(self) -> list[str]:
        """Return the freedoms that the measurements leave, in words."""
        values, vectors = np.linalg.eigh(self.information())
        found = []
        for value, vector in zip(values, vectors.T, strict=True):
            alone = self.problem.free.names[int(np.argmax(np.abs(vector)))]
            # A lag too small to show does no harm.
            if value * DESCENT.unknown**2 < 1.0 and alone != LAG:
                found.append(in_words(self.problem.free.names, vector))
        return found


def _next(below: tuple[float, float], above: tuple[float, float], goal: float) -> float:
    """Return the next distance to evaluate, from those on either side of the goal."""
    if math.isinf(above[0]):
        return below[0] * float(
            np.clip(DESCENT.beyond * goal / max(below[1], 1e-6), *DESCENT.onward)
        )
    if above[1] > DESCENT.steep * goal:
        return 0.5 * (below[0] + above[0])
    part = (goal - below[1]) / (above[1] - below[1])
    return below[0] + float(np.clip(part, *DESCENT.within)) * (above[0] - below[0])


def in_words(names: Sequence[str], direction: Array) -> str:
    """Describe a direction in which the logarithms can move unnoticed, in words."""
    direction = direction / direction[int(np.argmax(np.abs(direction)))]
    named = [k for k in np.argsort(-np.abs(direction)) if abs(direction[k]) >= DESCENT.share_named]
    if len(named) == 1:
        return f"{names[named[0]]} is not determined by these measurements"
    together = listed([names[k] for k in named])
    first = names[named[0]]
    ratios = []
    for k in named[1:]:
        power = float(direction[k])
        shown = "" if abs(abs(power) - 1.0) < 0.1 else f"^{abs(1.0 / power):.2g}"
        ratios.append(f"{names[k]}{shown} {'/' if power > 0.0 else '*'} {first}")
    text = f"{together} are not determined one by one: only {listed(ratios)} is"
    if len(ratios) > 1:
        text = text.removesuffix(" is") + " are"
    if "mass" in [names[k] for k in named]:
        return f"{text}; give the mass, or add a run against a spring of known stiffness"
    return f"{text}; give one of them (--prior), or add a run at another amplitude or preload"


def listed(names: Iterable[str]) -> str:
    """Return names as a text: commas, "and" before the last."""
    texts = list(names)
    return texts[0] if len(texts) == 1 else f"{', '.join(texts[:-1])} and {texts[-1]}"
