# SPDX-License-Identifier: Apache-2.0
"""Many operating points at once: from columns of parameters to what their steps are.

Parameters may hold columns, arrays of shape (points,); see `Parameters`. A set of columns never
becomes a set for each point: laws, plant and drive are evaluated for whole columns.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model import drive_of, plant_of
from stickslip_ros.model.excitation import drives_of
from stickslip_ros.model.friction import is_defined
from stickslip_ros.model.plant import plants_of
from stickslip_ros.parameters import ParameterError, Parameters
from stickslip_ros.solver.batch import Batch
from stickslip_ros.traces.steps import settled_mean

__all__ = ["batch_of", "fault_of", "steps_of"]


def batch_of(p: Parameters, points: int, sign: int) -> tuple[Batch, NDArray[np.bool_]]:
    """Return the batch of a column set and which of its points are possible, (points,).

    sign is the direction of the steps, +1 or -1. `fault_of` tells why a point is not possible.
    """
    plants = plants_of(p)
    patterns, possible = drives_of(p, points, sign)
    return Batch.of(plants, p.solver.tolerance, patterns), possible & is_defined(plants.contact)


def fault_of(p: Parameters) -> str | None:
    """Return why a plain set of parameters is impossible, None if it is not."""
    try:
        plant_of(p)
        drive_of(p)
    except ParameterError as error:
        return str(error)
    return None


def steps_of(
    p: Parameters, points: int, steps: int, where: NDArray[np.bool_] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return step size and backstep (m) of a column set, each (points,), as `run_steps` does.

    steps: how many from rest, sign: direction. nan at impossible points and, if given, where
    ``where`` is false.
    """
    batch, possible = batch_of(p, points, 1 if steps >= 0 else -1)
    position, backstep = batch.run(abs(steps), possible if where is None else possible & where)
    return (
        settled_mean(np.diff(position, prepend=0.0, axis=-1)),
        settled_mean(backstep),
    )
