# SPDX-License-Identifier: Apache-2.0
"""Whether a run repeats at another, shorter period: positions folded at many, by likelihood.

Folded at its period, a run is a shape that all cycles share, on a straight line. At a multiple of
the period the same shape stands there several times, which takes as many more numbers to say no
more; at any other period the slips are smeared. So the Schwarz criterion (Annals of Statistics 6
(1978) 461) decides, with cells of one width in time whatever the period.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.arrays import Array
from stickslip_ros.traces.even_samples import EvenSamples, SlipGrid


@dataclass(frozen=True)
class FoldingSettings:
    """What is folded, at which periods."""

    samples: int = 800  #: of a run that are folded, from its middle
    cells: int = 12  #: of the shorter period, where it has as many samples
    slow: int = 5  #: order of the polynomial that is taken out beforehand
    fewest: float = 4.0  #: samples of a period: what is faster is ringing or cannot be told
    parts: int = 12  #: of a period at most that are tried where samples are dense
    dense: float = 150.0  #: samples of a cycle from which on they are
    near: float = 0.25  #: periods by which the clock of a run may be off over it, to either side
    clocks: int = 9  #: that are tried there
    longer: float = 0.8  #: periods above this part of the run's own are its own
    together: int = 20_000  #: positions that are folded at a time: so many stay in the cache
    #: Of a fall of the criterion by chance, among all parts of the period or all other periods.
    chance: float = 1e-3


SETTINGS = FoldingSettings()


def shorter_period(even: EvenSamples, run: SlipGrid) -> float | None:
    """Return the shorter period (s) at which the positions of a run repeat better; None if none."""
    dense = run.period / even.tick > SETTINGS.dense
    cycles = max(2, math.ceil(SETTINGS.samples * even.tick / run.period))
    if dense:
        cycles = min(run.count, 2 * SETTINGS.parts)
    first = max(0, (run.count - cycles) // 2) if run.count > 3 else 0
    begin = run.begin + first * run.period
    end = min(run.begin + (first + cycles) * run.period, run.end)
    count = int((end - begin) / even.tick)
    if dense:
        count = min(count, int(cycles * SETTINGS.dense))
    edges = np.linspace(begin, end, count + 1)
    x = even.means(edges)
    t, x = (0.5 * (edges[1:] + edges[:-1]) - begin)[np.isfinite(x)], x[np.isfinite(x)]
    if len(t) < 3 * SETTINGS.cells or not np.ptp(x) > 0.0:
        return None
    tick = (end - begin) / count
    own = 1.0 / run.period
    # From one to the next, the phase moves by half a cell at either end of the run.
    step, last = 1.0 / (SETTINGS.cells * (end - begin)), 1.0 / (SETTINGS.fewest * tick)
    near = own * (1.0 + np.linspace(-SETTINGS.near, SETTINGS.near, SETTINGS.clocks) / run.count)
    number = np.arange(2.0, min(SETTINGS.parts, last / own) + 1.0)
    parts = (number[:, None] * near).ravel()
    others = np.empty(0) if dense else np.arange(own / SETTINGS.longer, last, step)
    tried = np.concatenate((parts, others))
    if not len(tried):
        return None
    trials = np.repeat([len(number), len(others)], [len(parts), len(others)])
    # What changes slowly would be taken up by more cells: first cycles, drift.
    slow = np.polynomial.Polynomial.fit(t, x, SETTINGS.slow)
    t, x = t - 0.5 * (end - begin), x - slow(t)
    # No finer than the samples of a period: a swing in few of them would pass for a shape.
    cells = np.clip(1.0 / (tried * tick), 3.0, SETTINGS.cells).astype(int)
    criteria = _criteria(t, x, tried, cells) + 2.0 * np.log(trials / SETTINGS.chance)
    best = int(np.argmin(criteria))
    # Its own, longer period takes as many times as many cells to draw its shape as finely; one cell
    # is no shape at all.
    whole = np.full(len(near), round(cells[best] * tried[best] / own))
    near, whole = np.append(near, own), np.append(whole, 1)
    alone = float(_criteria(t, x, near, whole).min())
    return 1.0 / float(tried[best]) if criteria[best] < alone else None


def _criteria(t: Array, x: Array, frequencies: Array, cells: NDArray[np.int64]) -> Array:
    """Return Schwarz's criterion of positions as a line and a shape of so many cells, of each."""
    together = max(1, SETTINGS.together // len(t))
    parts = range(0, len(frequencies), together)
    return np.concatenate(
        [_criteria_of(t, x, frequencies[k : k + together], cells[k : k + together]) for k in parts]
    )


def _criteria_of(t: Array, x: Array, frequencies: Array, cells: NDArray[np.int64]) -> Array:
    place = np.mod(t * frequencies[:, None], 1.0) * cells[:, None]
    most, trials = int(cells.max()), len(cells)
    cell = np.minimum(place.astype(np.int64), cells[:, None] - 1)
    # Beside the line, a slope within cells: a rise drawn as stairs would leave its steps.
    within = place - cell - 0.5
    cell = (cell + most * np.arange(trials)[:, None]).ravel()
    number = np.bincount(cell, minlength=most * trials).reshape(trials, most)
    every = np.broadcast_to([x, t / t[-1]], (trials, 2, len(t)))
    own = np.stack((every[:, 0], every[:, 1], within), axis=1)
    sums = np.stack(
        [np.bincount(cell, own[:, k].ravel(), most * trials) for k in range(3)]
    ).reshape(3, trials, most)
    products = own @ own.transpose(0, 2, 1) - np.einsum(
        "iab,jab->aij", sums / np.maximum(number, 1), sums
    )
    normal = products[:, 1:, 1:] + 1e-9 * len(x) * np.eye(2)
    seen = products[:, 0, 1:]
    fitted = np.einsum("ai,ai->a", seen, np.linalg.solve(normal, seen[:, :, None])[:, :, 0])
    # Of positions without noise, too, a part is open.
    left = np.maximum(products[:, 0, 0] - fitted, 1e-6 * float(x @ x))
    unknowns = np.count_nonzero(number, axis=1) + 2
    return np.asarray(len(x) * np.log(left / len(x)) + unknowns * math.log(len(x)))
