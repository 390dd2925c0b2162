# SPDX-License-Identifier: Apache-2.0
"""Many operating points in one call: each with a plant and a pattern of its own.

Every point is run by the same kernel as a `Simulation`, from the same rest, and its results are
the same to the last bit. The interpreter lock is released meanwhile, so threads with a batch each
use all cores.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled
from stickslip_ros.model import Patterns, Plant
from stickslip_ros.solver import series
from stickslip_ros.solver import state as st
from stickslip_ros.solver.kernel import advance, at_rest, begin, period_of, prepare

_NO_LIMIT = np.iinfo(np.int64).max


@dataclass(frozen=True)
class Batch:
    """Operating points, one row each; the arrays are C-contiguous float64."""

    coefficients: NDArray[np.float64]  #: (points, 13), as `Plant.coefficients`
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
        patterns: Patterns,
    ) -> Batch:
        """Build the batch of a column of plants and their patterns."""
        durations, rates = patterns.durations, patterns.rates
        coefficients = plants.coefficients()
        points = len(durations)
        return Batch(
            _filled(coefficients, (points, coefficients.shape[-1])),
            _filled(tolerance, (points,)),
            _filled(durations, durations.shape),
            _filled(rates, rates.shape),
            _filled(plants.ringing_frequency, (points,)),
            np.stack([patterns.slip, patterns.slip + patterns.slip_parts], axis=1),
            patterns.sign,
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
        _run_many(
            self._grouped(where),
            self.coefficients,
            self.tolerance,
            self.durations,
            self.rates,
            self.ringing,
            self.slip,
            self.sign,
            position,
            backstep,
        )
        return position, backstep

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
        _run_until_still(
            self._grouped(where),
            self.coefficients,
            self.tolerance,
            self.durations,
            self.rates,
            self.slip,
            self.sign,
            block,
            rise,
            limit,
            final,
        )
        return final


def _filled(values: NDArray[np.float64] | float, shape: tuple[int, ...]) -> NDArray[np.float64]:
    return np.ascontiguousarray(np.broadcast_to(values, shape), dtype=np.float64)


@compiled
def resting_time(period: float, ringing_frequency: float) -> float:
    """Return how long (s) to rest after a cycle so that its backstep ends."""
    return max(period, 1.0 / ringing_frequency) if ringing_frequency > 0.0 else period


@compiled
def _same_plant(coefficients: NDArray, tolerance: NDArray, k: int, other: int) -> bool:
    """Return whether two points differ in their drive only: a prepared plant serves both."""
    return tolerance[k] == tolerance[other] and bool((coefficients[k] == coefficients[other]).all())


@compiled
def _used(durations: NDArray, rates: NDArray) -> tuple[NDArray, NDArray]:
    """Return the row of a pattern, (segments,), without the zeros that fill it."""
    count = len(durations)
    while durations[count - 1] == 0.0:
        count -= 1
    return durations[:count], rates[:count]


@compiled
def _run_many(
    which: NDArray,
    coefficients: NDArray,
    tolerance: NDArray,
    durations: NDArray,
    rates: NDArray,
    ringing: NDArray,
    slip: NDArray,
    sign: int,
    position: NDArray,
    backstep: NDArray,
) -> None:
    """Fill the rows ``which`` of position (m), (points, steps), and of backstep (m)."""
    steps = position.shape[1]
    rows = np.empty((steps, st.ROW_SIZE))
    s, n = np.empty(st.STATE_SIZE), np.empty(st.COUNTER_SIZE, np.int64)
    arc, work = np.zeros(st.ARC_SIZE), np.zeros((series.ROWS, series.ORDER + 1))
    last = -1
    plant = np.empty(0)
    for k in which:
        if last < 0 or not _same_plant(coefficients, tolerance, k, last):
            plant = prepare(coefficients[k], tolerance[k])
        last = k
        spans, speeds = _used(durations[k], rates[k])
        at_rest(s, n)
        begin(s, n, 0.0, steps, slip[k, 0], slip[k, 1], sign, 0.0)
        advance(plant, spans, speeds, math.inf, steps, s, n, rows, arc, work)
        position[k] = rows[:, st.ROW_X]
        if steps > 1:
            backstep[k] = rows[1:, st.ROW_BACKSTEP]
            continue
        period = period_of(spans)
        end = s[st.START] + period + resting_time(period, ringing[k])
        advance(plant, spans, speeds, end, _NO_LIMIT, s, n, rows[:0], arc, work)
        backstep[k, 0] = s[st.BACKSTEP]


@compiled
def _run_until_still(
    which: NDArray,
    coefficients: NDArray,
    tolerance: NDArray,
    durations: NDArray,
    rates: NDArray,
    slip: NDArray,
    sign: int,
    block: int,
    rise: float,
    limit: int,
    final: NDArray,
) -> None:
    """Fill the entries ``which`` of final (m), (points,)."""
    rows = np.empty((block, st.ROW_SIZE))
    s, n = np.empty(st.STATE_SIZE), np.empty(st.COUNTER_SIZE, np.int64)
    arc, work = np.zeros(st.ARC_SIZE), np.zeros((series.ROWS, series.ORDER + 1))
    last = -1
    plant = np.empty(0)
    for k in which:
        if last < 0 or not _same_plant(coefficients, tolerance, k, last):
            plant = prepare(coefficients[k], tolerance[k])
        last = k
        spans, speeds = _used(durations[k], rates[k])
        at_rest(s, n)
        begin(s, n, 0.0, _NO_LIMIT, slip[k, 0], slip[k, 1], sign, 0.0)
        before = -math.inf
        for stop in range(block, limit + 1, block):
            advance(plant, spans, speeds, math.inf, stop, s, n, rows, arc, work)
            mean = rows[:, st.ROW_X].mean()
            if sign * mean - before < rise:
                final[k] = mean
                break
            before = sign * mean
