# SPDX-License-Identifier: Apache-2.0
"""The calls of the kernel from Python: advance, and advance to many times.

``contacts`` is None for a runner on one contact, else the buffer that `layout.contacts_in` opens.
A call returns with ``unfinished`` set where the allowance of arcs ran out first; call it again to
go on.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled
from stickslip_ros.solver.cycles import keeps_away, period_of, repeat, write_row
from stickslip_ros.solver.event_loop import heat_since, open_account, solve_cycles
from stickslip_ros.solver.layout import (
    ROW_SIZE,
    arc_in,
    axis_in,
    contacts_in,
    copy_for_preview,
    held_in,
    plant_in,
    preview_in,
    several_in,
)
from stickslip_ros.solver.within_arc import turns_within

#: What is kept of each sample: x (m), v (m/s), z (m), u' (m/s), u (m); then of each of several
#: contacts z (m), and of each the second state
SAMPLE_SIZE = 5
#: Times that the events of one arc may take
_LEAST_ROOM = 64
#: More cycles than any run has
ENDLESS = np.iinfo(np.int64).max


@compiled
def advance(
    plant: NDArray, axis: NDArray, contacts: NDArray | None, drive: NDArray, rows: NDArray
) -> int:
    """Advance to t_end (s) or to the end of cycle stop_cycle of the state, whichever comes first.

    rows (cycles, row) take the results of the cycles that end, further ones are dropped. Returns
    the number of cycles that ended.

    With ``replay``, a cycle that begins as the one before did is not solved again. With ``cut``,
    t_end becomes an event, to be finished by `anchor`.
    """
    s, each = axis_in(axis), contacts_in(contacts, False)
    s.unfinished = 0
    if s.cut or not s.replay:
        return solve_cycles(plant, s, axis, each, drive, rows)
    stop_cycle, period = s.stop_cycle, period_of(drive)
    ended = 0
    while s.done < min(s.count, stop_cycle):
        if s.steady and not keeps_away(s):
            s.steady = 0
        if s.steady:
            if (s.t_end - s.start) - s.done * period < period:
                if not s.previewing:
                    copy_for_preview(axis, contacts)
                _preview(plant, axis, contacts, drive)
                return ended
            if s.spent >= s.allowance:
                s.unfinished = 1
                return ended
            s.spent += 1
            repeat(s)
            write_row(s, rows, ended)
            ended += 1
            continue
        s.stop_cycle = s.done + 1
        if not solve_cycles(plant, s, axis, each, drive, rows[ended:]):
            return ended
        ended += 1
    s.stop_cycle = stop_cycle
    return ended + solve_cycles(plant, s, axis, each, drive, rows[ended:])


@compiled
def _preview(plant: NDArray, axis: NDArray, contacts: NDArray | None, drive: NDArray) -> None:
    """Find the state at t_end within a cycle that repeats the one before, on a copy.

    The next cycle will begin as this one did. The copy begins where `copy_for_preview` or the last
    preview of the cycle, for a time that is not later, has left it.
    """
    s, copy = axis_in(axis), preview_in(axis)
    copy.t_end, copy.stop_cycle = s.t_end, s.done + 1
    copy.spent, copy.unfinished = s.spent, 0
    ahead, rows = contacts_in(contacts, True), np.empty((0, ROW_SIZE))
    solve_cycles(plant, copy, axis, ahead, drive, rows)
    s.now_tau, s.now_x, s.now_v, s.now_z = copy.now_tau, copy.now_x, copy.now_v, copy.now_z
    s.now_rate, s.now_u = copy.now_rate, copy.now_u
    s.now_segment, s.now_tracking = copy.now_segment, copy.now_tracking
    s.spent, s.unfinished, s.previewing = copy.spent, copy.unfinished, copy.unfinished
    if contacts is not None:
        _take_preview(several_in(contacts, False), several_in(contacts, True))


@compiled
def _take_preview(each: NDArray, ahead: NDArray) -> None:
    """Take the states of contacts at the time asked for from those of a preview."""
    for i in range(len(each)):
        each[i].now_z = ahead[i].now_z
        for k in range(len(each[i].inner)):
            each[i].now_inner[k] = ahead[i].now_inner[k]


@compiled
def sample(
    plant: NDArray,
    axis: NDArray,
    contacts: NDArray | None,
    drive: NDArray,
    times: NDArray,
    samples: NDArray,
) -> int:
    """Advance to each of the times (s), rising; fill samples (times, SAMPLE_SIZE or more).

    Returns how many are filled: not all if the allowance of arcs ran out.
    """
    s = axis_in(axis)
    rows = np.empty((0, ROW_SIZE))
    period = period_of(drive)
    previewing = False  # within a cycle that repeats the one before: its preview goes on
    for k in range(len(times)):
        s.t_end, s.stop_cycle = times[k], ENDLESS
        if previewing and (times[k] - s.start) - s.done * period < period:
            _preview(plant, axis, contacts, drive)
        else:
            advance(plant, axis, contacts, drive, rows)
            previewing = s.steady != 0 and s.done < s.count
        if s.unfinished:
            return k
        kept = samples[k]
        kept[0], kept[1], kept[2] = s.now_x, s.now_v, s.now_z
        kept[3], kept[4] = s.now_rate, s.now_u
        if contacts is not None:
            _keep_deflections(several_in(contacts, False), kept)
    return len(times)


@compiled
def _keep_deflections(contacts: NDArray, kept: NDArray) -> None:
    """Keep deflections and second states of the contacts behind what is kept of a sample."""
    for i in range(len(contacts)):
        kept[SAMPLE_SIZE + i] = contacts[i].now_z
        kept[SAMPLE_SIZE + len(contacts) + i] = contacts[i].now_inner[0]


@compiled
def find_events(
    plant: NDArray, axis: NDArray, contacts: NDArray | None, drive: NDArray, times: NDArray
) -> int:
    """Advance as `advance` does, arc by arc; write when (s) they end and what turns within them.

    Returns how many times are written; unfinished where there is no more room. Nothing is tabulated
    on this way, so that nothing is passed over.
    """
    s, each, arc = axis_in(axis), contacts_in(contacts, False), arc_in(axis)
    period, rows, found = period_of(drive), np.empty((0, ROW_SIZE)), 0
    plant_in(plant).precomputed = -1
    while True:
        if found > len(times) - _LEAST_ROOM:
            s.unfinished = 1
            return found
        begun = s.start + s.done * period + s.since + s.tau
        s.spent, s.allowance, s.unfinished = 0, 1, 0
        solve_cycles(plant, s, axis, each, drive, rows)
        h = min(arc.length, s.t_end - begun)
        moving = held_in(axis) if s.stopped != 0 else plant_in(plant)
        if s.spent > 0 and 0.0 < h < math.inf:
            turns = turns_within(arc, moving, h, times[found:-1])
            times[found : found + turns] += begun
            found += turns
        if not s.unfinished:
            return found
        times[found] = begun + arc.length
        found += 1


@compiled
def anchor(plant: NDArray, axis: NDArray, x: float, v: float, z: float) -> None:
    """Make the time that `advance` has cut an event: from there on the plant may be another.

    x (m), v (m/s), z (m) is the state asked for last. It stays as it is, to the last bit; extremes,
    backstep and the account of energy have been brought up to it.
    """
    s, p = axis_in(axis), plant_in(plant)
    s.cut, s.steady = 0, 0
    s.cycle_z = math.nan  # a cycle under two plants is like none
    s.x, s.v, s.z = s.now_x, s.now_v, s.now_z = x, v, z
    s.rate = s.now_rate
    s.dissipated += heat_since(s, p, s.tau - s.open_tau)
    open_account(s)
