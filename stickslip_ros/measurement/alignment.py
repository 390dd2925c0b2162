# SPDX-License-Identifier: Apache-2.0
"""Aligns a measurement with a run: clock offset and drift, gain and zero of the sensor.

The clock offset is found in three steps: cross-correlation of the velocities gives candidates, the
remaining difference chooses one, and the times at which the slips begin refine it. Differences of
the measured axis from the model must not bias the clock. So each cycle is compared without its mean
and slope (position of the axis, size of the steps), and each motion has its own ringing. If ringing
is not visible, the last step is least squares on the offset, with the velocity of the run as its
derivative.
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
from stickslip_ros.measurement.steps.run import Cycles, Run


@dataclass(frozen=True)
class AlignmentSettings:
    """How the clock of a measurement is looked for."""

    grid: int = 2**20  #: samples of the cross-correlation at most
    candidates: int = 40  #: that it, or whole periods, hand on
    as_good: float = 1.2  #: times the least difference that fits equally well
    samples: int = 16  #: in common, at least
    overlap: float = 0.05  #: part of the shorter motion in common, at least
    noise_only: float = 1.2  #: times the noise below which nothing but noise is left
    #: Part of a period: the rest before the first step that pins the clock, and by which the times
    #: from the first step to the last may differ.
    rest: float = 0.2
    fewest: int = 8  #: distances of samples that the cross-correlation takes
    #: Periods, or samples where no steps are seen, that candidates of it are apart.
    apart: tuple[float, int] = (0.25, 5)
    dense: float = 0.05  #: swings of the ringing between samples of a trace
    bent: float = 0.01  #: part by which another period of the ringing moves where it begins
    missed: float = 2.0  #: times the difference that another first step has to leave
    moved: float = 0.01  #: part of its stroke by which an actuator leaves a rest
    reach: float = 0.55  #: part of a period about the start found in which the clock is looked for
    places: int = 111  #: offsets tried there, a hundredth of a period apart
    swings: float = 4.0  #: periods of the ringing about the best of them, tried in as many places
    near: float = 2.0  #: distances of samples about an offset, for the right swing of the ringing
    near_places: int = 41  #: offsets tried there
    rounds: int = 30  #: of least squares at most
    converged: float = 1e-9  #: change (s) that ends them: the runner moves by far less than noise
    periods_apart: float = 3.0  #: of the ringing in a cycle from which on it is seen by itself
    decays_apart: float = 2.0  #: the same of its decays
    straight: float = 0.05  #: part of a sample by which a straight line moves where a slip begins
    still: float = 1e-12  #: part of the positions by which they differ at rest: by rounding


SETTINGS = AlignmentSettings()


def align(
    pair: MotionPair,
    fits: Fits,
    run_steps: Run | None,
    measured_steps: Run | None,
    begun: Alignment | None = None,
) -> Alignment:
    """Find the alignment, near the one of `align_starts` if there is one.

    The steps are None for a motion that has none. Raises ComparisonError where there is too little
    in common.
    """
    search = ClockSearch(pair, fits, run_steps, measured_steps)
    start = pair.unaligned
    return search.fit_sensor(
        search.fit_clock(start, begun) if fits.offset else search.check_overlap(start)
    )


def align_starts(pair: MotionPair, measured: Sequence[Run]) -> Alignment | None:
    """Return the offset at which both begin to step, None unless both show all steps after a rest.

    Cycles look alike, and forward runs are like backward ones but for a slope; only the rest before
    the first cycle identifies them.
    """
    u, main = pair.run.u, max(measured, key=lambda one: one.steps, default=None)
    if u is None or main is None:
        return None
    begin, end = measured[0].start, measured[-1].end
    away = np.abs(np.subtract.outer(u[[0, -1]], u)) > SETTINGS.moved * np.ptp(u)
    if not away.any() or begin < pair.measurement.t[0] + SETTINGS.rest * main.period:
        return None
    first, last = pair.run.t[np.argmax(away[0])], pair.run.t[len(u) - 1 - np.argmax(away[1, ::-1])]
    if abs(end - begin - (last - first)) > SETTINGS.rest * main.period:
        return None
    start = replace(pair.unaligned, offset=float(begin - first))
    cycles = Cycles.even(start.run_time(main.slips), main.period, main.direction)
    about = pair.measurement.between(main.start - 2.0 * main.period, main.end + 2.0 * main.period)
    near = MotionPair(pair.run, about)
    search, best, least = ClockSearch(near, Fits(), None, None), None, math.inf
    for periods in (0.0, -1.0, 1.0):  # the search for steps may have missed the first one
        moved = replace(start, offset=start.offset + periods * main.period)
        found = search.best_near(moved, SETTINGS.reach * main.period, SETTINGS.places, cycles)
        left = math.inf if found is None else near.difference(found, cycles)
        if left * SETTINGS.missed < least:
            best, least = found, left
    if best is None or not main.ringing_frequency > 0.0:
        return best
    # Places further apart than half a period of the ringing may miss its right swing.
    reach = SETTINGS.swings / main.ringing_frequency
    return search.best_near(best, reach, SETTINGS.places, cycles)


@dataclass(frozen=True)
class ClockSearch:
    """The search for the clock of an alignment."""

    pair: MotionPair
    fits: Fits
    run_steps: Run | None
    measured_steps: Run | None

    def check_overlap(self, found: Alignment) -> Alignment:
        """Return an alignment itself. Raises ComparisonError if it brings too little together."""
        pair = self.pair
        apart = pair.overlap(found) < SETTINGS.overlap * pair.durations[0]
        if apart or len(pair.at(found).t) < SETTINGS.samples:
            run, measured = pair.run.t, pair.measurement.t
            raise ComparisonError(
                f"run ({run[0]:g} s to {run[-1]:g} s) and measurement ({measured[0]:g} s to "
                f"{measured[-1]:g} s) hardly overlap; let the clock offset be fitted"
            )
        return found

    def fit_clock(self, start: Alignment, begun: Alignment | None) -> Alignment:
        """Return the alignment with offset and drift of the clock. Raises ComparisonError."""
        steps = self.run_steps
        found = self.check_overlap(begun or self._correlate(start))
        near = max(self.pair.spacing, self.pair.durations[1] / SETTINGS.grid)
        found = self.best_near(found, SETTINGS.near * near, SETTINGS.near_places, steps) or found
        if steps is not None and begun is None:
            found = self.choose_period(found, steps)
        own, other = separate_ringing(steps), separate_ringing(self.measured_steps)
        if steps is None or own is None or other is None:
            return self.fit_velocity(found, steps)
        found = self._fit_onsets(found, steps, own, other)
        exact = self.fit_velocity(found, None)
        # Where the run leaves nothing but noise, every sample fixes the clock.
        noise = noise_of(self.pair.measurement.x)
        return exact if self.pair.difference(exact) < SETTINGS.noise_only * noise else found

    def _best(
        self, candidates: Sequence[Alignment], steps: Run | Cycles | None = None
    ) -> Alignment | None:
        """Return the candidate that leaves the least difference; None if all are apart."""
        judged = [(self.pair.difference(one, steps), one) for one in candidates]
        least, best = min(judged, key=lambda one: one[0], default=(math.inf, None))
        return best if math.isfinite(least) else None

    def best_near(
        self, found: Alignment, reach: float, places: int, steps: Run | Cycles | None = None
    ) -> Alignment | None:
        """Return the best of some places within a reach (s) of an offset; None if all are bad."""
        shifts = np.linspace(-reach, reach, places).tolist()
        return self._best([replace(found, offset=found.offset + one) for one in shifts], steps)

    def _correlate(self, start: Alignment) -> Alignment:
        """Return the candidate of the cross-correlation that leaves the least difference."""
        pair, steps = self.pair, self.run_steps
        spacing = max(pair.spacing, pair.durations[1] / SETTINGS.grid)
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
        lags = scipy.signal.correlation_lags(*map(len, speeds)) * spacing
        lags += pair.measurement.t[0] - pair.run.t[0]
        cycles, samples = SETTINGS.apart
        apart = max(1, round(cycles * steps.period / spacing if steps else samples))
        candidates = []
        for _ in range(SETTINGS.candidates):
            best = int(np.argmax(correlation))
            if not correlation[best] > 0.0:
                break
            candidates.append(replace(start, offset=float(lags[best])))
            correlation[max(0, best - apart) : best + apart + 1] = -np.inf
        found = self._best(candidates)
        if found is None:
            raise ComparisonError(
                "no clock offset brings run and measurement together; "
                "check that both show the same motion, in the same direction"
            )
        return found

    def choose_period(self, found: Alignment, steps: Run) -> Alignment:
        """Return the best of all offsets some periods apart.

        Equal steps look alike; of offsets that fit as well, the one with the longest overlap wins.
        """
        pair, period = self.pair, steps.period
        least = pair.difference(found)
        reach = int(pair.durations[1] / period)
        candidates = [
            replace(found, offset=found.offset + k * period) for k in range(-reach, reach + 1)
        ]
        candidates.sort(
            key=lambda one: (
                -round(pair.overlap(one) / (SETTINGS.apart[0] * period)),
                abs(one.offset),
            )
        )
        good = [
            one
            for one in candidates[: SETTINGS.candidates]
            if pair.difference(one) <= SETTINGS.as_good * least
        ]
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
            drift=found.drift + in_measurement.drift - in_run.drift,
            offset_error=math.hypot(in_measurement.shift_error, turned, bent, between),
        )

    def fit_velocity(self, found: Alignment, steps: Run | None) -> Alignment:
        """Move the clock by least squares, the velocity of the run taken for the derivative."""
        drift = self.fits.drift
        for _ in range(SETTINGS.rounds):
            found = self.fit_sensor(found)
            pairs = self.pair.judged_at(found)
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
        pairs, fits, gain = self.pair.at(found), self.fits, 1.0
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


def separate_ringing(steps: Run | None) -> Ringing | None:
    """Return the ringing where it can be separated from the steps."""
    if steps is None or not math.isfinite(steps.ringing_frequency):
        return None
    periods, decays = steps.ringing_frequency * steps.period, steps.decay * steps.period
    if periods < SETTINGS.periods_apart or decays < SETTINGS.decays_apart:
        return None
    return Ringing(steps.ringing_frequency, steps.decay)
