# SPDX-License-Identifier: Apache-2.0
"""Arcs of a runner on one contact: the kind of the next arc, and its end."""

from __future__ import annotations

import math

import numpy as np

from stickslip_ros.base.compiled import compiled, compiled_inline
from stickslip_ros.physics.laws.law import ALWAYS_PLASTIC, ELASTOPLASTIC
from stickslip_ros.physics.model.friction import z_limit
from stickslip_ros.physics.solver.arc_motion import end_at, glide_of, is_at_rest, motion_after
from stickslip_ros.physics.solver.branches import branch_at, held_at_jump, is_flat
from stickslip_ros.physics.solver.closed_arcs import elastic_end, glide, glide_end, rest_line
from stickslip_ros.physics.solver.layout import ELASTIC, FREE, GLIDE, REST, TABULATED, TAYLOR, TURN
from stickslip_ros.physics.solver.oscillator import Oscillator, bisection
from stickslip_ros.physics.solver.plants import precompute
from stickslip_ros.physics.solver.stiff import implicit_arc, rates
from stickslip_ros.physics.solver.tables import burst, point_above, reversal, slide, swing
from stickslip_ros.physics.solver.taylor import (
    Branch,
    TaylorEnd,
    W,
    Z,
    expand,
    expand_along,
    polynomial,
    step_length,
    taylor_end,
    time_at_level,
)

#: Error of one step of a series, as a fraction of the tolerance per cycle: where tables cover most
#: of a cycle, so that steps are few
_PER_RARE_STEP = 0.03
#: The same where tables cover the slides of a cycle alone
_PER_BENT_STEP = 2e-3
#: The same where they cover nothing
_PER_STEP = 1e-4
#: The same on the Stribeck curve, where the motion may be unstable
_PER_CURVED_STEP = 1e-5
#: Distance of z from steady sliding, as a fraction of the tolerance, at which it counts as reached
_REACHED = 1e-4
#: Largest change of w, as a fraction of v_s, between checks whether a jump of alpha holds z
_SHARE_OF_V_S = 0.1


@compiled
def next_arc(arc: np.record, plant: np.record, limit: float, tables: bool) -> None:
    """Find the end of the arc that `begin_arc` started, at most limit (s) long.

    u' is constant for at least limit. tables allows tabulated arcs, whose end is known, but not the
    motion within.
    """
    z, w = arc.z, arc.w
    net = arc.force - plant.spring * arc.x - plant.sigma_0 * z
    outward = z * w if w != 0.0 else z * net
    plastic = plant.kind >= ALWAYS_PLASTIC
    beyond = plastic or abs(z) >= plant.z_ba
    tables = tables and beyond and plant.spring == 0.0 and plant.precomputed >= 0
    if tables and plant.precomputed == 0:
        precompute(plant, arc.work)
        tables = plant.precomputed > 0
    if beyond and is_at_rest(arc, plant, net):
        end_at(arc, limit, z, 0.0, 0.0)
        arc.kind = REST
        return
    inward = not plastic and not (abs(z) >= plant.z_ba and outward > 0.0)
    arc.mirror = 1.0 if z > 0.0 else -1.0
    if plastic:
        arc.mirror = 1.0 if w > 0.0 or (w == 0.0 and net > 0.0) else -1.0
    if tables and _tabulated_arc(arc, plant, inward, limit):
        return
    if not inward:
        _plastic_arc(arc, plant, limit, tables and not plastic)
        return
    line = rest_line(arc, plant)
    o = Oscillator(plant.delta, plant.kappa, plant.omega)
    end = elastic_end(z, w, line, o, plant.z_ba, limit)
    arc.kind = ELASTIC
    arc.line, arc.line_rate = line
    arc.z_max, arc.z_min = end.z_max, end.z_min
    end_at(arc, end.t, end.z, end.w, end.z - z)


@compiled
def _tabulated_arc(arc: np.record, plant: np.record, inward: bool, limit: float) -> bool:
    """Fill an arc from the tables, if they contain it; arc.mirror is set.

    inward: alpha is 0 at its start, and it is a whole swing. Bursts and swings hold for the load of
    the plant, so that a bent actuator has slides alone.
    """
    mirror, side = arc.mirror, 0 if arc.mirror > 0.0 else 1
    z, w = mirror * arc.z, mirror * arc.w
    z_end, w_end, t, dr = z, 0.0, math.nan, 0.0
    straight = arc.bend == 0.0
    if inward and straight:
        if w == 0.0:
            over_there, t, dr = swing(plant, side, z)
            z_end = -over_there
    elif inward:
        return False
    elif plant.kind == ALWAYS_PLASTIC:
        if w == 0.0 and straight:
            rest = mirror * plant.force / plant.sigma_0
            left, t, dr = reversal(plant, 1 - side, rest - z)
            z_end = rest + left
    elif z == plant.z_ba and w <= plant.burst_top and straight:
        z_end, t, dr = burst(plant, side, w)
    elif w > plant.burst_top and plant.sigma_2 == 0.0 and z < plant.z_slide - plant.approach_reach:
        t, dr, z_end, w_slide = slide(plant, z, w, mirror * arc.force, limit)
        w_end = mirror * w_slide
    if not t <= limit:
        return False
    arc.kind = TABULATED
    end_at(arc, t, mirror * z_end, w_end, mirror * dr)
    return True


