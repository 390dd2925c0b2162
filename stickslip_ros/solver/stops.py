# SPDX-License-Identifier: Apache-2.0
"""Travel stops: where the runner hits one, how it is held there and when it gets away.

A hit is perfectly inelastic: the velocity becomes 0. As long as the other forces press the runner
against the stop it stands, and only the contact goes on, with w = -u'; for the contact that is as
if the runner were infinitely heavy, so the same arcs serve. When the forces turn, it is free again.

Arcs that may reach a stop are shortened until they either stay away for sure or are short against
the ringing. Within those the way is sampled to find the hit. All of it follows from the state at
the last event, so how a run is cut into calls changes nothing here either.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled
from stickslip_ros.model.friction import friction_force
from stickslip_ros.solver import state as st
from stickslip_ros.solver.arc import contact_part, next_arc, within_arc
from stickslip_ros.solver.series import Z, integral

#: A short arc: a 32nd of the ringing period, in units of its angular frequency
_SHORT = 2.0 * math.pi / 32.0
#: Arcs are shortened by this factor at a time, those without an end to so many short ones
_SHORTER, _LONGEST = 8.0, 64.0
#: Bisections: all digits of a double
_HALVINGS = 60
#: Times at which an arc of a held runner is looked at for the force to turn
_LOOKS = 8
#: Position counts as beyond a stop above this share of it: a few roundings
_ROUNDING = 1e-15


@compiled
def holding(plant: NDArray, s: NDArray, x: float, v: float, z: float, rate: float, now: int) -> int:
    """Return which stop holds the runner: -1 the lower, 1 the upper, 0 none.

    It is at x, z (m), v (m/s), and u' is rate (m/s); now is which stop has held it so far.
    """
    if v != 0.0:
        return 0
    for side in (-1, 1):
        if x == (s[st.LOW] if side < 0 else s[st.HIGH]):
            push = side * _push(plant, x, z, rate)
            if push > 0.0 or (push == 0.0 and now == side):
                return side
    return 0


@compiled
def _push(plant: NDArray, x: float, z: float, rate: float) -> float:
    """Return the force (N) on a runner that stands at x (m), the stop's own left out."""
    friction = friction_force(z, -rate, contact_part(plant))
    return plant[st.FORCE] - plant[st.SPRING] * x - friction  # type: ignore[no-any-return]


@compiled
def unmoved(plant: NDArray) -> NDArray:
    """Return the prepared plant whose arcs are those of the contact of a runner that stands."""
    held = plant[: st.SLIDE].copy()
    held[2] = 0.0  # viscous friction moves nothing here
    held[st.MASS] = math.inf
    held[st.FORCE] = held[st.SPRING] = 0.0
    held[st.DELTA] = held[st.KAPPA] = held[st.OMEGA] = 0.0
    held[st.MEMORY] = 1e300  # no speed is so small that it can be left out
    held[st.KNOWN] = -1.0
    return held


@compiled
def held_arc(
    arc: NDArray,
    work: NDArray,
    plant: NDArray,
    held: NDArray,
    x: float,
    z: float,
    rate: float,
    side: int,
    limit: float,
) -> float:
    """Fill arc with the way of the contact while the stop ``side`` holds the runner at x (m).

    held is `unmoved` plant. The arc ends where the runner gets away; return its length (s).
    """
    if rate == 0.0:
        arc[st.KIND], arc[st.LENGTH] = st.REST, limit
        arc[st.ARC_X], arc[st.ARC_Z], arc[st.ARC_W], arc[st.RATE] = x, z, 0.0, 0.0
        arc[st.Z_END], arc[st.W_END], arc[st.PATH] = z, 0.0, 0.0
        arc[st.PEAK_MAX], arc[st.PEAK_MIN] = -math.inf, math.inf
        return limit
    h = next_arc(arc, work, held, x, z, -rate, rate, limit, False)
    left = 0.0
    for look in range(1, _LOOKS + 1):
        right = h * look / _LOOKS
        z_right = within_arc(arc, work, held, right)[1]
        if side * _push(plant, x, z_right, rate) < 0.0:
            for _ in range(_HALVINGS):
                middle = 0.5 * (left + right)
                if side * _push(plant, x, within_arc(arc, work, held, middle)[1], rate) < 0.0:
                    right = middle
                else:
                    left = middle
            return next_arc(arc, work, held, x, z, -rate, rate, right, False)
        left = right
    return h


