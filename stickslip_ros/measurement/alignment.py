# SPDX-License-Identifier: Apache-2.0
"""Aligns a measurement with a run: clock offset and drift, gain and zero of the sensor.

Where both step, their first slips give the offset, and a run laid over the measurement at many
offsets refines it; so do the times at which the slips begin. Otherwise cross-correlation of the
velocities gives it, and least squares with the velocity of the run as their derivative refine it.
Differences of the measured axis from the model must not bias the clock. So each cycle is compared
without its mean and slope (position of the axis, size of the steps), and each motion has its own
ringing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.measurement.motion_pair import (
    Alignment,
    ComparisonError,
    Fits,
    MotionPair,
    without_slopes,
)
from stickslip_ros.measurement.onset import find_onset, thin_samples
from stickslip_ros.measurement.steps.noise import noise_of
from stickslip_ros.measurement.steps.ringing import Ringing
from stickslip_ros.measurement.steps.run import Run


@dataclass(frozen=True)
class AlignmentSettings:
    """How the clock of a measurement is looked for."""

    grid: int = 2**20  #: samples of the cross-correlation at most
    periods: int = 40  #: offsets whole periods apart that are tried at most
    as_good: float = 1.2  #: times the least difference that fits equally well
    apart: float = 0.25  #: part of a period by which times in common differ
    samples: int = 16  #: in common, at least
    overlap: float = 0.05  #: part of the shorter motion in common, at least
    noise_only: float = 1.2  #: times the noise below which nothing but noise is left
    fewest: int = 8  #: distances of samples that the cross-correlation takes
    dense: float = 0.05  #: swings of the ringing between samples of a trace
    #: Where the clock is looked for about a place: part of a period, swings of the ringing, and
    #: distances of samples; places tried in each.
    reaches: tuple[float, float, float] = (0.55, 4.0, 2.0)
    places: int = 111
    about: float = 2.0  #: periods beside the steps in which it is
    rounds: int = 30  #: of least squares at most
    converged: float = 1e-9  #: change (s) that ends them: the runner moves by far less than noise
    between: int = 3  #: rounds of the onsets of a run that is not known between its samples
    straight: float = 0.05  #: part of a sample by which it moves where a slip begins then
    bent: float = 0.01  #: part by which another period of the ringing moves where it begins
    periods_apart: float = 3.0  #: of the ringing in a cycle from which on it is seen by itself
    decays_apart: float = 2.0  #: the same of its decays
    still: float = 1e-12  #: part of the positions by which they differ at rest: by rounding


SETTINGS = AlignmentSettings()


def align(pair: MotionPair, fits: Fits, own: Sequence[Run], measured: Sequence[Run]) -> Alignment:
    """Find the alignment by the runs of steps in the run, and the main one of those measured.

    Raises ComparisonError where there is too little in common.
    """
    search = ClockSearch(pair, fits)
    main = max(measured, key=lambda one: one.steps, default=None)
    alike = [one for one in own if main is not None and one.direction == main.direction]
    if not fits.offset:
        found = pair.unaligned
    elif main is None or not alike:
        found = search.fit_velocity(search.correlate(), None)
    else:
        found = search.fit_steps(alike, main)
    return search.fit_sensor(found)


@dataclass(frozen=True)
class ClockSearch:
    """The search for the clock of an alignment."""

    pair: MotionPair
    fits: Fits

    def check_overlap(self, found: Alignment) -> Alignment:
        """Return an alignment itself. Raises ComparisonError if it brings too little together."""
        pair = self.pair
        apart = pair.overlap(found) < SETTINGS.overlap * pair.shorter
        if apart or len(pair.at(found).t) < SETTINGS.samples:
            run, measured = pair.run.t, pair.measurement.t
            cure = "let the clock offset be fitted"
            if self.fits.offset:
                cure = "check that both show the same motion, in the same direction"
            raise ComparisonError(
                f"run ({run[0]:g} s to {run[-1]:g} s) and measurement ({measured[0]:g} s to "
                f"{measured[-1]:g} s) hardly overlap; {cure}"
            )
        return found

    def correlate(self) -> Alignment:
        """Return the alignment by the cross-correlation of the velocities."""
        pair = self.pair
        longest = max(pair.run.duration, pair.measurement.duration)
        spacing = max(pair.spacing, longest / SETTINGS.grid)
        speeds = []
        for motion in (pair.measurement, pair.run):
            grid = np.arange(motion.t[0], motion.t[-1], spacing)
            speeds.append(np.diff(np.interp(grid, motion.t, motion.x)))
        if min(map(len, speeds)) < SETTINGS.fewest:
            raise ComparisonError(
                f"run and measurement have fewer than {SETTINGS.fewest} samples in common; sample "
                "more often"
            )
        correlation = scipy.signal.correlate(*speeds, method="fft")
        best = int(np.argmax(correlation))
        if not correlation[best] > 0.0:
            raise ComparisonError(
                "no clock offset brings run and measurement together; "
                "check that both show the same motion, in the same direction"
            )
        lag = float(scipy.signal.correlation_lags(*map(len, speeds))[best]) * spacing
        return replace(pair.unaligned, offset=lag + pair.measurement.t[0] - pair.run.t[0])

    def fit_steps(self, alike: Sequence[Run], measured: Run) -> Alignment:
        """Return the alignment of a measured run with one of the same direction."""
        pair = self.pair
        starts = [
            (replace(pair.unaligned, offset=float(measured.slips[0] - one.slips[0])), one)
            for one in alike
        ]
        found, run = min(starts, key=lambda one: pair.difference(one[0]))
        period, swing = measured.period, 1.0 / (measured.ringing_frequency or math.nan)
        margin = SETTINGS.about * period
        part = pair.measurement.between(measured.start - margin, measured.end + margin)
        near = MotionPair(pair.run, part)
        for reach, size in zip(SETTINGS.reaches, (period, swing, near.spacing), strict=True):
            if math.isfinite(size):
                found = near.best_near(found, reach * size, SETTINGS.places, run)
        if not measured.determined or run.steps != measured.steps:
            found = self.choose_period(found, run)
        self.check_overlap(found)
        own, other = separate_ringing(run), separate_ringing(measured)
        if own is None or other is None:
            return self.fit_velocity(found, run)
        for _ in range(SETTINGS.between if pair.run.v is None else 1):
            found = self._fit_onsets(found, run, own, other)
        exact = self.fit_velocity(found, None)
        # Where the run leaves nothing but noise, every sample fixes the clock.
        noise = noise_of(pair.measurement.x)
        return exact if pair.difference(exact) < SETTINGS.noise_only * noise else found

    def choose_period(self, found: Alignment, steps: Run) -> Alignment:
        """Return the best of all offsets some periods apart.

        Equal steps look alike; of offsets that fit as well, the one with the longest overlap wins.
        """
        pair, period = self.pair, steps.period
        reach = int(max(pair.run.duration, pair.measurement.duration) / period)
        moved = [replace(found, offset=found.offset + k * period) for k in range(-reach, reach + 1)]
        moved.sort(
            key=lambda one: (
                -round(pair.overlap(one) / (SETTINGS.apart * period)),
                abs(one.offset - found.offset),
            )
        )
        left = [(pair.difference(one, steps), one) for one in moved[: SETTINGS.periods]]
        least = min(one for one, _ in left)
        good = [one for size, one in left if size <= SETTINGS.as_good * least < math.inf]
        if not good:
            return found
        return replace(good[0], other_offset=good[1].offset if len(good) > 1 else None)

    def _fit_onsets(self, found: Alignment, steps: Run, own: Ringing, other: Ringing) -> Alignment:
        """Move the clock by how much later the slips begin in the measurement than in the run.

        The uncertainty includes the bias that different ringings may cause: a difference in damping
        changes the phase of the ringing, one in frequency counts for a hundredth of the period. It
        also includes a part of the spacing of the run's samples, if these are interpolated
        linearly.
        """
        run, measurement, middle = self.pair.run, self.pair.measurement, found.middle - found.offset
        clock, x = measurement.t, measurement.x
        if measurement.v is not None:  # a trace, denser in the slips; the fit weighs samples alike
            tick = min(self.pair.spacing, SETTINGS.dense / own.frequency)
            clock = np.arange(measurement.t[0], measurement.t[-1], tick)
            x = measurement.position_at(clock)
        # Both at the same places of the cycle: what the distance of samples does cancels.
        t = clock - found.offset
        inside = (t >= run.t[0]) & (t <= run.t[-1])
        shown = (t[inside], run.position_at(t[inside])), (t, x)
        onsets = []
        for (t, x), ringing in zip(shown, (own, other), strict=True):
            t, x = thin_samples(t, x, steps.slips, steps.period)
            slips = steps.slips[(steps.slips > t[0]) & (steps.slips < t[-1])]
            if not len(slips):
                raise ComparisonError(
                    "run and measurement have no step in common; measure at least one, or leave "
                    "the clock as it is"
                )
            drift = self.fits.drift and len(slips) > 1
            onsets.append(find_onset(t, x, slips, steps.period, ringing, drift, middle))
        in_run, in_measurement = onsets
        turned = abs(other.decay - own.decay) / (2.0 * math.pi * own.frequency) ** 2
        bent = SETTINGS.bent * abs(1.0 / other.frequency - 1.0 / own.frequency)
        between = SETTINGS.straight * run.spacing if run.v is None else 0.0
        return replace(
            found,
            offset=found.offset + in_measurement.shift - in_run.shift,
            drift=in_measurement.drift - in_run.drift,
            offset_error=math.hypot(in_measurement.shift_error, turned, bent, between),
        )

    def fit_velocity(self, found: Alignment, steps: Run | None) -> Alignment:
        """Move the clock by least squares, the velocity of the run taken for the derivative."""
        drift = self.fits.drift
        for _ in range(SETTINGS.rounds):
            found = self.fit_sensor(found)
            pairs = self.pair.at(found, self.pair.judges)
            rest = (pairs.measured - found.level) / found.gain - pairs.run
            columns = [-pairs.velocity]
            if drift:
                columns.append(-pairs.velocity * (pairs.t + found.offset - found.middle))
            rest, *columns = without_slopes(pairs.t, [rest, *columns], steps)
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
                drift=found.drift + (float(step[1]) if drift else 0.0),
                offset_error=float(np.std(left) / sizes[0]),
            )
            if abs(step[0]) < SETTINGS.converged:
                break
        return found

    def fit_sensor(self, found: Alignment) -> Alignment:
        """Return the alignment with level and gain over the whole run. Raises ComparisonError."""
        pairs, fits, gain = self.pair.at(self.check_overlap(found)), self.fits, 1.0
        weight = pairs.weights
        mean_run, mean_measured = float(weight @ pairs.run), float(weight @ pairs.measured)
        if fits.gain:
            about = pairs.run - (mean_run if fits.level else 0.0)
            square = float(weight @ about**2)
            if not square > (SETTINGS.still * float(np.abs(pairs.run).max())) ** 2:
                raise ComparisonError("the run does not move; there is no gain to fit")
            gain = float(weight @ (about * pairs.measured)) / square
            if not gain > 0.0:
                raise ComparisonError(
                    f"the fitted gain is {gain:.3g}; the measurement goes the other way: "
                    "check its sign or the sign of --steps"
                )
        return replace(
            found, level=mean_measured - gain * mean_run if fits.level else 0.0, gain=gain
        )


def separate_ringing(steps: Run) -> Ringing | None:
    """Return the ringing where it can be separated from the steps."""
    periods, decays = steps.ringing_frequency * steps.period, steps.decay * steps.period
    if not (periods >= SETTINGS.periods_apart and decays >= SETTINGS.decays_apart):
        return None
    return Ringing(steps.ringing_frequency, steps.decay)
