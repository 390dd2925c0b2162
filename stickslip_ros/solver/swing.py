# SPDX-License-Identifier: Apache-2.0
"""Bursts and swings: what happens between two turns is solved ahead, for a few starts.

In the frame of the actuator the motion between two kinks has no clock of its own: without a spring
(z, w) follow from (z, w) alone. So one number decides over

- a burst, the arc from |z| = z_ba outward to the next turn: its speed at the start;
- a swing, the way from a turn with |z| > z_ba over to the next one: the deflection at the start.

Both are interpolated by Chebyshev polynomials. How well these have converged is seen from their
last coefficients; where they do not meet the tolerance they are not used.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled
from stickslip_ros.model.friction import Contact
from stickslip_ros.solver import state as st
from stickslip_ros.solver.elastic import elastic_end
from stickslip_ros.solver.series import W, Z, expand, path, polynomial, series_end

_N = st.NODES
_ANGLES = (np.arange(_N) + 0.5) * math.pi / _N
#: Chebyshev points in (-1, 1), and what turns values there into coefficients
_POINTS = np.cos(_ANGLES)
_TO_COEFFICIENTS = np.cos(np.outer(np.arange(_N), _ANGLES)) * 2.0 / _N
_TO_COEFFICIENTS[0] *= 0.5
#: Shares of the tolerance per cycle: a step on the way to a value, and the tail of a series
_PER_STEP, _TAIL = 1e-3, 0.02


@compiled
def burst(plant: NDArray, side: int, w: float) -> tuple[float, float, float]:
    """Return (|z| at the turn, time, path) of the arc from z_ba at speed w > 0 (m/s).

    side is 0 for z > 0, 1 for z < 0; w is at most plant[BURST_TOP].
    """
    at = st.SIDES + side * st.SIDE_SIZE + st.BURST
    return _lookup(plant, at, 2.0 * w / plant[st.BURST_TOP] - 1.0)


@compiled
def swing(plant: NDArray, side: int, z: float) -> tuple[float, float, float]:
    """Return (|z| at the turn over there, time, path) of the swing from a turn at |z| = z.

    side is that of the start; nan where no swing from there goes plastic or none is tabulated.
    """
    at = st.SIDES + side * st.SIDE_SIZE
    excess = z - plant[at + st.SWING_FROM]
    top = plant[at + st.SWING_TOP]
    if not 0.0 < excess <= top * top:
        return math.nan, math.nan, math.nan
    return _lookup(plant, at + st.SWING, 2.0 * math.sqrt(excess) / top - 1.0)


@compiled
def _lookup(plant: NDArray, at: int, t: float) -> tuple[float, float, float]:
    """Evaluate three neighbouring Chebyshev series at t in [-1, 1], by Clenshaw's recurrence."""
    a1, a2, b1, b2, c1, c2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    twice = 2.0 * t
    for k in range(_N - 1, 0, -1):
        a1, a2 = twice * a1 - a2 + plant[at + k], a1
        b1, b2 = twice * b1 - b2 + plant[at + _N + k], b1
        c1, c2 = twice * c1 - c2 + plant[at + 2 * _N + k], c1
    return (
        t * a1 - a2 + plant[at],
        t * b1 - b2 + plant[at + _N],
        t * c1 - c2 + plant[at + 2 * _N],
    )


@compiled
def _fit(plant: NDArray, at: int, values: NDArray) -> NDArray:
    """Store the coefficients of three functions, values (3, NODES); return their tails."""
    tails = np.empty(3)
    for row in range(3):
        for k in range(_N):
            total = 0.0
            for j in range(_N):
                total += _TO_COEFFICIENTS[k, j] * values[row, j]
            plant[at + row * _N + k] = total
        tails[row] = abs(plant[at + row * _N + _N - 1]) + abs(plant[at + row * _N + _N - 2])
    return tails


@compiled
def learn_bursts(plant: NDArray, work: NDArray, contact: Contact, side: int) -> bool:
    pull = plant[st.FORCE] if side == 0 else -plant[st.FORCE]
    if pull >= contact[0] * contact[3]:
        return False  # the load alone goes plastic: a burst need not turn
    values = np.empty((3, _N))
    for j in range(_N):
        z, w = contact[3], 0.5 * plant[st.BURST_TOP] * (1.0 + _POINTS[j])
        t_sum, r_sum = 0.0, 0.0
        turned = False
        for _ in range(1000):
            expand(work, contact, z, w, False, pull, plant[st.MASS], 0.0, 0.0)
            h, turned = series_end(
                work,
                contact,
                False,
                _PER_STEP * plant[st.TOLERANCE],
                plant[st.MEMORY],
                math.inf,
            )
            z, w = polynomial(work, Z, h), polynomial(work, W, h)
            t_sum += h
            r_sum += path(work, h)
            if turned:
                break
        if not turned:
            return False
        values[0, j], values[1, j], values[2, j] = z, t_sum, r_sum
    tails = _fit(plant, st.SIDES + side * st.SIDE_SIZE + st.BURST, values)
    return _fine(plant, tails)


@compiled
def learn_swings(plant: NDArray, contact: Contact, side: int) -> None:
    """Swings that begin on side: elastic to -z_ba, then a burst of the other side."""
    at = st.SIDES + side * st.SIDE_SIZE
    z_ba, z_slide = contact[3], plant[st.Z_SLIDE]
    a = plant[st.FORCE] / contact[0] * (1.0 if side == 0 else -1.0)
    delta, kappa, omega = plant[st.DELTA], plant[st.KAPPA], plant[st.OMEGA]
    first = a + (z_ba + a) * math.exp(delta * math.pi / omega)
    plant[at + st.SWING_FROM], plant[at + st.SWING_TOP] = first, 0.0
    if not first < z_slide:
        return
    top = math.sqrt(z_slide - first)
    values = np.empty((3, _N))
    for j in range(_N):
        s = 0.5 * top * (1.0 + _POINTS[j])
        z = first + s * s
        t, ending, _, w, _, _ = elastic_end(z, 0.0, a, 0.0, delta, kappa, omega, z_ba, math.inf)
        if ending != st.BREAKAWAY or not -w <= plant[st.BURST_TOP]:
            return
        z_turn, t_burst, r_burst = burst(plant, 1 - side, -w)
        values[0, j], values[1, j] = z_turn, t + t_burst
        values[2, j] = -(z + z_ba) - r_burst
    if _fine(plant, _fit(plant, at + st.SWING, values)):
        plant[at + st.SWING_TOP] = top


@compiled
def _fine(plant: NDArray, tails: NDArray) -> bool:
    allowed = _TAIL * plant[st.TOLERANCE]
    return tails[0] <= allowed and tails[1] * plant[st.BURST_TOP] <= allowed and tails[2] <= allowed