@compiled
def held_heat(arc: NDArray, work: NDArray, plant: NDArray) -> float:
    """Return the energy (J) that the contact turns into heat over the arc of a held runner."""
    sigma_0, sigma_1, sigma_2 = plant[0], plant[1], plant[2]
    h, rate, z0, z1 = arc[st.LENGTH], arc[st.RATE], arc[st.ARC_Z], arc[st.Z_END]
    if arc[st.KIND] == st.SERIES:
        z_sum = arc[st.MIRROR] * integral(work, Z, h)
    else:  # linear
        z_sum = 0.5 * (z0 + z1) * h
    impulse = sigma_0 * z_sum + sigma_1 * (z1 - z0) - sigma_2 * rate * h
    return -rate * impulse - 0.5 * sigma_0 * (z1 * z1 - z0 * z0)  # type: ignore[no-any-return]


@compiled
def arc_to_stop(
    arc: NDArray,
    work: NDArray,
    plant: NDArray,
    s: NDArray,
    x: float,
    z: float,
    w: float,
    rate: float,
) -> tuple[float, int]:
    """Shorten the arc from x, z (m), w (m/s) so that it ends where the runner hits a stop.

    Return its length (s) and which stop it hits at its end: -1 the lower, 1 the upper, 0 none.
    """
    short = _SHORT * plant[st.MEMORY]
    h = arc[st.LENGTH]
    while True:
        lowest, highest = _reach(arc, x, rate)
        if s[st.LOW] <= lowest and highest <= s[st.HIGH]:
            return h, 0
        known = arc[st.KIND] == st.KNOWN_AHEAD
        if h <= short and not known:
            break
        shorter = min(h, max(short, min(h, _SHORTER * _LONGEST * short) / _SHORTER))
        h = next_arc(arc, work, plant, x, z, w, rate, shorter, False)
    t, side = h, 0
    for one in (-1, 1):
        at = _touch(arc, work, plant, x, rate, one, s[st.LOW] if one < 0 else s[st.HIGH])
        if at <= t:
            t, side = at, one
    if side != 0:
        t = next_arc(arc, work, plant, x, z, w, rate, t, False)
    return t, side


@compiled
def _reach(arc: NDArray, x: float, rate: float) -> tuple[float, float]:
    """Return a lowest and a highest position (m) that the arc from x (m) does not pass."""
    h = arc[st.LENGTH]
    carried = rate * h if rate != 0.0 else 0.0
    if arc[st.KIND] == st.ELASTIC:
        z = arc[st.ARC_Z]
        down = min(arc[st.PEAK_MIN], arc[st.Z_END]) - z
        up = max(arc[st.PEAK_MAX], arc[st.Z_END]) - z
    elif h < math.inf:  # w keeps its sign
        down = up = arc[st.PATH]
    else:
        down = up = arc[st.MIRROR] * math.inf if arc[st.KIND] == st.GLIDE else 0.0
    return x + min(carried, 0.0) + min(down, 0.0), x + max(carried, 0.0) + max(up, 0.0)


@compiled
def _touch(
    arc: NDArray, work: NDArray, plant: NDArray, x: float, rate: float, side: int, stop: float
) -> float:
    """Return when (s) a short arc from x (m) passes the stop (m) on that side, nan if it does not.

    An arc that only looks over it in between turns there.
    """
    if not abs(stop) < math.inf:
        return math.nan
    h = arc[st.LENGTH]
    beyond = _ROUNDING * abs(stop)
    if _over(arc, work, plant, x, rate, side, stop, h) <= beyond:
        if not side * (arc[st.ARC_W] + rate) > 0.0 > side * (arc[st.W_END] + rate):
            return math.nan
        left, right = 0.0, h
        for _ in range(_HALVINGS):
            middle = 0.5 * (left + right)
            if side * (within_arc(arc, work, plant, middle)[2] + rate) > 0.0:
                left = middle
            else:
                right = middle
        h = right
        if _over(arc, work, plant, x, rate, side, stop, h) <= beyond:
            return math.nan
    left, right = 0.0, h
    for _ in range(_HALVINGS):
        middle = 0.5 * (left + right)
        if _over(arc, work, plant, x, rate, side, stop, middle) > 0.0:
            right = middle
        else:
            left = middle
    return right


@compiled
def _over(
    arc: NDArray,
    work: NDArray,
    plant: NDArray,
    x: float,
    rate: float,
    side: int,
    stop: float,
    t: float,
) -> float:
    """Return how far (m) beyond the stop the runner would be after t (s)."""
    return side * (x + within_arc(arc, work, plant, t)[0] + rate * t - stop)  # type: ignore[no-any-return]


def reach_of(durations: NDArray[np.float64], rates: NDArray[np.float64], z: float) -> float:
    """Return how far (m) from both of its ends an arc may lead; z is the largest deflection (m)."""
    return float(np.max(np.abs(durations * rates))) + 2.0 * z
