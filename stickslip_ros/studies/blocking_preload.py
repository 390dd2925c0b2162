# SPDX-License-Identifier: Apache-2.0
"""The preload that blocks an axis: from there on its steps cannot be measured (Fig. 5, 9)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.parameters import PARAMETERS, Parameters
from stickslip_ros.studies.bisection import bisect
from stickslip_ros.studies.operating_points import batch_of, steps_of
from stickslip_ros.traces.steps import MEASURABLE

#: Factor between the preloads of the first search, and accuracy of the result, N.
_FACTOR, _RESOLUTION = 1.5, 1e-4
#: Where the first search begins, N.
_LOWEST = 0.01


def blocking_preloads(p: Parameters, points: int, steps: int) -> NDArray[np.float64]:
    """Return the blocking preload (N) of a column set, (points,).

    The preload goes up from 0.01 N in factors until the step falls below `MEASURABLE`, judged by a
    run of steps from rest, and bisection from there finds the limit: the first one from below, as
    on a bench. The preload in p plays no part; preloads that the law is not defined for are passed
    over. nan where no preload steps, or every one does up to the end of the table's range.
    """

    def blocks(preload: NDArray[np.float64], where: NDArray[np.bool_]) -> NDArray[np.bool_]:
        step_size, _ = steps_of(p.replace(preload=preload), points, steps, where)
        return np.abs(step_size) < MEASURABLE  # nan does not block: the law is not defined there

    low = np.full(points, _LOWEST)
    high = np.full(points, np.nan)
    stepped = np.zeros(points, dtype=bool)
    _, searching = batch_of(p.replace(preload=PARAMETERS["preload"].high), points, 1)
    trial = _LOWEST
    while searching.any() and trial <= PARAMETERS["preload"].high:
        preload = np.full(points, trial)
        step_size, _ = steps_of(p.replace(preload=preload), points, steps, searching)
        stopped = searching & (np.abs(step_size) < MEASURABLE)
        stepped |= searching & (np.abs(step_size) >= MEASURABLE)
        high[stopped] = trial
        searching &= ~stopped
        low[searching] = trial
        trial *= _FACTOR
    return bisect(blocks, low, high, stepped & np.isfinite(high), _RESOLUTION)
