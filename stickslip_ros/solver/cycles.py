# SPDX-License-Identifier: Apache-2.0
"""The end of a drive cycle: limits of the next arc, results of the cycle, repetition of cycles."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled

#: Largest difference at the start of two equal cycles, as share of the tolerance
REPEATED = 1e-3


class ArcLimits(NamedTuple):
    """Limits of the next arc."""

    resting: bool  #: the drive cycle is over
    limit: float  #: s until the next kink, or until t_end where that is an event
    ahead: float  #: s until t_end
    last: bool  #: t_end is an event and comes before the next kink


@compiled
def arc_limits(s: np.record, drive: NDArray, period: float) -> ArcLimits:
    """Set s.rate and s.bend and return the limits of the next arc."""
    resting = s.done >= s.count
    s.bend = 0.0 if resting else drive[2, s.segment]
    if resting:
        s.rate = 0.0
    elif s.bend == 0.0 or s.tau == 0.0:  # else it has got there: w = 0 at a turn has to stay exact
        s.rate = drive[1, s.segment]
    limit = math.inf if resting else drive[0, s.segment] - s.tau
    ahead = (s.t_end - s.start) - s.done * period - s.since - s.tau
    last = s.cut != 0 and ahead < limit
    return ArcLimits(resting, ahead if last and ahead > 0.0 else limit, ahead, last)


@compiled
def end_cycle(s: np.record, plant: np.record, contacts: NDArray | None) -> None:
    """Let the running cycle end at the anchor, and the next begin."""
    done = s.done + 1
    s.done, s.steady = done, 0
    s.level += s.shift
    close, step = REPEATED * plant.tolerance, s.x - s.cycle_x
    if (
        s.replay != 0
        and done > 1
        and abs(s.z - s.cycle_z) <= close
        and abs(s.v - s.cycle_v) * plant.inv_omega <= close
        and abs(step - s.last_step) <= close
        and (plant.spring == 0.0 or abs(step) <= close)
    ):  # it ended in the state in which it began, one step further
        s.steady = 1
    s.last_step, s.last_dissipated = step, s.dissipated
    s.last_z_max, s.last_z_min = s.z_max, s.z_min
    s.cycle_x, s.cycle_v, s.cycle_z = s.x, s.v, s.z
    s.z_max = s.z_min = s.z
    s.last_x_min, s.last_x_max = s.x_min, s.x_max
    s.x_min = s.x_max = s.x
    s.dissipated = 0.0
    if contacts is not None:  # it repeats only if every contact ends it as it began
        for c in contacts:
            if not abs(c.z - c.cycle_z) <= close:
                s.steady = 0
            if not abs(c.second - c.cycle_second) <= REPEATED * abs(c.second):
                s.steady = 0
            c.cycle_z, c.cycle_second = c.z, c.second


@compiled
def stays_clear(s: np.record) -> bool:
    """Return whether a repetition of the last cycle would reach no stop."""
    low, high = s.last_x_min + s.last_step, s.last_x_max + s.last_step
    return low >= s.near_low and high <= s.near_high  # type: ignore[no-any-return]


@compiled
def repeat(s: np.record) -> None:
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


@compiled
def write_row(s: np.record, rows: NDArray, at: int) -> None:
    """Write the last whole cycle, as `simulation.CycleResults` names it, if there is a row left."""
    if at < len(rows):
        row = rows[at]
        row[0], row[1] = s.x, s.backstep
        row[2], row[3], row[4] = s.last_z_max, s.last_z_min, s.last_dissipated


@compiled
def period_of(drive: NDArray) -> float:
    """Return the duration of a cycle (s), as `DriveCycle.period` sums it up."""
    period = 0.0
    for duration in drive[0]:
        period += duration
    return period
