# SPDX-License-Identifier: Apache-2.0
"""Arcs with alpha > 0 where an explicit series would creep: Radau IIA of order 5, L-stable.

A strongly damped contact, and one that slides many times its deflection while little happens,
relaxes much faster than anything else moves. A step of this kind is as long as the motion allows.
Each is taken twice, at once and in two halves; the halves are kept, the difference is their error.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.arrays import add_up
from stickslip_ros.base.compiled import compiled
from stickslip_ros.physics.laws.law import ALWAYS_PLASTIC
from stickslip_ros.physics.model.friction import alpha_at, z_limit
from stickslip_ros.physics.solver.layout import STIFF
from stickslip_ros.physics.solver.oscillator import bisection
from stickslip_ros.physics.solver.taylor import BAND, Branch, W, Z, limit_and_slope

_ROOT = math.sqrt(6.0)
_A = np.array(
    [
        [(88 - 7 * _ROOT) / 360, (296 - 169 * _ROOT) / 1800, (-2 + 3 * _ROOT) / 225],
        [(296 + 169 * _ROOT) / 1800, (88 + 7 * _ROOT) / 360, (-2 - 3 * _ROOT) / 225],
        [(16 - _ROOT) / 36, (16 + _ROOT) / 36, 1 / 9],
    ]
)
#: Its square, written out: a product of linear algebra rounds differently with the processor
_A_A = np.array([[add_up(row[k] * _A[k][j] for k in range(3)) for j in range(3)] for row in _A])
_C = np.array([(4 - _ROOT) / 10, (4 + _ROOT) / 10, 1.0])
#: Newton's iterations, at most
_ITERATIONS = 15
#: Their last correction, as a fraction of the error allowed
_CORRECTION = 1e-3
#: What two halves of a step of fifth order are better than the whole, 2^5 - 1 (Richardson)
_BETTER = 31.0
#: Part of the tolerance to which a step is solved again for an event or a sample
_EXACT = 1e-4
#: Error allowed in a step, as a fraction of the tolerance per cycle
_PER_STEP = 1e-4
#: Least length of an implicit step that pays off, in steps of a series: it costs
#: as much as that many
_WORTH = 10.0
#: An implicit step is tried where z and w change by less than this fraction in a step of the series
_SLOW = 0.3
#: Arcs until the next try after a step that did not pay off
_WAIT = 20.0
#: Lengths that are tried for one arc: tenths of tenths, down to less than any motion takes
_TRIES = 60
#: Largest factor from one step to the next
_GROWS = 5.0
#: Smallest factor from one step to the next
_SHRINKS = 0.1
#: Step taken, as a fraction of the one whose error would be just allowed: so the next try succeeds
_SAFETY = 0.9
#: Power of its length with which the error of a step grows
_ORDER = 6.0
#: Error (m) that counts as none
_NO_ERROR = 1e-300
#: Cost of an implicit step in the budget, in arcs of other kinds
_COST = 15
#: Borders that a step may cross
_AT_REST_W, _AT_EDGE, _AT_Z_SS, _AT_LIMIT, _AT_Z_BA = 1, 2, 3, 4, 5


class Moved(NamedTuple):
    """The state after a step, mirrored; z is nan if Newton's method did not converge."""

    t: float  #: since the start of the arc, s
    z: float  #: m
    w: float  #: m/s
    path: float  #: integral of w, m
    moment: float  #: integral of the path, m s


@compiled
def rates(plant: np.record, branch: Branch, z: float, w: float) -> tuple[float, float, float]:
    """Return z' (m/s) on a branch at z (m), w (m/s), and its derivatives by z and w."""
    limit, bend = limit_and_slope(w, plant) if branch.stribeck else (plant.z_k, 0.0)
    alpha, alpha_z, alpha_w = 1.0, 0.0, 0.0
    if not branch.plastic:
        width = (limit if branch.calc else branch.z_ss) - plant.z_ba
        angle = math.pi * (z - branch.sine_start) / width
        alpha, by_angle = alpha_at(angle)
        alpha_z = by_angle * math.pi / width
        if branch.calc:
            alpha_w = -by_angle * angle / width * bend
    share = alpha * z / limit
    by_w = 1.0 - share - w * z / limit * (alpha_w - alpha / limit * bend)
    return w * (1.0 - share), -w * (alpha_z * z + alpha) / limit, by_w


