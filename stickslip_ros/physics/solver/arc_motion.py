# SPDX-License-Identifier: Apache-2.0
"""Motion within an arc of any kind: position, turns, integral of the position."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.compiled import compiled, compiled_inline
from stickslip_ros.physics.solver.branches import branch_at
from stickslip_ros.physics.solver.closed_arcs import Glide, glide
from stickslip_ros.physics.solver.layout import ELASTIC, GLIDE, STIFF, TABULATED, TAYLOR
from stickslip_ros.physics.solver.oscillator import (
    Line,
    Oscillator,
    bisection,
    next_turn,
    propagate,
)
from stickslip_ros.physics.solver.stiff import Moved, resolve
from stickslip_ros.physics.solver.taylor import (
    W,
    Z,
    expand,
    integral,
    moment,
    polynomial,
    slope,
    time_at_level,
)

#: Parts of an arc between whose ends it is seen whether something turns
_PARTS = 8
#: An elastic arc of a bent actuator that takes less of the ringing than this (rad) turns once
_SHORT = 2.0
#: Looks for a turn of a longer one: its actuator hardly bends in the time of a ringing
_PASSES = 3
#: A motion that dies away counts as rest below this fraction of the tolerance; it would never end
AT_REST = 1e-3


@compiled
def begin_arc(
    arc: np.record,
    plant: np.record,
    state: tuple[float, float, float],
    piece: tuple[float, float, float],
) -> None:
    """Let an arc start at position x, deflection z (m), speed w (m/s), the state.

    piece is u' (m/s), u'' (m/s^2) and how long it has u'' (s). Seen from a bent actuator the runner
    has a load more. A spring is pulled by the line with the mean and the first moment of the piece.
    """
    (arc.x, arc.z, arc.w), (arc.rate, arc.bend, span) = state, piece
    arc.pulled, arc.force = arc.rate, plant.force
    if arc.bend != 0.0:
        arc.pulled += 0.5 * arc.bend * span
        arc.force += (plant.spring * span * span / 12.0 - plant.mass) * arc.bend
    arc.z_max, arc.z_min = -math.inf, math.inf
    arc.cost = 1


@compiled_inline
def actuator_path(arc: np.record, t: float) -> float:
    """Return how far (m) the actuator gets in t (s) of the arc, which may be infinite at rest."""
    rate = arc.rate if arc.bend == 0.0 else arc.rate + 0.5 * arc.bend * t
    return rate * t


@compiled_inline
def rate_after(arc: np.record, t: float) -> float:
    """Return u' (m/s) after t (s) of the arc."""
    return arc.rate if arc.bend == 0.0 else arc.rate + arc.bend * t


@compiled_inline
def is_at_rest(arc: np.record, plant: np.record, net: float) -> bool:
    """Return whether an arc under a net force (N) begins at rest and stays there."""
    return (
        plant.spring * arc.pulled == 0.0
        and abs(arc.w) * plant.inv_omega + abs(net) / plant.sigma_0 < AT_REST * plant.tolerance
    )


@compiled
def end_at(arc: np.record, t: float, z: float, w: float, dr: float) -> None:
    """Let the arc end after t (s) at z (m), w (m/s), path dr (m)."""
    arc.length, arc.z_end, arc.w_end, arc.path = t, z, w, dr


@compiled
def glide_of(arc: np.record, plant: np.record) -> Glide:
    """Return the steady slide that an arc is, mirrored."""
    mirror = arc.mirror
    w = mirror * arc.w
    if plant.slides != 0 and arc.approach_rate == 0.0:
        # What little z is off goes at once, and damping makes a speed of it that stays.
        w += plant.sigma_1 * mirror * (arc.z - arc.z_slide) / plant.mass
    return Glide(w, arc.net, plant.sigma_2, plant.spring, plant.mass, mirror * arc.pulled)


