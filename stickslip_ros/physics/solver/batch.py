# SPDX-License-Identifier: Apache-2.0
"""Simulates many operating points, each with its own plant and drive cycle, in compiled loops.

Every point runs as a `Simulation` from rest, to the last bit. The interpreter lock is released for
some milliseconds at a time, so threads with a batch each use all cores, and Ctrl-C gets through.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.compiled import compiled
from stickslip_ros.physics.model import DriveCycles, Plant
from stickslip_ros.physics.solver.advance import (
    ENDLESS,
    SLICE,
    KernelBuffers,
    SolverError,
    advance,
    finish,
)
from stickslip_ros.physics.solver.layout import ROW_SIZE, Fields, kernel_in
from stickslip_ros.physics.solver.plants import (
    axes_at_rest,
    begin_cycles,
    contact_buffer,
    pack_plants,
    set_contacts,
)
from stickslip_ros.physics.solver.simulation import rest_after


@dataclass(frozen=True)
class Batch:
    """Operating points as columns."""

    plants: Plant  #: numbers, or arrays (points,)
    tolerance: Array | float  #: error in position allowed per cycle, m
    drive_cycles: DriveCycles

    def run(self, steps: int, where: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Run steps from rest; return position (points, steps) and backstep, both in m.

        Backsteps have shape (points, steps - 1): each runs into the rise of the next cycle, which
        the last does not have. Of a single step it is the one that runs into rest, (points, 1).
        Points where ``where`` is false are left out: their rows are nan.
        """
        position = np.full((len(where), steps), math.nan)
        backstep = np.full((len(where), max(steps - 1, 1)), math.nan)
        ringing = np.broadcast_to(self.plants.ringing_frequency, where.shape)
        for points, group in self._groups(where, steps):
            rows = group.run_cycles(np.arange(len(points)), 0, steps)
            position[points] = rows[:, :, 0]
            if steps > 1:
                backstep[points] = rows[:, 1:, 1]
            else:
                each = zip(self.drive_cycles.periods[points], ringing[points], strict=True)
                group.ends[:] = [period + rest_after(period, hertz) for period, hertz in each]
                group.run(np.arange(len(points)), 1, ENDLESS, np.empty((len(points), 0, ROW_SIZE)))
                backstep[points, 0] = [Fields(axis)["backstep"] for axis in group.axes]
        return position, backstep

    def run_until_still(
        self, block: int, rise: float, limit: int, where: NDArray[np.bool_]
    ) -> Array:
        """Run until the position no longer rises; return it (m), shape (points,).

        The position at the ends of cycles is averaged over blocks of ``block`` cycles. A run ends
        with the first block that advances by less than rise (m) in the direction of the step. nan
        if that takes more than limit cycles, or if ``where`` is False.
        """
        final, sign = np.full(len(where), math.nan), self.drive_cycles.sign
        for points, group in self._groups(where, ENDLESS):
            active, before = np.arange(len(points)), np.full(len(points), -math.inf)
            for done in range(0, limit - block + 1, block):
                rows = group.run_cycles(active, done, block)
                # Summed up in order, as nobody promises of numpy's mean.
                mean = np.cumsum(rows[:, :, 0], axis=1)[:, -1] / block
                rises = ~(sign * mean - before[active] < rise)
                final[points[active[~rises]]] = mean[~rises]
                before[active] = sign * mean
                active = active[rises]
                if not len(active):
                    break
        return final

    def _groups(
        self, where: NDArray[np.bool_], count: int
    ) -> Iterator[tuple[NDArray[np.int64], _Group]]:
        """Yield points with drive cycles of equally many segments, count cycles begun."""
        for segments in np.unique(self.drive_cycles.segments[where]).tolist():
            points = np.flatnonzero(where & (self.drive_cycles.segments == segments))
            yield points, _Group(self, points, segments, count)


class _Group:
    """The buffers of points with drive cycles of equally many segments."""

    def __init__(self, batch: Batch, points: NDArray[np.int64], segments: int, count: int) -> None:
        """Begin count cycles at rest."""
        all_points = len(batch.drive_cycles.segments)
        self.plants, self._which = pack_plants(batch.plants, batch.tolerance, all_points, points)
        contacts = contact_buffer(batch.plants, all_points)
        set_contacts(contacts, batch.plants)
        self.contacts = None if contacts is None else contacts[points]
        self.axes = axes_at_rest(len(points))
        self._drives, shifts = batch.drive_cycles.packed(points, segments)
        self.ends = np.full(len(points), math.inf)  #: s, when each is to stop at the latest
        slips = batch.drive_cycles.slip[points]
        _begin(
            self.axes, self.contacts, count, shifts, slips,
            slips + batch.drive_cycles.slip_parts[points], batch.drive_cycles.sign,
        )  # fmt: skip

    def run_cycles(self, active: NDArray[np.int64], done: int, count: int) -> Array:
        """Advance some points by count cycles after those done; return their rows of results."""
        rows = np.empty((len(active), count, ROW_SIZE))
        self.run(active, done, done + count, rows)
        if not np.isfinite(rows[:, -1, 0]).all():
            raise SolverError("the solver failed; please report the parameters and commands")
        return rows

    def run(self, active: NDArray[np.int64], done: int, stop_cycle: int, rows: Array) -> None:
        """Advance some points to their ends, or to the end of a cycle. Raises SolverError.

        done: cycles that have ended before; rows, (points, cycles, ROW_SIZE), takes the results.
        """
        at, buffers = 0, (self.plants, self._which, self.axes, self.contacts, self._drives)
        while at < len(active):
            at = _advance_points(*buffers, active, self.ends, stop_cycle, rows, at)
            if at >= 0:
                continue
            at = -at
            k = active[at - 1]
            contacts = None if self.contacts is None else self.contacts[k]
            buffers_of_point = KernelBuffers(
                self.plants[self._which[k]], self.axes[k], contacts, self._drives[k]
            )
            until = float(self.ends[k]), stop_cycle
            finish(buffers_of_point, Fields(self.axes[k]), until, rows[at - 1], done)


@compiled
def _begin(
    axes: NDArray,
    contacts: NDArray | None,
    count: int,
    shifts: NDArray,
    slips: NDArray,
    slip_ends: NDArray,
    sign: int,
) -> None:
    """Start count drive cycles of each axis at time 0."""
    for k in range(len(axes)):
        each = None if contacts is None else contacts[k]
        begin_cycles(axes[k], each, 0.0, count, (shifts[k], slips[k], slip_ends[k], sign))


@compiled
def _advance_points(
    plants: NDArray,
    which: NDArray,
    axes: NDArray,
    contacts: NDArray | None,
    drives: NDArray,
    active: NDArray,
    ends: NDArray,
    stop_cycle: int,
    rows: NDArray,
    first: int,
) -> int:
    """Advance active points from number first on as `advance`, for a slice of arcs.

    Returns the number of the next one; negative if the one before it is unfinished.
    """
    spent = 0
    for i in range(first, len(active)):
        k = active[i]
        request = kernel_in(axes[k]).request
        request.previewing, request.spent, request.allowance = 0, 0, SLICE
        request.t_end, request.stop_cycle = ends[k], stop_cycle
        each = None if contacts is None else contacts[k]
        advance(plants[which[k]], axes[k], each, drives[k], rows[i])
        if request.unfinished:
            return -(i + 1)
        spent += request.spent
        if spent > SLICE:
            return i + 1
    return len(active)