@compiled
def stiff_step(
    plant: np.record,
    branch: Branch,
    state: tuple[float, float],
    h: float,
    weight: float,
    error: float,
) -> tuple[Moved, float]:
    """Return the state after h (s) from two half steps, and its difference to a whole step (m).

    state is z (m) and w (m/s) before; weight (s) is that of w; error (m) the allowed difference.
    """
    values, start = np.empty((3, 2)), Moved(0.0, state[0], state[1], 0.0, 0.0)
    whole = _radau(plant, branch, start, h, values, error)
    first = _radau(plant, branch, start, 0.5 * h, values, error)
    end = _radau(plant, branch, first, 0.5 * h, values, error)
    off = max(abs(end.z - whole.z), weight * abs(end.w - whole.w), abs(end.path - whole.path))
    return end, off / _BETTER


@compiled
def _radau(
    plant: np.record, branch: Branch, start: Moved, h: float, stages: NDArray, error: float
) -> Moved:
    """Return the state one step of h (s) after start.

    stages (3, 2) is scratch: z and h w of each.
    """
    residual, slopes = np.empty(6), np.empty((3, 4))
    matrix, per_mass = np.empty((6, 6)), 1.0 / branch.mass
    for i in range(3):
        stages[i, 0], stages[i, 1] = start.z, h * start.w
    for _ in range(_ITERATIONS):
        _slopes(plant, branch, start, h, stages, slopes)
        for i in range(3):
            z_sum, w_sum = 0.0, 0.0
            for j in range(3):
                z_sum += _A[i, j] * slopes[j, 0]
                w_sum += _A[i, j] * slopes[j, 3]
            residual[i] = start.z + h * z_sum - stages[i, 0]
            residual[3 + i] = h * start.w + h * h * w_sum - stages[i, 1]
        for i in range(3):  # of Newton's method, for z and h w of the three stages
            for j in range(3):
                a, by_z, by_w = _A[i, j], slopes[j, 1], slopes[j, 2]
                w_by_z = -(plant.sigma_0 + plant.sigma_1 * by_z) * per_mass
                w_by_w = -(plant.sigma_1 * by_w + plant.sigma_2) * per_mass
                one = 1.0 if i == j else 0.0
                matrix[i, j] = one - h * a * by_z
                matrix[i, 3 + j] = -a * by_w
                matrix[3 + i, j] = -h * h * a * w_by_z
                swing = h * h * branch.spring * per_mass * _A_A[i, j]
                matrix[3 + i, 3 + j] = one - h * a * w_by_w + swing
        _solve(matrix, residual)
        largest = 0.0
        for i in range(3):
            stages[i, 0] += residual[i]
            stages[i, 1] += residual[3 + i]
            largest = max(largest, abs(residual[i]), abs(residual[3 + i]))
        if not largest < math.inf:
            break
        if largest <= _CORRECTION * error:
            path, moment = start.path, start.moment + h * start.path
            for j in range(3):
                path += _A[2, j] * stages[j, 1]
                moment += h * _A_A[2, j] * stages[j, 1]
            return Moved(start.t + h, stages[2, 0], stages[2, 1] / h, path, moment)
    return Moved(math.nan, math.nan, math.nan, math.nan, math.nan)


@compiled
def _slopes(
    plant: np.record, branch: Branch, start: Moved, h: float, stages: NDArray, slopes: NDArray
) -> None:
    """Fill slopes (3, 4) with z', its derivatives by z and w, and w' at each stage."""
    for i in range(3):
        z, w = stages[i, 0], stages[i, 1] / h
        x = start.path + branch.rate * (start.t + _C[i] * h)
        for j in range(3):
            x += _A[i, j] * stages[j, 1]
        z_rate, by_z, by_w = rates(plant, branch, z, w)
        net = branch.pull - plant.sigma_0 * z - plant.sigma_1 * z_rate - plant.sigma_2 * w
        slopes[i, 0], slopes[i, 1], slopes[i, 2] = z_rate, by_z, by_w
        slopes[i, 3] = (net - branch.spring * x) / branch.mass


@compiled
def _solve(matrix: NDArray, right: NDArray) -> None:
    """Solve a system of linear equations in place, with partial pivoting."""
    size = len(right)
    for k in range(size):
        pivot = k
        for i in range(k + 1, size):
            if abs(matrix[i, k]) > abs(matrix[pivot, k]):
                pivot = i
        if pivot != k:
            for j in range(k, size):
                matrix[k, j], matrix[pivot, j] = matrix[pivot, j], matrix[k, j]
            right[k], right[pivot] = right[pivot], right[k]
        for i in range(k + 1, size):
            factor = matrix[i, k] / matrix[k, k]
            for j in range(k + 1, size):
                matrix[i, j] -= factor * matrix[k, j]
            right[i] -= factor * right[k]
    for k in range(size - 1, -1, -1):
        for j in range(k + 1, size):
            right[k] -= matrix[k, j] * right[j]
        right[k] /= matrix[k, k]


