# SPDX-License-Identifier: Apache-2.0
"""The closed loop of an axis itself, by its command of a position; see docs/states.md."""

from __future__ import annotations

import math

import gymnasium
import numpy as np

import stickslip_ros as ss
from stickslip_ros.gym import Task
from validation.control.policies import ID, Array

#: s, between looks at the position
_LOOK = 1e-4
#: Changes of the parameters in an episode
_STAGES = 50


def scores(task: Task, seeds: range) -> Array:
    """Return the scores of episodes, (seeds,), with what is hidden in those of the environment."""
    if task.score == "vibration":  # its cycles do not end where the environment looks
        return np.full(len(seeds), math.inf)
    return np.array([_score(task, seed) for seed in seeds])


def _score(task: Task, seed: int) -> float:
    core = gymnasium.make(ID, task=task).unwrapped.core
    core.start(np.array([0]), [np.random.default_rng(seed)])
    hidden = {name: float(values[0]) for name, values in core.hidden.items()}
    p = ss.Parameters.of(None, **task.parameters).replace(
        **hidden, frequency=4e3, max_frequency=1e5, scan_rate=1e6, sensor_seed=seed,
        target_tolerance=task.tolerance, hold_time=1e-3, settle_time=1e-3,
    )  # fmt: skip
    axis, since, sums = ss.Axis(p), math.inf, np.zeros(2)
    axis.command_position(float(core.goal[0]))
    for k in range(1, round(task.limit / _LOOK) + 1):
        t = k * _LOOK
        if task.changes and k % round(task.limit / _LOOK / _STAGES) == 0:
            done = t / task.limit
            factors = {name: float(values[0]) for name, values in core.factors.items()}
            changes = {name: hidden[name] * (1.0 + (f - 1.0) * done) for name, f in factors.items()}
            axis.set_parameters(changes)
        axis.advance(t)
        error = axis.state.x - float(core.goal[0])
        since = min(since, t) if abs(error) <= task.tolerance else math.inf
        if task.score == "arrival" and t - since >= task.hold:
            break
        if t >= 0.2 * task.limit:
            sums += error**2, 1.0
    return since if task.score == "arrival" else float(math.sqrt(sums[0] / sums[1]))
