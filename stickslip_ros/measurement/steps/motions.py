# SPDX-License-Identifier: Apache-2.0
"""The runs of a motion, and the part of one that they determine."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import TypeGuard

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.steps.analysis import find_steps
from stickslip_ros.measurement.steps.drive import Drive
from stickslip_ros.measurement.steps.record import FEWEST_SAMPLES
from stickslip_ros.measurement.steps.run import Run
from stickslip_ros.simulation.motion import Motion


def has_actuator(u: Array | None) -> TypeGuard[Array]:
    """Return True if the deflection u (m) of an actuator was measured and moves."""
    return u is not None and len(u) > 0 and bool(np.ptp(u) > 0.0)


def determined_part(motion: Motion, runs: Sequence[Run]) -> tuple[Motion, list[Run]]:
    """Return the part of a motion without its runs that are not determined, and its other runs.

    Of several such parts, that with most steps; all of the motion where no run is determined.
    """
    if all(one.determined for one in runs) or not any(one.determined for one in runs):
        return motion, list(runs)
    edges = [-1, *(k for k, one in enumerate(runs) if not one.determined), len(runs)]
    before, after = max(
        pairwise(edges), key=lambda edge: sum(one.steps for one in runs[edge[0] + 1 : edge[1]])
    )
    begin = runs[before].end if before >= 0 else -math.inf
    end = runs[after].start if after < len(runs) else math.inf
    return motion.between(begin, end), list(runs[before + 1 : after])


def why_left_out(runs: Sequence[Run], kept: Sequence[Run]) -> list[str]:
    """Return of each run why it is in no part that is determined; "" for those kept."""
    return [
        ""
        if any(one is other for other in kept)
        else "; ".join(one.doubts) or "beyond a run that is not determined"
        for one in runs
    ]


def runs_of(motion: Motion, drive: Drive | None = None) -> list[Run]:
    """Return the runs of a motion in the order of time, none where it does not step.

    Its actuator gives the cycles where that was measured and moves. Raises TraceError.
    """
    if len(motion.t) < FEWEST_SAMPLES or not np.ptp(motion.x) > 0.0:
        return []
    return find_steps(motion.t, motion.x, drive, motion.u).runs