@compiled
def _plastic_arc(arc: np.record, plant: np.record, limit: float, tables: bool) -> None:
    """Fill an arc with alpha > 0; arc.mirror is set. With tables, it ends where they continue."""
    mirror = arc.mirror
    z, w = mirror * arc.z, mirror * arc.w
    pull = mirror * (arc.force - plant.spring * arc.x)
    flat = is_flat(plant, w)
    floor = plant.v_edge if flat else 0.0
    if w != 0.0 and _glides(arc, plant, pull, flat, floor):
        t, slowed = glide_end(glide_of(arc, plant), floor, limit)
        if not flat:  # only as long as the jump of alpha holds z
            g = glide_of(arc, plant)
            acceleration = abs(g.net - g.damping * g.w) / g.mass
            if acceleration * t > _SHARE_OF_V_S * plant.v_s:
                t, slowed = _SHARE_OF_V_S * plant.v_s / acceleration, False
            if not _stays_held(t, (arc, plant)):
                t, slowed = _end_of_hold((arc, plant), 0.0, t), False
        end = TaylorEnd(t, TURN if slowed and floor == 0.0 else FREE, math.nan)
    else:
        branch = branch_at(plant, z, w, pull, mirror * arc.pulled, mirror)
        if branch.along:
            expand_along(arc.work, plant, branch, w)
        else:
            expand(arc.work, plant, branch, z, w)
        rare = plant.precomputed > 0 and plant.kind == ELASTOPLASTIC and plant.slides == 0
        error = _PER_CURVED_STEP if branch.stribeck else _PER_STEP
        if rare and plant.sigma_2 == 0.0 and not branch.stribeck:
            error = _PER_RARE_STEP if arc.bend == 0.0 else _PER_BENT_STEP
        h = step_length(arc.work, error * plant.tolerance, arc.weight, branch.stribeck)
        if implicit_arc(arc, plant, branch, min(h, limit), limit):
            return
        arc.kind = TAYLOR
        end = _series_end(arc, plant, branch, min(h, limit), tables)
    arc.length = end.t
    if end.t < math.inf:
        dr, z_end, w_end = motion_after(arc, plant, end.t)
        end_at(arc, end.t, z_end, 0.0 if end.event == TURN else w_end, dr)
        if end.z == end.z:
            arc.z_end = mirror * end.z


@compiled_inline
def _series_end(
    arc: np.record, plant: np.record, branch: Branch, h: float, tables: bool
) -> TaylorEnd:
    """Return where a step of a series, at most h (s) long, has its first event."""
    z, w = arc.work[Z, 0], arc.work[W, 0]
    end = taylor_end(arc.work, plant, branch, h)
    if branch.along:
        w_end = polynomial(arc.work, W, end.t)
        return TaylorEnd(end.t, end.event, z_limit(w_end, plant.z_k, plant.z_s, plant.v_s))
    if (
        tables
        and w > plant.burst_top
        and plant.sigma_2 == 0.0
        and z < plant.z_slide - plant.approach_reach
        and end.event != TURN
    ):
        stop = point_above(plant, z)  # the tables continue there
        if stop < polynomial(arc.work, Z, end.t):
            end = TaylorEnd(time_at_level(arc.work, Z, stop, end.t), FREE, stop)
    return end


@compiled_inline
def _glides(arc: np.record, plant: np.record, pull: float, flat: bool, floor: float) -> bool:
    """Set the constants of a glide; return whether the arc is one, down to the speed floor (m/s).

    flat: the Stribeck curve is flat at this speed.
    """
    mirror = arc.mirror
    z, w = mirror * arc.z, mirror * arc.w
    fast = w > plant.burst_top > 0.0 and plant.slides == 0
    z_slide = z
    if not held_at_jump(plant, z, w, mirror):
        if not flat:
            return False
        near = plant.approach_reach if fast else _REACHED * plant.tolerance
        z_slide = _steady(arc, plant, pull) if plant.printed != 0 else plant.z_slide
        if not abs(z - z_slide) <= near:
            return False
    arc.net, arc.z_slide = pull - plant.sigma_0 * z_slide, mirror * z_slide
    arc.approach_rate = plant.approach_rate if fast else 0.0
    if not glide_of(arc, plant).w > floor:
        return False
    arc.kind = GLIDE
    return True


@compiled
def _steady(arc: np.record, plant: np.record, pull: float) -> float:
    """Return the equilibrium of z (m, mirrored) near z, for alpha as printed; nan without one."""
    mirror = arc.mirror
    z, w = mirror * arc.z, mirror * arc.w
    branch = branch_at(plant, z, w, pull, mirror * arc.pulled, mirror)
    rate, by_z, _ = rates(plant, branch, z, w)
    return z - rate / by_z if by_z < 0.0 else math.nan


@compiled
def _stays_held(t: float, args: tuple[np.record, np.record]) -> bool:
    arc, plant = args
    w = glide(glide_of(arc, plant), t)[1]
    return held_at_jump(plant, arc.mirror * arc.z_slide, w, arc.mirror)


_end_of_hold = bisection(_stays_held)
