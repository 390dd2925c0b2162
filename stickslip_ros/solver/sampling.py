# SPDX-License-Identifier: Apache-2.0
"""A simulation looked at many times: the loop over the times is compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled
from stickslip_ros.model.friction import Contact, friction_force
from stickslip_ros.solver.integrator import advance, look_into, period_of
from stickslip_ros.solver.layout import ROW_SIZE, axis_in, plant_in

#: What is kept of each sample: x (m), v (m/s), z (m), u' (m/s), u (m)
SAMPLE_SIZE = 5
_NO_LIMIT = np.iinfo(np.int64).max


@compiled
def sample(
    plant: NDArray, axis: NDArray, drive: NDArray, times: NDArray, samples: NDArray, first: int
) -> int:
    """Advance to each of the times (s), rising; fill samples (SAMPLE_SIZE, times) from first on.

    Returns how many are filled in all: not all if the allowance of arcs ran out.
    """
    s, p = axis_in(axis), plant_in(plant)
    rows = np.empty((0, ROW_SIZE))
    period = period_of(drive)
    looking = False  # within a cycle that repeats the one before: the look into it goes on
    for k in range(first, len(times)):
        if looking and (times[k] - s.start) - s.done * period < period:
            s.t_end = times[k]
            look_into(p, axis, drive, False)
        else:
            advance(plant, axis, drive, times[k], _NO_LIMIT, rows)
            looking = s.steady != 0 and s.done < s.count
        if s.unfinished:
            return k
        samples[0, k], samples[1, k], samples[2, k] = s.now_x, s.now_v, s.now_z
        samples[3, k], samples[4, k] = s.now_rate, s.now_u
    return len(times)


@compiled
def friction_forces(z: NDArray, w: NDArray, contact: Contact) -> NDArray:
    """Return F (N) of Eq. 1 at deflections z (m) and differential velocities w (m/s), (times,)."""
    force = np.empty(len(z))
    for k in range(len(z)):
        force[k] = friction_force(z[k], w[k], contact)
    return force
