# SPDX-License-Identifier: Apache-2.0
"""Bursts and swings: the motion between two turns, precomputed for a few starts.

Relative to the actuator, the motion between two kinks does not depend on time: without a spring,
(z, w) follow from (z, w) alone. So one number determines

- a burst, the arc from |z| = z_ba outward to the next turn: its speed at the start;
- a swing, the motion from a turn with |z| > z_ba to the next one: the deflection at the start.

Both are interpolated by Chebyshev polynomials. Their last coefficients show the convergence;
without it they are not used.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled
from stickslip_ros.solver.branches import branch_at
from stickslip_ros.solver.closed_arcs import elastic_end
from stickslip_ros.solver.layout import BREAKAWAY, NODES, TURN
from stickslip_ros.solver.oscillator import Line, Oscillator
from stickslip_ros.solver.taylor import W, Z, expand, integral, polynomial, step_length, taylor_end

_ANGLES = (np.arange(NODES) + 0.5) * math.pi / NODES
#: Chebyshev points in (-1, 1), and the matrix from values there to coefficients
_POINTS = np.cos(_ANGLES)
_TO_COEFFICIENTS = np.cos(np.outer(np.arange(NODES), _ANGLES)) * 2.0 / NODES
_TO_COEFFICIENTS[0] *= 0.5
#: Shares of the tolerance per cycle: a step on the way to a value, and the tail of a series
_PER_STEP, _TAIL = 1e-4, 0.02
#: Steps of a series to the next turn; most take a few
_MOST_STEPS = 1000
#: Largest exponent of the decay of half a swing; nearer to critical damping no swing gets across
_MOST_DECAY = 500.0
#: Halvings of a table that is not exact enough: narrower ones serve too few swings
_NARROWER = 8


@compiled
def burst(plant: np.record, side: int, w: float) -> tuple[float, float, float]:
    """Return (|z| at the turn, time, path) of the arc from z_ba at speed w > 0 (m/s).

    side is 0 for z > 0, 1 for z < 0; w is at most plant.burst_top.
    """
    return _lookup(plant.burst[side], 2.0 * w / plant.burst_top - 1.0)


@compiled
def swing(plant: np.record, side: int, z: float) -> tuple[float, float, float]:
    """Return (|z| at the turn over there, time, path) of the swing from a turn at |z| = z.

    side is that of the start; nan where no swing from there goes plastic or none is tabulated.
    """
    excess = z - plant.swing_from[side]
    top = plant.swing_top[side]
    if not 0.0 < excess <= top * top:
        return math.nan, math.nan, math.nan
    return _lookup(plant.swing[side], 2.0 * math.sqrt(excess) / top - 1.0)


@compiled
def _lookup(table: NDArray, t: float) -> tuple[float, float, float]:
    """Evaluate three Chebyshev series, (3, NODES), at t in [-1, 1] by Clenshaw's recurrence."""
    a1, a2, b1, b2, c1, c2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    twice = 2.0 * t
    for k in range(NODES - 1, 0, -1):
        a1, a2 = twice * a1 - a2 + table[0, k], a1
        b1, b2 = twice * b1 - b2 + table[1, k], b1
        c1, c2 = twice * c1 - c2 + table[2, k], c1
    return (
        t * a1 - a2 + table[0, 0],
        t * b1 - b2 + table[1, 0],
        t * c1 - c2 + table[2, 0],
    )


@compiled
def _fit(plant: np.record, table: NDArray, values: NDArray, scales: tuple[float, float]) -> bool:
    """Store the coefficients of three functions, values (3, NODES); return whether they suffice.

    scales turn what the tails leave out into m: of the first and last function, and of the time.
    """
    length, speed = scales
    allowed, enough = _TAIL * plant.tolerance, True
    for row in range(3):
        for k in range(NODES):
            total = 0.0
            for j in range(NODES):
                total += _TO_COEFFICIENTS[k, j] * values[row, j]
            table[row, k] = total
        tail = abs(table[row, NODES - 1]) + abs(table[row, NODES - 2])
        enough = enough and tail * (speed if row == 1 else length) <= allowed
    return enough