@compiled
def motion_after(arc: np.record, plant: np.record, t: float) -> tuple[float, float, float]:
    """Return path so far (integral of w, m), deflection z (m), speed w (m/s) after t (s)."""
    z, mirror = arc.z, arc.mirror
    if arc.kind == ELASTIC:
        a, b = arc.line, arc.line_rate
        o = Oscillator(plant.delta, plant.kappa, plant.omega)
        y, wy = propagate(z - a, arc.w - b, t, o)
        z1 = a + b * t + y
        return z1 - z, z1, b + wy
    if arc.kind == TAYLOR:
        return (
            mirror * integral(arc.work, W, t),
            mirror * polynomial(arc.work, Z, t),
            mirror * polynomial(arc.work, W, t),
        )
    if arc.kind == GLIDE:
        dr, w1 = glide(glide_of(arc, plant), t)
        if arc.approach_rate == 0.0:
            return mirror * dr, arc.z_slide if plant.slides != 0 else z, mirror * w1
        left = (z - arc.z_slide) * math.exp(-arc.approach_rate * dr)
        held_back = plant.sigma_0 / (arc.approach_rate * mirror * arc.w) - plant.sigma_1
        w1 -= mirror * (z - arc.z_slide - left) * held_back / plant.mass
        return mirror * dr, arc.z_slide + left, mirror * w1
    if arc.kind == STIFF and t > 0.0:
        end = _implicit(arc, plant, t)
        return mirror * end.path, mirror * end.z, mirror * end.w
    return 0.0, z, 0.0


@compiled
def _implicit(arc: np.record, plant: np.record, t: float) -> Moved:
    """Return the state after t (s) of an implicit arc, mirrored."""
    mirror = arc.mirror
    pull = mirror * (arc.force - plant.spring * arc.x)
    branch = branch_at(plant, mirror * arc.z, mirror * arc.w, pull, mirror * arc.pulled, mirror)
    return resolve(arc, plant, branch, t)


@compiled
def position_integral(arc: np.record, plant: np.record) -> float:
    """Return the integral of the position (m s) over the arc; with a spring only."""
    h, z, w = arc.length, arc.z_end, arc.w_end
    straight = (arc.x + (0.5 * arc.rate + arc.bend * h / 6.0) * h) * h
    if arc.kind == ELASTIC:  # sum up the equation of motion
        damping, total = plant.sigma_1 + plant.sigma_2, plant.sigma_0 + plant.spring
        pull = arc.force - plant.spring * (arc.x - arc.z + 0.5 * arc.pulled * h)
        z_sum = (pull * h - plant.mass * (w - arc.w) - damping * (z - arc.z)) / total
        return straight + z_sum - arc.z * h
    if arc.kind == STIFF:
        return straight + arc.mirror * _implicit(arc, plant, h).moment
    if arc.kind == TAYLOR:
        return straight + arc.mirror * moment(arc.work, h)
    if arc.kind == GLIDE:
        impulse = (arc.force - plant.sigma_0 * z) * h - plant.sigma_1 * (z - arc.z)
        impulse -= plant.sigma_2 * arc.path + plant.mass * (w - arc.w)
        beside = straight - (arc.x + 0.5 * arc.pulled * h) * h
        return impulse / plant.spring + beside
    return straight


