# SPDX-License-Identifier: Apache-2.0
"""Run and measurement as a pair: their alignment, and quantities of both side by side."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.errors import StickslipError
from stickslip_ros.measurement.onset import beside_lines, thinned
from stickslip_ros.measurement.steps.run import Run
from stickslip_ros.simulation.motion import Motion

#: The shorter of the two overlaps the other with this part at least.
_OVERLAP = 0.5
#: Fewest samples in common that say something.
_FEWEST = 8
#: The one shift (s) of an offset that is left where it is.
_HERE = np.zeros(1)


class ComparisonError(StickslipError, ValueError):
    """The motions cannot be compared; the message says what to change."""


@dataclass(frozen=True)
class Fits:
    """Which quantities of the alignment are fitted."""

    offset: bool = True  #: of the clock
    drift: bool = False  #: of the clock
    level: bool = True  #: zero of the sensor
    gain: bool = False  #: of the sensor


@dataclass(frozen=True)
class Alignment:
    """The measurement at its time t has the place of the run at t - offset - drift (t - middle).

    There it reads level + gain times the position of the run.
    """

    offset: float = 0.0  #: s, in the middle of the measurement
    drift: float = 0.0  #: s/s
    middle: float = 0.0  #: s, by the clock of the measurement
    level: float = 0.0  #: m
    gain: float = 1.0
    offset_error: float = math.nan  #: standard uncertainty of the offset, s
    other_offset: float | None = None  #: an offset (s) that fits as well, if there is one

    def run_time(self, t: Array) -> Array:
        """Return times (s) of the run for those of the measurement."""
        return t - self.offset - self.drift * (t - self.middle)

    def measurement_time(self, t: Array) -> Array:
        """Return times (s) of the measurement for those of the run."""
        return self.middle + (t + self.offset - self.middle) / (1.0 - self.drift)


@dataclass(frozen=True)
class Pairs:
    """Run and measurement at the same instants, each of shape (samples,)."""

    t: Array  #: s, by the clock of the run
    run: Array  #: position, m
    measured: Array  #: position as the sensor reads it, m
    velocity: Array  #: of the run, m/s

    @property
    def weights(self) -> Array:
        """The part of the whole time that each sample represents; their sum is 1."""
        weight = np.gradient(self.t)
        weight[[0, -1]] *= 0.5
        return np.asarray(weight / weight.sum())


@dataclass(frozen=True)
class MotionPair:
    """A run and a measurement of the same motion."""

    run: Motion
    measurement: Motion

    @property
    def on_measurement(self) -> bool:
        """Whether the measurement is the coarser of the two: its samples are compared then."""
        return self.run.spacing <= 2.0 * self.measurement.spacing

    @property
    def unaligned(self) -> Alignment:
        """The alignment of one clock for both."""
        return Alignment(middle=0.5 * float(self.measurement.t[[0, -1]].sum()))

    def at(self, alignment: Alignment) -> Pairs:
        """Return both where they overlap, at the samples of the coarser one of them."""
        t, x, finer, place = self._laid(alignment, 0.0)
        other = finer.position_at(place)
        both = (other, x) if self.on_measurement else (x, other)
        return Pairs(t, *both, self.run.velocity_at(t))

    def _laid(self, alignment: Alignment, margin: float) -> tuple[Array, Array, Motion, Array]:
        """Return the coarser motion by the clock of the run, the finer one, and the places in it.

        Places (s) lie a margin (s) inside it.
        """
        coarser, finer = self.run, self.measurement
        t, place = coarser.t, alignment.measurement_time(coarser.t)
        if self.on_measurement:
            coarser, finer = finer, coarser
            t = place = alignment.run_time(coarser.t)
        kept = (place >= finer.t[0] + margin) & (place <= finer.t[-1] - margin)
        return t[kept], coarser.x[kept], finer, place[kept]

    @property
    def shorter(self) -> float:
        """Duration (s) of the shorter one."""
        return min(self.run.duration, self.measurement.duration)

    @property
    def spacing(self) -> float:
        """Distance (s) of samples of the coarser one."""
        return max(self.run.spacing, self.measurement.spacing)

    def overlap(self, alignment: Alignment) -> float:
        """Return the time (s) that both cover."""
        first, last = alignment.run_time(self.measurement.t[[0, -1]])
        return float(min(last, self.run.t[-1]) - max(first, self.run.t[0]))

    def left(self, alignment: Alignment, run: Run | None = None, shifts: Array = _HERE) -> Array:
        """Return the root mean square difference (m) at shifts (s) of the offset, (shifts,).

        It is without mean and slope, those of each cycle of a run where one is given; infinite
        without overlap.
        """
        reach = float(np.abs(shifts).max())
        t, x, finer, place = self._laid(alignment, reach)
        if len(t) < _FEWEST or self.overlap(alignment) < _OVERLAP * self.shorter:
            return np.full(len(shifts), math.inf)
        moves = shifts if self.on_measurement else -shifts
        some, cycle = thinned(t, run)
        sums = lay_over(
            place[some], x[some], finer.position_at, moves,
            lambda one: beside_lines(t[some], one, cycle),
        )  # fmt: skip
        return np.sqrt(sums / len(some))


def lay_over(
    t: Array,
    x: Array,
    model: Callable[[Array], Array],
    shifts: Array,
    clean: Callable[[Array], Array],
) -> Array:
    """Return what a model, laid over a record at some shifts (s), leaves: sums of squares, m^2.

    t (s) and x (m) are the record, (samples,); model gives positions (m) at times (s); clean takes
    out of differences, (samples, shifts), what an axis that is the same may differ by. The search
    for the clock, in `compare` and in `identify`, takes the least.
    """
    shown = model((t[:, None] - shifts).ravel()).reshape(len(t), -1)
    left = clean(x[:, None] - shown)
    return np.asarray(np.sum(left * left, axis=0))
