# SPDX-License-Identifier: Apache-2.0
"""What a cycle leaves behind when it ends, and the next ones taken from it unsolved.

One contact and several each have a function of their own that solves cycles. What is made of it,
`advancing` and `looking`, is compiled for each, as `roots` does with its functions.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled, compiled_anew
from stickslip_ros.solver.layout import ROW_SIZE, axis_in, copied_axis, last_copy

#: Share of the tolerance by which two cycles that count as the same may begin apart
REPEATED = 1e-3

#: Solves cycles (plant, state to advance, axis, drive, rows); returns how many ended
Run = Callable[[NDArray, np.record, NDArray, NDArray, NDArray], int]


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
    close = REPEATED * plant.tolerance
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


@compiled
def period_of(drive: NDArray) -> float:
    """Return the duration of a cycle (s), as `DriveCycle.period` sums it up."""
    period = 0.0
    for duration in drive[0]:
        period += duration
    return period


def looking(run: Run) -> Callable[[NDArray, NDArray, NDArray, bool], None]:
    """Return the compiled function (plant, axis, drive, afresh) that looks into a cycle at t_end.

    The cycle repeats the one before, and the next will begin as this one did. afresh: from its
    start; else from where the last look into it, not later, ended.
    """

    def look_into(plant: Any, axis: Any, drive: Any, afresh: bool) -> None:
        s = axis_in(axis)
        look = copied_axis(axis) if afresh else last_copy(axis)
        look.t_end, look.stop_cycle = s.t_end, s.done + 1
        look.spent, look.unfinished = s.spent, 0
        run(plant, look, axis, drive, np.empty((0, ROW_SIZE)))
        s.now_tau, s.now_x, s.now_v, s.now_z = look.now_tau, look.now_x, look.now_v, look.now_z
        s.now_rate, s.now_u = look.now_rate, look.now_u
        s.now_segment, s.now_tracking = look.now_segment, look.now_tracking
        s.spent, s.unfinished = look.spent, look.unfinished

    return compiled_anew(look_into)


def advancing(
    run: Run, look_into: Callable[[NDArray, NDArray, NDArray, bool], None]
) -> Callable[[NDArray, NDArray, NDArray, float, int, NDArray], int]:
    """Return the compiled function that does what `integrator.advance` says."""

    def advance(plant: Any, axis: Any, drive: Any, t_end: float, stop_cycle: int, rows: Any) -> int:
        s = axis_in(axis)
        s.t_end, s.stop_cycle, s.unfinished = t_end, stop_cycle, 0
        if s.cut or not s.replay:
            return run(plant, s, axis, drive, rows)
        period = period_of(drive)
        ended = 0
        while s.done < min(s.count, stop_cycle):
            if s.steady and not keeps_away(s):
                s.steady = 0
            if s.steady:
                if (t_end - s.start) - s.done * period < period:
                    look_into(plant, axis, drive, True)
                    return ended
                if s.spent >= s.allowance:
                    s.unfinished = 1
                    return ended
                s.spent += 1
                repeat(s, rows[ended : ended + 1])
                ended += 1
                continue
            s.stop_cycle = s.done + 1
            if not run(plant, s, axis, drive, rows[ended : ended + 1]):
                return ended
            ended += 1
        s.stop_cycle = stop_cycle
        return ended + run(plant, s, axis, drive, rows[ended:])

    return compiled_anew(advance)
