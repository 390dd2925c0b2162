# SPDX-License-Identifier: Apache-2.0
"""Many operating points at once: their steps, and searches over them.

Parameters may hold columns, arrays of shape (points,); see `Parameters`. A set of columns never
becomes a set for each point: laws, plant and drive are evaluated for whole columns.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model import Plant, drive_of
from stickslip_ros.model.friction import is_defined, value_or
from stickslip_ros.model.plant import scale_distances
from stickslip_ros.model.surface import Surface
from stickslip_ros.model.waveforms import command_of, drives_of
from stickslip_ros.parameters import PARAMETERS, ParameterError, Parameters
from stickslip_ros.solver.batch import Batch
from stickslip_ros.traces.steps import MEASURABLE, settled_mean

#: (values to try, at which points) -> at which points the value is high enough
Trial = Callable[[NDArray[np.float64], NDArray[np.bool_]], NDArray[np.bool_]]

#: Search for the blocking preload: where it begins, the factor between its preloads, and the
#: accuracy of the result, N.
_LOWEST, _FACTOR, _RESOLUTION = 0.01, 1.5, 1e-4
#: N/m, where the parameter ``spring`` is not set: a stiff force sensor.
SPRING = 1e6
#: Cycles over which the position is averaged, and cycles after which a run is given up.
_BLOCK, _LIMIT = 10, 100_000


def batch_of(p: Parameters, points: int, sign: int) -> tuple[Batch, NDArray[np.bool_]]:
    """Return the batch of columns, and whether each point is possible, (points,).

    sign is the direction of the steps, +1 or -1. `why_impossible` explains an impossible point.
    """
    plants = Plant.column(p)
    drive_cycles, possible = drives_of(p, points, sign)
    possible = possible & is_defined(plants.contact)
    plants = _aged(p, plants, possible)
    return Batch.of(plants, p.solver.tolerance, drive_cycles), possible


def _aged(p: Parameters, plants: Plant, possible: NDArray[np.bool_]) -> Plant:
    """Return the plants with contacts of the dwell and rate of their drives, if these count."""
    f = p.friction
    if not (np.any(f.dwell_growth) or np.any(f.rate_growth)):
        return plants
    factors: Any = np.ones(len(possible))
    for k in np.flatnonzero(possible).tolist():
        point = p.point(k)
        surface, command = Surface.of(point.friction), command_of(point)
        if surface and command.slip >= 0:
            factors[k] = surface.aged(command.dwell, command.slip_rate)
    return scale_distances(plants, factors)


def why_impossible(p: Parameters) -> str | None:
    """Return why the parameters of one point are impossible, None if they are possible."""
    try:
        Plant.of(p)
        drive_of(p)
    except ParameterError as error:
        return str(error)
    return None


def steps_of(
    p: Parameters, points: int, steps: int, where: NDArray[np.bool_] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return step size and backstep (m) of columns, each (points,), as `run_steps` does.

    steps: how many from rest, sign: direction. nan at impossible points and, if given, where
    ``where`` is false.
    """
    batch, possible = batch_of(p, points, 1 if steps >= 0 else -1)
    position, backstep = batch.run(abs(steps), possible if where is None else possible & where)
    return (
        settled_mean(np.diff(position, prepend=0.0, axis=-1)),
        settled_mean(backstep),
    )


def bisect(
    is_enough: Trial,
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    where: NDArray[np.bool_],
    accuracy: NDArray[np.float64] | float,
) -> NDArray[np.float64]:
    """Return the lowest value found that is enough, shape (points,); nan where ``where`` is false.

    low is known not to be enough and high to be enough. Ends where the two are no further apart
    than accuracy; every point takes the same path as if it were alone.
    """
    low, high = low.copy(), high.copy()
    while True:
        active = where & (high - low > accuracy)
        if not active.any():
            return np.where(where, high, np.nan)
        middle = 0.5 * (low + high)
        enough = is_enough(middle, active)
        high = np.where(active & enough, middle, high)
        low = np.where(active & ~enough, middle, low)


def blocking_preloads(p: Parameters, points: int, steps: int) -> NDArray[np.float64]:
    """Return the blocking preload (N) of columns, (points,).

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


def generated_forces(p: Parameters, points: int, steps: int) -> NDArray[np.float64]:
    """Return the generated force (N) of columns, (points,): spring times final position (Fig. 15).

    The runner pushes a spring, that of p or `SPRING`, until slip and stick cost as much as they
    bring; only the sign of steps counts. Positions at the ends of cycles are averaged over ten
    cycles; the run ends when this mean has risen by less than `MEASURABLE` over that of the ten
    cycles before, 0.01 nm a cycle. nan where it still rises after 100 000 cycles.
    """
    spring = value_or(p.runner.spring, SPRING)
    batch, possible = batch_of(p.replace(spring=spring), points, 1 if steps >= 0 else -1)
    return spring * batch.run_until_still(_BLOCK, MEASURABLE, _LIMIT, possible)  # type: ignore[no-any-return]
