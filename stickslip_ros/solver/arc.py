# SPDX-License-Identifier: Apache-2.0
"""The way from one event to the next: which kind of arc starts here, where it ends, where it is."""

from __future__ import annotations

import math

from numpy.typing import NDArray

from stickslip_ros.compiled import compiled
from stickslip_ros.model.friction import ALWAYS_PLASTIC, ELASTOPLASTIC_CALC, Contact, z_limit
from stickslip_ros.solver import state as st
from stickslip_ros.solver.elastic import elastic_end, line_and_oscillator
from stickslip_ros.solver.glide import glide, glide_end
from stickslip_ros.solver.oscillator import next_turn, propagate
from stickslip_ros.solver.series import W, Z, expand, moment, path, polynomial, reaches, series_end

#: Parts of the tolerance per cycle: one step of a series; z that counts as having reached steady
#: sliding; a swing that counts as rest where no deflection is elastic.
_PER_STEP, _SETTLED, _AT_REST = 0.02, 1e-3, 1e-3


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
) -> float:
    """Fill arc (and work) from position x, deflection z (m), speed w (m/s); return its length (s).

    rate is u' (m/s), constant for at least limit (s); the arc is at most that long.
    """
    contact = contact_part(plant)
    sigma_0, sigma_1, sigma_2, z_ba, _, _, _, _, kind = contact
    mass, force, spring = plant[st.MASS], plant[st.FORCE], plant[st.SPRING]
    tolerance, z_slide = plant[st.TOLERANCE], plant[st.Z_SLIDE]
    arc[st.ARC_X], arc[st.ARC_Z], arc[st.ARC_W], arc[st.RATE] = x, z, w, rate
    arc[st.PEAK_MAX], arc[st.PEAK_MIN] = -math.inf, math.inf
    arc[st.LEVEL] = math.nan
    ending = st.FREE
    net = force - spring * x - sigma_0 * z
    if kind != ALWAYS_PLASTIC:
        outward = z * w if w != 0.0 else z * net
        if not (abs(z) >= z_ba and outward > 0.0):
            a, b, delta, kappa = line_and_oscillator(
                x, z, rate, sigma_0, sigma_1 + sigma_2, mass, force, spring
            )
            h, ending, z_max, z_min = elastic_end(z, w, a, b, delta, kappa, z_ba, limit)
            if ending == st.BREAKAWAY:
                w_end = b + propagate(z - a, w - b, h, delta, kappa)[1]
                arc[st.LEVEL] = z_ba if w_end > 0.0 else -z_ba
            arc[st.KIND], arc[st.LENGTH], arc[st.ENDING] = st.ELASTIC, h, ending
            arc[st.LINE], arc[st.LINE_RATE], arc[st.DELTA], arc[st.KAPPA] = a, b, delta, kappa
            arc[st.PEAK_MAX], arc[st.PEAK_MIN] = z_max, z_min
            return h
        mirror = 1.0 if z > 0.0 else -1.0
    else:
        mirror = 1.0 if w > 0.0 or (w == 0.0 and net > 0.0) else -1.0
    arc[st.MIRROR] = mirror
    pull = mirror * (force - spring * x)
    if w != 0.0 and abs(mirror * z - z_slide) <= _SETTLED * tolerance:
        arc[st.KIND] = st.GLIDE
        arc[st.LEVEL] = mirror * z_slide
        arc[st.NET] = pull - sigma_0 * z_slide
        h, turned = glide_end(mirror * w, arc[st.NET], sigma_2, spring, mass, mirror * rate, limit)
    elif (
        kind == ALWAYS_PLASTIC
        and spring * rate == 0.0
        and abs(w) * plant[st.MEMORY] + abs(net) / sigma_0 < _AT_REST * tolerance
    ):
        arc[st.KIND] = st.REST
        h, turned = limit, True
    else:
        arc[st.KIND] = st.SERIES
        plastic = _plastic_branch(mirror * z, mirror * w, contact)
        expand(work, contact, mirror * z, mirror * w, plastic, pull, mass, spring, mirror * rate)
        h, turned = series_end(
            work, contact, plastic, _PER_STEP * tolerance, plant[st.MEMORY], limit
        )
    arc[st.LENGTH], arc[st.ENDING] = h, st.TURN if turned else st.FREE
    return h


