# SPDX-License-Identifier: Apache-2.0
"""Advances one axis: from event to event, restarting at every kink of u(t).

The state is kept at the last event, the anchor. Asking for a time between two events evaluates
the arc there and leaves the anchor alone, so how often a run is sampled never changes its path.
Time counts from the start of the cycle, so a cycle that starts in the same state is the same to
the last bit whenever it happens.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled
from stickslip_ros.solver import state as st
from stickslip_ros.solver.arc import (
    contact_part,
    next_arc,
    position_integral,
    sliding_deflection,
    turning_point,
    within_arc,
)
from stickslip_ros.solver.cycles import end_cycle, keeps_away, repeat, write_row
from stickslip_ros.solver.oscillator import swing_rate
from stickslip_ros.solver.stops import arc_to_stop, held_arc, held_heat, holding, unmoved

#: So many arcs without a length, and the solver gives up
_STALLED = 1000
#: A hit so soon after the event before, in units of the ringing, leaves no time for a motion
_AT_ONCE = 1e-6


@compiled
def prepare(coefficients: NDArray, tolerance: float) -> NDArray:
    """Return shape (PLANT_SIZE,): `Plant.coefficients` with what the kernel derives from them.

    tolerance is the error in position (m) allowed per cycle.
    """
    plant = np.empty(st.PLANT_SIZE)
    plant[: len(coefficients)] = coefficients
    plant[st.TOLERANCE] = tolerance
    plant[st.Z_SLIDE] = sliding_deflection(contact_part(plant))
    plant[st.KAPPA] = (plant[0] + plant[st.SPRING]) / plant[st.MASS]
    plant[st.DELTA] = 0.5 * (plant[1] + plant[2]) / plant[st.MASS]
    plant[st.OMEGA] = swing_rate(plant[st.DELTA], plant[st.KAPPA])
    plant[st.MEMORY] = 1.0 / math.sqrt(plant[st.KAPPA])
    plant[st.KNOWN] = 0.0
    return plant


@compiled
def at_rest(s: NDArray, n: NDArray) -> None:
    """Set the state to that of an axis that never moved."""
    s[:] = 0.0
    n[:] = 0
    s[st.BACKSTEP] = s[st.LAST_STEP] = s[st.LAST_LOST] = math.nan
    s[st.LOW] = s[st.NEAR_LOW] = -math.inf
    s[st.HIGH] = s[st.NEAR_HIGH] = math.inf
    n[st.REPLAY] = 1


@compiled
def begin(
    s: NDArray,
    n: NDArray,
    t: float,
    count: int,
    slip: int,
    slip_end: int,
    sign: int,
    shift: float,
) -> None:
    """Start a pattern of count cycles at time t (s), from the state asked for last.

    The slip takes the segments from slip up to, not including, slip_end; shift is what u gains over
    a cycle (m).
    """
    s[st.START] = t
    s[st.LEVEL], s[st.SHIFT] = s[st.NOW_U], shift
    s[st.TAU] = 0.0
    s[st.X], s[st.V], s[st.Z] = s[st.NOW_X], s[st.NOW_V], s[st.NOW_Z]
    _open_account(s, 0.0, s[st.X], s[st.V], s[st.Z])
    s[st.Z_MAX] = s[st.Z_MIN] = s[st.Z]
    s[st.LOST] = 0.0
    s[st.CYCLE_X], s[st.CYCLE_V], s[st.CYCLE_Z] = s[st.X], s[st.V], s[st.Z]
    s[st.X_MIN] = s[st.X_MAX] = s[st.X]
    n[st.TRACKING] = n[st.NOW_TRACKING] = n[st.NOW_SEGMENT] = 0
    n[st.COUNT], n[st.DONE], n[st.SEGMENT], n[st.STEADY] = count, 0, 0, 0
    n[st.SLIP], n[st.SLIP_END], n[st.SIGN] = slip, slip_end, sign


@compiled
def anchor(
    plant: NDArray,
    durations: NDArray,
    rates: NDArray,
    t: float,
    s: NDArray,
    n: NDArray,
    arc: NDArray,
    work: NDArray,
) -> None:
    """Make the time advanced to last, t (s), an event: from there on the plant may be another.

    The state asked for last stays as it is, to the last bit; extremes, backstep and the account of
    energy are brought up to it.
    """
    x, v, z = s[st.NOW_X], s[st.NOW_V], s[st.NOW_Z]
    rows = np.empty((0, st.ROW_SIZE))
    _run(plant, durations, rates, t, n[st.DONE] + 2, s, n, rows, arc, work, True)
    n[st.STEADY] = 0
    s[st.CYCLE_Z] = math.nan  # a cycle under two plants is like none
    s[st.X], s[st.V], s[st.Z] = s[st.NOW_X], s[st.NOW_V], s[st.NOW_Z] = x, v, z
    rate = s[st.NOW_RATE]
    s[st.LOST] += _lost(s, plant, x, v, z, rate, s[st.TAU] - s[st.SEG_TAU])
    _open_account(s, s[st.TAU], x, v, z)


@compiled
def _open_account(s: NDArray, tau: float, x: float, v: float, z: float) -> None:
    """Let what `_lost` accounts for begin at tau (s) after the start of the segment."""
    s[st.SEG_TAU], s[st.SEG_X], s[st.SEG_V], s[st.SEG_Z] = tau, x, v, z
    s[st.IMPULSE] = 0.0


@compiled
def period_of(durations: NDArray) -> float:
    """Return the duration of a cycle (s), as `Pattern.period` sums it up."""
    period = 0.0
    for duration in durations:
        period += duration
    return period


@compiled
def advance(
    plant: NDArray,
    durations: NDArray,
    rates: NDArray,
    t_end: float,
    stop_cycle: int,
    s: NDArray,
    n: NDArray,
    rows: NDArray,
    arc: NDArray,
    work: NDArray,
) -> int:
    """Advance to t_end (s) or to the end of cycle stop_cycle, whichever comes first.

    plant as `prepare` makes it; durations (s) and rates (m/s) of one cycle; s, n the state; rows
    (cycles, ROW_SIZE) take the results of the cycles that end, further ones are dropped; arc
    (ARC_SIZE,) and work (ROWS, ORDER + 1) are scratch. Returns the number of cycles that ended.

    With n[REPLAY], a cycle that begins as the one before did is not solved again.
    """
    if not n[st.REPLAY]:
        return _run(plant, durations, rates, t_end, stop_cycle, s, n, rows, arc, work, False)
    period = period_of(durations)
    ended = 0
    while n[st.DONE] < min(n[st.COUNT], stop_cycle):
        if n[st.STEADY] and not keeps_away(s):
            n[st.STEADY] = 0
        if n[st.STEADY]:
            if (t_end - s[st.START]) - n[st.DONE] * period < period:
                # a look into the cycle; the next one will begin as this one did
                s_look, n_look = s.copy(), n.copy()
                _run(
                    plant,
                    durations,
                    rates,
                    t_end,
                    stop_cycle,
                    s_look,
                    n_look,
                    rows,
                    arc,
                    work,
                    False,
                )
                for k in range(st.NOW_TAU, st.STATE_SIZE):
                    s[k] = s_look[k]
                n[st.NOW_SEGMENT] = n_look[st.NOW_SEGMENT]
                n[st.NOW_TRACKING] = n_look[st.NOW_TRACKING]
                return ended
            repeat(s, n, rows[ended : ended + 1])
            ended += 1
            continue
        row, next_stop = rows[ended : ended + 1], n[st.DONE] + 1
        if not _run(plant, durations, rates, t_end, next_stop, s, n, row, arc, work, False):
            return ended
        ended += 1
    left = rows[ended:]
    return ended + _run(plant, durations, rates, t_end, stop_cycle, s, n, left, arc, work, False)


@compiled
def _run(
    plant: NDArray,
    durations: NDArray,
    rates: NDArray,
    t_end: float,
    stop_cycle: int,
    s: NDArray,
    n: NDArray,
    rows: NDArray,
    arc: NDArray,
    work: NDArray,
    cut: bool,
) -> int:
    """Do what `advance` says, solving every cycle; with cut, t_end becomes an event itself."""
    period = period_of(durations)
    count, done, segment = n[st.COUNT], n[st.DONE], n[st.SEGMENT]
    tau, x, v, z = s[st.TAU], s[st.X], s[st.V], s[st.Z]
    since = 0.0  # the running segment began this long after its cycle
    for k in range(segment):
        since += durations[k]
    sign = float(n[st.SIGN])
    near_low, near_high = s[st.NEAR_LOW], s[st.NEAR_HIGH]
    ended, stalled = 0, 0
    while True:
        resting = done >= count
        rate = 0.0 if resting else rates[segment]
        if done >= stop_cycle and segment == 0 and tau == 0.0:
            now = x, v, z, rate, tau
            _sample(s, n, durations, rates, segment, n[st.TRACKING], now)
            break
        limit = math.inf if resting else durations[segment] - tau
        ahead = (t_end - s[st.START]) - done * period - since - tau
        last = cut and ahead < limit
        if last and not ahead > 0.0:
            _sample(s, n, durations, rates, segment, n[st.TRACKING], (x, v, z, rate, tau))
            break
        if last:
            limit = ahead
        near, hit = not near_low <= x <= near_high, 0
        if near:
            n[st.STOPPED] = holding(plant, s, x, v, z, rate, n[st.STOPPED])
        if n[st.STOPPED] != 0:
            if n[st.TRACKING] and (segment != n[st.SLIP] or resting):
                s[st.BACKSTEP] = s[st.X_TOP] - s[st.X_LOW]
                n[st.TRACKING] = 0
            h = held_arc(arc, work, plant, unmoved(plant), x, z, rate, n[st.STOPPED], limit)
            x1 = x
        else:
            h = next_arc(arc, work, plant, x, z, v - rate, rate, limit, True)
            x1 = x + arc[st.PATH] + rate * h
            if near or not near_low <= x1 <= near_high:
                h, hit = arc_to_stop(arc, work, plant, s, x, z, v - rate, rate)
                x1 = min(max(x + arc[st.PATH] + rate * h, s[st.LOW]), s[st.HIGH])
        stalled = stalled + 1 if not h > (_AT_ONCE * plant[st.MEMORY] if hit != 0 else 0.0) else 0
        if stalled > _STALLED or not math.isfinite(x):  # `Simulation` refuses to go on
            _sample(s, n, durations, rates, segment, 0, (math.nan, v, z, rate, tau))
            break
        if h > ahead or h == math.inf:
            tracking = n[st.TRACKING]
            if tracking and resting:  # at rest the last arc never ends
                t, gone = turning_point(arc, work, plant, sign)
                if t <= ahead:
                    s[st.BACKSTEP] = s[st.X_TOP] - min(s[st.X_LOW], sign * (x + gone))
                    tracking = 0
            if 0.0 < ahead < math.inf:
                # chosen here only: passing arrays from name to name costs as much as an arc
                moving = plant if n[st.STOPPED] == 0 else unmoved(plant)
                x1, z1, w1 = _look(arc, work, moving, x, z, v - rate, rate, limit, ahead)
                x1 = x if n[st.STOPPED] != 0 else min(max(x1, s[st.LOW]), s[st.HIGH])
                now = x1, w1 + rate, z1, rate, tau + ahead
            else:
                now = x, v, z, rate, tau
            _sample(s, n, durations, rates, segment, tracking, now)
            break
        if segment == n[st.SLIP] and tau == 0.0 and not resting:
            if n[st.TRACKING]:
                s[st.BACKSTEP] = s[st.X_TOP] - s[st.X_LOW]
            n[st.TRACKING] = 1
            s[st.X_TOP] = s[st.X_LOW] = sign * x
        z1 = arc[st.Z_END]
        v1 = arc[st.W_END] + rate
        if n[st.TRACKING]:
            if segment != n[st.SLIP] or resting:
                t, gone = turning_point(arc, work, plant, sign)
                if t == t:
                    s[st.X_LOW] = min(s[st.X_LOW], sign * (x + gone))
                    if resting or not n[st.SLIP] < segment < n[st.SLIP_END]:
                        s[st.BACKSTEP] = s[st.X_TOP] - s[st.X_LOW]
                        n[st.TRACKING] = 0
            s[st.X_LOW] = min(s[st.X_LOW], sign * x1)
        s[st.Z_MAX] = max(s[st.Z_MAX], z1, arc[st.PEAK_MAX])
        s[st.Z_MIN] = min(s[st.Z_MIN], z1, arc[st.PEAK_MIN])
        s[st.X_MIN], s[st.X_MAX] = min(s[st.X_MIN], x1), max(s[st.X_MAX], x1)
        if n[st.STOPPED] != 0:
            s[st.LOST] += held_heat(arc, work, plant)
            _open_account(s, tau + h, x1, v1, z1)
        elif plant[st.SPRING] != 0.0:
            s[st.IMPULSE] += position_integral(arc, work, plant) * plant[st.SPRING]
        if hit != 0:  # what is left of its motion goes into the stop
            x1 = s[st.LOW] if hit < 0 else s[st.HIGH]
            s[st.LOST] += _lost(s, plant, x1, v1, z1, rate, tau + h - s[st.SEG_TAU])
            v1 = 0.0
            _open_account(s, tau + h, x1, v1, z1)
            n[st.STOPPED], n[st.HITS] = hit, n[st.HITS] + 1
        tau, x, v, z = tau + h, x1, v1, z1
        if h < limit:
            continue
        if last:
            _sample(s, n, durations, rates, segment, n[st.TRACKING], (x, v, z, rate, tau))
            break
        # -- a kink: the rate changes
        s[st.LOST] += _lost(s, plant, x, v, z, rate, durations[segment] - s[st.SEG_TAU])
        _open_account(s, 0.0, x, v, z)
        since += durations[segment]
        tau = 0.0
        segment += 1
        if segment == len(durations):
            since, segment = 0.0, 0
            done += 1
            end_cycle(s, n, plant, done, x, v, z)
            if ended < len(rows):
                write_row(s, rows[ended])
            ended += 1
    n[st.DONE], n[st.SEGMENT] = done, segment
    s[st.TAU], s[st.X], s[st.V], s[st.Z] = tau, x, v, z
    return ended


@compiled
def _look(
    arc: NDArray,
    work: NDArray,
    plant: NDArray,
    x: float,
    z: float,
    w: float,
    rate: float,
    limit: float,
    ahead: float,
) -> tuple[float, float, float]:
    """Return x, z, w at ``ahead`` (s) after x, z (m), w (m/s), within the present arc."""
    h = arc[st.LENGTH]
    if arc[st.KIND] == st.KNOWN_AHEAD:  # there is nothing within: go through it arc by arc
        h = next_arc(arc, work, plant, x, z, w, rate, limit, False)
        while h <= ahead:
            x, z, w = x + arc[st.PATH] + rate * h, arc[st.Z_END], arc[st.W_END]
            ahead -= h
            limit -= h
            h = next_arc(arc, work, plant, x, z, w, rate, limit, False)
    gone, z1, w1 = within_arc(arc, work, plant, ahead)
    return x + gone + rate * ahead, z1, w1


@compiled
def _sample(
    s: NDArray,
    n: NDArray,
    durations: NDArray,
    rates: NDArray,
    segment: int,
    tracking: int,
    now: tuple[float, float, float, float, float],
) -> None:
    """Keep what was asked for: now is x, v, z, u' and the time (s) into the segment."""
    n[st.NOW_SEGMENT], n[st.NOW_TRACKING] = segment, tracking
    x, v, z, rate, tau = now
    s[st.NOW_TAU], s[st.NOW_U] = tau, rate * tau
    for k in range(segment):
        s[st.NOW_TAU] += durations[k]
        s[st.NOW_U] += durations[k] * rates[k]
    s[st.NOW_U] += s[st.LEVEL]
    s[st.NOW_X], s[st.NOW_V], s[st.NOW_Z], s[st.NOW_RATE] = x, v, z, rate


@compiled
def _lost(
    s: NDArray, plant: NDArray, x: float, v: float, z: float, rate: float, duration: float
) -> float:
    """Return the energy (J) turned into heat by the contact since its account was opened.

    Work F w of both bodies on the contact less what its springs hold. Momentum and energy of the
    runner give it from the ends alone: F dt = -m dv + (F_ext - k x) dt, over duration (s).
    """
    mass, force, spring = plant[st.MASS], plant[st.FORCE], plant[st.SPRING]
    x0, v0, z0 = s[st.SEG_X], s[st.SEG_V], s[st.SEG_Z]
    on_runner = 0.5 * mass * (v0 * v0 - v * v) + force * (x - x0) + 0.5 * spring * (x0 * x0 - x * x)
    impulse = mass * (v0 - v) + force * duration - s[st.IMPULSE]
    stored = 0.5 * plant[0] * (z * z - z0 * z0)
    return on_runner - rate * impulse - stored
