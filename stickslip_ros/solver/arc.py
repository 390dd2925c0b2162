# SPDX-License-Identifier: Apache-2.0
"""The way from one event to the next: which kind of arc starts here, where it ends, where it is."""

from __future__ import annotations

import math

from numpy.typing import NDArray

from stickslip_ros.compiled import compiled
from stickslip_ros.model.friction import (
    ALWAYS_PLASTIC,
    ELASTOPLASTIC,
    ELASTOPLASTIC_CALC,
    Contact,
    z_limit,
)
from stickslip_ros.solver import state as st
from stickslip_ros.solver.elastic import elastic_end, rest_line
from stickslip_ros.solver.glide import glide, glide_end
from stickslip_ros.solver.known import learn
from stickslip_ros.solver.oscillator import next_turn, propagate
from stickslip_ros.solver.series import (
    BAND,
    W,
    Z,
    expand,
    moment,
    on_side,
    path,
    polynomial,
    reaches,
    series_end,
)
from stickslip_ros.solver.slide import point_above, slide
from stickslip_ros.solver.swing import burst, swing

#: Parts of the tolerance per cycle: one step of a series; z that counts as having reached steady
#: sliding; a swing that counts as rest where no deflection is elastic.
_PER_STEP, _SETTLED, _AT_REST = 0.05, 0.05, 1e-3


@compiled
def contact_part(plant: NDArray) -> Contact:
    """Return the contact as a plain tuple, which is what compiled code takes it for."""
    return (  # type: ignore[return-value]
        plant[0],
        plant[1],
        plant[2],
        plant[3],
        plant[4],
        plant[5],
        plant[6],
        plant[7],
        int(plant[8]),
        int(plant[9]),
    )


@compiled
def next_arc(
    arc: NDArray,
    work: NDArray,
    plant: NDArray,
    x: float,
    z: float,
    w: float,
    rate: float,
    limit: float,
    ahead: bool,
) -> float:
    """Fill arc (and work) from position x, deflection z (m), speed w (m/s); return its length (s).

    rate is u' (m/s), constant for at least limit (s); the arc is at most that long. ahead allows
    arcs that are known ahead, which have an end but nothing within.
    """
    contact = contact_part(plant)
    sigma_0, sigma_1, sigma_2, z_ba, _, _, _, _, kind, _ = contact
    mass, force, spring = plant[st.MASS], plant[st.FORCE], plant[st.SPRING]
    tolerance, z_slide = plant[st.TOLERANCE], plant[st.Z_SLIDE]
    arc[st.ARC_X], arc[st.ARC_Z], arc[st.ARC_W], arc[st.RATE] = x, z, w, rate
    arc[st.PEAK_MAX], arc[st.PEAK_MIN] = -math.inf, math.inf
    net = force - spring * x - sigma_0 * z
    outward = z * w if w != 0.0 else z * net
    mirror = 1.0 if z > 0.0 else -1.0
    side = 0 if z > 0.0 else 1
    ahead = ahead and kind == ELASTOPLASTIC and contact[9] == 0 and spring == 0.0 and abs(z) >= z_ba
    if ahead and plant[st.KNOWN] == 0.0:
        learn(plant, work, contact)
    ahead = ahead and plant[st.KNOWN] > 0.0
    if (
        (kind == ALWAYS_PLASTIC or abs(z) >= z_ba)
        and spring * rate == 0.0
        and abs(w) * plant[st.MEMORY] + abs(net) / sigma_0 < _AT_REST * tolerance
    ):  # a swing that would die away for ever
        arc[st.KIND], arc[st.LENGTH] = st.REST, limit
        arc[st.Z_END], arc[st.W_END], arc[st.PATH] = z, 0.0, 0.0
        return limit
    if kind != ALWAYS_PLASTIC and not (abs(z) >= z_ba and outward > 0.0):
        if ahead and w == 0.0:
            z_end, t, gone = swing(plant, side, mirror * z)
            if t <= limit:
                return _known(arc, t, -mirror * z_end, 0.0, mirror * gone)
        a, b = rest_line(x, z, rate, sigma_0, sigma_1 + sigma_2, force, spring)
        h, _, z_end, w_end, z_max, z_min = elastic_end(
            z, w, a, b, plant[st.DELTA], plant[st.KAPPA], plant[st.OMEGA], z_ba, limit
        )
        arc[st.KIND], arc[st.LENGTH] = st.ELASTIC, h
        arc[st.LINE], arc[st.LINE_RATE] = a, b
        arc[st.PEAK_MAX], arc[st.PEAK_MIN] = z_max, z_min
        arc[st.Z_END], arc[st.W_END], arc[st.PATH] = z_end, w_end, z_end - z
        return h
    if kind == ALWAYS_PLASTIC:
        mirror = 1.0 if w > 0.0 or (w == 0.0 and net > 0.0) else -1.0
    arc[st.MIRROR] = mirror
    pull = mirror * (force - spring * x)
    stop, stopped = math.inf, False
    if ahead:
        z_m, w_m = mirror * z, mirror * w
        if z_m == z_ba and w_m <= plant[st.BURST_TOP]:
            z_end, t, gone = burst(plant, side, w_m)
            if t <= limit:
                return _known(arc, t, mirror * z_end, 0.0, mirror * gone)
        elif w_m > plant[st.BURST_TOP] and sigma_2 == 0.0 and z_m < z_slide:
            t, gone, z_end, w_end = slide(plant, contact, z_m, w_m, pull, limit)
            if t <= limit:
                return _known(arc, t, mirror * z_end, mirror * w_end, mirror * gone)
            stop = point_above(plant, z_m)  # from there on it may be known
    if w != 0.0 and abs(mirror * z - z_slide) <= _SETTLED * tolerance:
        arc[st.KIND], arc[st.NET] = st.GLIDE, pull - sigma_0 * z_slide
        h, turned = glide_end(mirror * w, arc[st.NET], sigma_2, spring, mass, mirror * rate, limit)
    else:
        arc[st.KIND] = st.SERIES
        branch = on_side(contact, mirror)
        plastic = _plastic_branch(mirror * z, mirror * w, branch)
        expand(work, branch, mirror * z, mirror * w, plastic, pull, mass, spring, mirror * rate)
        h, turned = series_end(
            work, branch, plastic, _PER_STEP * tolerance, plant[st.MEMORY], limit
        )
        if not turned and stop < polynomial(work, Z, h):
            h, stopped = reaches(work, Z, stop, h), True
    arc[st.LENGTH] = h
    if h < math.inf:
        gone, z_end, w_end = within_arc(arc, work, plant, h)
        arc[st.PATH], arc[st.W_END] = gone, 0.0 if turned else w_end
        arc[st.Z_END] = mirror * stop if stopped else z_end
    return h


