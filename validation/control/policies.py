# SPDX-License-Identifier: Apache-2.0
"""Runs policies on a task, and turns volts and hertz into actions."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import stickslip_ros.gym
from stickslip_ros.gym import Task

Array = NDArray[np.float64]
#: Observations (axes, 4) -> actions (axes, 4)
Policy = Callable[[Array], Array]

ID = "stickslip_ros/Position-v0"
assert stickslip_ros.gym.TASKS  # the import registers the environments


def run(
    task: Task, make_policy: Callable[[Any], Policy], seeds: range
) -> tuple[Array, list[Array]]:
    """Return the score of an episode of each seed, (seeds,), and observations with positions.

    The history has an array (axes, 5) for each period: the observation and the true position (m).
    """
    environment: Any = gymnasium.make_vec(ID, len(seeds), task=task)
    seen, _ = environment.reset(seed=list(seeds))
    policy = make_policy(environment.unwrapped.core.axes.drive)
    scores, running, history = np.full(len(seeds), math.inf), np.ones(len(seeds), bool), []
    while running.any():
        seen, _, terminated, truncated, info = environment.step(policy(seen))
        ended = running & (terminated | truncated)
        scores[ended] = info["score"][ended]
        history.append(np.column_stack([seen, info["position"]]))
        history[-1][~running] = math.nan
        running &= ~ended
    return scores, history


def share(value: Any, ends: tuple[float, float]) -> Any:
    """Return the number within -1 and 1 of an action for a value within ends, by its logarithm."""
    return np.clip(2.0 * np.log(value / ends[0]) / math.log(ends[1] / ends[0]) - 1.0, -1.0, 1.0)


def actions(drive: Any, amplitude: Array, level: Array, frequency: Array, slewrate: float) -> Array:
    """Return actions (axes, 4): full voltage or none, as a share of it; V, Hz and V/us else.

    The level plays a part without an amplitude only; other cycles leave room ahead for a scan.
    """
    found = np.zeros((len(amplitude), 4))
    found[:, 0] = amplitude
    scan = (
        2.0 * (np.clip(level, drive.low, drive.high) - drive.low) / (drive.high - drive.low) - 1.0
    )
    found[:, 1] = np.where(amplitude == 0.0, scan, -np.sign(amplitude))
    found[:, 2] = share(frequency, drive.frequency)
    found[:, 3] = share(1e6 * slewrate, drive.slewrate)
    return found
