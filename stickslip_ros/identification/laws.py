# SPDX-License-Identifier: Apache-2.0
"""Ranks friction laws by their predictions of data that was left out of the fit.

A law with more constants always fits better. So each law is fitted to a part of the measurements
and judged by the rest: of several runs, each is left out in turn; of a single one, each third of
its cycles. Zero, drift, hum and clock of a left-out run are fitted to that run. The score is the
deviance of all left-out data, in units of the residual noise of the best law (cross-validation: M.
Stone, J. R. Stat. Soc. B 36 (1974) 111). Of two laws, the one with more constants comes first only
if it is significantly better.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stickslip_ros.arrays import Array
from stickslip_ros.identification.curve import CurveFit
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
from stickslip_ros.identification.trace_fit import TraceFit
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
    """Score a law on left-out runs, or on left-out cycles of a single run."""
    count = len(problem.traces)
    squares, bins, total = np.zeros(count), np.zeros(count), 0.0
    left_out = _leave_out_runs if len(problem.fits) > 1 else _leave_out_cycles
    for k, left, samples in left_out(problem, best):
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


def _leave_out_runs(problem: Problem, best: Point) -> Iterator[tuple[int, Array, Array]]:
    """Yield for each trace its number, its residuals (m), and the samples of its bins."""
    count = len(problem.free.names)
    traces = [fit for _, fit in problem.traces]
    for k, fit in enumerate(traces):
        others: list[TraceFit | CurveFit] = [one for one in problem.fits if one is not fit]
        clocks = [problem.clock(best.unknowns, j) for j, one in enumerate(problem.fits) if j != k]
        without = Problem(others, problem.free)
        begun = without.point(np.concatenate([best.unknowns[:count], *clocks]))
        if begun is None:
            continue
        theta = descend(without, begun, MISFIT.rounds_without).unknowns[:count]
        own = copy.copy(fit)
        known = problem.free.applied(fit.parameters, theta)
        own.experiment = replace(fit.experiment, parameters=known)
        alone = Problem([own], FreeParameters((), np.zeros(0), np.zeros(0), np.zeros(0), {}))
        begun = alone.point(problem.clock(best.unknowns, k).copy())
        if begun is not None:
            end = descend(alone, begun, MISFIT.rounds_without)
            yield k, own.unprojected(end.seen[0]), fit.bins.count


def _leave_out_cycles(problem: Problem, best: Point) -> Iterator[tuple[int, Array, Array]]:
    """Yield for each part of a run 0, its residuals (m), and the samples of its bins."""
    ((_, fit),) = problem.traces
    cycle = fit.cycles(problem.clock(best.unknowns, 0))
    number = np.floor(cycle / (np.nanmax(cycle) + 1e-9) * MISFIT.left_out_parts)
    for part in range(MISFIT.left_out_parts):
        out = number == part
        own = copy.copy(fit)
        own.kept = fit.kept * ~out
        without = Problem([own], problem.free)
        begun = without.point(best.unknowns)
        if begun is not None and out.any():
            end = descend(without, begun, MISFIT.rounds_without)
            yield 0, own.unprojected(end.seen[0])[out], fit.bins.count[out]