@compiled
def learn_bursts(plant: np.record, work: NDArray, side: int) -> bool:
    """Fill the table of bursts on a side; return whether it is good enough."""
    pull = plant.force if side == 0 else -plant.force
    if pull >= plant.sigma_0 * plant.z_ba:
        return False  # the load alone goes plastic: a burst need not turn
    values = np.empty((3, NODES))
    for j in range(NODES):
        w = 0.5 * plant.burst_top * (1.0 + _POINTS[j])
        z, time, dr = _to_turn(plant, work, plant.z_ba, w, pull)
        if math.isnan(z):
            return False
        values[0, j], values[1, j], values[2, j] = z, time, dr
    return _fit(plant, plant.burst[side], values, (1.0, plant.burst_top))


@compiled
def learn_swings(plant: np.record, side: int) -> None:
    """Swings that begin on side: elastic to -z_ba, then a burst of the other side."""
    z_ba, z_slide = plant.z_ba, plant.z_slide
    line = Line(plant.force / plant.sigma_0 * (1.0 if side == 0 else -1.0), 0.0)
    o = Oscillator(plant.delta, plant.kappa, plant.omega)
    decay = min(o.delta * math.pi / o.omega, _MOST_DECAY)
    first = line.a + (z_ba + line.a) * math.exp(decay)
    plant.swing_from[side], plant.swing_top[side] = first, 0.0
    if not first < z_slide:
        return
    top = math.sqrt(z_slide - first)
    values = np.empty((3, NODES))
    for j in range(NODES):
        s = 0.5 * top * (1.0 + _POINTS[j])
        z = first + s * s
        end = elastic_end(z, 0.0, line, o, z_ba, math.inf)
        if end.event != BREAKAWAY or not -end.w <= plant.burst_top:
            return
        z_turn, t_burst, r_burst = burst(plant, 1 - side, -end.w)
        values[0, j], values[1, j] = z_turn, end.t + t_burst
        values[2, j] = -(z + z_ba) - r_burst
    if _fit(plant, plant.swing[side], values, (1.0, plant.burst_top)):
        plant.swing_top[side] = top


@compiled
def reversal(plant: np.record, side: int, distance: float) -> tuple[float, float, float]:
    """Return (distance at the turn, time, path) of a swing of a law that is always plastic.

    distance (m) is that of z from where the load holds it, at a turn; nan where none is tabulated.
    """
    top = plant.swing_top[side]
    if not 0.0 < distance <= top:
        return math.nan, math.nan, math.nan
    left, time, dr = _lookup(plant.swing[side], 2.0 * distance / top - 1.0)
    return left * distance, time, dr * distance


@compiled
def learn_reversals(plant: np.record, work: NDArray, side: int) -> None:
    """Fill the table of swings from one turn to the next, as wide as the tolerance allows.

    side is 0 for those that begin above rest and go down, 1 for the others. Kept are the shares of
    the distance, so that a swing that dies away does so to nothing.
    """
    pull = -plant.force if side == 0 else plant.force
    rest = pull / plant.sigma_0
    top = min(plant.z_k, plant.z_s) - abs(rest)
    values = np.empty((3, NODES))
    for _ in range(_NARROWER):
        whole = top > 0.0
        for j in range(NODES):
            distance = 0.5 * top * (1.0 + _POINTS[j])
            z, time, dr = _to_turn(plant, work, rest - distance, 0.0, pull)
            whole = whole and z == z
            values[0, j], values[1, j] = (z - rest) / distance, time
            values[2, j] = dr / distance
        if whole and _fit(plant, plant.swing[side], values, (top, top / plant.inv_omega)):
            plant.swing_top[side] = top
            return
        top *= 0.5


@compiled
def _to_turn(
    plant: np.record, work: NDArray, z: float, w: float, pull: float
) -> tuple[float, float, float]:
    """Return z at the next turn after z (m), w (m/s), mirrored, and time and path up to there."""
    time = dr = 0.0
    for _ in range(_MOST_STEPS):
        branch = branch_at(plant, z, w, pull, 0.0, 1.0)
        expand(work, plant, branch, z, w)
        h = step_length(work, _PER_STEP * plant.tolerance, plant.inv_omega, branch.stribeck)
        end = taylor_end(work, plant, branch, h)
        z, w = polynomial(work, Z, end.t), polynomial(work, W, end.t)
        time += end.t
        dr += integral(work, W, end.t)
        if end.event == TURN:
            return z, time, dr
    return math.nan, 0.0, 0.0
