# SPDX-License-Identifier: Apache-2.0
"""Intervals of 95 %: a profile of the deviance along the constant that is known least.

Across that ridge the deviance is quadratic; along it, it may bend. So the ridge is followed, all
else at its optimum, until the deviance has risen by the 95 % quantile of chi squared. The profile
of each constant follows from its place on the ridge and its spread across it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.identification.fit import Profile
from stickslip_ros.measurement.identification.problem import Point, Problem

#: Rise of the deviance at the ends of an interval of 95 %.
RISE = float(1.959963984540054**2)
#: Deviation (logarithm) below which a ridge is straight, and from which on nothing is determined.
_STRAIGHT, UNKNOWN = 0.02, 0.7
#: First stride along the ridge as part of the end that is expected; longest one (logarithm); how it
#: goes on below parts of the rise; looks at a side; rise that is far enough; farthest distance.
_STRIDE, _LONGEST, _LOOKS, _ENOUGH, _FARTHEST = 0.55, 0.5, 9, 1.3, math.log(30.0)
#: Distance (logarithm) to a bound that is not worth a look.
_NEAREST = 1e-3
_NEXT = ((0.15, 1.7), (0.5, 1.0), (math.inf, 0.7))
#: Rounds of a descent on the ridge; deviance below the optimum that makes a better one.
_ROUNDS, _BETTER = 4, 1.0
#: Points of a profile, and the highest rise in it.
_POINTS, _SHOWN = 61, 8.0
#: Slope of logarithms from which on a parameter goes along with the ridge.
_ALONG = 0.3
#: Share of a parameter in a direction from which on it is named.
_SHARE = 0.25


class BetterOptimum(Exception):
    """A ridge has come below the optimum."""

    def __init__(self, point: Point) -> None:
        """Keep the better point."""
        super().__init__()
        self.point = point


@dataclass(frozen=True)
class Span:
    """The interval of one parameter, as logarithms; None for an end that is not determined."""

    value: float
    low: float | None
    high: float | None

    def joined(self, other: Span) -> Span:
        """Return an interval that holds both, with the value of this one."""
        low = None if None in (self.low, other.low) else min(self.low, other.low)  # type: ignore[type-var]
        high = None if None in (self.high, other.high) else max(self.high, other.high)  # type: ignore[type-var]
        return Span(self.value, low, high)


class Surroundings:
    """What a problem knows about its optimum: the Jacobian, the covariance and the ridge."""

    def __init__(self, problem: Problem, best: Point, stops: bool = True) -> None:
        """Compute the Jacobian and follow the ridge. BetterOptimum, unless it does not stop."""
        self.problem, self.best = problem, best
        self.jacobian = problem.jacobian(best, central=True)
        measured = sum(getattr(fit, "known", fit.size) for fit in problem.fits)
        self.free = max(measured - problem.size, 1)
        # A good fit by chance makes no interval narrower; a table without deviations learns them.
        self.scale = max(1.0, best.deviance / self.free)
        self.rise = RISE
        if not problem.traces:
            self.rise = float(scipy.stats.f.ppf(0.95, 1, self.free))
            if not all(getattr(fit, "is_stated", False) for fit in problem.fits):
                self.scale = best.deviance / self.free
        self.covariance = problem.covariance(self.jacobian, self.scale)
        self._ridge = int(np.argmax(np.diag(self.covariance)[: problem.count]))
        self._looks = self._follow(stops)

    @property
    def deviations(self) -> Array:
        """Standard deviations of the unknowns."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def information(self) -> Array:
        """Return the information of the logarithms, all else projected out, (parameters,) * 2."""
        count = self.problem.count
        own, others = self.jacobian[:, :count], self.jacobian[:, count:]
        if others.shape[1]:
            basis, _ = np.linalg.qr(others)
            own = own - basis @ (basis.T @ own)
        return np.asarray(own.T @ own / self.scale)

    def correlations(self) -> Array:
        """Return the correlations of the logarithms, (parameters,) * 2."""
        count, size = self.problem.count, self.deviations
        own = self.covariance[:count, :count]
        return np.asarray(own / np.outer(size[:count], size[:count]))

    def unknown(self) -> list[str]:
        """Return the freedoms that the measurements leave, in words."""
        values, vectors = np.linalg.eigh(self.information())
        return [
            in_words(self.problem.free.names, vector)
            for value, vector in zip(values, vectors.T, strict=True)
            if value * UNKNOWN**2 < 1.0
        ]

    def _follow(self, stops: bool) -> list[tuple[float, float, Array]]:
        """Return place, rise and unknowns along the ridge, in rising order."""
        problem, best, k = self.problem, self.best, self._ridge
        looks = [(float(best.unknowns[k]), 0.0, best.unknowns)]
        deviation = float(self.deviations[k])
        if deviation < _STRAIGHT:
            return looks
        for sign in (-1.0, 1.0):
            slope = self.covariance[:, k] / self.covariance[k, k]
            at, stride = best.unknowns, _STRIDE * math.sqrt(self.rise) * deviation
            for _ in range(_LOOKS):
                place = float(at[k]) + sign * min(stride, _LONGEST)
                last = problem.high[k] if sign > 0.0 else problem.low[k]
                if sign * (place - last) > 0.0:
                    place = float(last)
                far = abs(place - float(best.unknowns[k])) > _FARTHEST
                if far or abs(place - float(at[k])) < _NEAREST:
                    break
                end = self._held(k, place, at, slope)
                if end is None:
                    break
                rise = (end.deviance - best.deviance) / self.scale
                if rise < -_BETTER and stops:
                    raise BetterOptimum(end)
                looks.append((place, max(rise, 0.0), end.unknowns))
                slope, at = (end.unknowns - at) / (place - float(at[k])), end.unknowns
                if rise > _ENOUGH * self.rise:
                    break
                stride *= next(factor for part, factor in _NEXT if rise < part * self.rise)
        return sorted(looks, key=lambda one: one[0])

    def _held(self, k: int, place: float, at: Array, slope: Array) -> Point | None:
        """Return the best point with one parameter held, all else along a slope first."""
        for ahead in (slope, np.zeros_like(slope)):
            unknowns = at + ahead * (place - float(at[k]))
            unknowns = np.clip(unknowns, self.problem.low, self.problem.high)
            unknowns[k] = place
            begun = self.problem.point(unknowns)
            if begun is not None:
                return self.problem.descend(begun, _ROUNDS, held=k)
        return None

    def profile(self, k: int) -> Profile:
        """Return the profile of parameter k, SI units."""
        name, value = self.problem.free.names[k], float(self.best.unknowns[k])
        span = self.span(k)
        ends = [e for e in (span.low, span.high) if e is not None]
        reach = max((abs(e - value) for e in ends), default=float(self.deviations[k]))
        reach = min(reach * math.sqrt(_SHOWN / self.rise), _FARTHEST)
        at = np.linspace(value - reach, value + reach, _POINTS)
        rise = self._rise(k, at)
        low, high = (None if e is None else math.exp(e) for e in (span.low, span.high))
        return Profile(name, np.exp(at), rise, low, high, self.rise)

    def span(self, k: int) -> Span:
        """Return the interval of parameter k."""
        value, deviation = float(self.best.unknowns[k]), float(self.deviations[k])
        if len(self._looks) < 3:
            end = math.sqrt(self.rise) * deviation
            known = deviation < UNKNOWN
            return Span(value, value - end if known else None, value + end if known else None)
        places, rises, middle = self._fine(k)
        inside = rises <= self.rise
        half = np.sqrt(np.maximum((self.rise - rises[inside]) * self._across(k), 0.0))
        low, high = float((middle[inside] - half).min()), float((middle[inside] + half).max())
        # A ridge that does not close leaves open what goes along with it.
        open_low, open_high = bool(inside[0]), bool(inside[-1])
        if k != self._ridge:
            slopes = np.diff(middle)[[0, -1]] / np.diff(places)[[0, -1]]
            ends = [(slopes[0], open_low, -1.0), (slopes[1], open_high, 1.0)]
            along = [sign * slope for slope, is_open, sign in ends if is_open]
            open_low = any(slope < -_ALONG for slope in along)
            open_high = any(slope > _ALONG for slope in along)
        return Span(value, None if open_low else low, None if open_high else high)

    def _across(self, k: int) -> float:
        """Return the variance of parameter k across the ridge."""
        own, r = self.covariance, self._ridge
        return max(float(own[k, k] - own[k, r] ** 2 / own[r, r]), 0.0)

    def _fine(self, k: int) -> tuple[Array, Array, Array]:
        """Return places on the ridge, rises, and where parameter k lies there."""
        at = np.array([one[0] for one in self._looks])
        signs = np.sign(at - float(self.best.unknowns[self._ridge]))
        root = signs * np.sqrt(np.array([one[1] for one in self._looks]))
        fine = np.linspace(at[0], at[-1], 1001)
        own = np.array([one[2][k] for one in self._looks])
        middle = scipy.interpolate.PchipInterpolator(at, own)(fine)
        return fine, np.interp(fine, at, root) ** 2, np.asarray(middle)

    def _rise(self, k: int, at: Array) -> Array:
        """Return the least rise at values of parameter k, over the ridge."""
        if len(self._looks) < 3:
            return np.asarray((at - float(self.best.unknowns[k])) ** 2 / self.covariance[k, k])
        places, rises, middle = self._fine(k)
        if k == self._ridge:
            return np.interp(at, places, rises, math.inf, math.inf)
        across = max(self._across(k), float(np.abs(np.diff(middle)).max()) ** 2)
        return np.asarray(np.min(rises + (at[:, None] - middle) ** 2 / across, axis=1))


def in_words(names: Sequence[str], direction: Array) -> str:
    """Describe a direction in which the logarithms can move unnoticed, in words."""
    direction = direction / direction[int(np.argmax(np.abs(direction)))]
    named = [k for k in np.argsort(-np.abs(direction)) if abs(direction[k]) >= _SHARE]
    if len(named) == 1:
        return f"{names[named[0]]} is not determined by these measurements"
    together = listed([names[k] for k in named])
    first, ratios = names[named[0]], []
    for k in named[1:]:
        power = float(direction[k])
        shown = "" if abs(abs(power) - 1.0) < 0.1 else f"^{abs(1.0 / power):.2g}"
        ratios.append(f"{names[k]}{shown} {'/' if power > 0.0 else '*'} {first}")
    verb = "is" if len(ratios) == 1 else "are"
    text = f"{together} are not determined one by one: only {listed(ratios)} {verb}"
    if "mass" in [names[k] for k in named]:
        return f"{text}; give the mass, or add a run against a spring of known stiffness"
    return f"{text}; give one of them (--prior), or add a run at another amplitude or preload"


def listed(names: Sequence[str]) -> str:
    """Return names as a text: commas, "and" before the last."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
