# SPDX-License-Identifier: Apache-2.0
"""Iterative learning: the same move again and again, without feedback within a move.

A move is full steps, then a scan, for a distance that is corrected by the error in which the last
one ended (S. Arimoto, S. Kawamura, F. Miyazaki, J. Robotic Systems 1 (1984) 123; D. A. Bristow, M.
Tharayil, A. G. Alleyne, IEEE Control Systems 26 (2006) 96). Every trial is scored like the others;
the last one counts.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from stickslip_ros.gym import Task
from validation.control.policies import ID, Array, Policy, actions, run
from validation.control.steps_then_scan import step_of

TRIALS = 8
#: Hz, of the steps and of the periods after them
_FREQUENCY = 4e3
#: Share of the error that the next move corrects; readings at the end that are averaged
_LEARNED, _AVERAGED = 0.9, 50


class Move:
    """Moves of some axes: sides, numbers of steps and ways (m) of the scans after them, (axes,)."""

    def __init__(self, way: Array, step: float) -> None:
        """Plan moves over ways (m) with a step (m)."""
        self.step, self.side = step, np.sign(way)
        self.steps = np.floor(np.abs(way) / step)
        self.rest = np.abs(way) - self.steps * step

    def correct(self, error: Array, reach: float) -> None:
        """Learn from errors (m); as long as the scan, of reach (m), can, it alone is corrected."""
        self.rest += _LEARNED * self.side * error
        beyond = (self.rest < 0.0) | (self.rest > reach)
        more = np.where(beyond, np.round((self.rest - 0.5 * reach) / self.step), 0.0)
        self.steps += more
        self.rest -= more * self.step

    def policy(self, drive: Any) -> Policy:
        """Return the policy that does the moves."""
        start = np.where(self.side > 0.0, drive.low, drive.high)
        level, left = start + self.side * self.rest / drive.gain, self.steps.copy()

        def act(seen: Array) -> Array:
            steps = left > 0.0
            left[steps] -= 1.0
            frequency = np.full(len(seen), _FREQUENCY)
            return actions(drive, np.where(steps, self.side, 0.0), level, frequency, 100.0)

        return act


def scores(task: Task, seeds: range) -> Array:
    """Return the scores of the last trials, (seeds,)."""
    environment: Any = gymnasium.make_vec(ID, len(seeds), task=task)
    first, _ = environment.reset(seed=list(seeds))
    drive = environment.unwrapped.core.axes.drive
    move = Move(first[:, 1] - first[:, 0], step_of(task))
    for _ in range(TRIALS):
        found, history = run(task, move.policy, seeds)
        seen = np.stack(history)  # (periods, axes, 5)
        error = np.zeros(len(seeds))
        for k in range(len(seeds)):
            known = seen[np.isfinite(seen[:, k, 0]), k][-_AVERAGED:]
            error[k] = np.mean(known[:, 1] - known[:, 0])
        move.correct(error, drive.gain * (drive.high - drive.low))
    return found