@compiled
def resolve(arc: np.record, plant: np.record, branch: Branch, t: float) -> Moved:
    """Return the state after t (s) of an implicit arc on a branch, mirrored."""
    state = arc.mirror * arc.z, arc.mirror * arc.w
    found = stiff_step(plant, branch, state, t, plant.inv_omega, _EXACT * plant.tolerance)[0]
    if math.isnan(found.z):  # rounding hides so small a correction; the arc converged without it
        found = stiff_step(plant, branch, state, t, plant.inv_omega, plant.tolerance)[0]
    return found


@compiled
def implicit_arc(
    arc: np.record, plant: np.record, branch: Branch, explicit: float, limit: float
) -> bool:
    """Fill an arc with alpha > 0 by an implicit step where that is worth it; return whether.

    explicit (s) is as far as a series would get; limit (s) is the most.
    """
    z, w = arc.mirror * arc.z, arc.mirror * arc.w
    if arc.trial < 0.0:
        arc.trial += 1.0
        return False
    least = _WORTH * explicit
    if branch.along or not (least < limit and plant.mass < math.inf):
        return False
    z_slow = _moved(arc.work, Z, least) < _SLOW * (abs(z) + plant.tolerance)
    w_slow = _moved(arc.work, W, least) < _SLOW * (w + plant.tolerance / plant.inv_omega)
    if not (z_slow and w_slow):
        return False
    h = min(max(arc.trial, least), limit)
    allowed = _PER_STEP * plant.tolerance
    for _ in range(_TRIES):
        arc.cost += _COST
        end, off = stiff_step(plant, branch, (z, w), h, arc.weight, allowed)
        longer = _SHRINKS
        if off <= math.inf:
            longer = min(
                _GROWS, max(_SHRINKS, _SAFETY * (allowed / (off + _NO_ERROR)) ** (1.0 / _ORDER))
            )
        if off <= allowed:
            if not _end_step(arc, plant, branch, end, h):
                break
            arc.kind, arc.trial = STIFF, h * longer
            return True
        if h < least:
            break
        h *= min(longer, _SAFETY)
    arc.trial = -_WAIT
    return False


@compiled
def _moved(work: NDArray, row: int, t: float) -> float:
    """Return how far a row may get in t (s), by its first and second derivative.

    Of a ringing one of them is large at any phase: an implicit step would only silence it.
    """
    return (abs(work[row, 1]) + abs(work[row, 2]) * t) * t


@compiled
def _end_step(arc: np.record, plant: np.record, branch: Branch, end: Moved, h: float) -> bool:
    """End an implicit step of h (s) at its first event; return whether the state there is found."""
    z, w = arc.mirror * arc.z, arc.mirror * arc.w
    event = _crossed(plant, branch, z, end, w)
    if event != 0:
        h = _first_event((arc, plant, branch), 0.0, h)
        end = resolve(arc, plant, branch, h)
        event = _crossed(plant, branch, z, end, w)
    z_end = branch.z_ss if event == _AT_Z_SS else end.z
    z_end = plant.z_ba if event == _AT_Z_BA else z_end
    w_end = 0.0 if event == _AT_REST_W else end.w
    mirror = arc.mirror
    arc.length, arc.path = h, mirror * end.path
    arc.z_end, arc.w_end = mirror * z_end, mirror * w_end
    return end.z == end.z


@compiled
def _is_before_event(h: float, args: tuple[np.record, np.record, Branch]) -> bool:
    arc, plant, branch = args
    arc.cost += _COST
    z, w = arc.mirror * arc.z, arc.mirror * arc.w
    there = resolve(arc, plant, branch, h)
    return _crossed(plant, branch, z, there, w) == 0


_first_event = bisection(_is_before_event)


@compiled
def _crossed(plant: np.record, branch: Branch, z: float, end: Moved, w: float) -> int:
    """Return which border a step from z (m), w (m/s) has crossed at its end, 0 for none."""
    floor = 0.0 if branch.stribeck else plant.v_edge
    if not end.w > floor:
        return _AT_REST_W if floor == 0.0 else _AT_EDGE
    if plant.kind >= ALWAYS_PLASTIC:
        return 0
    if branch.calc:
        excess = end.z - z_limit(end.w, plant.z_k, plant.z_s, plant.v_s)
        beyond = excess < -2.0 * BAND * plant.z_k if branch.plastic else excess > 0.0
        return _AT_LIMIT if beyond else 0
    crossed = end.z < branch.z_ss < z if branch.plastic else end.z > branch.z_ss > z
    if branch.sine_start < 0.0 and end.z < plant.z_ba < z:  # down to the other jump
        return _AT_Z_BA
    return _AT_Z_SS if crossed else 0