@compiled
def _known(arc: NDArray, t: float, z_end: float, w_end: float, gone: float) -> float:
    arc[st.KIND], arc[st.LENGTH] = st.KNOWN_AHEAD, t
    arc[st.Z_END], arc[st.W_END], arc[st.PATH] = z_end, w_end, gone
    return t


@compiled
def within_arc(arc: NDArray, work: NDArray, plant: NDArray, t: float) -> tuple[float, float, float]:
    """Return path so far (integral of w, m), deflection z (m), speed w (m/s) after t (s)."""
    z, w, rate, mirror = arc[st.ARC_Z], arc[st.ARC_W], arc[st.RATE], arc[st.MIRROR]
    if arc[st.KIND] == st.ELASTIC:
        a, b = arc[st.LINE], arc[st.LINE_RATE]
        y, wy = propagate(z - a, w - b, t, plant[st.DELTA], plant[st.KAPPA], plant[st.OMEGA])
        z1 = a + b * t + y
        return z1 - z, z1, b + wy
    if arc[st.KIND] == st.SERIES:
        return (
            mirror * path(work, t),
            mirror * polynomial(work, Z, t),
            mirror * polynomial(work, W, t),
        )
    if arc[st.KIND] == st.GLIDE:
        gone, w1 = glide(
            mirror * w, arc[st.NET], plant[2], plant[st.SPRING], plant[st.MASS], mirror * rate, t
        )
        return mirror * gone, mirror * plant[st.Z_SLIDE], mirror * w1
    return 0.0, z, 0.0


