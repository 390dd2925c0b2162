# SPDX-License-Identifier: Apache-2.0
"""Arcs with alpha = 0: the contact is a linear spring and damper, solved in closed form.

With z' = w and m v' = -sigma_0 z - (sigma_1 + sigma_2) w + F_ext - k x, and x - u - z constant,

    z(t) = a + b t + y(t),   y'' + 2 delta y' + kappa y = 0.

The arc ends where plastic deformation begins: |z| passes z_ba outward, or w turns outward while
|z| > z_ba. Peaks are taken at their analytic time, never searched by sampling: a ringing peak that
just grazes z_ba decides over nanometres of the next step.
"""

from __future__ import annotations

import math

from stickslip_ros.compiled import compiled
from stickslip_ros.solver.oscillator import first_turn, half_period, next_turn, passes, propagate
from stickslip_ros.solver.state import BREAKAWAY, FREE, TURN


@compiled
def rest_line(
    x: float, z: float, rate: float, stiffness: float, damping: float, force: float, spring: float
) -> tuple[float, float]:
    """Return a (m) and b (m/s) of the arc that starts at x, z (m)."""
    if spring == 0.0:
        return force / stiffness, 0.0
    total = stiffness + spring
    b = -spring * rate / total
    return (force - spring * (x - z) - damping * b) / total, b


@compiled
def elastic_end(
    z: float,
    w: float,
    a: float,
    b: float,
    delta: float,
    kappa: float,
    omega: float,
    z_ba: float,
    limit: float,
) -> tuple[float, int, float, float, float, float]:
    """Return (t, how it ends, z, w at the end, largest z, smallest z inside) of an elastic arc.

    z (m), w (m/s) is where it starts; t (s) is at most limit. Where that is inf, nothing happens
    any more, and z, w at the end have no meaning.
    """
    y, wy = z - a, w - b
    half = half_period(omega)
    from_turn = w == 0.0 and b == 0.0 and omega > 0.0
    t_left, z_left = 0.0, z
    z_max, z_min = -math.inf, math.inf
    y_right, wy_right = y, wy
    calm = False
    t_turn = first_turn(y, wy, delta, kappa, omega) if b == 0.0 else 0.0
    while True:
        if b != 0.0:
            t_turn = next_turn(y, wy, delta, kappa, omega, b, t_left, limit)
        t_right, w_right = min(t_turn, limit), 0.0
        if from_turn and t_turn <= limit:
            z_right = a - (z_left - a) * math.exp(-delta * half)
        elif t_right == math.inf:
            z_right = a  # b is 0 where time has no end
        else:
            y_right, wy_right = propagate(y, wy, t_right, delta, kappa, omega)
            z_right, w_right = a + b * t_right + y_right, b + wy_right
        level = math.nan
        if z_left < z_ba < z_right:
            level = z_ba
        elif z_left > -z_ba > z_right:
            level = -z_ba
        if level == level:
            if t_right == math.inf:
                t_right = 120.0 * delta / kappa  # overdamped: sixty of the slow time constants
            t, w_end = passes(
                y, wy, delta, kappa, omega, a, b, level, t_left, z_left, t_right, z_right
            )
            return t, BREAKAWAY, level, w_end, z_max, z_min
        if t_turn >= limit:
            return limit, FREE, z_right, w_right, z_max, z_min
        if abs(z_right) > z_ba:
            return t_turn, TURN, z_right, 0.0, z_max, z_min
        z_max, z_min = max(z_max, z_right), min(z_min, z_right)
        if b == 0.0 and abs(z_right - a) <= z_ba - abs(a):  # every later peak is smaller
            if t_turn + half < limit:
                z_next = a - (z_right - a) * math.exp(-delta * half)
                z_max, z_min = max(z_max, z_next), min(z_min, z_next)
            if limit < math.inf:
                y_right, w_right = propagate(y, wy, limit, delta, kappa, omega)
                z_right = a + y_right
            return limit, FREE, z_right, w_right, z_max, z_min
        if b != 0.0 and omega > 0.0:
            swing = math.hypot(y_right, (wy_right + delta * y_right) / omega)
            line = max(abs(a + b * t_right), abs(a + b * limit))
            if calm and limit < math.inf:  # the largest peak of either side has been seen
                y_right, wy_right = propagate(y, wy, limit, delta, kappa, omega)
                z_right, w_right = a + b * limit + y_right, b + wy_right
                return limit, FREE, z_right, w_right, z_max, z_min
            calm = line + swing <= z_ba  # no later peak reaches z_ba
        t_left, z_left = t_turn, z_right
        if b == 0.0:
            t_turn += half
