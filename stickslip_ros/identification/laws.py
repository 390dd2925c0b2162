# SPDX-License-Identifier: Apache-2.0
"""Ranks friction laws: by recordings that were left out where there are several, else by deviance.

Each law begins anywhere between bounds that ringing and stroke give, alike for all, and all are
judged in the noise that the best of them leaves. A law with more constants always fits better: of
several recordings, each is left out in turn and predicted by the fit to the others (M. Stone, J. R.
Stat. Soc. B 36 (1974) 111); in any case each constant counts 4 (H. Akaike, IEEE Trans. Autom.
Control 19 (1974) 716, gives 2: with twice as much, chance hardly takes a further one).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stickslip_ros.arrays import Array
from stickslip_ros.identification.fit import RankedLaw
from stickslip_ros.identification.free import LAG, WIDTH, starting_value
from stickslip_ros.identification.problem import Point, Problem
from stickslip_ros.identification.trace import Trace
from stickslip_ros.laws import LAWS
from stickslip_ros.model import Plant
from stickslip_ros.parameters import ParameterError, Parameters


class _Ranked(Mapping[str, tuple[str, tuple[str, ...]]]):
    """Laws that are ranked, all that say what is free: model, and what is free besides."""

    def _now(self) -> dict[str, tuple[str, tuple[str, ...]]]:
        """Return them; laws are registered while a process runs."""
        found = {name: (name, ()) for name, law in LAWS.items() if law.free and law.ranked}
        return {**found, "free": ("ceim", ("z_ss",))}

    def __getitem__(self, name: str) -> tuple[str, tuple[str, ...]]:
        return self._now()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._now())

    def __len__(self) -> int:
        return len(self._now())


RANKED_LAWS = _Ranked()
#: What each constant costs; score above which nothing speaks for a law (K. P. Burnham, D. R.
#: Anderson, Model Selection and Multimodel Inference, Springer 2002, section 2.6).
_CONSTANT, _UNLIKELY = 4.0, 10.0
#: Rounds of descents in the common noise, and without one recording.
_ROUNDS, _WITHOUT = 12, 8
#: Rounds of a descent of a clock alone.
_CLOCK_ROUNDS = 4
#: Halvings of a breakaway distance above the limit of another law.
_HALVINGS = 8


def with_law(p: Parameters, model: str) -> Parameters:
    """Return parameters with another law. ParameterError if it makes no contact.

    The limit of a law may lie below the breakaway distance given for another law.
    """
    p = p.replace(model=model)
    for _ in range(_HALVINGS):
        try:
            Plant.of(p)
        except ParameterError:
            p = p.replace(z_ba=0.5 * starting_value(p, "z_ba"))
    Plant.of(p)
    return p


@dataclass(frozen=True)
class FittedLaw:
    """A law at its optimum."""

    name: str
    problem: Problem
    best: Point

    @property
    def residual(self) -> float:
        """Root mean square (m) of what is left of the blocks."""
        left = [fit.left(self.best.seen[k]) for k, fit in self.problem.traces]
        return float(np.sqrt(np.mean(np.concatenate(left) ** 2)))

    @property
    def constants(self) -> dict[str, float]:
        """Its constants by name, SI units."""
        values = self.problem.free.values(self.best.unknowns[: self.problem.count])
        return {name: value for name, value in values.items() if name not in (LAG, WIDTH)}


def rank_laws(laws: Sequence[FittedLaw]) -> tuple[RankedLaw, ...]:
    """Return laws, the best one first, and which may be the law."""
    least = min(laws, key=lambda law: law.residual)
    noises = [trace.noise for _, trace in least.problem.traces]
    found = []
    for law in laws:
        for (_, trace), noise in zip(law.problem.traces, noises, strict=True):
            trace.set_noise(noise)
        begun = law.problem.point_of(law.best.unknowns, law.best.seen)
        end = law.problem.descend(begun, _ROUNDS)
        several = len(law.problem.traces) > 1
        deviance = _left_out(law.problem, end) if several else end.deviance
        scale = max(1.0, end.deviance / max(len(end.residuals), 1)) if law is least else 1.0
        score = deviance + _CONSTANT * len(law.constants)
        found.append((replace(law, best=end), score, scale))
    best = min(score for _, score, _ in found)
    scale = max(scale for _, _, scale in found)
    return tuple(
        RankedLaw(law.name, law.constants, (score - best) / scale, law.residual,
                  (score - best) / scale < _UNLIKELY)
        for law, score, _ in sorted(found, key=lambda one: one[1])
    )  # fmt: skip


def _left_out(problem: Problem, best: Point) -> float:
    """Return the deviance of each recording at the optimum of the others, its clock fitted."""
    total = 0.0
    for k, own in problem.traces:
        fits = [one for j, one in enumerate(problem.fits) if j != k]
        others = Problem(fits, problem.free, problem.nuisances)
        clocks = [problem.clock(best.unknowns, j) for j in range(len(problem.fits)) if j != k]
        begun = others.point(np.concatenate([best.unknowns[: problem.shared], *clocks]))
        if begun is None:
            continue
        shared = others.descend(begun, _WITHOUT).unknowns[: problem.shared]
        total += _predicted(others, own, shared, problem.clock(best.unknowns, k))
    return total


def _predicted(problem: Problem, trace: Trace, shared: Array, clock: Array) -> float:
    """Return the deviance of a recording where only its clock is fitted."""
    p, width, least = problem.applied(trace.parameters, shared), problem.width(shared), math.inf
    for _ in range(_CLOCK_ROUNDS):
        seen = trace.model(p, clock, width)
        left = trace.residuals(seen)
        least = min(least, float(left @ left))
        slopes = trace.changed(trace.clock_derivatives(seen, clock))
        clock = clock - np.linalg.lstsq(slopes, left, rcond=1e-9)[0]
    return least
