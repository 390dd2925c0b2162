# SPDX-License-Identifier: Apache-2.0
"""A simulation looked at many times: the loop over the times is compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled, compiled_anew
from stickslip_ros.model.friction import Contact, friction_force
from stickslip_ros.solver.cycles import period_of
from stickslip_ros.solver.integrator import advance, look_into
from stickslip_ros.solver.layout import ROW_SIZE, axis_in

#: What is kept of each sample: x (m), v (m/s), z (m), u' (m/s), u (m)
SAMPLE_SIZE = 5
_NO_LIMIT = np.iinfo(np.int64).max


def sampling(
    advance: Callable[..., int],
    look_into: Callable[..., None],
    keep: Callable[[NDArray, NDArray, NDArray], None],
) -> Callable[[NDArray, NDArray, NDArray, NDArray, NDArray, int], int]:
    """Return the compiled function that does what `sample` says, by what `cycles` makes.

    keep(plant, axis, sample) fills one sample, from the state at the time asked for.
    """

    def sample(plant: Any, axis: Any, drive: Any, times: Any, samples: Any, first: int) -> int:
        s = axis_in(axis)
        rows = np.empty((0, ROW_SIZE))
        period = period_of(drive)
        looking = False  # within a cycle that repeats the one before: the look into it goes on
        for k in range(first, len(times)):
            if looking and (times[k] - s.start) - s.done * period < period:
                s.t_end = times[k]
                look_into(plant, axis, drive, False)
            else:
                advance(plant, axis, drive, times[k], _NO_LIMIT, rows)
                looking = s.steady != 0 and s.done < s.count
            if s.unfinished:
                return k
            keep(plant, axis, samples[:, k])
        return len(times)

    return compiled_anew(sample)


@compiled
def keep_motion(axis: NDArray, sample: NDArray) -> None:
    """Fill what is kept of a sample, however many contacts there are."""
    s = axis_in(axis)
    sample[0], sample[1], sample[2] = s.now_x, s.now_v, s.now_z
    sample[3], sample[4] = s.now_rate, s.now_u


@compiled
def _keep(_plant: NDArray, axis: NDArray, sample: NDArray) -> None:
    keep_motion(axis, sample)


_sample = sampling(advance, look_into, _keep)


@compiled
def sample(
    plant: NDArray, axis: NDArray, drive: NDArray, times: NDArray, samples: NDArray, first: int
) -> int:
    """Advance to each of the times (s), rising; fill samples (SAMPLE_SIZE, times) from first on.

    Returns how many are filled in all: not all if the allowance of arcs ran out.
    """
    return _sample(plant, axis, drive, times, samples, first)


@compiled
def friction_forces(z: NDArray, w: NDArray, contact: Contact) -> NDArray:
    """Return F (N) of Eq. 1 at deflections z (m) and differential velocities w (m/s), (times,)."""
    force = np.empty(len(z))
    for k in range(len(z)):
        force[k] = friction_force(z[k], w[k], contact)
    return force
