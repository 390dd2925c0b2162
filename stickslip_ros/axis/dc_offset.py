# SPDX-License-Identifier: Apache-2.0
"""The dc offset: the voltage of the actuator between drive cycles, and the memory of the actuator.

Levels are given in metres, as `gain` times the voltage, because a controller knows only this about
its actuator. A linear actuator has this deflection; one with hysteresis follows its loop.
"""

from __future__ import annotations

import math

import numpy as np

from stickslip_ros.axis.config import Config
from stickslip_ros.physics.model import DriveCycle, ramp
from stickslip_ros.physics.solver import State

_NEAR_ZERO = 1e-15  # m: levels below are rounding


class DcOffset:
    """The level between cycles, and on its ramp to another one."""

    def __init__(self, config: Config) -> None:
        """Start at 0 V, with an empty memory."""
        self._actuator, self._gain = config.commanded, config.gain
        self._zero = 0.0  # deflection (m) at level 0 of a linear actuator
        self._memory = self._actuator.rest()  # of one with a memory, at the start of a ramp
        self._start, self._rate = 0.0, 0.0  # of the ramp, s and V/s
        self._aim = 0.0  # level that the ramp goes to, m

    def at(self, now: State) -> float:
        """Return the level (m) while no cycles run."""
        linear = self._actuator.is_linear
        level = now.u - self._zero if linear else self._gain * self._volts(now.t)
        return level if abs(level) > _NEAR_ZERO else 0.0

    def ramp_to(self, aim: float, now: State, speed: float) -> DriveCycle | None:
        """Return the ramp to a level (m) at a speed (m/s); None if there is none to go."""
        distance = aim - self.at(now)
        self.stay(now.t)
        if abs(distance) <= _NEAR_ZERO:
            return None
        self._aim = aim
        if self._actuator.is_linear:
            return ramp(distance, abs(distance) / speed)
        volts = aim / self._gain - self._memory.volts
        self._start, self._rate = now.t, math.copysign(speed / self._gain, volts)
        pieces, _ = self._actuator.path(self._memory, volts / self._rate, self._rate)
        durations, rates = np.array(pieces).T
        return DriveCycle(durations, rates, slip=-1, sign=-1 if volts < 0.0 else 1, slip_parts=0)

    def arrive(self) -> None:
        """End the ramp at its target."""
        self._stand(self._aim / self._gain)

    def stay(self, t: float) -> None:
        """End the ramp, if there is one, at time t (s)."""
        self._stand(self._volts(t))

    def moved(self, volts: list[float]) -> None:
        """Remember voltages (V) that the actuator went between, and stay at the last."""
        for one in volts:
            self._stand(one)

    def replace(self, config: Config, level: float, now: State) -> float | None:
        """Set another actuator, at the same voltage and deflection.

        With other thresholds, its memory holds only the path from 0 V. level is the present level
        (m). Returns the new level (m) for the target voltage of a running ramp.
        """
        old, new = self._actuator, config.commanded
        volts, aim = level / self._gain, self._aim / self._gain * config.gain
        self._actuator, self._gain = new, config.gain
        if old.is_linear and new.is_linear:
            return None
        if new.is_linear:
            self._zero = now.u - volts * self._gain
        elif old.is_linear or not np.array_equal(old.thresholds, new.thresholds):
            self._memory = new.rest().moved(volts, new.thresholds)
        elif np.array_equal(old.weights, new.weights) and old.elastic == new.elastic:
            return None
        else:
            self.stay(now.t)
        self._rate = 0.0
        return aim if abs(aim - self.at(now)) > _NEAR_ZERO else None

    # -- inside

    def _volts(self, t: float) -> float:
        """Return the voltage at time t (s) of an actuator with a memory."""
        return self._memory.volts + self._rate * (t - self._start)

    def _stand(self, volts: float) -> None:
        if not self._actuator.is_linear:
            self._memory = self._memory.moved(volts, self._actuator.thresholds)
        self._rate = 0.0
