# SPDX-License-Identifier: Apache-2.0
"""What a cycle leaves behind when it ends, and the next ones taken from it unsolved."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled

#: Share of the tolerance by which two cycles that count as the same may begin apart
_REPEATED = 1e-3


@compiled
def end_cycle(s: np.record, plant: np.record) -> None:
    """Let the running cycle end at the anchor, and the next begin."""
    done = s.done + 1
    s.done, s.steady = done, 0
    s.level += s.shift
    if s.replay != 0 and done > 1 and _repeats(s, plant):
        s.steady = 1
    s.last_step, s.last_dissipated = s.x - s.cycle_x, s.dissipated
    s.last_z_max, s.last_z_min = s.z_max, s.z_min
    s.cycle_x, s.cycle_v, s.cycle_z = s.x, s.v, s.z
    s.z_max = s.z_min = s.z
    s.last_x_min, s.last_x_max = s.x_min, s.x_max
    s.x_min = s.x_max = s.x
    s.dissipated = 0.0


@compiled
def _repeats(s: np.record, plant: np.record) -> bool:
    """Return whether the cycle that has just ended left all as it began, one step further on."""
    close = _REPEATED * plant.tolerance
    step = s.x - s.cycle_x
    return (  # type: ignore[no-any-return]
        abs(s.z - s.cycle_z) <= close
        and abs(s.v - s.cycle_v) * plant.inv_omega <= close
        and abs(step - s.last_step) <= close
        and (plant.spring == 0.0 or abs(step) <= close)
    )


@compiled
def keeps_away(s: np.record) -> bool:
    """Return whether the next cycle gets to no stop when it repeats the last one."""
    low, high = s.last_x_min + s.last_step, s.last_x_max + s.last_step
    return low >= s.near_low and high <= s.near_high  # type: ignore[no-any-return]


@compiled
def repeat(s: np.record, rows: NDArray) -> None:
    """End one more cycle just as the last one ended, one step further on."""
    step = s.last_step
    s.cycle_x = s.x + step
    s.x = s.cycle_x
    s.open_x = s.x
    s.x_min = s.x_max = s.x
    s.last_x_min += step
    s.last_x_max += step
    s.x_top += s.sign * step
    s.x_low += s.sign * step
    s.done += 1
    if len(rows):
        write_row(s, rows[0])


@compiled
def write_row(s: np.record, row: NDArray) -> None:
    """Write the last whole cycle into a row as `layout.CYCLE_ROW` names it."""
    row[0], row[1] = s.x, s.backstep
    row[2], row[3], row[4] = s.last_z_max, s.last_z_min, s.last_dissipated
