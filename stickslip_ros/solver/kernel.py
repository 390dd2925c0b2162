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
    arc_end,
    contact_part,
    next_arc,
    position_integral,
    sliding_deflection,
    standstill,
    within_arc,
)


@compiled
def prepare(coefficients: NDArray, tolerance: float) -> NDArray:
    """Return shape (PLANT_SIZE,): `Plant.coefficients` with what the kernel derives from them.

    tolerance is the error in position (m) allowed per cycle.
    """
    plant = np.empty(st.PLANT_SIZE)
    plant[: len(coefficients)] = coefficients
    plant[st.TOLERANCE] = tolerance
    plant[st.Z_SLIDE] = sliding_deflection(contact_part(plant))
    plant[st.MEMORY] = math.sqrt(plant[st.MASS] / (plant[0] + plant[st.SPRING]))
    return plant


@compiled
def begin(s: NDArray, n: NDArray, t: float, count: int, slip: int, sign: int) -> None:
    """Start a pattern of count cycles at time t (s), from the state asked for last."""
    s[st.START] = t
    s[st.TAU] = 0.0
    s[st.X], s[st.V], s[st.Z] = s[st.NOW_X], s[st.NOW_V], s[st.NOW_Z]
    s[st.SEG_X], s[st.SEG_V], s[st.SEG_Z] = s[st.X], s[st.V], s[st.Z]
    s[st.IMPULSE] = 0.0
    s[st.Z_MAX] = s[st.Z_MIN] = s[st.Z]
    s[st.LOST] = 0.0
    s[st.CYCLE_X] = s[st.X]
    n[st.COUNT], n[st.DONE], n[st.SEGMENT] = count, 0, 0
    n[st.SLIP], n[st.SIGN] = slip, sign


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
    """
    period = 0.0
    for duration in durations:
        period += duration
    count, done, segment = n[st.COUNT], n[st.DONE], n[st.SEGMENT]
    tau, x, v, z = s[st.TAU], s[st.X], s[st.V], s[st.Z]
    since = 0.0  # the running segment began this long after its cycle
    for k in range(segment):
        since += durations[k]
    sign = float(n[st.SIGN])
    ended = 0
    while True:
        resting = done >= count
        rate = 0.0 if resting else rates[segment]
        if done >= stop_cycle and segment == 0 and tau == 0.0:
            _sample(s, n, durations, rates, x, v, z, rate, tau)
            break
        limit = math.inf if resting else durations[segment] - tau
        h = next_arc(arc, work, plant, x, z, v - rate, rate, limit)
        ahead = (t_end - s[st.START]) - done * period - since - tau
        if h > ahead or h == math.inf:
            n[st.SEGMENT] = segment
            if 0.0 < ahead < math.inf:
                x1, z1, w1 = within_arc(arc, work, plant, ahead)
                _sample(s, n, durations, rates, x1, w1 + rate, z1, rate, tau + ahead)
            else:
                _sample(s, n, durations, rates, x, v, z, rate, tau)
            break
        if segment == n[st.SLIP] and tau == 0.0 and not resting:
            if n[st.TRACKING]:
                s[st.BACKSTEP] = s[st.X_TOP] - s[st.X_LOW]
            n[st.TRACKING] = 1
            s[st.X_TOP] = s[st.X_LOW] = sign * x
        x1, z1, w1 = arc_end(arc, work, plant)
        v1 = w1 + rate
        if n[st.TRACKING]:
            s[st.X_LOW] = min(s[st.X_LOW], sign * x1)
            t = standstill(arc, work, plant, sign, v1)
            if t == t:
                s[st.X_LOW] = min(s[st.X_LOW], sign * within_arc(arc, work, plant, t)[0])
                s[st.BACKSTEP] = s[st.X_TOP] - s[st.X_LOW]
                n[st.TRACKING] = 0
        s[st.Z_MAX] = max(s[st.Z_MAX], z1, arc[st.PEAK_MAX])
        s[st.Z_MIN] = min(s[st.Z_MIN], z1, arc[st.PEAK_MIN])
        if plant[st.SPRING] != 0.0:
            s[st.IMPULSE] += position_integral(arc, work, plant, x1, z1, w1) * plant[st.SPRING]
        tau, x, v, z = tau + h, x1, v1, z1
        if h < limit:
            continue
        # -- a kink: the rate changes
        s[st.LOST] += _lost(s, plant, x, v, z, rate, durations[segment])
        s[st.SEG_X], s[st.SEG_V], s[st.SEG_Z], s[st.IMPULSE] = x, v, z, 0.0
        since += durations[segment]
        tau = 0.0
        segment += 1
        if segment == len(durations):
            since, segment = 0.0, 0
            done += 1
            if ended < len(rows):
                row = rows[ended]
                row[st.ROW_X], row[st.ROW_V], row[st.ROW_Z] = x, v, z
                row[st.ROW_BACKSTEP] = s[st.BACKSTEP]
                row[st.ROW_Z_MAX], row[st.ROW_Z_MIN] = s[st.Z_MAX], s[st.Z_MIN]
                row[st.ROW_LOST] = s[st.LOST]
            ended += 1
            s[st.LAST_STEP], s[st.LAST_LOST] = x - s[st.CYCLE_X], s[st.LOST]
            s[st.CYCLE_X] = x
            s[st.Z_MAX] = s[st.Z_MIN] = z
            s[st.LOST] = 0.0
    n[st.DONE], n[st.SEGMENT] = done, segment
    s[st.TAU], s[st.X], s[st.V], s[st.Z] = tau, x, v, z
    return ended


@compiled
def _sample(
    s: NDArray,
    n: NDArray,
    durations: NDArray,
    rates: NDArray,
    x: float,
    v: float,
    z: float,
    rate: float,
    tau: float,
) -> None:
    """Keep what was asked for: the state at tau (s) into the running segment."""
    s[st.NOW_TAU], s[st.NOW_U] = tau, rate * tau
    for k in range(n[st.SEGMENT]):
        s[st.NOW_TAU] += durations[k]
        s[st.NOW_U] += durations[k] * rates[k]
    s[st.NOW_X], s[st.NOW_V], s[st.NOW_Z], s[st.NOW_RATE] = x, v, z, rate


@compiled
def _lost(
    s: NDArray, plant: NDArray, x: float, v: float, z: float, rate: float, duration: float
) -> float:
    """Return the energy (J) that the contact turned into heat over a segment.

    Work F w of both bodies on the contact less what its springs hold. Momentum and energy of the
    runner give it from the ends alone: F dt = -m dv + (F_ext - k x) dt.
    """
    mass, force, spring = plant[st.MASS], plant[st.FORCE], plant[st.SPRING]
    x0, v0, z0 = s[st.SEG_X], s[st.SEG_V], s[st.SEG_Z]
    on_runner = 0.5 * mass * (v0 * v0 - v * v) + force * (x - x0) + 0.5 * spring * (x0 * x0 - x * x)
    impulse = mass * (v0 - v) + force * duration - s[st.IMPULSE]
    stored = 0.5 * plant[0] * (z * z - z0 * z0)
    return on_runner - rate * impulse - stored
