# SPDX-License-Identifier: Apache-2.0
"""Simulates many operating points, each with its own plant and drive cycle, in one call.

Every point is a `Simulation` from rest. The interpreter lock is released within each point, so
threads with a batch each use all cores.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.arrays import Array
from stickslip_ros.physics.model import DriveCycles, Plant
from stickslip_ros.physics.solver.advance import ENDLESS
from stickslip_ros.physics.solver.simulation import Simulation


@dataclass(frozen=True)
class Batch:
    """Operating points, one entry or row each."""

    plants: list[Plant]
    tolerance: Array  #: (points,), error in position allowed per cycle, m
    drive_cycles: DriveCycles

    @classmethod
    def of(cls, plants: Plant, tolerance: Array | float, drive_cycles: DriveCycles) -> Batch:
        """Build the batch of a column of plants and their drive cycles."""
        points = len(drive_cycles.durations)
        return cls(plants.points(points), np.broadcast_to(tolerance, points), drive_cycles)

    def run(self, steps: int, where: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Run steps from rest; return position (points, steps) and backstep, both in m.

        Backsteps have shape (points, steps - 1): each runs into the rise of the next cycle, which
        the last does not have. Of a single step it is the one that runs into rest, (points, 1).
        Points where ``where`` is false are left out: their rows are nan.
        """
        position = np.full((len(self.plants), steps), math.nan)
        backstep = np.full((len(self.plants), max(steps - 1, 1)), math.nan)
        for k, simulation in self._started(where, steps):
            cycles = simulation.run_cycles(steps)
            position[k] = cycles.position
            if steps > 1:
                backstep[k] = cycles.backstep[1:]
            else:
                backstep[k] = backstep_into_rest(simulation)
        return position, backstep

    def _started(self, where: NDArray[np.bool_], count: int) -> Iterator[tuple[int, Simulation]]:
        """Yield index and simulation of each point, its cycles begun.

        Points of the same plant have one simulation in turn: a plant is prepared once.
        """
        same: dict[tuple[Plant, float], list[int]] = {}
        for k in np.flatnonzero(where).tolist():
            same.setdefault((self.plants[k], float(self.tolerance[k])), []).append(k)
        for (plant, tolerance), points in same.items():
            simulation = Simulation(plant, tolerance)
            for k in points:
                if k != points[0]:
                    simulation.restart()
                simulation.start(self.drive_cycles.row(k), count)
                yield k, simulation

    def run_until_still(
        self, block: int, rise: float, limit: int, where: NDArray[np.bool_]
    ) -> Array:
        """Run until the position no longer rises; return it (m), shape (points,).

        The position at the ends of cycles is averaged over blocks of ``block`` cycles. A run ends
        with the first block that advances by less than rise (m) in the direction of the step. nan
        if that takes more than limit cycles, or if ``where`` is False.
        """
        final, sign = np.full(len(self.plants), math.nan), self.drive_cycles.sign
        for k, simulation in self._started(where, ENDLESS):
            before = -math.inf
            for _ in range(limit // block):
                # Summed up in order, as nobody promises of numpy's mean.
                mean = float(np.cumsum(simulation.run_cycles(block).position)[-1]) / block
                if sign * mean - before < rise:
                    final[k] = mean
                    break
                before = sign * mean
        return final


def backstep_into_rest(simulation: Simulation) -> float:
    """Return the backstep (m) of the last cycle, after a rest in which it ends."""
    ringing = simulation.plant.ringing_frequency
    longest = max(simulation.drive_cycle.period, 1.0 / ringing if ringing > 0.0 else 0.0)
    simulation.advance(simulation.end_of_move + longest)
    return simulation.backstep
