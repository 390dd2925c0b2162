# SPDX-License-Identifier: Apache-2.0
"""Tables of slides, bursts and swings, computed once for a plant.

A slide goes from z_ba into steady sliding, so fast that the runner hardly reacts. While |z| grows,
dz/dr = 1 - alpha z / z_lim holds along the path r at any speed, so each contact has one curve z(r).
It is stored as a row of points, with the integrals that give the work of the forces and the time of
any slide.

Without a spring, the motion between two kinks follows from (z, w) alone, so one number determines

- a burst, the arc from |z| = z_ba outward to the next turn: its speed at the start;
- a swing, the motion from a turn with |z| > z_ba to the next one: the deflection at the start.

Both are interpolated by Chebyshev polynomials. Their last coefficients show the convergence;
without it they are not used.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.compiled import compiled
from stickslip_ros.physics.solver.branches import branch_at
from stickslip_ros.physics.solver.closed_arcs import elastic_end
from stickslip_ros.physics.solver.layout import BREAKAWAY, NODES, SLIDE_POINTS, SLIDE_SIZE, TURN
from stickslip_ros.physics.solver.oscillator import Line, Oscillator
from stickslip_ros.physics.solver.taylor import (
    Branch,
    W,
    Z,
    expand,
    integral,
    polynomial,
    step_length,
    taylor_end,
)

#: Gauss points in (0, 1) and their weights, as numbers: NumPy finds them by linear algebra, which
#: rounds differently with the processor
_HALF = np.array([0.18343464249564978, 0.525532409916329, 0.7966664774136267, 0.9602898564975362])
_SHARES = np.array(
    [0.36268378337836166, 0.3137066458778869, 0.22238103445337443, 0.10122853629037706]
)
_GAUSS = 0.5 * np.concatenate([-_HALF[::-1], _HALF]) + 0.5
_WEIGHTS = 0.5 * np.concatenate([_SHARES[::-1], _SHARES])
#: Error of a step of a series on the way to a table, as a fraction of the tolerance per cycle
_PER_STEP = 1e-4
#: What a slide may leave out, as the same fraction
_LEFT_OUT = 2e-3
#: The tail of a Chebyshev series, as the same fraction
_TAIL = 0.02
#: Largest skewness of the work of the forces along a slide; at constant z the work is linear
_SKEW = 0.03
_ANGLES = (np.arange(NODES) + 0.5) * math.pi / NODES
#: Chebyshev points in (-1, 1), and the matrix from values there to coefficients
_POINTS = np.array([math.cos(angle) for angle in _ANGLES])
_TO_COEFFICIENTS = np.array([[math.cos(k * angle) for angle in _ANGLES] for k in range(NODES)])
_TO_COEFFICIENTS = _TO_COEFFICIENTS * 2.0 / NODES
_TO_COEFFICIENTS[0] *= 0.5
#: Steps of a series to the next turn; most take a few
_MOST_STEPS = 1000
#: Largest exponent of the decay of half a swing; nearer to critical damping no swing gets across
_MOST_DECAY = 500.0
#: Halvings of a table that is not exact enough: narrower ones serve too few swings
_NARROWER = 8


class Slide(NamedTuple):
    """The end of a slide, mirrored."""

    t: float  #: s, nan if there is no such slide
    path: float  #: m
    z: float  #: m
    w: float  #: m/s


@compiled
def slide(plant: np.record, z: float, w: float, pull: float, limit: float) -> Slide:
    """Return the end of a slide from z > 0 (m) at speed w > 0 (m/s), within limit (s).

    z has to be one of the known points; the slide ends at the furthest of them that is reached
    within limit (s) and whose error is small enough. pull is the mirrored external force (N).
    """
    start = _point(plant, z)
    if plant.slide[start, 1] == z:
        for at in range(plant.slide_count - 1, start, -1):
            if plant.slide[at, 0] - plant.slide[start, 0] < w * limit:
                end = _slide_to(plant, w, pull, start, at)
                if end.t <= limit:
                    return end
    return Slide(math.nan, 0.0, 0.0, 0.0)


@compiled
def point_above(plant: np.record, z: float) -> float:
    """Return z (m) of the first known point of the slide above z > 0, inf if there is none."""
    at = _point(plant, z)
    if plant.slide[at, 1] <= z:
        at += 1
    return plant.slide[at, 1] if at < plant.slide_count else math.inf


@compiled
def _point(plant: np.record, z: float) -> int:
    """Return which is the first point at or above z, else the last one."""
    at = 0
    while at < plant.slide_count - 1 and plant.slide[at, 1] < z:
        at += 1
    return at


@compiled
def _slide_to(plant: np.record, w: float, pull: float, start: int, at: int) -> Slide:
    """Return the end at the known point ``at``, by perturbation of a constant speed.

    w w' = g' - c w z' along r, with g = p r - k Z1 the work of the forces, p, k, c of the mass. To
    second order w(r) = w + w1 + w2, where w1 = g / w - c d and d = z - z0, all from the start on.

    The time is the integral of 1 / w(r). w^2 = w0^2 + 2 G, with G = g - c times the integral of w
    over z. It is expanded around its mean, so the first order vanishes, and the third nearly does:
    G is almost linear in r.
    """
    p, k, c = pull / plant.mass, plant.sigma_0 / plant.mass, plant.sigma_1 / plant.mass
    # the stored integrals, moved to the start
    first, last = plant.slide[start], plant.slide[at]
    r0, z0, z10 = first[0], first[1], first[2]
    r, z, z1 = last[0] - r0, last[1], last[2] - z10
    z2_whole, zz = last[3] - first[3], last[4] - first[4]
    z2 = z2_whole - z10 * r
    rz1 = last[5] - first[5] - r0 * z2_whole - z10 * (0.5 * r * r)
    z1z1 = last[6] - first[6] - 2.0 * z10 * z2_whole + z10 * z10 * r
    zzz1 = last[7] - first[7] - z10 * zz
    rzz = last[8] - first[8] - r0 * zz
    d, g = z - z0, p * r - k * z1
    damped, loaded = c * d / w, abs(p) * r / (w * w)
    share = abs(g) / (w * w)
    third = (share + damped) * (share + damped) * (share + damped)
    # what the orders left out come to in position, by the error in speed and in time
    unsure = (third + share * (damped + loaded)) * plant.inv_omega * c * d
    most = loaded + k * z1 / (w * w) + damped
    third = most * most * (_SKEW * most + damped)
    unsure += third * r * (1.0 + plant.inv_omega * k * z / w)
    if not unsure <= _LEFT_OUT * plant.tolerance:
        return Slide(math.nan, 0.0, 0.0, 0.0)
    # the balance of energy with the integral of w over z
    w_dz = w * d + (g * z - p * z1 + k * zz) / w - 0.5 * c * d * d
    w_dz -= 0.5 * k * k * (z1 * z1 * z - 2.0 * zzz1) / (w * w * w)
    w_end = math.sqrt(w * w + 2.0 * (g - c * w_dz))
    rz = r * z1 - z2
    rd, d1 = rz - 0.5 * z0 * r * r, z1 - z0 * r
    g_sum = 0.5 * p * r * r - k * z2
    gg = p * p * r * r * r / 3.0 - 2.0 * p * k * rz1 + k * k * z1z1
    gd = p * rd - k * (0.5 * z1 * z1 - z0 * z2)
    dd = zz - 2.0 * z0 * z1 + z0 * z0 * r
    slope_d = p * d1 - k * (zz - z0 * z1)
    r_slope_d = p * rd - k * (rzz - z0 * rz)
    one = g_sum - c * w * d1
    mean = (one - c / w * (gd - r * slope_d + r_slope_d) + 0.5 * c * c * dd) / r
    spread = gg - 2.0 * c * w * gd + c * c * w * w * dd - one * one / r
    square = w * w + 2.0 * mean
    return Slide((r + 1.5 * spread / (square * square)) / math.sqrt(square), r, z, w_end)


@compiled
def learn_slide(plant: np.record, work: NDArray) -> bool:
    """Compute z(r) from z_ba to steady sliding; store points on the way for `slide`."""
    z = plant.z_ba
    r, z1, z2, zz, rz1, z1z1, zzz1, rzz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(SLIDE_SIZE):
        plant.slide[0, k] = z if k == 1 else 0.0
    # An infinite mass keeps w at 1 m/s, so that time is the path.
    branch = Branch(plant.z_ss, False, False, False, False, z, math.inf, 0.0, 0.0, 0.0)
    for piece in range(1, SLIDE_POINTS):
        expand(work, plant, branch, z, 1.0)
        h = step_length(work, _PER_STEP * plant.tolerance, 0.0, False)
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
        at = plant.slide[piece]
        at[0], at[1], at[2], at[3], at[4] = r, z, z1, z2, zz
        at[5], at[6], at[7], at[8] = rz1, z1z1, zzz1, rzz
        if z >= plant.z_slide - plant.approach_reach:
            plant.slide_count = piece + 1
            return True
    return False


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