@compiled
def position_integral(arc: NDArray, work: NDArray, plant: NDArray) -> float:
    """Return the integral of the position (m s) over the arc; with a spring only."""
    sigma_0, mass = plant[0], plant[st.MASS]
    x0, z0, w0 = arc[st.ARC_X], arc[st.ARC_Z], arc[st.ARC_W]
    z, w = arc[st.Z_END], arc[st.W_END]
    h, rate = arc[st.LENGTH], arc[st.RATE]
    straight = (x0 + 0.5 * rate * h) * h
    if arc[st.KIND] == st.ELASTIC:  # sum up the equation of motion
        damping, total = plant[1] + plant[2], sigma_0 + plant[st.SPRING]
        pull = plant[st.FORCE] - plant[st.SPRING] * (x0 - z0 + 0.5 * rate * h)
        z_sum = (pull * h - mass * (w - w0) - damping * (z - z0)) / total
        return straight + z_sum - z0 * h
    if arc[st.KIND] == st.SERIES:
        return straight + arc[st.MIRROR] * moment(work, h)
    if arc[st.KIND] == st.GLIDE:
        pull = plant[st.FORCE] - sigma_0 * z
        return (pull * h - plant[2] * arc[st.PATH] - mass * (w - w0)) / plant[st.SPRING]
    return straight


@compiled
def turning_point(arc: NDArray, work: NDArray, plant: NDArray, sign: float) -> tuple[float, float]:
    """Return when (s) the runner turns towards sign within the arc, and its way (m) up to there.

    The time is nan where it does not.
    """
    w, rate, h = arc[st.ARC_W], arc[st.RATE], arc[st.LENGTH]
    v_start, v_end = sign * (w + rate), sign * (arc[st.W_END] + rate)
    if arc[st.KIND] == st.ELASTIC:
        a, b = arc[st.LINE], arc[st.LINE_RATE]
        y, wy = arc[st.ARC_Z] - a, w - b
        delta, kappa, omega = plant[st.DELTA], plant[st.KAPPA], plant[st.OMEGA]
        t = next_turn(y, wy, delta, kappa, omega, b + rate, 0.0, h)
        if v_start > 0.0 and t < math.inf:  # that was where it turned away
            t = next_turn(y, wy, delta, kappa, omega, b + rate, t, h)
        if not t < h:
            return math.nan, 0.0
        return t, within_arc(arc, work, plant, t)[0] + rate * t
    if not v_start < 0.0 <= v_end:
        return math.nan, 0.0
    mirror = arc[st.MIRROR]
    if arc[st.KIND] == st.SERIES:
        t = reaches(work, W, -mirror * rate, h)
        return t, mirror * path(work, t) + rate * t
    if arc[st.KIND] == st.KNOWN_AHEAD:
        # it ends where w = 0, a little later: look back from there
        side = 1.0 if arc[st.Z_END] > 0.0 else -1.0
        expand(
            work,
            contact_part(plant),
            side * arc[st.Z_END],
            0.0,
            False,
            side * plant[st.FORCE],
            plant[st.MASS],
            0.0,
            side * rate,
        )
        t = reaches(work, W, -side * rate, -h)
        return h + t, arc[st.PATH] + side * path(work, t) + rate * (h + t)
    left, right = 0.0, h
    for _ in range(60):
        middle = 0.5 * (left + right)
        if sign * (within_arc(arc, work, plant, middle)[2] + rate) < 0.0:
            left = middle
        else:
            right = middle
    return right, within_arc(arc, work, plant, right)[0] + rate * right


@compiled
def sliding_deflection(contact: Contact) -> float:
    """Return |z| (m) of steady sliding, where alpha z = z_lim; nan if it depends on the speed."""
    _, _, _, z_ba, z_ss, z_k, z_s, _, kind, printed = contact
    if z_k != z_s or printed != 0:
        return math.nan
    if kind == ALWAYS_PLASTIC or z_k >= z_ss:
        return z_k
    left, right = max(z_ba, z_k), z_ss
    scale = math.pi / (z_ss - z_ba)
    z = 0.5 * (left + right)
    for _ in range(100):
        angle = scale * (z - z_ba)
        share = 0.5 * (1.0 - math.cos(angle))
        excess = share * z - z_k
        if excess > 0.0:
            right = z
        else:
            left = z
        step = excess / (share + 0.5 * scale * math.sin(angle) * z)
        if not left < z - step < right:
            step = z - 0.5 * (left + right)
        if z - step == z:
            break
        z -= step
    return z


@compiled
def _plastic_branch(z: float, w: float, contact: Contact) -> bool:
    """True where alpha = 1, for z, w mirrored to w >= 0."""
    _, _, _, _, z_ss, z_k, z_s, v_s, kind, _ = contact
    if kind == ALWAYS_PLASTIC:
        return True
    if kind == ELASTOPLASTIC_CALC:
        return z >= z_limit(w, z_k, z_s, v_s) - BAND * z_k
    return z >= z_ss
