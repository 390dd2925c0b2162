# SPDX-License-Identifier: Apache-2.0
"""Arcs that are solved in closed form, because their equations are linear.

Elastic arcs, alpha = 0: the contact is a spring and damper. With z' = w and m v' = -sigma_0 z -
(sigma_1 + sigma_2) w + F_ext - k x, and x - u - z constant,

    z(t) = a + b t + y(t),   y'' + 2 delta y' + kappa y = 0.

The arc ends where plastic deformation begins: |z| passes z_ba outward, or w turns outward while
|z| > z_ba. Peaks are taken at their analytic time, never searched by sampling: a ringing peak that
just grazes z_ba decides over nanometres of the next step.

Glides, arcs of steady sliding: z has reached the deflection at which z' = 0, and stays there.

    m w' = F_ext - k x - sigma_0 z - sigma_2 w,   w > 0 after mirroring

The rest of a slip costs one evaluation, however long it lasts. The forms used are those that keep
their digits while sigma_2 or the spring tends to 0.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from stickslip_ros.base.compiled import compiled
from stickslip_ros.physics.solver.layout import BREAKAWAY, FREE, TURN
from stickslip_ros.physics.solver.oscillator import (
    Line,
    Oscillator,
    Span,
    first_turn,
    half_period,
    next_turn,
    oscillator,
    overdamped_end,
    passes,
    propagate,
)

#: So many turns, and the arc ends at one of them: one arc may not take the time of thousands
_MOST_TURNS = 1000
#: The functions of `_decays` and `_risen` are summed up as series below this argument.
_SMALL = 0.5
#: Terms of the first, which is exact then: 0.5^16 / 17! is below rounding
_TERMS = 16
#: (omega t)^2 from which the closed form loses no more than two digits; below, a series
_TURNED = 0.01
#: Terms of the series, at most
_MOST_TERMS = 40
#: Share of its sum below which a term is lost in rounding, and the series ends
_ROUNDING = 1e-17


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
        return Line(arc.force / plant.sigma_0, 0.0)
    total = plant.sigma_0 + plant.spring
    b = -plant.spring * arc.pulled / total
    damped = (plant.sigma_1 + plant.sigma_2) * b
    return Line((arc.force - plant.spring * (arc.x - arc.z) - damped) / total, b)


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
        if z_left < z_ba < z_right or z_left > -z_ba > z_right:
            level = z_ba if z_left < z_right else -z_ba
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


# -- glides


class Glide(NamedTuple):
    """A steady slide, mirrored."""

    w: float  #: at the start, m/s
    net: float  #: force on the runner at the start without the viscous part, N
    damping: float  #: sigma_2, N s/m
    spring: float  #: N/m
    mass: float  #: kg
    rate: float  #: u', m/s


@compiled
def glide(g: Glide, t: float) -> tuple[float, float]:
    """Return (path, w) after t (s): integral of w (m) and w (m/s)."""
    if g.spring != 0.0:
        o = _springy(g)
        moved, v1 = propagate(0.0, g.w + g.rate, t, o)
        driven = (g.net + g.damping * g.rate) / g.mass
        v1 += driven * propagate(0.0, 1.0, t, o)[0]
        return moved + driven * _risen(o, t) - g.rate * t, v1 - g.rate
    acceleration = g.net / g.mass
    if g.damping != 0.0:
        lost, lost_twice = _decays(g.damping / g.mass * t)
        return (
            (g.w * lost + acceleration * t * lost_twice) * t,
            g.w * math.exp(-g.damping / g.mass * t) + acceleration * t * lost,
        )
    return (g.w + 0.5 * acceleration * t) * t, g.w + acceleration * t


@compiled
def glide_end(g: Glide, floor: float, limit: float) -> tuple[float, bool]:
    """Return (t, whether it is reached): when w comes down to floor (m/s), at most limit (s)."""
    t = math.inf
    if g.spring != 0.0:
        o = _springy(g)
        y = -(g.net + g.damping * g.rate) / g.spring
        t = next_turn(y, g.w + g.rate, o, -(g.rate + floor), 0.0, limit)
    else:
        brake = floor * g.damping - g.net
        if brake > 0.0:
            t = (g.w - floor) * g.mass / brake
            lost = (g.w - floor) * g.damping / brake
            if lost > 0.0:
                t *= math.log1p(lost) / lost
    return (t, True) if t < limit else (limit, False)


@compiled
def _springy(g: Glide) -> Oscillator:
    return oscillator(0.5 * g.damping / g.mass, g.spring / g.mass)


@compiled
def _decays(x: float) -> tuple[float, float]:
    """Return (1 - exp(-x)) / x and (x - 1 + exp(-x)) / x^2, for x >= 0."""
    if x > _SMALL:
        lost = -math.expm1(-x) / x
        return lost, (1.0 - lost) / x
    twice = 0.0
    for n in range(_TERMS, 1, -1):  # 1/2! - x/3! + x^2/4! ..
        twice = (1.0 - x * twice) / n
    return 1.0 - x * twice, twice


@compiled
def _risen(o: Oscillator, t: float) -> float:
    """Return y(t) (s^2) of y'' + 2 delta y' + kappa y = 1 from rest at 0."""
    delta, kappa, omega = o
    if omega <= 0.0 and (delta - omega) * t > _SMALL:  # from its two roots
        quick = delta - omega
        slow = kappa / quick
        apart = quick - slow
        if apart * t > _SMALL:
            return t * (_decays(slow * t)[0] - _decays(quick * t)[0]) / apart
    if kappa * t * t > _TURNED:
        y, _ = propagate(1.0, 0.0, t, o)
        return (1.0 - y) / kappa
    before, term, total = 0.0, 0.5 * t * t, 0.0
    for n in range(2, _MOST_TERMS):
        total += term
        following = -(2.0 * delta * t * n * term + kappa * t * t * before) / ((n + 1.0) * n)
        before, term = term, following
        if abs(term) + abs(before) <= _ROUNDING * total:
            break
    return total
