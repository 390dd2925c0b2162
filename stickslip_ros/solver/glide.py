# SPDX-License-Identifier: Apache-2.0
"""Arcs of steady sliding: z has reached the deflection at which z' = 0, and stays there.

    m w' = F_ext - k x - sigma_0 z - sigma_2 w,   w > 0 after mirroring

is linear, so the rest of a slip costs one evaluation, however long it lasts.
"""

from __future__ import annotations

import math

from stickslip_ros.compiled import compiled
from stickslip_ros.solver.oscillator import next_turn, propagate, swing_rate


@compiled
def glide(
    w: float, net: float, damping: float, spring: float, mass: float, rate: float, t: float
) -> tuple[float, float]:
    """Return (path, w) after t (s): integral of w (m) and w (m/s).

    net is the force (N) on the runner at the start without the viscous part, rate u' (m/s).
    """
    if spring != 0.0:
        y, wy = _about_rest(w, net, damping, spring, rate)
        delta, kappa = 0.5 * damping / mass, spring / mass
        y1, wy1 = propagate(y, wy, t, delta, kappa, swing_rate(delta, kappa))
        return y1 - y - rate * t, wy1 - rate
    if damping != 0.0:
        slow = damping / mass
        lost = -math.expm1(-slow * t)
        final = net / damping
        return final * t + (w - final) * lost / slow, w + (final - w) * lost
    acceleration = net / mass
    return (w + 0.5 * acceleration * t) * t, w + acceleration * t


@compiled
def glide_end(
    w: float, net: float, damping: float, spring: float, mass: float, rate: float, limit: float
) -> tuple[float, bool]:
    """Return (t, turned): when w reaches 0, at most limit (s)."""
    t = math.inf
    if spring != 0.0:
        y, wy = _about_rest(w, net, damping, spring, rate)
        delta, kappa = 0.5 * damping / mass, spring / mass
        t = next_turn(y, wy, delta, kappa, swing_rate(delta, kappa), -rate, 0.0, limit)
    elif damping != 0.0:
        if net < 0.0:
            t = math.log1p(-w * damping / net) * mass / damping
    elif net < 0.0:
        t = -w * mass / net
    return (t, True) if t < limit else (limit, False)


@compiled
def _about_rest(
    w: float, net: float, damping: float, spring: float, rate: float
) -> tuple[float, float]:
    """Return position (m) from where the spring balances, and velocity x' (m/s)."""
    return -(net + damping * rate) / spring, w + rate
