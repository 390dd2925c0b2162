# SPDX-License-Identifier: Apache-2.0
"""The inverse of the play with feedforward: each cycle gets the amplitude that its way needs.

A drive loses the same part of every stroke, so from strokes to steps it is a play, whose inverse
adds the width again; the closed form says how wide it is. The target's own speed is fed forward,
and ways that the late reading does not show yet count as done. After inverse feedforward of the
hysteresis of piezos (S. Devasia, E. Eleftheriou, S. O. R. Moheimani, IEEE Trans. Control Syst.
Technol. 15 (2007) 802). The actuators of the environments have no hysteresis of their own.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import stickslip_ros as ss
from stickslip_ros.gym import Task
from validation.control.policies import Array, Policy, actions, run
from validation.control.steps_then_scan import step_of

#: Hz, of steps, and of the periods of a scan, at most that of half a latency
_FREQUENCY, _SCAN = 4e3, 2e3
#: Share of the error that a scan corrects in a period; V/us
_GAIN, _SLEWRATE = 0.5, 100.0


def policy_of(drive: Any, task: Task) -> Policy:
    """Return the policy, for as many axes as observations are given."""
    latency = ss.Parameters.of(None, **task.parameters).sensor.sensor_latency
    full, stroke = step_of(task), drive.gain * (drive.high - drive.low)
    play = stroke - full
    # A target that moves leaves as much time for a step as it takes to go that far.
    pace = min(_FREQUENCY, 2.0 * task.speed / full) if task.speed else _FREQUENCY
    scan_rate = min(_SCAN, 0.5 / latency)
    done: list[tuple[Array, Array]] = []  # ends (s) and ways (m) of the last periods

    def act(seen: Array) -> Array:
        x, target, level, t = seen.T
        side = np.sign(target)  # of a target that moves
        unseen = sum((np.where(end > t - latency, way, 0.0) for end, way in done), np.zeros(len(x)))
        error = target + side * task.speed / pace - x - unseen
        moved = done[-1][1] != 0.0 if done else np.zeros(len(x), bool)
        reach = level + error / drive.gain
        scan = (reach >= drive.low) & (reach <= drive.high)
        if task.speed:
            scan = wait = side * error <= 0.0
        else:
            scan &= ~(moved & (unseen != 0.0))
            wait = ~scan & (np.abs(error) < full) & (unseen != 0.0)
        way = np.where(scan | wait, 0.0, np.clip(error, -full, full))
        amplitude = np.where(way != 0.0, np.sign(way) * (np.abs(way) + play) / stroke, 0.0)
        frequency = np.where(scan | wait, scan_rate, pace)
        done.append((t + 1.0 / frequency, way))
        del done[:-100]
        wanted = np.where(scan & ~wait, level + _GAIN * error / drive.gain, level)
        return actions(drive, amplitude, wanted, frequency, _SLEWRATE)

    return act


def scores(task: Task, seeds: range) -> Array:
    """Return the scores of episodes, (seeds,)."""
    return run(task, lambda drive: policy_of(drive, task), seeds)[0]
