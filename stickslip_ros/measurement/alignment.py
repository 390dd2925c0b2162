# SPDX-License-Identifier: Apache-2.0
"""Where and how a measurement lies on a run: clock offset and drift, gain and zero of the sensor.

The clock offset is found in three strokes: cross-correlation of the velocities names candidates,
the remaining difference chooses among them, and the moments at which the slips begin give the
rest. A measured axis differs from the model, and the difference must not pull at the clock: each
cycle is looked at by itself, without its mean and slope (where the axis has got to, how large its
steps are), and each motion rings in its own way (:mod:`slip_onset`). Where ringing cannot be seen,
the last stroke is least squares on the offset with the velocity of the run as its derivative.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.errors import StickslipError
from stickslip_ros.traces.evenly import noise_of
from stickslip_ros.traces.motion import Motion
from stickslip_ros.traces.ringing import Ringing
from stickslip_ros.traces.slip_onset import cycle_of, detrended, find_onset, some_cycles
from stickslip_ros.traces.step_analysis import StepAnalysis

#: Samples of the coarse search, the candidates it hands on, and the samples that judge these.
_GRID, _CANDIDATES, _JUDGES = 2**20, 40, 20_000
#: Candidates whose difference is within this factor of the least fit equally well.
_AS_GOOD = 1.2
#: The shorter of the two overlaps the other with this part at least.
_OVERLAP = 0.5
#: What is left is mere noise if it is below so many times the noise.
_NOISE_ONLY = 1.2
#: Rest (part of a period) before the first step that pins the clock; the part of a period about the
#: start found in which the clock is looked for, in so many places, and then again over so many
#: swings of the ringing.
_REST, _REACH, _SHIFTS, _SWINGS = 0.2, 0.55, 111, 4.0
#: Rounds of least squares at most, the change (s) that ends them.
_ROUNDS, _SETTLED = 30, 1e-9
#: Ringing is seen by itself where that many of its periods and decays fit into a cycle.
_PERIODS_APART, _DECAYS_APART = 3.0, 2.0
#: Part of the distance of samples by which a straight line may move where a slip begins.
_STRAIGHT = 0.05
#: A run stands still if its positions differ by less than this part of them: by rounding.
_STILL = 1e-12


class ComparisonError(StickslipError, ValueError):
    """Two motions that cannot be compared; the message says what to change."""


@dataclass(frozen=True)
class Fits:
    """What is fitted; the rest is taken as it is."""

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

    def run_time(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return times (s) of the run for those of the measurement."""
        return t - self.offset - self.drift * (t - self.middle)

    def measurement_time(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return times (s) of the measurement for those of the run."""
        return self.middle + (t + self.offset - self.middle) / (1.0 - self.drift)


@dataclass(frozen=True)
class Pairs:
    """Run and measurement at the same instants, each of shape (samples,)."""

    t: NDArray[np.float64]  #: s, by the clock of the run
    run: NDArray[np.float64]  #: position, m
    measured: NDArray[np.float64]  #: position as the sensor reads it, m
    velocity: NDArray[np.float64]  #: of the run, m/s


def on_samples_of_measurement(run: Motion, measurement: Motion) -> bool:
    """Return whether the measurement is the coarser of the two: its samples are compared then."""
    return run.spacing <= 2.0 * measurement.spacing


def pair(run: Motion, measurement: Motion, alignment: Alignment, every: int = 1) -> Pairs:
    """Return both where they overlap, on every so many samples of the coarser one.

    The finer one is interpolated.
    """
    if on_samples_of_measurement(run, measurement):
        t = alignment.run_time(measurement.t[::every])
        inside = (t >= run.t[0]) & (t <= run.t[-1])
        t = t[inside]
        measured = measurement.x[::every][inside]
        return Pairs(t, run.position_at(t), measured, run.velocity_at(t))
    clock = alignment.measurement_time(run.t[::every])
    inside = (clock >= measurement.t[0]) & (clock <= measurement.t[-1])
    t = run.t[::every][inside]
    measured = measurement.position_at(clock[inside])
    return Pairs(t, run.x[::every][inside], measured, run.velocity_at(t))


def align(
    run: Motion,
    measurement: Motion,
    fits: Fits,
    run_steps: StepAnalysis | None,
    measured_steps: StepAnalysis | None,
) -> Alignment:
    """Find the alignment; the steps are None for a motion that has none.

    Raises ComparisonError where there is too little in common.
    """
    found = Alignment(middle=0.5 * float(measurement.t[0] + measurement.t[-1]))
    begun = _by_start(run, measurement, found, run_steps, measured_steps)
    if fits.offset:
        found = begun or _coarse(run, measurement, found, run_steps)
    _refuse_if_apart(run, measurement, found)
    if fits.offset:
        found = _nearby(run, measurement, found, run_steps)
        if run_steps is not None and begun is None:
            found = _whole_periods_on(run, measurement, found, run_steps)
        own, other = _ringing(run_steps), _ringing(measured_steps)
        if run_steps is not None and own is not None and other is not None:
            found = _by_onset(run, measurement, found, fits.drift, run_steps, own, other)
            every = _every(run, measurement, _JUDGES)
            exact = _by_velocity(run, measurement, found, fits, None)
            # Where the run leaves nothing but noise, every sample fixes the clock.
            if _difference(run, measurement, exact, every) < _NOISE_ONLY * noise_of(measurement.x):
                found = exact
        else:
            found = _by_velocity(run, measurement, found, fits, run_steps)
    return _sensor(run, measurement, found, fits)


def _ringing(steps: StepAnalysis | None) -> Ringing | None:
    """Return the ringing where it can be separated from the steps."""
    if steps is None or not math.isfinite(steps.ringing_frequency):
        return None
    periods, decays = steps.ringing_frequency * steps.period, steps.decay * steps.period
    if periods < _PERIODS_APART or decays < _DECAYS_APART:
        return None
    return Ringing(steps.ringing_frequency, steps.decay)


def _refuse_if_apart(run: Motion, measurement: Motion, found: Alignment) -> None:
    shorter = min(run.duration, measurement.duration)
    if (
        len(pair(run, measurement, found).t) < 16
        or _overlap(run, measurement, found) < 0.05 * shorter
    ):
        raise ComparisonError(
            f"run ({run.t[0]:g} s to {run.t[-1]:g} s) and measurement ({measurement.t[0]:g} s to "
            f"{measurement.t[-1]:g} s) hardly overlap; let the clock offset be fitted"
        )


def _overlap(run: Motion, measurement: Motion, found: Alignment) -> float:
    """Return the time (s) that both cover."""
    first, last = found.run_time(measurement.t[[0, -1]])
    return float(min(last, run.t[-1]) - max(first, run.t[0]))


def _coarse(
    run: Motion, measurement: Motion, start: Alignment, steps: StepAnalysis | None
) -> Alignment:
    """Return the candidate of the cross-correlation that leaves the least difference."""
    spacing = max(run.spacing, measurement.spacing, max(run.duration, measurement.duration) / _GRID)
    speeds = []
    for motion in (measurement, run):
        grid = np.arange(motion.t[0], motion.t[-1], spacing)
        speeds.append(np.diff(np.interp(grid, motion.t, motion.x)))
    if min(map(len, speeds)) < 8:
        raise ComparisonError(
            "run and measurement have fewer than 8 samples in common; sample more often"
        )
    likeness = scipy.signal.correlate(*speeds, method="fft")
    lags = scipy.signal.correlation_lags(*map(len, speeds)) * spacing + (
        measurement.t[0] - run.t[0]
    )
    apart = max(1, round((0.25 * steps.period if steps else 5.0 * spacing) / spacing))
    every = _every(run, measurement, _JUDGES)
    judged: list[tuple[float, float]] = []
    for _ in range(_CANDIDATES):
        best = int(np.argmax(likeness))
        if not likeness[best] > 0.0:
            break
        candidate = replace(start, offset=float(lags[best]))
        judged.append((_difference(run, measurement, candidate, every), candidate.offset))
        likeness[max(0, best - apart) : best + apart + 1] = -np.inf
    least, offset = min(judged, default=(math.inf, 0.0))
    if not math.isfinite(least):
        raise ComparisonError(
            "no clock offset brings run and measurement together; "
            "check that both show the same motion, in the same direction"
        )
    return replace(start, offset=offset)


def _by_start(
    run: Motion,
    measurement: Motion,
    start: Alignment,
    steps: StepAnalysis | None,
    measured: StepAnalysis | None,
) -> Alignment | None:
    """Return the offset at which both begin to step; None unless both show the rest before.

    Cycles look alike; only the rest before the first one shows which is which.
    """
    if steps is None or measured is None or len(steps.slips) != len(measured.slips):
        return None
    if run.u is None or measured.starts[0] < measurement.t[0] + _REST * measured.period:
        return None
    if abs(measured.period / steps.period - 1.0) > _REST:
        return None
    about = float(measured.starts[0] - steps.starts[0])
    found = _best_near(run, measurement, replace(start, offset=about), _REACH * steps.period)
    if found is None or not steps.ringing_frequency > 0.0:
        return found
    # Places further apart than half a period of the ringing may miss its right swing.
    return _best_near(run, measurement, found, _SWINGS / steps.ringing_frequency)


def _best_near(
    run: Motion, measurement: Motion, found: Alignment, reach: float
) -> Alignment | None:
    """Return the best of some offsets within a reach (s) of the one found; None if all are bad."""
    every = _every(run, measurement, _JUDGES)
    shifts = np.linspace(-reach, reach, _SHIFTS)
    candidates = [replace(found, offset=found.offset + float(shift)) for shift in shifts]
    judged = [(_difference(run, measurement, one, every), one) for one in candidates]
    least, best = min(judged, key=lambda pair: pair[0])
    return best if math.isfinite(least) else None


def _whole_periods_on(
    run: Motion, measurement: Motion, found: Alignment, steps: StepAnalysis
) -> Alignment:
    """Return, of all offsets some periods apart, the one that recordings of one motion have.

    Equal steps look alike; of those that fit as well, it is the one with most time in common.
    """
    every = _every(run, measurement, _JUDGES)
    least = _difference(run, measurement, found, every)
    reach = int(max(run.duration, measurement.duration) / steps.period)
    candidates = [
        replace(found, offset=found.offset + k * steps.period) for k in range(-reach, reach + 1)
    ]
    candidates.sort(
        key=lambda one: (
            -round(_overlap(run, measurement, one) / (0.25 * steps.period)),
            abs(one.offset),
        )
    )
    good = [
        one
        for one in candidates[:_CANDIDATES]
        if _difference(run, measurement, one, every) <= _AS_GOOD * least
    ]
    if not good:
        return found
    return replace(good[0], other_offset=good[1].offset if len(good) > 1 else None)


def _difference(run: Motion, measurement: Motion, candidate: Alignment, every: int) -> float:
    """Return the root mean square (m) of what is left but for mean and slope; inf if apart."""
    if _overlap(run, measurement, candidate) < _OVERLAP * min(run.duration, measurement.duration):
        return math.inf
    pairs = pair(run, measurement, candidate, every)
    if len(pairs.t) < 8:
        return math.inf
    rest = _detrended(pairs.t, [pairs.measured - pairs.run], None)[0]
    return float(np.sqrt(np.mean(rest**2)))


def _nearby(
    run: Motion, measurement: Motion, found: Alignment, steps: StepAnalysis | None
) -> Alignment:
    """Return the best of a fine grid around an offset: in the right swing of the ringing."""
    every = _every(run, measurement, _JUDGES)
    reach = max(run.spacing, measurement.spacing, max(run.duration, measurement.duration) / _GRID)
    best, least = found, math.inf
    for shift in np.linspace(-2.0, 2.0, 41) * reach:
        candidate = replace(found, offset=found.offset + float(shift))
        pairs = pair(run, measurement, candidate, every)
        rest = _detrended(pairs.t, [pairs.measured - pairs.run], steps)[0]
        left = float(np.mean(rest**2))
        if left < least:
            best, least = candidate, left
    return best


def _by_onset(
    run: Motion,
    measurement: Motion,
    found: Alignment,
    drift: bool,
    steps: StepAnalysis,
    own: Ringing,
    other: Ringing,
) -> Alignment:
    """Move the clock by how much later the slips begin in the measurement than in the run.

    What the two ringings may pull at the onsets is part of the uncertainty: a difference in
    damping as it turns the phase of the ringing, one in frequency by a hundredth of the period. So
    is a part of the distance of the run's samples, if there are only straight lines between them.
    """
    middle = found.middle - found.offset
    clock, x = measurement.t, measurement.x
    if measurement.v is not None:  # a trace, denser in the slips; the fit weighs every sample alike
        tick = min(max(run.spacing, measurement.spacing), 0.05 / own.frequency)
        clock = np.arange(measurement.t[0], measurement.t[-1], tick)
        x = measurement.position_at(clock)
    # Both at the same places of the cycle: what the distance of samples does to the fits cancels.
    t = clock - found.offset
    inside = (t >= run.t[0]) & (t <= run.t[-1])
    shown = (t[inside], run.position_at(t[inside])), (t, x)
    onsets = []
    for (t, x), ringing in zip(shown, (own, other), strict=True):
        t, x = some_cycles(t, x, steps.slips, steps.period)
        slips = steps.slips[(steps.slips > t[0]) & (steps.slips < t[-1])]
        if not len(slips):
            raise ComparisonError(
                "run and measurement have no step in common; measure at least one, or leave the "
                "clock as it is"
            )
        onsets.append(
            find_onset(t, x, slips, steps.period, ringing, drift and len(slips) > 1, middle)
        )
    in_run, in_measurement = onsets
    turned = abs(other.decay - own.decay) / (2.0 * math.pi * own.frequency) ** 2
    bent = 0.01 * abs(1.0 / other.frequency - 1.0 / own.frequency)
    between = _STRAIGHT * run.spacing if run.v is None else 0.0
    return replace(
        found,
        offset=found.offset + in_measurement.shift - in_run.shift,
        drift=found.drift + in_measurement.drift - in_run.drift,
        offset_error=math.hypot(in_measurement.shift_error, turned, bent, between),
    )


def _by_velocity(
    run: Motion, measurement: Motion, found: Alignment, fits: Fits, steps: StepAnalysis | None
) -> Alignment:
    """Move the clock by least squares, the velocity of the run taken for the derivative."""
    for _ in range(_ROUNDS):
        found = _sensor(run, measurement, found, fits)
        pairs = pair(run, measurement, found, _every(run, measurement, _JUDGES))
        rest = (pairs.measured - found.level) / found.gain - pairs.run
        columns = [-pairs.velocity]
        if fits.drift:
            columns.append(-pairs.velocity * (pairs.t + found.offset - found.middle))
        rest, *columns = _detrended(pairs.t, [rest, *columns], steps)
        sizes = np.array([np.linalg.norm(column) for column in columns])
        if not (sizes > 0.0).all():
            raise ComparisonError("the run does not move; there is no clock to fit")
        design = np.stack(columns, axis=1) / sizes
        step, *_ = np.linalg.lstsq(design, rest, rcond=None)
        left = rest - design @ step
        step = step / sizes
        found = replace(
            found,
            offset=found.offset + float(step[0]),
            drift=found.drift + (float(step[1]) if fits.drift else 0.0),
            offset_error=float(np.std(left) / sizes[0]),
        )
        if abs(step[0]) < _SETTLED:
            break
    return found


def _sensor(run: Motion, measurement: Motion, found: Alignment, fits: Fits) -> Alignment:
    """Fit level and gain over the whole run."""
    pairs = pair(run, measurement, found)
    weight = time_weights(pairs.t)
    gain = 1.0
    mean_run = float(weight @ pairs.run)
    mean_measured = float(weight @ pairs.measured)
    if fits.gain:
        about = pairs.run - (mean_run if fits.level else 0.0)
        square = float(weight @ about**2)
        if not square > (_STILL * float(np.abs(pairs.run).max())) ** 2:
            raise ComparisonError("the run does not move; there is no gain to fit")
        gain = float(weight @ (about * pairs.measured)) / square
        if not gain > 0.0:
            raise ComparisonError(
                f"the fitted gain is {gain:.3g}; the measurement goes the other way: "
                "check its sign or the sign of --steps"
            )
    level = mean_measured - gain * mean_run if fits.level else 0.0
    return replace(found, level=level, gain=gain)


def time_weights(t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the part of the whole time that each sample stands for; their sum is 1."""
    between = np.diff(t)
    weight = np.zeros(len(t))
    weight[:-1] += 0.5 * between
    weight[1:] += 0.5 * between
    return np.asarray(weight / weight.sum())


def _every(run: Motion, measurement: Motion, samples: int) -> int:
    """Return the stride that leaves about so many samples to compare."""
    base = measurement if on_samples_of_measurement(run, measurement) else run
    return max(1, len(base.t) // samples)


def _detrended(
    t: NDArray[np.float64], columns: list[NDArray[np.float64]], steps: StepAnalysis | None
) -> list[NDArray[np.float64]]:
    return detrended(t, columns, _cycle_of(t, steps))


def _cycle_of(t: NDArray[np.float64], steps: StepAnalysis | None) -> NDArray[np.int64]:
    if steps is None:
        return np.zeros(len(t), dtype=np.int64)
    return cycle_of(t, steps.slips, steps.period)
