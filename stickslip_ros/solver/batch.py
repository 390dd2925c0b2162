# SPDX-License-Identifier: Apache-2.0
"""Many operating points in one call: each with a plant and a drive cycle of its own.

Every point is run by the same kernel as a `Simulation`, from the same rest, and its results are
the same to the last bit. The interpreter lock is released within each point, so threads with a
batch each use all cores.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model import DriveCycles, Plant
from stickslip_ros.model.plant import CONTACT_INPUTS, PLANT_INPUTS
from stickslip_ros.solver.advance import ENDLESS
from stickslip_ros.solver.budget import Buffers, run
from stickslip_ros.solver.layout import AXIS, AXIS_BUFFER, ROW_SIZE, opened
from stickslip_ros.solver.plants import at_rest, begin, contact_buffer, prepared, set_constants


@dataclass(frozen=True)
class Batch:
    """Operating points, one row each; the arrays are C-contiguous float64."""

    coefficients: NDArray[np.float64]  #: (points, numbers), as `Plant.coefficients`
    tolerance: NDArray[np.float64]  #: (points,), error in position allowed per cycle, m
    durations: NDArray[np.float64]  #: (points, segments), s; short rows end in zeros
    rates: NDArray[np.float64]  #: (points, segments), m/s
    ringing: NDArray[np.float64]  #: (points,), `Plant.ringing_frequency`, Hz
    slip: NDArray[np.int64]  #: (points, 2), segment in which the slip begins, and that after it
    sign: int  #: direction of the step, +1 or -1

    @staticmethod
    def of(
        plants: Plant,
        tolerance: NDArray[np.float64] | float,
        drive_cycles: DriveCycles,
    ) -> Batch:
        """Build the batch of a column of plants and their drive cycles."""
        durations, rates = drive_cycles.durations, drive_cycles.rates
        coefficients = plants.coefficients()
        points = len(durations)
        return Batch(
            _filled(coefficients, (points, coefficients.shape[-1])),
            _filled(tolerance, (points,)),
            _filled(durations, durations.shape),
            _filled(rates, rates.shape),
            _filled(plants.ringing_frequency, (points,)),
            np.stack([drive_cycles.slip, drive_cycles.slip + drive_cycles.slip_parts], axis=1),
            drive_cycles.sign,
        )

    def run(
        self, steps: int, where: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Run steps from rest; return position (points, steps) and backstep, both in m.

        Backsteps have shape (points, steps - 1): each runs into the rise of the next cycle, which
        the last does not have. Of a single step it is the one that runs into rest, (points, 1).
        Points where ``where`` is false are left out: their rows are nan.
        """
        position = np.full((len(self.tolerance), steps), math.nan)
        backstep = np.full((len(self.tolerance), max(steps - 1, 1)), math.nan)
        rows = np.empty((steps, ROW_SIZE))
        for k, point in self._points(where):
            point.start(steps)
            point.run(math.inf, steps, rows)
            position[k] = rows[:, 0]
            if steps > 1:
                backstep[k] = rows[1:, 1]
                continue
            period = float(np.cumsum(point.buffers.drive[0])[-1])
            end = period + resting_time(period, self.ringing[k])
            point.run(end, ENDLESS, rows[:0])
            backstep[k, 0] = point.backstep
        return position, backstep

    def _points(self, where: NDArray[np.bool_]) -> Iterator[tuple[int, _Point]]:
        """Yield index and axis of each point; a prepared plant serves all points that share it."""
        whole, each = np.split(self.coefficients, [len(PLANT_INPUTS)], axis=1)
        each = each.reshape(len(whole), -1, len(CONTACT_INPUTS))
        axis, plant = np.empty(AXIS_BUFFER), np.empty(0)
        contacts = contact_buffer(each.shape[1])
        last = -1
        for k in self._grouped(where):
            if last < 0 or not self._same_plant(k, last):
                plant = prepared(whole[k].tolist(), self.tolerance[k])
                if contacts is not None:
                    set_constants(contacts, each[k].tolist())
            last = k
            used = int(np.flatnonzero(self.durations[k])[-1]) + 1
            drive = np.stack([self.durations[k, :used], self.rates[k, :used]])
            slip = (int(self.slip[k, 0]), int(self.slip[k, 1]), self.sign)
            yield int(k), _Point(Buffers(plant, axis, contacts, drive), slip)

    def _same_plant(self, k: int, other: int) -> bool:
        """Return whether two points differ in their drive only."""
        same = self.coefficients[k] == self.coefficients[other]
        return bool(self.tolerance[k] == self.tolerance[other] and same.all())

    def _grouped(self, where: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Return the indices of points, equal plants side by side: they are prepared once."""
        which = np.flatnonzero(where)
        rows = self.coefficients[which]
        differing = (rows != rows[:1]).any(axis=0)
        return which[np.lexsort(rows[:, differing].T)] if differing.any() else which

    def run_until_still(
        self, block: int, rise: float, limit: int, where: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """Run until the position no longer rises; return it (m), shape (points,).

        Position means that at the ends of cycles, averaged over blocks of ``block`` cycles. A run
        ends with the first block that lies less than rise (m) further in the direction of the
        step than the one before. nan where that takes more than limit cycles, or ``where`` is
        false.
        """
        final = np.full(len(self.tolerance), math.nan)
        rows = np.empty((block, ROW_SIZE))
        for k, point in self._points(where):
            point.start(ENDLESS)
            before = -math.inf
            for stop in range(block, limit + 1, block):
                point.run(math.inf, stop, rows)
                mean = _mean(rows[:, 0])
                if self.sign * mean - before < rise:
                    final[k] = mean
                    break
                before = self.sign * mean
        return final


def _filled(values: NDArray[np.float64] | float, shape: tuple[int, ...]) -> NDArray[np.float64]:
    return np.ascontiguousarray(np.broadcast_to(values, shape), dtype=np.float64)


@dataclass(frozen=True)
class _Point:
    """One operating point on its way."""

    buffers: Buffers
    slip: tuple[int, int, int]  #: segments in which the slip begins, that follow it; direction

    @property
    def state(self) -> np.void:
        """The record of the axis."""
        return opened(self.buffers.axis, AXIS)

    def start(self, count: int) -> None:
        """Begin count cycles from rest."""
        at_rest(self.buffers.axis, self.buffers.contacts)
        begin(self.state, self.buffers.contacts, 0.0, (count, 0.0), self.slip)

    def run(self, t: float, stop_cycle: int, rows: NDArray[np.float64]) -> None:
        """Advance to t (s) or to the end of a cycle."""
        run(self.buffers, self.state, (t, stop_cycle), rows)

    @property
    def backstep(self) -> float:
        """Backstep (m) of the last slip whose backstep is complete."""
        return float(self.state["backstep"])


def resting_time(period: float, ringing_frequency: float) -> float:
    """Return how long (s) to rest after a cycle so that its backstep ends."""
    return max(period, 1.0 / ringing_frequency) if ringing_frequency > 0.0 else period


def _mean(values: NDArray[np.float64]) -> float:
    """Return the mean, summed up in order."""
    return float(np.cumsum(values)[-1]) / len(values)
