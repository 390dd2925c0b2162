# SPDX-License-Identifier: Apache-2.0
"""The way from one event to the next: which kind of arc starts here, where it ends, where it is."""

from __future__ import annotations

import math

import numpy as np

from stickslip_ros.compiled import compiled
from stickslip_ros.model.friction import ALWAYS_PLASTIC, ELASTOPLASTIC
from stickslip_ros.solver.branches import branch_at, is_flat
from stickslip_ros.solver.elastic import elastic_end, rest_line
from stickslip_ros.solver.glide import Glide, glide, glide_end
from stickslip_ros.solver.layout import ELASTIC, GLIDE, REST, TABULATED, TAYLOR, TURN
from stickslip_ros.solver.oscillator import Line, Oscillator, next_turn, propagate
from stickslip_ros.solver.precomputed import precompute
from stickslip_ros.solver.slides import point_above, slide
from stickslip_ros.solver.swings import burst, swing
from stickslip_ros.solver.taylor import (
    W,
    Z,
    expand,
    moment,
    path,
    polynomial,
    reaches,
    step_length,
    taylor_end,
)

#: Parts of the tolerance per cycle: one step of a series; z that counts as having reached steady
#: sliding; a swing that counts as rest where no deflection is elastic.
_PER_STEP, _SETTLED, _AT_REST = 0.05, 0.05, 1e-3


@compiled
def begin_arc(arc: np.record, x: float, z: float, w: float, rate: float) -> None:
    """Let an arc start at position x, deflection z (m), speed w (m/s), with u' = rate (m/s)."""
    arc.x, arc.z, arc.w, arc.rate = x, z, w, rate
    arc.z_max, arc.z_min = -math.inf, math.inf


@compiled
def next_arc(arc: np.record, plant: np.record, limit: float, tables: bool) -> None:
    """Find the end of the arc that `begin_arc` started, at most limit (s) long.

    u' is constant for at least limit. tables allows arcs that are tabulated, which have an end but
    nothing within.
    """
    z, w = arc.z, arc.w
    arc.z_max, arc.z_min = -math.inf, math.inf
    net = plant.force - plant.spring * arc.x - plant.sigma_0 * z
    outward = z * w if w != 0.0 else z * net
    beyond = plant.kind == ALWAYS_PLASTIC or abs(z) >= plant.z_ba
    tables = tables and plant.kind == ELASTOPLASTIC and plant.v_edge == 0.0
    tables = tables and plant.printed == 0 and plant.spring == 0.0 and abs(z) >= plant.z_ba
    if tables and plant.precomputed == 0:
        precompute(plant, arc.work)
    tables = tables and plant.precomputed > 0
    if (
        beyond
        and plant.spring * arc.rate == 0.0
        and abs(w) * plant.inv_omega + abs(net) / plant.sigma_0 < _AT_REST * plant.tolerance
    ):  # a swing that would die away for ever
        end_at(arc, limit, z, 0.0, 0.0)
        arc.kind = REST
    elif plant.kind != ALWAYS_PLASTIC and not (abs(z) >= plant.z_ba and outward > 0.0):
        _elastic_arc(arc, plant, limit, tables)
    else:
        arc.mirror = 1.0 if z > 0.0 else -1.0
        if plant.kind == ALWAYS_PLASTIC:
            arc.mirror = 1.0 if w > 0.0 or (w == 0.0 and net > 0.0) else -1.0
        _plastic_arc(arc, plant, limit, tables)


@compiled
def end_at(arc: np.record, t: float, z: float, w: float, gone: float) -> None:
    """Let the arc end after t (s) at z (m), w (m/s), path gone (m)."""
    arc.length, arc.z_end, arc.w_end, arc.path = t, z, w, gone


@compiled
def _elastic_arc(arc: np.record, plant: np.record, limit: float, tables: bool) -> None:
    """Fill an arc with alpha = 0, or the whole swing that it begins where that is tabulated."""
    z, w = arc.z, arc.w
    if tables and w == 0.0:
        mirror, side = (1.0, 0) if z > 0.0 else (-1.0, 1)
        z_end, t, gone = swing(plant, side, mirror * z)
        if t <= limit:
            arc.kind = TABULATED
            end_at(arc, t, -mirror * z_end, 0.0, mirror * gone)
            return
    damping = plant.sigma_1 + plant.sigma_2
    contact = (plant.sigma_0, damping)
    line = rest_line(arc.x, z, arc.rate, plant.force, plant.spring, contact)
    o = Oscillator(plant.delta, plant.kappa, plant.omega)
    end = elastic_end(z, w, line, o, plant.z_ba, limit)
    arc.kind = ELASTIC
    arc.line, arc.line_rate = line
    arc.z_max, arc.z_min = end.z_max, end.z_min
    end_at(arc, end.t, end.z, end.w, end.z - z)


