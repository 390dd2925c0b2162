# SPDX-License-Identifier: Apache-2.0
"""Steps up to the range of the actuator, then a scan: the hand-over within one step.

As in positioners of two stages, the coarse one brings the target into the range of the fine one (T.
Tuma et al., IEEE/ASME Trans. Mechatronics 19 (2014) 1035). The step that the closed form predicts
says where the runner is by now, for the reading is late.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import stickslip_ros as ss
from stickslip_ros.gym import Task
from validation.control.policies import Array, Policy, actions, run


@dataclass(frozen=True)
class Settings:
    """What may be tuned."""

    far: float = 0.6e-6  #: distance (m) beyond which steps are fast
    fast: float = 4e3  #: Hz, of these
    slow: float = 1e3  #: Hz, of the last steps, at most that of half a latency
    scan: float = 2e3  #: Hz, of the periods of a scan, likewise
    gain: float = 0.5  #: share of the error that a scan corrects in a period
    slewrate: float = 100.0  #: V/us


class Piezo:
    """An actuator taken to be linear."""

    def __init__(self, drive: Any) -> None:
        """Take the range (V) and the gain (m/V) of a drive."""
        self.low, self.high, self.gain = drive.low, drive.high, drive.gain

    def level_for(self, level: Array, way: Array, time: float) -> Array:
        """Return the voltage (V) that moves by a way (m) from a level (V) within a time (s)."""
        return level + way / self.gain

    def reaches(self, level: Array, way: Array) -> NDArray[np.bool_]:
        """Return whether a scan from a level (V) can go a way (m)."""
        reach = level + way / self.gain
        return (reach >= self.low) & (reach <= self.high)

    def drive(self, amplitude: Array, level: Array, time: Array) -> None:
        """Take what a period (s) does: a full step, or a scan to a level (V)."""


def step_of(task: Task) -> float:
    """Return the step (m) at full voltage that the closed form has for the nominal axis."""
    p = ss.Parameters.of(None, **task.parameters).replace(
        frequency=100.0, inclination=0.0, actuator="linear", actuator_memory=False, creep=0.0
    )
    return ss.predict(p).step


def policy_of(drive: Any, task: Task, settings: Settings, piezo: Piezo | None = None) -> Policy:
    """Return the policy, for as many axes as observations are given."""
    latency = ss.Parameters.of(None, **task.parameters).sensor.sensor_latency
    # What a period does is seen before the next one begins, or the loop would swing.
    slow, scan_rate = min(settings.slow, 0.5 / latency), min(settings.scan, 0.5 / latency)
    step, piezo = step_of(task), piezo or Piezo(drive)
    state: dict[str, Array] = {}

    def act(seen: Array) -> Array:
        x, target, level, _ = seen.T
        before = state.get("amplitude", np.zeros(len(x)))  # of the last period
        pace = before * step * state.get("frequency", 0.0)
        fast = np.abs(target - x) > settings.far
        error = target - x - np.where(fast, pace * latency, 0.0)
        # The slip ends a period, and the reading is older: after the last steps it is waited for.
        wait = ~fast & (before != 0.0)
        scan = wait | piezo.reaches(level, error)
        way = np.where(wait, 0.0, settings.gain * error)
        wanted = piezo.level_for(level, way, 1.0 / scan_rate)
        amplitude = np.where(scan, 0.0, np.sign(error))
        frequency = np.where(scan, scan_rate, np.where(fast, settings.fast, slow))
        piezo.drive(amplitude, wanted, 1.0 / frequency)
        state["amplitude"], state["frequency"] = amplitude, frequency
        return actions(drive, amplitude, wanted, frequency, settings.slewrate)

    return act


def scores(task: Task, seeds: range, settings: Settings | None = None) -> Array:
    """Return the scores of episodes, (seeds,)."""
    return run(task, lambda drive: policy_of(drive, task, settings or Settings()), seeds)[0]
