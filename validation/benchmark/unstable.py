# SPDX-License-Identifier: Apache-2.0
"""How far off a run may be because the motion itself is unstable.

A cycle from equal starts shows what the solver does wrong in it: an error in position, in
deflection and in speed, the last times sqrt(m / sigma_0). While each of them is within the bar, the
solver keeps its promise. What the motion makes of them does not depend on the solver: it shows when
the finer run begins a cycle with its deflection, or its speed, changed by just the bar. The sum of
that over all cycles and both changes is what may be seen at the end, to first order. A run that is
further off is not explained, and counts as an error.
"""

from __future__ import annotations

import copy
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model import Plant, drive_of
from stickslip_ros.parameters import Parameters
from stickslip_ros.solver import Simulation


class Growth(NamedTuple):
    """What the solver does wrong in single cycles, and what may become of it; both in m."""

    committed: float  #: largest error of a cycle from an equal start
    explained: float  #: error per cycle that it may grow to; 0 if a cycle is off by itself


def growth_of(p: Parameters, cycles: int, bar: float, budget: int) -> Growth:
    """Return what `Growth` says of a run of so many cycles from rest.

    bar (m) is what a cycle may be off by; budget is in arcs for each cycle.

    Raises SolverError where a run exceeds it.
    """
    plant, tolerance = Plant.of(p), p.solver.tolerance
    finer = Simulation(plant, 1e-3 * tolerance, replay=False, budget=budget)
    finer.start(drive_of(p), cycles)
    starts = []
    for _ in range(cycles):
        starts.append(copy.deepcopy(finer))
        finer.run_cycles(1)
    committed = max(_error_of_a_cycle(start, plant, tolerance) for start in starts)
    if not committed <= bar:
        return Growth(committed, 0.0)
    number = np.arange(1.0, cycles + 1.0)
    most = bar * number  # an error in position alone stays what it is
    for cycle, start in enumerate(starts):
        for change in ((bar, 0.0), (0.0, bar / _time_of(plant))):
            most[cycle:] += _deviation(start, plant, 1e-3 * tolerance, change, cycles - cycle)
    return Growth(committed, float((most / number).max()))


def _time_of(plant: Plant) -> float:
    """Return the time (s) by which an error in speed counts as one in position."""
    return math.sqrt(plant.mass / plant.contact.sigma_0)


def _error_of_a_cycle(start: Simulation, plant: Plant, tolerance: float) -> float:
    """Return how far off (m) one cycle at a tolerance (m) ends from where the finer one does."""
    ends = []
    for at in (tolerance, 1e-3 * tolerance):
        one = copy.deepcopy(start)
        one.set_plant(plant, at)
        one.run_cycles(1)
        ends.append(one.state)
    coarse, fine = ends
    off = coarse.x - fine.x, coarse.z - fine.z, (coarse.v - fine.v) * _time_of(plant)
    return max(map(abs, off))


def _deviation(
    start: Simulation, plant: Plant, tolerance: float, change: tuple[float, float], cycles: int
) -> NDArray[np.float64]:
    """Return how far (m) from the true ends cycles end after a change of z (m) and v (m/s)."""
    ends = []
    for z, v in ((0.0, 0.0), change):
        one = copy.deepcopy(start)
        one._s["now_z"] += z
        one._s["now_v"] += v
        one.set_plant(plant, tolerance)  # goes on from the state as it is now
        ends.append(one.run_cycles(cycles).position)
    deviation: NDArray[np.float64] = np.abs(ends[1] - ends[0])
    return deviation
