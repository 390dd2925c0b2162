# SPDX-License-Identifier: Apache-2.0
"""Tracks position and parameters of an axis with a Kalman filter on tables of the kernel.

The state is the position at the last reading and the logarithms of parameters, as differences from
those of the file. Between two readings the position goes on by what the kernel's curves say,

    x' = x + D + J (theta - theta_0),

with D at theta_0, where the curve was made: it is made anew as the estimate leaves it. So this is
an extended Kalman filter (Jazwinski 1970, section 8.3) whose model is the kernel. J stays that of
the first estimate: slopes that turn with the estimate would feign knowledge of what no reading
shows (Huang, Mourikis, Roumeliotis 2008).
Steps scatter, and the parameters walk at random; what no reading shows keeps its mean.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Generator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.library.ensemble import Ensemble
from stickslip_ros.parameters import Parameters
from stickslip_ros.reporting import CONFIDENCE
from stickslip_ros.twin.response import Blur, Model, parts_of_cycles
from stickslip_ros.twin.settings import TwinSettings
from stickslip_ros.twin.timeline import OperatingPoint, Piece

Array = NDArray[np.float64]
Parts = Sequence[tuple[Piece, float, float]]

#: Parameters that walk: the one that wears, loosens and warms, and the actuator with its amplifier
WALKING = ("preload", "gain")
#: Change of a logarithm from which on the curves are made anew; beyond the last, there is no model
_RECENTRE, FARTHEST = 0.04, math.log(3.0)
#: Place of the logarithms in the state
THETA = slice(1, -1)
#: Times that readings after a change are gone through
_REFITS = 2
#: Readings that are gone through while one comes
_FASTER = 3
#: How well the size of a change is known then, a logarithm
_ABOUT = 0.05
#: Standard deviations beyond which a reading is a glitch, which moves no estimate; glitches in a
#: row after which the position has jumped
_GLITCH, _JUMP = 5.0, 2


class ModelledWay(NamedTuple):
    """What the model says of the time between two readings."""

    way: float  #: m
    slope: Array  #: of the way by each parameter's logarithm, m
    scatter: float  #: variance of the way, m^2
    blur: Blur  #: of the second reading
    direction: int  #: of the cycles, 0 at rest


class Seen(NamedTuple):
    """A reading, and what the tracker knew of the motion before it."""

    t: float  #: s
    reading: float  #: m
    parts: Parts
    motion: ModelledWay


class Innovation(NamedTuple):
    """A reading against what was expected."""

    expected: Any  #: m
    deviation: float  #: standard deviation of the difference, m
    z: Any  #: the difference in these
    jumped: bool = False  #: whether the position has, so that it is taken anew


class ReadingFilter:
    """Position, logarithms of n parameters and ringing: the state (..., 2 + n), from readings.

    Leading axes are ways that the axis may have gone, whose covariance is one.
    """

    def __init__(self, n: int, noise: float, ways: tuple[int, ...] = ()) -> None:
        """Begin at zero, known well; noise (m) is the standard deviation of a reading."""
        self.state = np.zeros((*ways, 2 + n))
        self.covariance = np.zeros((2 + n, 2 + n))
        self._noise, self._blur = noise, Blur()  # that of the last reading
        self._going, self._glitches = np.eye(2 + n), 0  # in a row

    def anchor(self, reading: float, blur: float = 0.0) -> None:
        """Take the position (m) from a reading alone; blur is its deviation beside the noise."""
        self.state[..., [0, -1]] = reading, 0.0
        self.covariance[[0, -1], :] = 0.0
        self.covariance[:, [0, -1]] = 0.0
        self._blur, self._glitches = Blur(), 0
        self.covariance[0, 0] = self._noise**2 + blur**2

    def go(self, way: Array | float, slope: Array, scatter: float) -> None:
        """Go on by a way (m), its slope by the logarithms, and its variance (m^2)."""
        self.state[..., 0] += way + self.state[..., THETA] @ slope
        self._going[0, THETA] = slope
        self.covariance = self._going @ self.covariance @ self._going.T
        self.covariance[0, 0] += scatter

    def see(self, reading: float, blur: Blur, glitch: float = math.inf) -> Innovation:
        """Take a reading (m) after `go`; one beyond so many deviations is told but not taken.

        Where readings meet the same phase of the ringing they differ from the curve alike: only its
        phase after the slip is unknown, so their covariance is a cosine of what it has turned.
        """
        last, self._blur = self._blur, blur
        alike = math.cos(blur.turned - last.turned) * blur.coherence if last.ringing else 0.0
        kept = alike * blur.ringing / last.ringing if last.ringing else 0.0
        self.state[..., -1] *= kept
        self.covariance[-1] *= kept
        self.covariance[:, -1] *= kept
        self.covariance[-1, -1] += (1.0 - alike**2) * blur.ringing**2
        shared = self.covariance[:, 0] + self.covariance[:, -1]  # of the state with the reading
        expected = self.state[..., 0] + self.state[..., -1]
        total = float(shared[0] + shared[-1]) + self._noise**2 + blur.timing**2
        z = (reading - expected) / math.sqrt(total)
        if glitch < math.inf and abs(z) > glitch:
            self._glitches += 1
            jumped = self._glitches == _JUMP
            if jumped:
                self.anchor(reading)
            return Innovation(expected, math.sqrt(total), z, jumped)
        self._glitches, gain = 0, shared / total
        self.state = self.state + np.multiply.outer(reading - expected, gain)
        self.covariance = self.covariance - np.outer(gain, shared)
        self.covariance = 0.5 * (self.covariance + self.covariance.T)
        return Innovation(expected, math.sqrt(total), z)


class Tracker(ReadingFilter):
    """Position and parameters with their covariance, from reading to reading."""

    def __init__(self, p: Parameters, settings: TwinSettings, ensemble: Ensemble | None) -> None:
        """Start from parameters, and from their covariance where a fit says it."""
        given = ensemble.names if ensemble else ()
        self.names = (*given, *(name for name in WALKING if name not in given))
        super().__init__(len(self.names), settings.noise)
        self._settings, self._origin = settings, Model(p)
        self.model, self._centre = self._origin, np.zeros(len(self.names))
        #: Whether no axis has the estimates, or they are far off; the model is the last one then
        self.lost = False
        self._first = self.model  # whose slopes are used
        usual = {"preload": settings.preload_deviation, "gain": settings.gain_deviation}
        prior = np.diag([usual.get(name, 0.0) ** 2 for name in self.names])
        if ensemble:
            n = len(given)
            deviations = (np.log(ensemble.high) - np.log(ensemble.low)) / (2.0 * CONFIDENCE)
            prior[:n, :n] = np.array(ensemble.correlations) * np.outer(deviations, deviations)
        self.prior = np.sqrt(np.diag(prior))
        self.covariance[THETA, THETA] = prior
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
    def deviations(self) -> Array:
        """Standard deviations of these logarithms, (names,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)[THETA]))

    @property
    def values(self) -> Array:
        """Values of the parameters, (names,)."""
        known = [float(self._origin.p.value(name)) for name in self.names]
        return np.asarray(known * np.exp(self.theta))

    def step_size(self, drive: OperatingPoint) -> tuple[float, float]:
        """Return the settled step of a drive and its standard deviation, m."""
        self._recentre()
        curve = self.model.curve(drive)
        slope = np.array([one.step for one in self._first.slopes(drive, self.names)])
        step = curve.step + float(slope @ (self.theta - self._centre))
        gain = self.sensor_gain
        return gain * step, gain * math.sqrt(
            max(float(slope @ self.covariance[THETA, THETA] @ slope), 0.0)
        )

    # -- going on

    def reopen(self, name: str, deviation: float) -> None:
        """Let a parameter be anywhere within a standard deviation of its logarithm."""
        k = 1 + self.names.index(name)
        self.covariance[k, k] += deviation**2
        self.prior = self.deviations

    def motion(self, parts: Parts) -> ModelledWay:
        """Return what the model says of pieces of drive cycles."""
        self._recentre()
        settings, slope = self._settings, np.zeros(len(self.names))
        way = scatter = 0.0
        direction, blur = 0, Blur()
        for piece, begin, end in parts:
            if piece.drive is None:
                continue
            curve = self.model.curve(piece.drive)
            slopes = self._first.slopes(piece.drive, self.names)
            at = parts_of_cycles(piece, begin, end)
            x = curve.at(*at)
            way += self.sensor_gain * float(x[1] - x[0])
            blur = curve.blur(piece, end, settings.timing)
            for k, one in enumerate(slopes):
                ends = one.at(*at)
                slope[k] += self.sensor_gain * float(ends[1] - ends[0])
            done = float(at[0][1] - at[0][0])
            step, drive = abs(curve.step), piece.drive
            scatter += done * (settings.step_spread * step) ** 2
            if begin == piece.start:  # a contact that nobody saw may take a step to settle
                spread = settings.start_spread if piece.alike else settings.change_spread
                scatter += spread**2 if drive.before else step**2
            if done > 0.0:
                direction = piece.drive.direction
        return ModelledWay(way, slope, scatter, blur, direction)

    def advance(self, motion: ModelledWay, duration: float) -> None:
        """Go on by a motion that takes a duration (s)."""
        settings, hours = self._settings, duration / 3600.0
        walk = settings.drift_hour**2 * hours + settings.drift_metre**2 * abs(motion.way)
        walks = self._walks * walk
        # A walk from nothing at the begin has a third of its last variance in the mean.
        scatter = motion.scatter + float(motion.slope**2 @ walks) / 3.0
        self.go(motion.way - float(motion.slope @ self._centre), motion.slope, scatter)
        self.covariance[THETA, THETA] += np.diag(walks)

    def forecast(self, motion: ModelledWay, duration: float) -> tuple[float, float]:
        """Return position and standard deviation (m) after a motion, and leave the state."""
        kept = self.state.copy(), self.covariance.copy()
        self.advance(motion, duration)
        found = self.x, math.sqrt(float(self.covariance[0, 0]))
        self.state, self.covariance = kept
        return found

    def take(self, one: Seen, duration: float) -> Innovation:
        """Go on to a reading, and take it."""
        self.advance(one.motion, duration)
        return self.see(one.reading, one.motion.blur, _GLITCH)

    def rebased(
        self, p: Parameters, name: str, sensor_gain: float, covariance: Array, seen: Sequence[Seen]
    ) -> Generator[float, None, Tracker]:
        """Return one that starts from other parameters and has gone through readings once more.

        The named parameter, if it is tracked, may be off by a little; covariance is that of all
        before. A change makes the first curves wrong ones: this is the iterated filter (Jazwinski
        1970, section 8.3). The first of the readings is where they begin; others may come to their
        end meanwhile.
        """
        new = copy.copy(self)
        new._origin, new.sensor_gain = Model(p), sensor_gain
        new.state, new._going = np.zeros_like(self.state), self._going.copy()
        opened = np.array([_ABOUT * (one == name) for one in self.names])
        for _ in range(_REFITS):
            new._renew()
            new._first = new.model
            new.state[THETA] = 0.0
            new.covariance = np.zeros_like(self.covariance)
            new.covariance[THETA, THETA] = covariance + np.diag(opened**2)
            new.prior = new.deviations
            new.anchor(seen[0].reading)
            for k, (before, one) in enumerate(pairwise(seen)):
                again = one._replace(motion=new.motion(one.parts))
                new.take(again, one.t - before.t)
                if k % _FASTER == 0:
                    yield 1e-9
        return new

    def model_at(self, theta: Array) -> Model | None:
        """Return the model with other logarithms of the parameters, None where there is none."""
        if np.abs(theta).max() > FARTHEST:
            return None
        return self._origin.moved(dict(zip(self.names, theta.tolist(), strict=True)))

    def _recentre(self) -> None:
        if np.abs(self.theta - self._centre).max() > _RECENTRE:
            self._renew()
        else:
            self.lost = False

    def _renew(self) -> None:
        model = self.model_at(self.theta)
        self.lost = model is None
        if model is not None:
            self.model, self._centre = model, self.theta.copy()
