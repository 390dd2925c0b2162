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
from typing import NamedTuple

import numpy as np

from stickslip_ros.compiled import compiled
from stickslip_ros.solver.layout import BREAKAWAY, FREE, TURN
from stickslip_ros.solver.oscillator import (
    Line,
    Oscillator,
    Span,
    first_turn,
    half_period,
    next_turn,
    overdamped_end,
    passes,
    propagate,
)

#: So many turns, and the arc ends at one of them: one arc may not take the time of thousands
_MOST_TURNS = 1000


class ElasticEnd(NamedTuple):
    """Where an elastic arc ends."""

    t: float  #: s; where it is inf, nothing happens any more, and z and w have no meaning
    event: int  #: FREE, TURN or BREAKAWAY
    z: float  #: m
    w: float  #: m/s
    z_max: float  #: extremes of z inside, m
    z_min: float


@compiled
def rest_line(arc: np.record, plant: np.record) -> Line:
    """Return the line around which an elastic arc swings."""
    if plant.spring == 0.0:
        return Line(plant.force / plant.sigma_0, 0.0)
    total = plant.sigma_0 + plant.spring
    b = -plant.spring * arc.rate / total
    damped = (plant.sigma_1 + plant.sigma_2) * b
    return Line((plant.force - plant.spring * (arc.x - arc.z) - damped) / total, b)


@compiled
def elastic_end(
    z: float, w: float, line: Line, o: Oscillator, z_ba: float, limit: float
) -> ElasticEnd:
    """Return the end of an elastic arc from z (m), w (m/s), within limit (s)."""
    a, b = line
    y, wy = z - a, w - b
    half = half_period(o)
    from_turn = w == 0.0 and b == 0.0 and o.omega > 0.0
    t_left, z_left = 0.0, z
    z_max, z_min = -math.inf, math.inf
    y_right, wy_right = y, wy
    calm = False
    t_turn = first_turn(y, wy, o) if b == 0.0 else 0.0
    for turn in range(_MOST_TURNS):
        if b != 0.0:
            t_turn = next_turn(y, wy, o, b, t_left, limit)
        t_right, w_right = min(t_turn, limit), 0.0
        if from_turn and t_turn <= limit:
            z_right = a - (z_left - a) * math.exp(-o.delta * half)
        elif t_right == math.inf:
            z_right = a  # b is 0 where time has no end
        else:
            y_right, wy_right = propagate(y, wy, t_right, o)
            z_right, w_right = a + b * t_right + y_right, b + wy_right
        level = _level_passed(z_left, z_right, z_ba)
        if level == level:
            if t_right == math.inf:
                t_right = overdamped_end(o)
            span = Span(t_left, z_left, t_right, z_right)
            t, w_end = passes(y, wy, o, line, level, span)
            return ElasticEnd(t, BREAKAWAY, level, w_end, z_max, z_min)
        if t_turn >= limit:
            return ElasticEnd(limit, FREE, z_right, w_right, z_max, z_min)
        if abs(z_right) > z_ba or turn == _MOST_TURNS - 1:
            return ElasticEnd(t_turn, TURN, z_right, 0.0, z_max, z_min)
        z_max, z_min = max(z_max, z_right), min(z_min, z_right)
        if b == 0.0 and abs(z_right - a) <= z_ba - abs(a):  # every later peak is smaller
            if t_turn + half < limit:
                z_next = a - (z_right - a) * math.exp(-o.delta * half)
                z_max, z_min = max(z_max, z_next), min(z_min, z_next)
            if limit < math.inf:
                y_right, w_right = propagate(y, wy, limit, o)
                z_right = a + y_right
            return ElasticEnd(limit, FREE, z_right, w_right, z_max, z_min)
        if b != 0.0 and o.omega > 0.0:
            if calm and limit < math.inf:  # the largest peak of either side has been seen
                y_right, wy_right = propagate(y, wy, limit, o)
                z_right, w_right = a + b * limit + y_right, b + wy_right
                return ElasticEnd(limit, FREE, z_right, w_right, z_max, z_min)
            swing = math.hypot(y_right, (wy_right + o.delta * y_right) / o.omega)
            farthest = max(abs(a + b * t_right), abs(a + b * limit))
            calm = farthest + swing <= z_ba  # no later peak reaches z_ba
        t_left, z_left = t_turn, z_right
        if b == 0.0:
            t_turn += half
    return ElasticEnd(t_left, TURN, z_left, 0.0, z_max, z_min)


@compiled
def _level_passed(z_left: float, z_right: float, z_ba: float) -> float:
    """Return the z (m) of the breakaway passed between two values of z, nan if there is none."""
    if z_left < z_ba < z_right:
        return z_ba
    if z_left > -z_ba > z_right:
        return -z_ba
    return math.nan
