# SPDX-License-Identifier: Apache-2.0
"""How many steps run and measurement make; known where both rest before and after them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from stickslip_ros.arrays import Array
from stickslip_ros.measurement.motion_pair import Alignment, MotionPair
from stickslip_ros.motion.motion import Motion
from stickslip_ros.traces.analysis import has_actuator
from stickslip_ros.traces.cycles import TraceError, cycles_of_actuator
from stickslip_ros.traces.runs import Run

#: Part of its stroke by which an actuator moves that does not rest, and periods of a rest.
_MOVED, _REST = 0.01, 0.5


def step_counts(
    motions: MotionPair, alignment: Alignment, runs: Sequence[Run], k: int
) -> tuple[float, float, str]:
    """Return the steps of both in measured run k and the rests about it; or nan and why not."""
    one, (begin, end) = runs[k], _rests_about(motions.measurement, runs, k)
    begin = 0.5 * (begin + one.start) if k else begin
    end = 0.5 * (end + one.end) if k + 1 < len(runs) else end
    seen, why = _found_steps(motions.measurement, runs, k)
    edges = alignment.run_time(np.array([begin, end])).tolist()
    part, own, unknown = motions.run.between(*edges), 0, ""
    if has_actuator(part.u):
        own, unknown = _driven_steps(part.t, part.u, one.frequency if one.steps == 1 else None)
    elif not has_actuator(motions.run.u):
        found = motions.found_in_run
        near = nearest_run(found, one.direction, *edges)
        if near:
            own, unknown = _found_steps(motions.run, found, found.index(near))
    why = why or unknown
    return (math.nan, math.nan, why) if why else (own, seen, "")


def nearest_run(runs: Sequence[Run], direction: int, begin: float, end: float) -> Run | None:
    """Return the run with most time between begin and end (s), None if there is none."""
    shared = [
        (min(one.end, end) - max(one.start, begin), k)
        for k, one in enumerate(runs)
        if one.direction == direction
    ]
    longest, k = max(shared, default=(0.0, 0))
    return runs[k] if longest > 0.0 else None


def _rests_about(motion: Motion, runs: Sequence[Run], k: int) -> tuple[float, float]:
    """Return where the rest before a run begins and the one after it ends, s."""
    begin = runs[k - 1].end if k else float(motion.t[0])
    return begin, runs[k + 1].start if k + 1 < len(runs) else float(motion.t[-1])


def _found_steps(motion: Motion, runs: Sequence[Run], k: int) -> tuple[int, str]:
    """Return the steps that were found in a motion, and why their number is not known."""
    one, (begin, end) = runs[k], _rests_about(motion, runs, k)
    rests = min(one.start - begin, end - one.end) > _REST * one.period
    why = "; ".join(one.doubts) if rests else f"{motion.source} does not rest before and after them"
    return one.steps, why


def _driven_steps(t: Array, u: Array, frequency: float | None) -> tuple[int, str]:
    """Return the steps of an actuator, and why their number is not known."""
    try:
        cycles = cycles_of_actuator(t, u, frequency)
    except TraceError as error:
        return 0, str(error)
    outside = u[t < cycles.starts[0]], u[t > cycles.ends[-1]]
    cut = any(np.ptp(rest) > _MOVED * np.ptp(u) for rest in outside if len(rest))
    return len(cycles.slips), "the run begins or ends within a cycle" if cut else ""
