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
)
from stickslip_ros.measurement.onset import beside_lines, find_onset, thinned
from stickslip_ros.measurement.steps.noise import noise_of
from stickslip_ros.measurement.steps.ringing import Ringing
from stickslip_ros.measurement.steps.run import Run

#: Samples in common at least, and part of the shorter motion; samples of the cross-correlation.
_SAMPLES, _OVERLAP, _GRID = 16, 0.05, 2**20
#: Where the clock is looked for about a place: part of a period, swings of the ringing, and
#: distances of samples; places in each. Periods beside the steps in which it is.
_REACHES, _PLACES, _ABOUT = (0.55, 4.0, 2.0), 111, 2.0
#: Offsets whole periods apart that are tried at most; times the least difference that is as good;
#: part of a period by which times in common differ.
_PERIODS, _AS_GOOD, _APART = 40, 1.2, 0.25
#: Times the noise below which nothing but noise is left.
_NOISE_ONLY = 1.2
#: Rounds of least squares at most, and the change (s) that ends them: the runner moves by far less
#: than noise.
_ROUNDS, _CONVERGED = 30, 1e-9
#: Swings of the ringing between samples of a trace. Rounds of the onsets of a run that is not known
#: between its samples, and part of one of these by which its slips may begin elsewhere.
_DENSE, _BETWEEN, _STRAIGHT = 0.05, 3, 0.05
#: Part by which another period of the ringing moves where it begins.
_BENT = 0.01
#: Periods and decays of the ringing in a cycle from which on it is seen by itself.
_PERIODS_APART, _DECAYS_APART = 3.0, 2.0
#: Part of the positions by which they differ at rest: by rounding.
_STILL = 1e-12


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
        apart = pair.overlap(found) < _OVERLAP * pair.shorter
        if apart or len(pair.at(found).t) < _SAMPLES:
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
        motions = pair.measurement, pair.run
        spacing = max(pair.spacing, max(one.duration for one in motions) / _GRID)
        grids = [np.arange(one.t[0], one.t[-1] + spacing, spacing) for one in motions]
        speeds = [np.diff(one.position_at(t)) for one, t in zip(motions, grids, strict=True)]
        correlation = scipy.signal.correlate(*speeds, method="fft")
        best = int(np.argmax(correlation))
        if not correlation[best] > 0.0:
            raise ComparisonError(
                "no clock offset brings run and measurement together; "
                "check that both show the same motion, in the same direction"
            )
        lag = float(scipy.signal.correlation_lags(*map(len, speeds))[best]) * spacing
        return replace(pair.unaligned, offset=lag + float(grids[0][0] - grids[1][0]))

    def fit_steps(self, alike: Sequence[Run], measured: Run) -> Alignment:
        """Return the alignment of a measured run with one of the same direction."""
        pair, period = self.pair, measured.period
        found, run = self._first_slips(alike, measured)
        margin, swing = _ABOUT * period, 1.0 / (measured.ringing_frequency or math.nan)
        part = pair.measurement.between(measured.start - margin, measured.end + margin)
        near = MotionPair(pair.run, part)
        for reach, size in zip(_REACHES, (period, swing, near.spacing), strict=True):
            if math.isfinite(size):
                shifts = np.linspace(-reach * size, reach * size, _PLACES)
                best = int(np.argmin(near.left(found, run, shifts)))
                found = replace(found, offset=found.offset + float(shifts[best]))
        self.check_overlap(found)
        own, other = separate_ringing(run), separate_ringing(measured)
        if own is None or other is None or self.fits.drift:
            found = self.fit_velocity(found, run)
        if own is None or other is None:
            return found
        for _ in range(_BETWEEN if pair.run.v is None else 1):
            found = self._fit_onsets(found, run, own, other)
        exact = self.fit_velocity(found, None)
        # Where the run leaves nothing but noise, every sample fixes the clock.
        noise = noise_of(pair.measurement.x)
        return exact if pair.left(exact)[0] < _NOISE_ONLY * noise else found

    def _first_slips(self, alike: Sequence[Run], measured: Run) -> tuple[Alignment, Run]:
        """Return where the first slips of a measured run and of one like it meet, and that one.

        Where they may have other numbers of steps, the first may be another one, some periods
        away. Equal steps look alike: of places that fit as well, the one with the longest overlap
        wins.
        """
        pair, places = self.pair, []
        for run in alike:
            same = measured.determined and run.steps == measured.steps
            for k in (0,) if same else range(1 - measured.steps, run.steps):
                begun = float(measured.slips[0] - run.slips[0]) - k * run.period
                found = replace(pair.unaligned, offset=begun)
                rank = -round(pair.overlap(found) / (_APART * run.period)), abs(k)
                places.append((rank, found, run))
        best = sorted(places, key=lambda one: one[0])[:_PERIODS]
        left = [float(pair.left(found, run)[0]) for _, found, run in best]
        good = [k for k, size in enumerate(left) if size <= _AS_GOOD * min(left)]
        _, found, run = best[good[0]]
        other = best[good[1]][1].offset if len(good) > 1 else None
        return replace(found, other_offset=other), run

    def _fit_onsets(self, found: Alignment, run: Run, own: Ringing, other: Ringing) -> Alignment:
        """Move the clock by how much later the slips begin in the measurement than in the run.

        The uncertainty includes the bias that different ringings may cause: a difference in damping
        changes the phase of the ringing, one in frequency counts for a hundredth of the period. It
        also includes a part of the spacing of the run's samples, if these are interpolated
        linearly.
        """
        motion, measurement = self.pair.run, self.pair.measurement
        clock, x = measurement.t, measurement.x
        if measurement.v is not None:  # a trace, denser in the slips; the fit weighs samples alike
            tick = min(self.pair.spacing, _DENSE / own.frequency)
            clock = np.arange(measurement.t[0], measurement.t[-1], tick)
            x = measurement.position_at(clock)
        # Both at the same places of the cycle: what the distance of samples does cancels.
        t = found.run_time(clock)
        inside = (t >= motion.t[0]) & (t <= motion.t[-1])
        shown = (t[inside], motion.position_at(t[inside])), (t, x)
        onsets = []
        for (t, x), ringing in zip(shown, (own, other), strict=True):
            slips = run.slips[(run.slips > t[0]) & (run.slips < t[-1])]
            if not len(slips):
                raise ComparisonError(
                    "run and measurement have no step in common; measure at least one, or leave "
                    "the clock as it is"
                )
            onsets.append(find_onset(t, x, run, ringing))
        (own_shift, _), (shift, error) = onsets
        turned = abs(other.decay - own.decay) / (2.0 * math.pi * own.frequency) ** 2
        bent = _BENT * abs(1.0 / other.frequency - 1.0 / own.frequency)
        between = _STRAIGHT * motion.spacing if motion.v is None else 0.0
        return replace(
            found,
            offset=found.offset + shift - own_shift,
            offset_error=math.hypot(error, turned, bent, between),
        )

    def fit_velocity(self, found: Alignment, run: Run | None) -> Alignment:
        """Move the clock by least squares, the velocity of the run taken for the derivative."""
        for _ in range(_ROUNDS):
            found = self.fit_sensor(found)
            pairs = self.pair.at(found)
            some, cycle = thinned(pairs.t, run)
            left = (pairs.measured - found.level) / found.gain - pairs.run
            since = pairs.t + found.offset - found.middle
            columns = np.stack([left, -pairs.velocity, -pairs.velocity * since], axis=1)
            kept = columns[some] if self.fits.drift else columns[some, :2]
            clean = beside_lines(pairs.t[some], kept, cycle)
            sizes = np.linalg.norm(clean, axis=0)
            if not (sizes[1:] > 0.0).all():
                raise ComparisonError("the run does not move; there is no clock to fit")
            design = clean[:, 1:] / sizes[1:]
            step, *_ = np.linalg.lstsq(design, clean[:, 0], rcond=None)
            error = float(np.std(clean[:, 0] - design @ step) / sizes[1])
            shift, *drifts = (step / sizes[1:]).tolist()
            found = replace(
                found,
                offset=found.offset + shift,
                drift=found.drift + sum(drifts),
                offset_error=error,
            )
            if abs(shift) < _CONVERGED:
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


def separate_ringing(run: Run) -> Ringing | None:
    """Return the ringing where it can be separated from the steps."""
    periods, decays = run.ringing_frequency * run.period, run.decay * run.period
    separate = periods >= _PERIODS_APART and decays >= _DECAYS_APART
    return Ringing(run.ringing_frequency, run.decay) if separate else None