@compiled
def within_arc(arc: NDArray, work: NDArray, plant: NDArray, t: float) -> tuple[float, float, float]:
    """Return position x, deflection z (m) and speed w (m/s) at t (s) after the start of the arc."""
    x, z, w, rate = arc[st.ARC_X], arc[st.ARC_Z], arc[st.ARC_W], arc[st.RATE]
    mirror = arc[st.MIRROR]
    if arc[st.KIND] == st.ELASTIC:
        a, b = arc[st.LINE], arc[st.LINE_RATE]
        y, wy = propagate(z - a, w - b, t, arc[st.DELTA], arc[st.KAPPA])
        z1 = a + b * t + y
        return x + (z1 - z) + rate * t, z1, b + wy
    if arc[st.KIND] == st.SERIES:
        return (
            x + mirror * path(work, t) + rate * t,
            mirror * polynomial(work, Z, t),
            mirror * polynomial(work, W, t),
        )
    if arc[st.KIND] == st.GLIDE:
        gone, w1 = glide(
            mirror * w, arc[st.NET], plant[2], plant[st.SPRING], plant[st.MASS], mirror * rate, t
        )
        return x + mirror * gone + rate * t, arc[st.LEVEL], mirror * w1
    return x + rate * t, z, 0.0


@compiled
def arc_end(arc: NDArray, work: NDArray, plant: NDArray) -> tuple[float, float, float]:
    """Return x, z, w at the end of the arc, with what its ending fixes set exactly."""
    x, z, w = within_arc(arc, work, plant, arc[st.LENGTH])
    if arc[st.LEVEL] == arc[st.LEVEL]:
        z = arc[st.LEVEL]
    if arc[st.ENDING] == st.TURN:
        w = 0.0
    return x, z, w


@compiled
def position_integral(
    arc: NDArray, work: NDArray, plant: NDArray, x: float, z: float, w: float
) -> float:
    """Return the integral of the position (m s) over the arc that ends at x, z (m), w (m/s)."""
    sigma_0, mass = plant[0], plant[st.MASS]
    x0, z0, w0 = arc[st.ARC_X], arc[st.ARC_Z], arc[st.ARC_W]
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
        pull = plant[st.FORCE] - sigma_0 * arc[st.LEVEL]
        slid = x - x0 - rate * h
        return (pull * h - plant[2] * slid - mass * (w - w0)) / plant[st.SPRING]
    return straight


@compiled
def standstill(arc: NDArray, work: NDArray, plant: NDArray, sign: float, v_end: float) -> float:
    """Return the first t (s) of the arc at which the runner turns towards sign, nan if none.

    v_end (m/s) is the velocity at the end of the arc.
    """
    w, rate, h = arc[st.ARC_W], arc[st.RATE], arc[st.LENGTH]
    v_start = sign * (w + rate)
    if arc[st.KIND] == st.ELASTIC:
        a, b = arc[st.LINE], arc[st.LINE_RATE]
        y, wy = arc[st.ARC_Z] - a, w - b
        delta, kappa = arc[st.DELTA], arc[st.KAPPA]
        t = next_turn(y, wy, delta, kappa, b + rate, 0.0, h)
        if v_start > 0.0 and t < math.inf:  # that was where it turned away
            t = next_turn(y, wy, delta, kappa, b + rate, t, h)
        return t if t < h else math.nan
    if not v_start < 0.0 <= sign * v_end:
        return math.nan
    mirror = arc[st.MIRROR]
    if arc[st.KIND] == st.SERIES:
        return reaches(work, W, -mirror * rate, h)
    left, right = 0.0, h
    for _ in range(60):
        middle = 0.5 * (left + right)
        if sign * (within_arc(arc, work, plant, middle)[2] + rate) < 0.0:
            left = middle
        else:
            right = middle
    return right


@compiled
def sliding_deflection(contact: Contact) -> float:
    """Return |z| (m) of steady sliding, where alpha z = z_lim; nan if it depends on the speed."""
    _, _, _, z_ba, z_ss, z_k, z_s, _, kind = contact
    if z_k != z_s:
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
    _, _, _, _, z_ss, z_k, z_s, v_s, kind = contact
    if kind == ALWAYS_PLASTIC:
        return True
    if kind == ELASTOPLASTIC_CALC:
        return z >= z_limit(w, z_k, z_s, v_s)
    return z >= z_ss
