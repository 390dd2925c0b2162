# SPDX-License-Identifier: Apache-2.0
"""Tracks position and parameters of an axis with a Kalman filter on tables of the kernel.

The state is the position at the last reading, the logarithms of parameters as differences from
those of the file, the rate of one of them, and what the steps of the drive that runs have beyond
those of the model. Between two readings the position goes on by what the kernel's curves say,

    x' = x + D + N (J (theta - theta_0) + b),

with the cycles N and D at theta_0, where the curve was made: it is made anew as the estimate leaves
it, and the estimate is then put where the steps seen are the same in the new one. So this is an
extended Kalman filter (Jazwinski 1970, section 8.3) whose model is the kernel. J stays that of the
first estimate: slopes that turn with the estimate would feign knowledge of what no reading shows
(Huang, Mourikis, Roumeliotis 2008).
Steps scatter, and the parameters walk at random; what no reading shows keeps its mean.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.reporting import CONFIDENCE
from stickslip_ros.measurement.identification.posterior import Posterior
from stickslip_ros.measurement.twin.response import Blur, Model, parts_of_cycles, settled_step
from stickslip_ros.measurement.twin.settings import TwinSettings
from stickslip_ros.measurement.twin.timeline import OperatingPoint, Piece
from stickslip_ros.physics.parameters import Parameters

Parts = Sequence[tuple[Piece, float, float]]

#: Parameters that walk: the one that wears, loosens and warms, and the actuator with its amplifier
WALKING = ("preload", "gain")
#: Change of a logarithm from which on the curves are made anew; beyond the last, there is no model
_RECENTRE, FARTHEST = 0.04, math.log(3.0)
#: Variance that is left to steps in a new model, as a fraction of what they have
_BENT = 0.01
#: Places of the logarithms, of the rate and of b in the state, between position and ringing
THETA, RATE, OFFSET = slice(1, -3), -3, -2
#: Deviation of a step of the last runs from that of the next, as a fraction of it
_SHOWN = 1e-3
#: Deviation of steps, and of positions in a cycle, from those of the model where a change is not
#: understood, as fractions of a step
_OPEN, _SHAPE = 0.1, 0.03
#: Deviation of b, as a fraction of the step, of a model that is as straight as its slopes
_OFFSET = 3e-4
#: What the rate of the preload may be at the start and after a change, 1/s of stepping; its change
#: in the root of a second as a fraction of itself; how well its slope holds where it drifts, as a
#: fraction
_RATE, _RATE_WALK, _RATE_SLOPE = 0.03, 0.1, 0.25
#: How well the size of a change is known then, a logarithm
_ABOUT = 0.05
#: Standard deviations beyond which a reading is a glitch, which moves no estimate; glitches in a
#: row after which the position has jumped
GLITCH, _JUMP = 5.0, 2


class ModelledMotion(NamedTuple):
    """What the model says of the time between two readings."""

    distance: float  #: m
    slope: Array  #: of the distance by each parameter's logarithm, m
    scatter: float  #: variance of the distance, m^2
    blur: Blur  #: of the second reading
    stepping: float  #: s of cycles
    direction: int  #: of the cycles, 0 at rest
    cycles: float  #: in that direction, of the drive that runs at the end


class ProcessedReading(NamedTuple):
    """A reading, and what the tracker knew of the motion before it."""

    t: float  #: s
    reading: float  #: m
    parts: Parts
    motion: ModelledMotion


class ShownStep(NamedTuple):
    """A step as readings show it."""

    drive: OperatingPoint
    beyond: bool  #: whether it was made beyond the place of the change
    step: float  #: m
    deviation: float  #: m


class ReadingFilter:
    """Position, logarithms of n parameters, a rate, a step, and ringing: the state (4 + n,).

    A shallow copy keeps what is known now: arrays are replaced.
    """

    def __init__(self, n: int, noise: float, drifts: int = 0) -> None:
        """Begin at zero, known well; the rate is that of one parameter.

        noise (m) is the standard deviation of a reading.
        """
        self.state = np.zeros(4 + n)
        self.covariance = np.zeros((4 + n, 4 + n))
        self._noise, self._blur = noise, Blur()  # that of the last reading
        self._drifts = drifts
        self._glitches, self.jumped = 0, False  # in a row; whether the position just has

    def forget(self, first: int, last: int, variance: float = 0.0) -> None:
        """Set a part of the state to 0 with a variance of its own."""
        kept = np.ones(len(self.state))
        kept[first:last] = 0.0
        self.state = self.state * kept
        self.covariance = self.covariance * np.outer(kept, kept) + np.diag(variance * (1.0 - kept))

    def anchor(self, reading: float, blur: Blur) -> None:
        """Take the position (m) from a reading alone, which may lie in the ringing."""
        self.forget(-1, len(self.state), blur.ringing**2)
        self.forget(0, 1, self._noise**2 + blur.timing**2 + blur.ringing**2)
        self.state[0] = reading
        self.covariance[[0, -1], [-1, 0]] = -(blur.ringing**2)
        self._blur, self._glitches = blur, 0

    def move(
        self,
        dx: float,
        slope: Array,
        scatter: float,
        stepping: float = 0.0,
        cycles: float = 0.0,
    ) -> None:
        """Go on by a distance (m), its slope by the logarithms, and its variance (m^2)."""
        going = np.eye(len(self.covariance))
        going[0, THETA] = slope
        going[0, OFFSET] = cycles
        going[0, RATE] = 0.5 * stepping * slope[self._drifts]
        going[1 + self._drifts, RATE] = stepping
        self.state = going @ self.state
        self.state[0] += dx
        self.covariance = going @ self.covariance @ going.T
        self.covariance[0, 0] += scatter

    def read(
        self, reading: float, blur: Blur, glitch: float = math.inf
    ) -> tuple[float, float, float]:
        """Take a reading (m) after `move`, unless it is beyond so many deviations, a glitch.

        Return what was expected (m), the standard deviation (m) of the difference, and this in it.

        Where readings meet the same phase of the ringing they differ from the curve alike: only its
        phase after the slip is unknown, so their covariance is a cosine of what it has turned.
        """
        last, self._blur = self._blur, blur
        alike = math.cos(blur.turned - last.turned) * blur.coherence if last.ringing else 0.0
        kept = alike * blur.ringing / last.ringing if last.ringing else 0.0
        self.state[-1] *= kept
        self.covariance[-1] *= kept
        self.covariance[:, -1] *= kept
        self.covariance[-1, -1] += (1.0 - alike**2) * blur.ringing**2
        shared = self.covariance[:, 0] + self.covariance[:, -1]  # of the state with the reading
        expected = float(self.state[0] + self.state[-1])
        total = float(shared[0] + shared[-1]) + self._noise**2 + blur.timing**2
        z = (reading - expected) / math.sqrt(total)
        self.jumped = False
        if glitch < math.inf and abs(z) > glitch:
            self._glitches += 1
            self.jumped = self._glitches == _JUMP
            if self.jumped:
                self.anchor(reading, blur)
            return expected, math.sqrt(total), z
        self._glitches, gain = 0, shared / total
        self.state = self.state + (reading - expected) * gain
        self.covariance = self.covariance - np.outer(gain, shared)
        self.covariance = 0.5 * (self.covariance + self.covariance.T)
        return expected, math.sqrt(total), z


class Tracker(ReadingFilter):
    """Position and parameters with their covariance, from reading to reading."""

    def __init__(self, p: Parameters, settings: TwinSettings, posterior: Posterior | None) -> None:
        """Start from parameters, and from their covariance where a fit says it."""
        given = posterior.names if posterior else ()
        self.names = (*given, *(name for name in WALKING if name not in given))
        super().__init__(len(self.names), settings.noise, self.names.index("preload"))
        self._settings, self._origin = settings, Model(p)
        self.model, self._centre = self._origin, np.zeros(len(self.names))
        #: Whether no axis has the estimates, or they are far off; the model is the last one then
        self.lost = False
        self._first = self.model  # whose slopes are used
        usual = {"preload": settings.preload_deviation, "gain": settings.gain_deviation}
        prior = np.diag([usual.get(name, 0.0) ** 2 for name in self.names])
        if posterior:
            n = len(given)
            deviations = (np.log(posterior.high) - np.log(posterior.low)) / (2.0 * CONFIDENCE)
            prior[:n, :n] = np.array(posterior.correlations) * np.outer(deviations, deviations)
        self._drive: OperatingPoint | None = None  # the one that b is of
        self._open = 0.0  # deviation of steps from those of the model, as a fraction
        self._beyond: dict[tuple[float, float, int], float] = {}
        self.prior = np.sqrt(np.diag(prior))
        self.covariance[THETA, THETA] = prior
        self.covariance[RATE, RATE] = _RATE**2
        self.sensor_gain = 1.0  #: by which the readings are too large
        self._walks = np.array([name in WALKING for name in self.names], dtype=np.float64)

    # -- what is known

    @property
    def x(self) -> float:
        """Position at the last reading, m."""
        return float(self.state[0])

    @property
    def theta(self) -> Array:
        """Logarithms of the parameters over those of the file, (names,)."""
        return self.state[THETA]

    @property
    def values(self) -> Array:
        """Values of the parameters, (names,)."""
        return np.exp(self.theta) * [float(self._origin.p.value(name)) for name in self.names]

    @property
    def deviations(self) -> Array:
        """Standard deviations of these logarithms, (names,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)[THETA]))

    def step_size(self, drive: OperatingPoint) -> tuple[float, float]:
        """Return the settled step of a drive and its standard deviation, m."""
        step, row, variance = self.modelled_step(drive)
        variance += float(row @ self.covariance @ row)
        return step + float(row @ self.state), math.sqrt(max(variance, 0.0))

    def modelled_step(self, drive: OperatingPoint) -> tuple[float, Array, float]:
        """Return the step of a drive at a state of 0, its derivatives by the state, and a variance.

        The variance (m^2) is what the state does not know of it.
        """
        step = self.sensor_gain * self.renew(_RECENTRE).curve(drive).step
        row, variance = np.zeros(len(self.covariance)), 0.0
        row[THETA] = self.slopes_of_step(drive)
        if self._runs(drive):
            row[OFFSET] = drive.direction
        else:
            variance = self._beyond_slopes(drive)
        return step - float(row[THETA] @ self._centre), row, variance

    def drift(self, drive: OperatingPoint) -> tuple[float, float]:
        """Return the rate of a drive's step since a change, and its standard error.

        Both are fractions of the step in a second of stepping; 0 and 0 where no rate is sought, or
        no step is made.
        """
        step = self.model.curve(drive).step
        if not step:
            return 0.0, 0.0
        slope = float(self._first.slopes(drive, self.names)[self._drifts])
        share = slope / step
        rate, deviation = self.state[RATE], math.sqrt(self.covariance[RATE, RATE])
        return share * float(rate), abs(share) * deviation

    def slopes_of_step(self, drive: OperatingPoint) -> Array:
        """Return the derivatives of a drive's step by the logarithms of parameters, m."""
        return self.sensor_gain * self._first.slopes(drive, self.names)

    def _runs(self, drive: OperatingPoint) -> bool:
        """Whether b is of a drive: of both directions, where it is not for an unknown change."""
        alike = 3 if self._open else 2
        return self._drive is not None and drive[:alike] == self._drive[:alike]

    def _beyond_slopes(self, drive: OperatingPoint) -> float:
        """Return the variance (m^2) of a drive's step that the slopes do not make.

        The steps at one deviation to either side of each principal axis of what is known of the
        parameters, less those that the slopes say.
        """
        if drive[:3] not in self._beyond:
            model, slopes = self.renew(_RECENTRE), self._first.slopes(drive, self.names)
            step = model.curve(drive).step
            variances, axes = np.linalg.eigh(self.covariance[THETA, THETA])
            away = [_OFFSET * step, self._open * step]
            for way in (axes * np.sqrt(np.maximum(variances, 0.0))).T:
                for sign in (1.0, -1.0):
                    near = model.moved(dict(zip(self.names, (sign * way).tolist(), strict=True)))
                    if near:
                        away.append(settled_step(near.p, drive) - step - sign * float(slopes @ way))
            self._beyond[drive[:3]] = float(np.sum(np.square(away))) / 2.0
        return self.sensor_gain**2 * self._beyond[drive[:3]]

    # -- going on

    def reopen(self) -> None:
        """Let steps be others than those of the model, and drift."""
        self.open_steps()
        self.forget(RATE, RATE + 1, _RATE**2)

    def open_steps(self) -> None:
        """Let the steps of each drive be other ones than those of the model."""
        step = self._open = _OPEN
        if self._drive:
            step *= self.model.curve(self._drive).step
        self.forget(OFFSET, OFFSET + 1, step**2)

    def hold_rate(self) -> None:
        """Take the rate for 0, and all else for what it then is."""
        if (known := self.covariance[RATE])[RATE] > 0.0:
            gain = known / known[RATE]
            self.state = self.state - gain * self.state[RATE]
            self.covariance = self.covariance - np.outer(gain, known)
            self.forget(RATE, RATE + 1)

    def motion(self, parts: Parts) -> ModelledMotion:
        """Return what the model says of pieces of drive cycles.

        The state forgets b where another drive runs.
        """
        model, settings, slope = self.renew(_RECENTRE), self._settings, np.zeros(len(self.names))
        distance = scatter = stepping = cycles = 0.0
        direction, blur = 0, Blur()
        for piece, begin, end in parts:
            if piece.drive is None:
                continue
            curve, at = model.curve(piece.drive), parts_of_cycles(piece, begin, end)
            distance += self.sensor_gain * float(np.diff(curve.at(*at))[0])
            blur = curve.blur(piece, end, settings.timing)
            done, step = float(at[0][1] - at[0][0]), abs(curve.step)
            slope += done * self.slopes_of_step(piece.drive)
            scatter += done * (settings.step_spread * step) ** 2
            ends = (begin == piece.start) + (piece.rests and begin < piece.end <= end)
            scatter += ends * (self._open * step) ** 2
            if begin == piece.start:  # a contact that nobody saw may take a step to settle
                spread = settings.start_spread if piece.alike else settings.change_spread
                scatter += spread**2 if piece.drive.before else step**2
            if done > 0.0:
                if self._open:  # a cycle is of another shape, too
                    blur = blur._replace(timing=math.hypot(blur.timing, _SHAPE * step))
                direction = piece.drive.direction
                stepping += done / piece.drive.frequency
                if not self._runs(piece.drive):
                    self._beyond = {}
                    # The parameters take what the first drive shows.
                    first = self._drive is None and not self._open
                    variance = 0.0 if first else self._beyond_slopes(piece.drive)
                    self._drive, cycles = piece.drive, 0.0
                    self.forget(OFFSET, OFFSET + 1, variance)
                cycles += direction * done
        return ModelledMotion(distance, slope, scatter, blur, stepping, direction, cycles)

    def advance(self, motion: ModelledMotion, duration: float) -> None:
        """Go on by a motion that takes a duration (s)."""
        settings, hours, rate = self._settings, duration / 3600.0, float(self.state[RATE])
        walk = settings.drift_hour**2 * hours + settings.drift_metre**2 * abs(motion.distance)
        walks = self._walks * walk
        # A walk from nothing at the begin has a third of its last variance in the mean.
        scatter = motion.scatter + float(motion.slope**2 @ walks) / 3.0
        drifting = 0.5 * motion.stepping * rate * float(motion.slope[self._drifts])
        distance = motion.distance - float(motion.slope @ self._centre)
        scatter += (_RATE_SLOPE * drifting) ** 2
        self.move(distance, motion.slope, scatter, motion.stepping, motion.cycles)
        self.covariance[THETA, THETA] += np.diag(walks)
        self.covariance[RATE, RATE] += (_RATE_WALK * rate) ** 2 * motion.stepping

    def update(self, one: ProcessedReading, duration: float) -> tuple[float, float, float]:
        """Go on to a reading, and take it; return as `read`."""
        self.advance(one.motion, duration)
        return self.read(one.reading, one.motion.blur, GLITCH)

    def rebased(
        self,
        p: Parameters,
        name: str,
        sensor_gain: float,
        before: Array,
        shown: Sequence[ShownStep],
        ambiguous: bool,
    ) -> Tracker:
        """Return the tracker of an axis of other parameters, which makes the steps shown.

        The named parameter, if it is tracked, may be off by a little; before is the covariance of
        all before. The position is the present one. ambiguous: whether it may be another parameter.
        """
        new = copy.copy(self)
        new._origin, new.sensor_gain = Model(p), sensor_gain
        new._first = new.model = new._origin
        new._centre, new.state = np.zeros(len(self.names)), self.state.copy()
        new.forget(1, len(new.covariance) - 1)
        new.covariance[THETA, THETA] = before
        new._open, new._beyond = 0.0, {}
        if ambiguous:
            new.open_steps()
        elif new._drive:
            new.covariance[OFFSET, OFFSET] = new._beyond_slopes(new._drive)
        if name in self.names:
            new.covariance[1 + self.names.index(name), 1 + self.names.index(name)] += _ABOUT**2
        new.prior = new.deviations
        steps, rows, unknown = zip(*(new.modelled_step(one.drive) for one in shown), strict=True)
        errors = np.diag([one.deviation**2 + (_SHOWN * one.step) ** 2 for one in shown])
        errors += np.diag(unknown)
        away = np.array([one.step for one in shown]) - steps
        shared = new.covariance @ np.array(rows).T
        gain = np.linalg.solve(rows @ shared + errors, shared.T).T
        new.state = new.state + gain @ away
        new.covariance = new.covariance - gain @ shared.T
        return new

    def renew(self, within: float) -> Model:
        """Make the model anew where the estimates are farther off than within, and return it.

        The last one stays where there is none.
        """
        theta, self.lost = self.theta.copy(), False
        if np.abs(theta - self._centre).max() > within:
            near = np.abs(theta).max() <= FARTHEST
            changes = dict(zip(self.names, theta.tolist(), strict=True))
            model = self._origin.moved(changes) if near else None
            self.lost = model is None
            if model is not None:
                self._keep_steps(model)
                self.model, self._centre = model, theta
        return self.model

    def _keep_steps(self, model: Model) -> None:
        """Move the estimates so that the steps of the drives seen stay those in a new model.

        The readings said what the steps are. The ringing that outlasts a cycle makes them wavy
        functions of the parameters, of which the slopes know nothing.
        """
        drives = self.model.drives
        if not drives:
            return
        slopes = np.array([self._first.slopes(one, self.names) for one in drives])
        bent = np.array([model.curve(p).step - self.model.curve(p).step for p in drives])
        bent -= slopes @ (self.theta - self._centre)
        shared = self.covariance[THETA, THETA] @ slopes.T
        known = slopes @ shared
        known += _BENT * np.diag(np.diag(known))  # two drives may not agree
        move = shared @ np.linalg.lstsq(known, bent, rcond=None)[0]
        far = float(np.abs(move / np.maximum(self.deviations, 1e-12)).max())
        self.state = self.state.copy()
        self.state[THETA] -= move / max(far, 1.0)  # farther off, slopes say nothing