@compiled
def turning_point(arc: np.record, plant: np.record, sign: int) -> tuple[float, float]:
    """Return when (s) the runner turns towards sign within the arc, and its path (m) up to there.

    The time is nan where it does not.
    """
    w, rate, h = arc.w, arc.rate, arc.length
    v_start, v_end = sign * (w + rate), sign * (arc.w_end + rate_after(arc, h))
    straight = arc.bend == 0.0
    if arc.kind == ELASTIC and (straight or not h * plant.omega < _SHORT):
        line = Line(arc.line, arc.line_rate)
        y, wy = arc.z - line.a, w - line.b
        o = Oscillator(plant.delta, plant.kappa, plant.omega)
        t, passes = 0.0, 1 if straight else _PASSES
        for _ in range(passes):  # with the rate of the time that was found last
            rate = rate_after(arc, t)
            t = next_turn(y, wy, o, line.b + rate, 0.0, h)
            if v_start > 0.0 and t < math.inf:  # that was where it turned away
                t = next_turn(y, wy, o, line.b + rate, t, h)
            if not t < h:
                return math.nan, 0.0
        return t, motion_after(arc, plant, t)[0] + actuator_path(arc, t)
    if not v_start < 0.0 <= v_end:
        return math.nan, 0.0
    if arc.kind == TAYLOR and straight:
        t = time_at_level(arc.work, W, -arc.mirror * rate, h)
        return t, arc.mirror * integral(arc.work, W, t) + rate * t
    if arc.kind == TABULATED:
        # it ends where w = 0, a little later: look back from there
        side = 1.0 if arc.path > 0.0 else -1.0
        z_end, w_end = side * arc.z_end, side * arc.w_end
        rate = rate_after(arc, h)
        branch = branch_at(plant, z_end, w_end, side * arc.force, side * rate, side)
        expand(arc.work, plant, branch, z_end, w_end)
        t = time_at_level(arc.work, W, -side * rate, -h)
        return h + t, arc.path + side * integral(arc.work, W, t) + actuator_path(arc, h + t)
    t = turn_from((arc, plant, -sign, False), 0.0, h)
    return t, motion_after(arc, plant, t)[0] + actuator_path(arc, t)


@compiled
def _moves_towards(t: float, args: tuple[np.record, np.record, int, bool]) -> bool:
    """Return whether runner or deflection moves to a side at t (s) of an arc.

    args: arc, plant, side, and True for the deflection, of a series or a short swing alone.
    """
    arc, plant, side, deflection = args
    if deflection and arc.kind == TAYLOR:
        return side * slope(arc.work, Z, t) > 0.0
    if deflection:
        return side * motion_after(arc, plant, t)[2] > 0.0
    return side * (motion_after(arc, plant, t)[2] + rate_after(arc, t)) > 0.0


#: When (s) it no longer moves to a side: of the args of `_moves_towards` and a bracket
turn_from = bisection(_moves_towards)


@compiled
def turns_within(arc: np.record, plant: np.record, h: float, times: NDArray) -> int:
    """Write when (s) runner and deflection turn in the first h (s) of an arc; return how often."""
    if arc.kind == ELASTIC and (arc.bend == 0.0 or not h * plant.omega < _SHORT):
        found = _turns_of_swing(arc, plant, h, arc.line_rate, times)
        rate = rate_after(arc, 0.5 * h)
        if rate == 0.0:
            return found
        return found + _turns_of_swing(arc, plant, h, arc.line_rate + rate, times[found:])
    found, left = 0, 0.0
    for part in range(1, _PARTS + 1):
        right = h * part / _PARTS
        for deflection in (False, True):
            for side in (-1, 1):
                if found == len(times) or (deflection and arc.kind not in (TAYLOR, ELASTIC)):
                    continue
                there, back = (arc, plant, side, deflection), (arc, plant, -side, deflection)
                if _moves_towards(left, there) and _moves_towards(right, back):
                    times[found] = turn_from(there, left, right)
                    found += 1
        left = right
    return found


@compiled
def _turns_of_swing(arc: np.record, plant: np.record, h: float, b: float, times: NDArray) -> int:
    """Write when (s) an elastic arc turns against a line that goes at -b (m/s), up to h (s)."""
    o = Oscillator(plant.delta, plant.kappa, plant.omega)
    y, wy = arc.z - arc.line, arc.w - arc.line_rate
    t, found = 0.0, 0
    while found < len(times):
        t = next_turn(y, wy, o, b, t, h)
        if not t < h or abs(propagate(y, wy, t, o)[0]) < AT_REST * plant.tolerance:
            break
        times[found] = t
        found += 1
    return found
