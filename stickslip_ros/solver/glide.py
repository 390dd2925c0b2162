# SPDX-License-Identifier: Apache-2.0
"""Arcs of steady sliding: z has reached the deflection at which z' = 0, and stays there.

    m w' = F_ext - k x - sigma_0 z - sigma_2 w,   w > 0 after mirroring

is linear, so the rest of a slip costs one evaluation, however long it lasts. The forms used are
those that keep their digits while sigma_2 or the spring tends to 0.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from stickslip_ros.compiled import compiled
from stickslip_ros.solver.oscillator import Oscillator, next_turn, oscillator, propagate

#: The functions of `_decays` and `_risen` are summed up as series below this argument.
_SMALL = 0.5
#: Terms of the first, which is exact then: 0.5^16 / 17! is below rounding
_TERMS = 16
#: (omega t)^2 from which the closed form loses no more than two digits; below, a series of at most
#: so many terms, that ends where they are below rounding
_TURNED, _MOST_TERMS, _ROUNDING = 0.01, 40, 1e-17


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
