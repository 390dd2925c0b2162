# SPDX-License-Identifier: Apache-2.0
"""Ranks friction laws by their predictions of data that was left out of the fit.

A law with more constants always fits better. So each law is fitted to a part of the measurements
and judged by the rest: each third of the cycles of all runs is left out in turn. (A run left out
whole may have a preload of its own, of which the others cannot tell Eq. 13 and 14.) The score is
the deviance of all left-out data, in units of the residual noise of the best law (cross-validation:
M. Stone, J. R. Stat. Soc. B 36 (1974) 111). Of two laws, the one with more constants comes first
only if it is significantly better.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stickslip_ros.arrays import Array
from stickslip_ros.identification.fit import RankedLaw
from stickslip_ros.identification.free import (
    LAG,
    FreeParameters,
    Prior,
    default_names,
    free_parameters,
    starting_value,
)
from stickslip_ros.identification.least_squares import Point, Problem, descend
from stickslip_ros.identification.settings import MISFIT
from stickslip_ros.laws import LAWS
from stickslip_ros.model import Plant
from stickslip_ros.parameters import ParameterError, Parameters

#: Laws that are ranked, all that say what is free: model, and what is free besides.
RANKED_LAWS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    **{name: (name, ()) for name, law in LAWS.items() if law.free and law.ranked},
    "free": ("ceim", ("z_ss",)),
}


def with_law(p: Parameters, model: str) -> Parameters:
    """Return parameters with another law. ParameterError if it makes no contact.

    The limit of a law may lie below the breakaway distance given for another law.
    """
    p = p.replace(model=model)
    for _ in range(MISFIT.halvings):
        try:
            Plant.of(p)
        except ParameterError:
            p = p.replace(z_ba=0.5 * starting_value(p, "z_ba"))
    Plant.of(p)
    return p


def free_of_law(
    sets: Sequence[Parameters],
    more: Sequence[str],
    bounds: Mapping[str, tuple[float, float]],
    priors: Mapping[str, Prior],
) -> FreeParameters:
    """Return the free parameters of the law of sets; more: free besides its default ones.

    Bounds and priors apply to the constants that the law has.
    """
    names = (*default_names(sets), *more)
    return free_parameters(
        sets,
        names,
        {name: one for name, one in bounds.items() if name in names},
        {name: one for name, one in priors.items() if name in names},
    )


@dataclass(frozen=True)
class LawScore:
    """A law and its residuals of left-out data; arrays have shape (traces,)."""

    name: str
    values: Mapping[str, float]  #: of its constants, fitted to everything
    squares: Array  #: sum over all samples, m^2
    bins: Array  #: number of bins
    chance: Array  #: effective variance of a sample of correlated noise like the residuals, m^2
    residual: float  #: root mean square over all bins, m


def score_law(name: str, problem: Problem, best: Point) -> LawScore:
    """Score a law on left-out cycles."""
    count = len(problem.traces)
    squares, bins, total = np.zeros(count), np.zeros(count), 0.0
    for k, left, samples in _leave_out_cycles(problem, best):
        squares[k] += float(np.sum(left**2 * samples))
        bins[k] += len(left)
        total += float(np.sum(left**2))
    # What repeats with the drive is judged, so the noise at its frequency counts.
    colour = [
        fit.noise.power(fit.experiment.runs[0].frequency * float(np.median(np.diff(fit.bins.t))))
        for _, fit in problem.traces
    ]
    values = problem.free.values(best.unknowns[: len(problem.free.names)])
    constants = {key: value for key, value in values.items() if key != LAG}
    return LawScore(
        name, constants, squares, bins,
        np.maximum(squares / bins, colour), float(np.sqrt(total / bins.sum())),
    )  # fmt: skip


def rank_laws(laws: Sequence[LawScore]) -> tuple[RankedLaw, ...]:
    """Return the laws, the best one first."""
    chance = np.min([law.chance for law in laws], axis=0)
    deviance = [float(np.sum(law.squares / chance)) for law in laws]
    least = min(deviance)
    order = sorted(
        range(len(laws)), key=lambda k: deviance[k] + MISFIT.for_a_constant * len(laws[k].values)
    )
    scores = [one - least for one in deviance]
    return tuple(
        RankedLaw(
            laws[k].name, laws[k].values, scores[k], laws[k].residual, scores[k] < MISFIT.unlikely
        )
        for k in order
    )


def _leave_out_cycles(problem: Problem, best: Point) -> Iterator[tuple[int, Array, Array]]:
    """Yield for each trace and part of it the number, residuals (m), and samples of the bins."""
    cycles = {k: fit.cycles(problem.clock(best.unknowns, k)) for k, fit in problem.traces}
    for part in range(MISFIT.left_out_parts):
        fits, left_out = list(problem.fits), {}
        for k, fit in problem.traces:
            number = np.floor(cycles[k] / (np.nanmax(cycles[k]) + 1e-9) * MISFIT.left_out_parts)
            left_out[k] = (number == part) & (fit.kept > 0.0)
            fits[k] = own = copy.copy(fit)
            own.kept = fit.kept * ~left_out[k]
        without = Problem(fits, problem.free)
        begun = without.point(best.unknowns)
        if begun is None:
            continue
        end = descend(without, begun, MISFIT.rounds_without)
        for k, fit in without.traces:
            yield k, fit.unprojected(end.seen[k])[left_out[k]], fit.bins.count[left_out[k]]
