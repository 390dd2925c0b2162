# SPDX-License-Identifier: Apache-2.0
"""Slides: from z_ba on into steady sliding, so fast that the runner hardly reacts.

While |z| grows, dz/dr = 1 - alpha z / z_lim holds along the path r, whatever the speed: z(r) is one
curve for each contact. It is followed once; what is kept of it is a row of points with the
integrals from which the work of the forces and the time of any such slide follow.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled
from stickslip_ros.model.friction import Contact
from stickslip_ros.solver import state as st
from stickslip_ros.solver.series import Z, expand, integral, polynomial, step_length

#: Gauss points in (0, 1)
_GAUSS, _WEIGHTS = (0.5 * np.array(part) for part in np.polynomial.legendre.leggauss(8))
_GAUSS = _GAUSS + 0.5
#: Shares of the tolerance per cycle: a piece of the curve, what a slide may leave out, and how
#: near to steady sliding its last point is.
_PER_STEP, _LEFT_OUT, _SETTLED = 1e-3, 0.02, 1e-3


@compiled
def slide(
    plant: NDArray, contact: Contact, z: float, w: float, pull: float, limit: float
) -> tuple[float, float, float, float]:
    """Return (time, path, z, w) at the end of a slide from z > 0 (m) at speed w > 0 (m/s).

    z has to be one of the known points; the slide ends at the furthest of them that is reached
    within limit (s) and whose error is small enough. pull is the mirrored external force (N). The
    time is nan where there is no such point.
    """
    start = _point(plant, z)
    if plant[start + 1] != z:
        return math.nan, 0.0, 0.0, 0.0
    last = st.SLIDE + (int(plant[st.SLIDE_COUNT]) - 1) * st.SLIDE_SIZE
    for at in range(last, start, -st.SLIDE_SIZE):
        if plant[at] - plant[start] < w * limit:
            t, r, z_end, w_end = _slide_to(plant, contact, w, pull, start, at)
            if t <= limit:
                return t, r, z_end, w_end
    return math.nan, 0.0, 0.0, 0.0


@compiled
def point_above(plant: NDArray, z: float) -> float:
    """Return z (m) of the first known point of the slide above z > 0, inf if there is none."""
    at = _point(plant, z)
    if plant[at + 1] <= z:
        at += st.SLIDE_SIZE
    if at >= st.SLIDE + int(plant[st.SLIDE_COUNT]) * st.SLIDE_SIZE:
        return math.inf
    return plant[at + 1]


@compiled
def _point(plant: NDArray, z: float) -> int:
    """Return where the first point at or above z stands, else the last one."""
    at = st.SLIDE
    last = st.SLIDE + (int(plant[st.SLIDE_COUNT]) - 1) * st.SLIDE_SIZE
    while at < last and plant[at + 1] < z:
        at += st.SLIDE_SIZE
    return at


@compiled
def _slide_to(
    plant: NDArray, contact: Contact, w: float, pull: float, start: int, at: int
) -> tuple[float, float, float, float]:
    """Return (time, path, z, w) at the known point ``at``, by perturbation of a constant speed.

    w w' = g' - c w z' along r, with g = p r - k Z1 the work of the forces, p, k, c of the mass. To
    second order w(r) = w + w1 + w2, where w1 = g / w - c d and d = z - z0, all from the start on.
    """
    sigma_0, sigma_1, _, _, _, _, _, _, _, _ = contact
    mass, memory = plant[st.MASS], plant[st.MEMORY]
    p, k, c = pull / mass, sigma_0 / mass, sigma_1 / mass
    # the integrals, moved to the start
    r0, z0, z10 = plant[start], plant[start + 1], plant[start + 2]
    r, z, z1 = plant[at] - r0, plant[at + 1], plant[at + 2] - z10
    z2_whole, zz = plant[at + 3] - plant[start + 3], plant[at + 4] - plant[start + 4]
    z2 = z2_whole - z10 * r
    rz1 = plant[at + 5] - plant[start + 5] - r0 * z2_whole - z10 * (0.5 * r * r)
    z1z1 = plant[at + 6] - plant[start + 6] - 2.0 * z10 * z2_whole + z10 * z10 * r
    zzz1 = plant[at + 7] - plant[start + 7] - z10 * zz
    rzz = plant[at + 8] - plant[start + 8] - r0 * zz
    d = z - z0
    g = p * r - k * z1
    damped, loaded = c * d / w, abs(p) * r / (w * w)
    share = abs(g) / (w * w)
    third = (share + damped) * (share + damped) * (share + damped)
    # what the orders left out come to in position, by the error in speed and in time
    unsure = (third + share * (damped + loaded)) * memory * c * d
    unsure += third * memory * k * z * r / w
    if not unsure <= _LEFT_OUT * plant[st.TOLERANCE]:
        return math.nan, 0.0, 0.0, 0.0
    # the balance of energy with the integral of w over z
    w_dz = w * d + (g * z - p * z1 + k * zz) / w - 0.5 * c * d * d
    w_dz -= 0.5 * k * k * (z1 * z1 * z - 2.0 * zzz1) / (w * w * w)
    w_end = math.sqrt(w * w + 2.0 * (g - c * w_dz))
    # the time: integral of 1 / w(r)
    rz = r * z1 - z2
    rd, d1 = rz - 0.5 * z0 * r * r, z1 - z0 * r
    g_sum = 0.5 * p * r * r - k * z2
    gg = p * p * r * r * r / 3.0 - 2.0 * p * k * rz1 + k * k * z1z1
    gd = p * rd - k * (0.5 * z1 * z1 - z0 * z2)
    dd = zz - 2.0 * z0 * z1 + z0 * z0 * r
    slope_d = p * d1 - k * (zz - z0 * z1)
    r_slope_d = p * rd - k * (rzz - z0 * rz)
    first = g_sum / w - c * d1
    second = 1.5 * gg / (w * w) - c / w * (2.0 * gd + r * slope_d - r_slope_d) + c * c * dd
    return (r - first / w + second / (w * w)) / w, r, z, w_end


@compiled
def learn_slide(plant: NDArray, work: NDArray, contact: Contact) -> bool:
    """Follow z(r) from z_ba to steady sliding; keep points on the way with what `slide` needs."""
    z, z_slide = contact[3], plant[st.Z_SLIDE]
    r, z1, z2, zz, rz1, z1z1, zzz1, rzz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(st.SLIDE_SIZE):
        plant[st.SLIDE + k] = 0.0
    plant[st.SLIDE + 1] = z
    for piece in range(1, st.SLIDE_POINTS):
        # with an infinite mass w stays 1 m/s, and time is path
        expand(work, contact, z, 1.0, False, 0.0, math.inf, 0.0, 0.0)
        h = step_length(work, _PER_STEP * plant[st.TOLERANCE], 0.0)
        for k in range(len(_GAUSS)):
            t = h * _GAUSS[k]
            weight = h * _WEIGHTS[k]
            zt = polynomial(work, Z, t)
            z1t = z1 + integral(work, Z, t)
            z2 += weight * z1t
            zz += weight * zt * zt
            rz1 += weight * (r + t) * z1t
            z1z1 += weight * z1t * z1t
            zzz1 += weight * zt * zt * z1t
            rzz += weight * (r + t) * zt * zt
        z1 += integral(work, Z, h)
        r += h
        z = polynomial(work, Z, h)
        settled = z >= z_slide - _SETTLED * plant[st.TOLERANCE]
        if settled:
            z = z_slide
        at = st.SLIDE + piece * st.SLIDE_SIZE
        plant[at], plant[at + 1], plant[at + 2], plant[at + 3] = r, z, z1, z2
        plant[at + 4], plant[at + 5], plant[at + 6], plant[at + 7] = zz, rz1, z1z1, zzz1
        plant[at + 8] = rzz
        if settled:
            plant[st.SLIDE_COUNT] = piece + 1
            return True
    return False
