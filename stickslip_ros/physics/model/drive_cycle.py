# SPDX-License-Identifier: Apache-2.0
"""One drive cycle of the actuator: u(t) in segments, straight or parabolas.

So one solver runs them all and restarts at every kink. Only amplifier and actuator bend them.
A closed drive cycle (u ends where it began) can be repeated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.arrays import Array
from stickslip_ros.physics.model.actuator import Actuator
from stickslip_ros.physics.parameters import ParameterError

#: A drive cycle closes if its end is off its start by less than this fraction of its strokes:
#: rounding
_CLOSED = 1e-9


@dataclass(frozen=True)
class DriveCycle:
    """One cycle of the actuator deflection.

    ``durations`` (s) and ``rates`` (m/s) have shape (segments,); ``slip`` is the index of the
    segment in which the slip begins, -1 if none does, ``slip_parts`` says how many segments it
    takes, holds within it included; ``sign`` is the direction of the step, +1 or -1. ``bends``
    (m/s^2) are the second derivatives of bent segments, whose rates are those at their starts.
    ``commanded`` (m/s) is the mean speed of the slip by its command, where the actuator alters it.
    """

    durations: Array
    rates: Array
    slip: int
    sign: int
    slip_parts: int = 1
    bends: Array | None = None
    commanded: float | None = None

    @property
    def strokes(self) -> Array:
        """How far u gets in each segment, m."""
        return _strokes(self.durations, self.rates, self.bends)

    @cached_property
    def period(self) -> float:
        """Duration of the cycle, s: the sum over the segments, in their order."""
        return float(np.cumsum(self.durations)[-1])

    @cached_property
    def shift(self) -> float:
        """Where u ends less where it began, m; exactly 0 if the drive cycle closes."""
        return float(_shift(self.strokes))

    @property
    def slip_end(self) -> int:
        """Index of the segment that follows the slip; the number of segments if none does."""
        return self.slip + self.slip_parts

    @property
    def slip_duration(self) -> float:
        """Time (s) from the beginning to the end of the slip."""
        return float(np.sum(self.durations[self.slip : self.slip_end]))

    @property
    def dwell(self) -> float:
        """Time (s) from one slip to the next."""
        return self.period - self.slip_duration

    @property
    def slip_rate(self) -> float:
        """Mean speed at which the slip is commanded, m/s."""
        if self.commanded is not None:
            return self.commanded
        stroke = float(np.abs(self.strokes[self.slip : self.slip_end]).sum())
        return stroke / self.slip_duration


def _strokes(durations: Array, rates: Array, bends: Array | None) -> Array:
    """Return how far u gets in segments, m."""
    if bends is None:
        return durations * rates
    return durations * (rates + 0.5 * bends * durations)


def _shift(strokes: Array) -> Array:
    """Return the sum over the last axis, m; exactly 0 where it is a rounding error."""
    shift = np.sum(strokes, axis=-1)
    return np.where(np.abs(shift) > _CLOSED * np.sum(np.abs(strokes), axis=-1), shift, 0.0)


def ramp(distance: float, duration: float) -> DriveCycle:
    """Return a straight way of the actuator over distance (m) within duration (s), without a slip.

    Raises ParameterError if it does not take time.
    """
    if not 0.0 < duration < np.inf:
        raise ParameterError(f"the duration of a ramp is {duration:g} s; it has to be above 0 s")
    return DriveCycle(
        durations=np.array([duration]),
        rates=np.array([distance / duration]),
        slip=-1,
        sign=-1 if distance < 0.0 else 1,
        slip_parts=0,
    )


@dataclass(frozen=True)
class DriveCycles:
    """Drive cycles of many operating points, one row each.

    ``durations`` (s), ``rates`` (m/s) and ``bends`` (m/s^2), if any, have shape (points, segments),
    rows of fewer segments end in durations of 0; ``slip`` and ``slip_parts`` have shape (points,).
    """

    durations: Array
    rates: Array
    slip: NDArray[np.int64]
    sign: int
    slip_parts: NDArray[np.int64]
    bends: Array | None = None

    def row(self, k: int) -> DriveCycle:
        """Return the drive cycle of one point."""
        used = int(self.segments[k])
        return DriveCycle(
            self.durations[k, :used],
            self.rates[k, :used],
            int(self.slip[k]),
            self.sign,
            int(self.slip_parts[k]),
            None if self.bends is None else self.bends[k, :used],
        )

    @cached_property
    def segments(self) -> NDArray[np.int64]:
        """Number of segments of each point, (points,)."""
        return self.durations.shape[1] - np.argmax(self.durations[:, ::-1] != 0.0, axis=1)

    @cached_property
    def periods(self) -> Array:
        """Duration of each cycle, s, (points,)."""
        return np.asarray(np.cumsum(self.durations, axis=1)[:, -1])

    def packed(self, points: NDArray[np.int64], segments: int) -> tuple[Array, Array]:
        """Return durations, rates and bends of points, (points, 3, segments), and their shifts.

        segments is what each of them has; see `DriveCycle.shift`.
        """
        packed = np.zeros((len(points), 3, segments))
        for i, numbers in enumerate((self.durations, self.rates, self.bends)):
            if numbers is not None:
                packed[:, i] = numbers[points, :segments]
        bends = None if self.bends is None else packed[:, 2]
        return packed, _shift(_strokes(packed[:, 0], packed[:, 1], bends))


def stack_cycles(drive_cycles: Sequence[DriveCycle | None], sign: int) -> DriveCycles:
    """Return drive cycles as rows; a row of one segment at rest for each None."""
    rest = DriveCycle(np.ones(1), np.zeros(1), slip=0, sign=sign)
    rows = [drive_cycle or rest for drive_cycle in drive_cycles]
    durations, rates, bends = np.zeros((3, len(rows), max(len(row.durations) for row in rows)))
    for k, row in enumerate(rows):
        durations[k, : len(row.durations)] = row.durations
        rates[k, : len(row.rates)] = row.rates
        if row.bends is not None:
            bends[k, : len(row.bends)] = row.bends
    slip, slip_parts = (np.array([getattr(row, n) for row in rows]) for n in ("slip", "slip_parts"))
    return DriveCycles(durations, rates, slip, sign, slip_parts, bends)


def deflect(actuator: Actuator, start: float, voltage: DriveCycle) -> DriveCycle:
    """Return the drive cycle of the deflection that an actuator settles to; it closes.

    voltage has rates in V/s, its cycle begins at the level start (V). An actuator with hysteresis
    remembers the voltages of its past. The first cycle erases that memory, and from the second
    cycle on all deflections are alike: the second one is returned.
    """
    memory = actuator.rest().moved(start, actuator.thresholds)
    memory = actuator.follow(memory, voltage.durations, voltage.rates)[2]
    pieces: list[tuple[float, float]] = []
    begins = []  # at which piece each segment of the voltage begins
    for duration, rate in zip(voltage.durations.tolist(), voltage.rates.tolist(), strict=True):
        begins.append(len(pieces))
        straight, memory = actuator.path(memory, duration, rate)
        pieces += straight
    begins.append(len(pieces))
    durations, rates = np.array(pieces).T
    slip = begins[voltage.slip]
    return DriveCycle(durations, rates, slip, voltage.sign, begins[voltage.slip_end] - slip)