@compiled
def _plastic_arc(arc: np.record, plant: np.record, limit: float, tables: bool) -> None:
    """Fill an arc with alpha > 0; arc.mirror is set."""
    mirror = arc.mirror
    z, w = mirror * arc.z, mirror * arc.w
    pull = mirror * (plant.force - plant.spring * arc.x)
    stop = math.inf
    if tables:
        if z == plant.z_ba and w <= plant.burst_top:
            z_end, t, gone = burst(plant, 0 if mirror > 0.0 else 1, w)
            if t <= limit:
                arc.kind = TABULATED
                end_at(arc, t, mirror * z_end, 0.0, mirror * gone)
                return
        elif w > plant.burst_top and plant.sigma_2 == 0.0 and z < plant.z_slide:
            known = slide(plant, z, w, pull, limit)
            if known.t <= limit:
                arc.kind = TABULATED
                end_at(arc, known.t, mirror * known.z, mirror * known.w, mirror * known.path)
                return
            stop = point_above(plant, z)  # from there on it may be tabulated
    flat = is_flat(plant, w)
    floor = plant.v_edge if flat else 0.0
    if w != 0.0 and flat and abs(z - plant.z_slide) <= _SETTLED * plant.tolerance:
        arc.kind, arc.net = GLIDE, pull - plant.sigma_0 * plant.z_slide
        t, slowed = glide_end(glide_of(arc, plant), floor, limit)
        event, exact = TURN if slowed and floor == 0.0 else 0, math.nan
    else:
        arc.kind = TAYLOR
        branch = branch_at(plant, z, w, pull, mirror * arc.rate, mirror)
        expand(arc.work, branch, z, w)
        t = step_length(arc.work, _PER_STEP * plant.tolerance, plant.inv_omega, branch.stribeck)
        end = taylor_end(arc.work, branch, min(t, limit), floor, plant.kind != ALWAYS_PLASTIC)
        t, event, exact = end.t, end.event, end.z
        if event != TURN and stop < polynomial(arc.work, Z, t):
            t, exact = reaches(arc.work, Z, stop, t), stop
    arc.length = t
    if t < math.inf:
        gone, z_end, w_end = within_arc(arc, plant, t)
        end_at(arc, t, z_end, 0.0 if event == TURN else w_end, gone)
        if exact == exact:
            arc.z_end = mirror * exact


@compiled
def glide_of(arc: np.record, plant: np.record) -> Glide:
    """Return the steady slide that an arc is, mirrored."""
    mirror = arc.mirror
    return Glide(
        mirror * arc.w, arc.net, plant.sigma_2, plant.spring, plant.mass, mirror * arc.rate
    )


@compiled
def within_arc(arc: np.record, plant: np.record, t: float) -> tuple[float, float, float]:
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
            mirror * path(arc.work, t),
            mirror * polynomial(arc.work, Z, t),
            mirror * polynomial(arc.work, W, t),
        )
    if arc.kind == GLIDE:
        gone, w1 = glide(glide_of(arc, plant), t)
        return mirror * gone, mirror * plant.z_slide, mirror * w1
    return 0.0, z, 0.0


@compiled
def position_integral(arc: np.record, plant: np.record) -> float:
    """Return the integral of the position (m s) over the arc; with a spring only."""
    h, rate, z, w = arc.length, arc.rate, arc.z_end, arc.w_end
    straight = (arc.x + 0.5 * rate * h) * h
    if arc.kind == ELASTIC:  # sum up the equation of motion
        damping, total = plant.sigma_1 + plant.sigma_2, plant.sigma_0 + plant.spring
        pull = plant.force - plant.spring * (arc.x - arc.z + 0.5 * rate * h)
        z_sum = (pull * h - plant.mass * (w - arc.w) - damping * (z - arc.z)) / total
        return straight + z_sum - arc.z * h  # type: ignore[no-any-return]
    if arc.kind == TAYLOR:
        return straight + arc.mirror * moment(arc.work, h)  # type: ignore[no-any-return]
    if arc.kind == GLIDE:
        pull = plant.force - plant.sigma_0 * z
        return (  # type: ignore[no-any-return]
            pull * h - plant.sigma_2 * arc.path - plant.mass * (w - arc.w)
        ) / plant.spring
    return straight  # type: ignore[no-any-return]


@compiled
def turning_point(arc: np.record, plant: np.record, sign: int) -> tuple[float, float]:
    """Return when (s) the runner turns towards sign within the arc, and its way (m) up to there.

    The time is nan where it does not.
    """
    w, rate, h = arc.w, arc.rate, arc.length
    v_start, v_end = sign * (w + rate), sign * (arc.w_end + rate)
    if arc.kind == ELASTIC:
        line = Line(arc.line, arc.line_rate)
        y, wy = arc.z - line.a, w - line.b
        o = Oscillator(plant.delta, plant.kappa, plant.omega)
        t = next_turn(y, wy, o, line.b + rate, 0.0, h)
        if v_start > 0.0 and t < math.inf:  # that was where it turned away
            t = next_turn(y, wy, o, line.b + rate, t, h)
        if not t < h:
            return math.nan, 0.0
        return t, within_arc(arc, plant, t)[0] + rate * t
    if not v_start < 0.0 <= v_end:
        return math.nan, 0.0
    if arc.kind == TAYLOR:
        t = reaches(arc.work, W, -arc.mirror * rate, h)
        return t, arc.mirror * path(arc.work, t) + rate * t
    if arc.kind == TABULATED:
        # it ends where w = 0, a little later: look back from there
        side = 1.0 if arc.z_end > 0.0 else -1.0
        branch = branch_at(plant, side * arc.z_end, 0.0, side * plant.force, side * rate, side)
        expand(arc.work, branch, side * arc.z_end, 0.0)
        t = reaches(arc.work, W, -side * rate, -h)
        return h + t, arc.path + side * path(arc.work, t) + rate * (h + t)
    left, right = 0.0, h
    for _ in range(60):
        middle = 0.5 * (left + right)
        if sign * (within_arc(arc, plant, middle)[2] + rate) < 0.0:
            left = middle
        else:
            right = middle
    return right, within_arc(arc, plant, right)[0] + rate * right
