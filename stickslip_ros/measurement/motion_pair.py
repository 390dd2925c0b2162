# SPDX-License-Identifier: Apache-2.0
"""Run and measurement as a pair: their alignment, and quantities of both side by side."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.errors import StickslipError
from stickslip_ros.measurement.onset import cycle_of, detrend
from stickslip_ros.measurement.steps.run import Run
from stickslip_ros.simulation.motion import Motion

#: Samples that candidates are judged by.
_JUDGES = 20_000
#: The shorter of the two overlaps the other with this part at least.
_OVERLAP = 0.5
#: Fewest samples in common that say something.
_FEWEST = 8
#: Order of the Butterworth filter, run back and forth: twice that in effect, without any delay.
ORDER = 4
#: Samples are even if their distances are within this part.
_EVEN = 1e-3
#: Highest corner of a filter, as part of the sampling rate.
_HIGHEST = 0.45


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
        between = np.diff(self.t)
        weight = np.zeros(len(self.t))
        weight[:-1] += 0.5 * between
        weight[1:] += 0.5 * between
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

    def at(self, alignment: Alignment, every: int = 1) -> Pairs:
        """Return both where they overlap, at every n-th sample of the coarser motion.

        The finer motion is interpolated.
        """
        t, x, finer, place = self._laid(alignment, every, 0.0)
        other = finer.position_at(place)
        both = (other, x) if self.on_measurement else (x, other)
        return Pairs(t, *both, self.run.velocity_at(t))

    def _laid(
        self, alignment: Alignment, every: int, margin: float
    ) -> tuple[Array, Array, Motion, Array]:
        """Return the coarser motion by the clock of the run, the finer one, and the places in it.

        Places (s) lie a margin (s) inside it.
        """
        run, measurement = self.run, self.measurement
        if self.on_measurement:
            t, x, finer = alignment.run_time(measurement.t[::every]), measurement.x[::every], run
            place = t
        else:
            t, x, finer = run.t[::every], run.x[::every], measurement
            place = alignment.measurement_time(t)
        kept = (place >= finer.t[0] + margin) & (place <= finer.t[-1] - margin)
        return t[kept], x[kept], finer, place[kept]

    @property
    def judges(self) -> int:
        """Every n-th sample of the coarser one is enough to judge an alignment by."""
        return max(1, len((self.measurement if self.on_measurement else self.run).t) // _JUDGES)

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

    def difference(self, alignment: Alignment, steps: Run | None = None) -> float:
        """Return the root mean square difference (m) without mean and slope; inf without overlap.

        With steps, mean and slope are those of each cycle.
        """
        if self.overlap(alignment) < _OVERLAP * self.shorter:
            return math.inf
        pairs = self.at(alignment, self.judges)
        if len(pairs.t) < _FEWEST:
            return math.inf
        (rest,) = without_slopes(pairs.t, [pairs.measured - pairs.run], steps)
        return float(np.sqrt(np.mean(rest**2)))

    def best_near(self, found: Alignment, reach: float, places: int, steps: Run) -> Alignment:
        """Return the best of some places within a reach (s) of an offset, by cycles of the run."""
        t, x, finer, place = self._laid(found, self.judges, reach)
        if len(t) < _FEWEST:
            return found

        def clean(columns: Array) -> Array:
            return np.stack(without_slopes(t, list(columns.T), steps), axis=1)

        shifts = np.linspace(-reach, reach, places)
        moves = shifts if self.on_measurement else -shifts
        left = lay_over(place, x, finer.position_at, moves, clean)
        return replace(found, offset=found.offset + float(shifts[np.argmin(left)]))


def without_slopes(t: Array, columns: list[Array], steps: Run | None) -> list[Array]:
    """Return columns without mean and slope, of each cycle where there are steps."""
    cycle = cycle_of(t, steps.slips, steps.period) if steps else np.zeros(len(t), dtype=np.int64)
    return detrend(t, columns, cycle)


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


def low_pass(pairs: Pairs, cutoff: float) -> Pairs:
    """Return run and measurement, both below the cutoff (Hz), on even samples.

    Raises ComparisonError for a cutoff that the samples cannot carry.
    """
    distances = np.diff(pairs.t)
    tick = float(np.median(distances))
    if not 0.0 < cutoff < _HIGHEST / tick:
        raise ComparisonError(
            f"the filter is {cutoff:g} Hz; it has to lie above 0 and below {_HIGHEST / tick:g} "
            f"Hz, {_HIGHEST} of the sampling rate"
        )
    if np.ptp(distances) > _EVEN * tick:
        t = np.arange(pairs.t[0], pairs.t[-1], tick)
        parts = (pairs.run, pairs.measured, pairs.velocity)
        pairs = Pairs(t, *(np.interp(t, pairs.t, part) for part in parts))
    sections = scipy.signal.butter(ORDER, cutoff, fs=1.0 / tick, output="sos")

    def smooth(x: Array) -> Array:
        reach = min(len(x) - 1, int(3.0 / (cutoff * tick)))
        return np.asarray(scipy.signal.sosfiltfilt(sections, x, padlen=reach))

    return Pairs(pairs.t, smooth(pairs.run), smooth(pairs.measured), smooth(pairs.velocity))
