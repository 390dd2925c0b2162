# SPDX-License-Identifier: Apache-2.0
"""Steps, then a scan through the inverse of the hysteresis, with feedforward of the creep.

The plays of the actuator, known from a loop of the make as `identify_actuator` finds them, are
followed through every voltage, and inverted for the deflection that is wanted (K. Kuhnen, European
J. Control 9 (2003) 407; D. Croft, G. Shed, S. Devasia, J. Dyn. Syst. Meas. Control 123 (2001) 35
add that of the creep). What an inverse leaves is small beside the noise, so less of the error is
corrected in a period.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

import stickslip_ros as ss
from stickslip_ros.gym import Task
from stickslip_ros.model.actuator import Actuator
from validation.control.policies import Array, run
from validation.control.steps_then_scan import Piezo, Settings, policy_of

#: Halvings of the range in which the voltage of a deflection is found
_HALVINGS = 45
_SETTINGS = Settings(gain=0.3)


class Plays(Piezo):
    """The plays of some actuators, followed and inverted."""

    def __init__(self, drive: Any, task: Task, count: int) -> None:
        """Start with actuators that never moved."""
        super().__init__(drive)
        p = ss.Parameters.of(None, **task.parameters).actuator
        self._actuator, self._creep, self._start = Actuator.of(p), p.creep or 0.0, p.creep_start
        self._plays = np.zeros((count, len(self._actuator.thresholds)))
        self._rested = np.zeros(count)  # s, since the last slip

    def moved(self, volts: Array) -> Array:
        """Return the plays (axes, operators) after voltages (V, axes)."""
        v, gap = volts[:, None], self._actuator.thresholds
        return np.maximum(v - gap, np.minimum(v + gap, self._plays))

    def deflection(self, volts: Array) -> Array:
        """Return the deflections (m) at voltages (V) to which the actuators go straight."""
        return self._actuator.elastic * volts + self.moved(volts) @ self._actuator.weights

    def level_for(self, level: Array, way: Array, time: float) -> Array:
        """Return the voltage (V) that moves by a way (m) from a level, beyond what creeps (m)."""
        here = self.deflection(level)
        ages = np.maximum(self._rested, self._start)
        wanted = here + way - self._creep * here * np.log10(1.0 + time / ages)
        low, high = np.full(len(level), self.low), np.full(len(level), self.high)
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            below = self.deflection(middle) < wanted
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return 0.5 * (low + high)

    def reaches(self, level: Array, way: Array) -> NDArray[np.bool_]:
        """Return whether a scan from a level (V) can go a way (m)."""
        goal = self.deflection(level) + way
        low, high = (self.deflection(np.full(len(level), end)) for end in (self.low, self.high))
        return (low <= goal) & (goal <= high)

    def drive(self, amplitude: Array, level: Array, time: Array) -> None:
        """Take what a period (s) does: a full step, or a scan to a level (V)."""
        steps = amplitude != 0.0
        top = np.where(amplitude > 0.0, self.high, self.low)
        self._plays = self.moved(np.where(steps, top, level))
        self._plays = self.moved(np.where(steps, self.low + self.high - top, level))
        self._rested = np.where(steps, 0.0, self._rested + time)


def scores(task: Task, seeds: range) -> Array:
    """Return the scores of episodes, (seeds,)."""
    return run(
        task, lambda drive: policy_of(drive, task, _SETTINGS, Plays(drive, task, len(seeds))), seeds
    )[0]
