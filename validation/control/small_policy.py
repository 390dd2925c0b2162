# SPDX-License-Identifier: Apache-2.0
"""The settings of `steps_then_scan`, found by CMA-ES on other draws than those that are scored.

N. Hansen, A. Ostermeier, Evolutionary Computation 9 (2001) 159, by the package ``cma``.
Every candidate is judged by the same draws.
"""

from __future__ import annotations

from dataclasses import astuple
from functools import cache

import cma
import numpy as np

from stickslip_ros.gym import TASKS, Task
from validation.control import steps_then_scan
from validation.control.policies import Array
from validation.control.steps_then_scan import Settings

#: Draws that a candidate is judged by; generations, and candidates of each
_DRAWS, _GENERATIONS, _CANDIDATES = range(1000, 1008), 6, 6
#: Settings are searched in their logarithms, this wide at first, within the ranges of an action
_WIDE = 0.4
_BOUNDS = Settings(2e-7, 1e3, 5e2, 5e2, 0.1, 20.0), Settings(5e-6, 8e3, 6e3, 6e3, 1.0, 100.0)


@cache
def found(name: str) -> Settings:
    """Return the settings found for a task."""
    low, high = (np.log(astuple(ends)) for ends in _BOUNDS)
    start = np.clip(np.log(astuple(Settings())), low + 1e-6, high - 1e-6)
    options = {
        "bounds": [low.tolist(), high.tolist()], "seed": 1, "popsize": _CANDIDATES,
        "maxiter": _GENERATIONS, "verbose": -9,
    }  # fmt: skip
    search = cma.CMAEvolutionStrategy(start.tolist(), _WIDE, options)
    while not search.stop():
        tried = search.ask()
        search.tell(tried, [_cost(TASKS[name], Settings(*np.exp(one))) for one in tried])
    return Settings(*np.exp(search.result.xbest))


def _cost(task: Task, settings: Settings) -> float:
    """Return the mean score; a task that is not done counts ten times the largest score."""
    scores = steps_then_scan.scores(task, _DRAWS, settings)
    done = scores[np.isfinite(scores)]
    worst = task.limit if task.score == "arrival" else 1e-7
    return float((done.sum() + 10.0 * worst * (len(scores) - len(done))) / len(scores))


def scores(task: Task, seeds: range) -> Array:
    """Return the scores of episodes, (seeds,), with the settings found."""
    return steps_then_scan.scores(task, seeds, found(task.name))
