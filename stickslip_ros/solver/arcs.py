# SPDX-License-Identifier: Apache-2.0
"""The way from one event to the next: which kind of arc starts here, where it ends, where it is."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled, compiled_inline
from stickslip_ros.model.friction import ALWAYS_PLASTIC, ELASTOPLASTIC, FOREIGN, z_limit
from stickslip_ros.solver.branches import branch_at, held_at_jump, is_flat
from stickslip_ros.solver.elastic import elastic_end, rest_line
from stickslip_ros.solver.glide import Glide, glide, glide_end
from stickslip_ros.solver.layout import (
    ELASTIC,
    FREE,
    GLIDE,
    REST,
    STIFF,
    TABULATED,
    TAYLOR,
    TURN,
)
from stickslip_ros.solver.oscillator import Line, Oscillator, next_turn, propagate
from stickslip_ros.solver.precomputed import precompute
from stickslip_ros.solver.roots import bisection
from stickslip_ros.solver.slides import point_above, slide
from stickslip_ros.solver.stiff import Moved, rates, stiff_step
from stickslip_ros.solver.swings import burst, reversal, swing
from stickslip_ros.solver.taylor import (
    BAND,
    Branch,
    TaylorEnd,
    W,
    Z,
    expand,
    expand_along,
    moment,
    path,
    polynomial,
    reaches,
    step_length,
    taylor_end,
)

#: Parts of the tolerance per cycle: one step of a series where tables serve most of a cycle, one
#: where they do not, one on the Stribeck curve, where the motion may be unstable; z that counts as
#: having reached steady sliding; a swing that counts as rest where no deflection is elastic.
_PER_RARE_STEP, _PER_STEP, _PER_CURVED_STEP = 0.03, 1e-4, 1e-5
_SETTLED, _AT_REST = 1e-4, 1e-3
#: An implicit step has to be so many times longer than that of a series to be worth it, and is
#: tried where z and w change by no more than a share of themselves meanwhile; again after so many
#: arcs
_WORTH, _SLOW, _WAIT, _TRIES = 10.0, 0.3, 20.0, 60
#: Part of the tolerance to which an implicit step is solved again for an event or a sample
_EXACT = 1e-4
#: Share of v_s by which w changes at most while it is looked whether a jump holds z
_SHARE_OF_V_S = 0.1
_AT_REST_W, _AT_EDGE, _AT_Z_SS, _AT_LIMIT, _AT_Z_BA = 1, 2, 3, 4, 5


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
    plastic = plant.kind >= ALWAYS_PLASTIC
    beyond = plastic or abs(z) >= plant.z_ba
    tables = tables and beyond and plant.spring == 0.0 and plant.precomputed >= 0
    if tables and plant.precomputed == 0:
        precompute(plant, arc.work)
        tables = plant.precomputed > 0
    if (
        beyond
        and plant.spring * arc.rate == 0.0
        and abs(w) * plant.inv_omega + abs(net) / plant.sigma_0 < _AT_REST * plant.tolerance
    ):  # a swing that would die away for ever
        end_at(arc, limit, z, 0.0, 0.0)
        arc.kind = REST
    elif not plastic and not (abs(z) >= plant.z_ba and outward > 0.0):
        _elastic_arc(arc, plant, limit, tables)
    else:
        arc.mirror = 1.0 if z > 0.0 else -1.0
        if plastic:
            arc.mirror = 1.0 if w > 0.0 or (w == 0.0 and net > 0.0) else -1.0
        if not (tables and _tabulated_arc(arc, plant, limit)):
            _plastic_arc(arc, plant, limit, tables and not plastic)


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
def _tabulated_arc(arc: np.record, plant: np.record, limit: float) -> bool:
    """Fill an arc with alpha > 0 from the tables; return whether it is there. arc.mirror is set."""
    mirror = arc.mirror
    z, w = mirror * arc.z, mirror * arc.w
    arc.kind = TABULATED
    if plant.kind == ALWAYS_PLASTIC:
        rest = mirror * plant.force / plant.sigma_0
        left, t, gone = reversal(plant, 0 if mirror < 0.0 else 1, rest - z)
        if w == 0.0 and t <= limit:
            end_at(arc, t, mirror * (rest + left), 0.0, mirror * gone)
            return True
    elif z == plant.z_ba and w <= plant.burst_top:
        z_end, t, gone = burst(plant, 0 if mirror > 0.0 else 1, w)
        if t <= limit:
            end_at(arc, t, mirror * z_end, 0.0, mirror * gone)
            return True
    elif w > plant.burst_top and plant.sigma_2 == 0.0 and z < plant.z_slide - plant.settled:
        known = slide(plant, z, w, mirror * plant.force, limit)
        if known.t <= limit:
            end_at(arc, known.t, mirror * known.z, mirror * known.w, mirror * known.path)
            return True
    return False


@compiled
def _plastic_arc(arc: np.record, plant: np.record, limit: float, tables: bool) -> None:
    """Fill an arc with alpha > 0; arc.mirror is set. With tables it ends where they go on."""
    mirror = arc.mirror
    z, w = mirror * arc.z, mirror * arc.w
    pull = mirror * (plant.force - plant.spring * arc.x)
    flat = is_flat(plant, w)
    floor = plant.v_edge if flat else 0.0
    if w != 0.0 and _glides(arc, plant, pull, flat, floor):
        t, slowed = glide_end(glide_of(arc, plant), floor, limit)
        if not flat:
            t, slowed = _while_held(arc, plant, t, slowed)
        end = TaylorEnd(t, TURN if slowed and floor == 0.0 else FREE, math.nan)
    else:
        branch = branch_at(plant, z, w, pull, mirror * arc.rate, mirror)
        h = 0.0
        if branch.along:
            expand_along(arc.work, branch, w)
        elif plant.kind < FOREIGN:
            expand(arc.work, branch, z, w)
        if plant.kind < FOREIGN:
            share = _share(plant, branch) * plant.tolerance
            h = step_length(arc.work, share, arc.weight, branch.stribeck)
        if _stiff_arc(arc, plant, branch, min(h, limit), limit):
            return
        arc.kind = TAYLOR
        end = _series_end(arc, plant, branch, min(h, limit), tables)
    arc.length = end.t
    if end.t < math.inf:
        gone, z_end, w_end = within_arc(arc, plant, end.t)
        end_at(arc, end.t, z_end, 0.0 if end.event == TURN else w_end, gone)
        if end.z == end.z:
            arc.z_end = mirror * end.z


@compiled_inline
def _series_end(
    arc: np.record, plant: np.record, branch: Branch, h: float, tables: bool
) -> TaylorEnd:
    """Return where a step of a series, at most h (s) long, has its first event."""
    z, w = arc.work[Z, 0], arc.work[W, 0]
    floor = 0.0 if branch.stribeck else plant.v_edge
    end = taylor_end(arc.work, branch, h, floor, plant.kind != ALWAYS_PLASTIC)
    if branch.along:
        w_end = polynomial(arc.work, W, end.t)
        return TaylorEnd(end.t, end.event, z_limit(w_end, plant.z_k, plant.z_s, plant.v_s))
    if (
        tables
        and w > plant.burst_top
        and plant.sigma_2 == 0.0
        and z < plant.z_slide - plant.settled
        and end.event != TURN
    ):
        stop = point_above(plant, z)  # from there on it may be tabulated
        if stop < polynomial(arc.work, Z, end.t):
            end = TaylorEnd(reaches(arc.work, Z, stop, end.t), FREE, stop)
    return end


@compiled_inline
def _glides(arc: np.record, plant: np.record, pull: float, flat: bool, floor: float) -> bool:
    """Set what an arc of steady sliding needs; return whether it is one, down to a speed floor.

    flat says whether the Stribeck curve plays no part.
    """
    mirror = arc.mirror
    z, w = mirror * arc.z, mirror * arc.w
    fast = w > plant.burst_top > 0.0 and plant.slides == 0
    z_slide = z
    if not held_at_jump(plant, z, w, mirror):
        if not flat:
            return False
        near = plant.settled if fast else _SETTLED * plant.tolerance
        z_slide = _steady(arc, plant, pull) if plant.printed != 0 else plant.z_slide
        if not abs(z - z_slide) <= near:
            return False
    arc.net, arc.z_slide = pull - plant.sigma_0 * z_slide, mirror * z_slide
    arc.settling = plant.settling if fast else 0.0
    if not glide_of(arc, plant).w > floor:
        return False
    arc.kind = GLIDE
    return True


@compiled
def _steady(arc: np.record, plant: np.record, pull: float) -> float:
    """Return z (m, mirrored) near by at which it would stay, with alpha as printed; else nan."""
    mirror = arc.mirror
    z, w = mirror * arc.z, mirror * arc.w
    branch = branch_at(plant, z, w, pull, mirror * arc.rate, mirror)
    rate, by_z, _ = rates(branch, z, w)
    return z - rate / by_z if by_z < 0.0 else math.nan


@compiled
def _while_held(arc: np.record, plant: np.record, t: float, slowed: bool) -> tuple[float, bool]:
    """Shorten a glide at a jump of alpha, t (s) long, to where the jump no longer holds z."""
    g, z = glide_of(arc, plant), arc.mirror * arc.z_slide
    acceleration = abs(g.net - g.damping * g.w) / g.mass
    if acceleration * t > _SHARE_OF_V_S * plant.v_s:
        t, slowed = _SHARE_OF_V_S * plant.v_s / acceleration, False
    if held_at_jump(plant, z, glide(g, t)[1], arc.mirror):
        return t, slowed
    return _end_of_hold((arc, plant), 0.0, t), False


@compiled
def _stays_held(t: float, args: tuple[np.record, np.record]) -> bool:
    arc, plant = args
    w = glide(glide_of(arc, plant), t)[1]
    return held_at_jump(plant, arc.mirror * arc.z_slide, w, arc.mirror)


_end_of_hold = bisection(_stays_held)


@compiled
def _share(plant: np.record, branch: Branch) -> float:
    """Return the share of the tolerance that one step of a series may be off by."""
    if branch.stribeck:
        return _PER_CURVED_STEP
    rare = plant.precomputed > 0 and plant.kind == ELASTOPLASTIC and plant.slides == 0
    rare = rare and plant.sigma_2 == 0.0
    return _PER_RARE_STEP if rare else _PER_STEP


@compiled
def _stiff_arc(
    arc: np.record, plant: np.record, branch: Branch, explicit: float, limit: float
) -> bool:
    """Fill an arc with alpha > 0 by an implicit step where that is worth it; return whether.

    explicit (s) is as far as a series would get, 0 if there is none; limit (s) is the most.
    """
    foreign = branch.contact.kind >= FOREIGN
    z, w = arc.mirror * arc.z, arc.mirror * arc.w
    if not foreign:
        if arc.trial < 0.0:
            arc.trial += 1.0
            return False
        far = _WORTH * explicit
        if branch.along or not (far < limit and plant.mass < math.inf):
            return False
        z_slow = _moved(arc.work, Z, far) < _SLOW * (abs(z) + plant.tolerance)
        w_slow = _moved(arc.work, W, far) < _SLOW * (w + plant.tolerance / plant.inv_omega)
        if not (z_slow and w_slow):
            return False
    least = 0.0 if foreign else _WORTH * explicit
    h = min(max(arc.trial, least if least > 0.0 else plant.inv_omega * 0.1), limit)
    allowed = _PER_STEP * plant.tolerance
    for _ in range(_TRIES):
        end, off = stiff_step(branch, z, w, h, arc.weight, allowed)
        longer = 0.1
        if off <= math.inf:
            longer = min(5.0, max(0.1, 0.9 * (allowed / (off + 1e-300)) ** (1.0 / 6.0)))
        if off <= allowed:
            if not _end_stiff(arc, plant, branch, end, h):
                break
            arc.kind, arc.trial = STIFF, h * longer
            return True
        if h < least:
            break
        h *= min(longer, 0.9)
    arc.trial = -_WAIT
    return False


@compiled
def _moved(work: NDArray, row: int, t: float) -> float:
    """Return how far a row may get in t (s), by its first and second derivative.

    Of a ringing one of them is large at any phase: an implicit step would only silence it.
    """
    return (abs(work[row, 1]) + abs(work[row, 2]) * t) * t  # type: ignore[no-any-return]


@compiled
def _end_stiff(arc: np.record, plant: np.record, branch: Branch, end: Moved, h: float) -> bool:
    """End an implicit step of h (s) at its first event; return whether the state there is found."""
    z, w = arc.mirror * arc.z, arc.mirror * arc.w
    event = _crossed(plant, branch, z, end, w)
    if event != 0:
        h = _first_event((arc, plant, branch), 0.0, h)
        end, _ = stiff_step(branch, z, w, h, plant.inv_omega, _EXACT * plant.tolerance)
        event = _crossed(plant, branch, z, end, w)
    z_end = branch.z_ss if event == _AT_Z_SS else end.z
    z_end = plant.z_ba if event == _AT_Z_BA else z_end
    w_end = 0.0 if event == _AT_REST_W else end.w
    mirror = arc.mirror
    end_at(arc, h, mirror * z_end, mirror * w_end, mirror * end.path)
    return end.z == end.z  # type: ignore[no-any-return]


@compiled
def _is_before_event(h: float, args: tuple[np.record, np.record, Branch]) -> bool:
    arc, plant, branch = args
    z, w = arc.mirror * arc.z, arc.mirror * arc.w
    there, _ = stiff_step(branch, z, w, h, plant.inv_omega, _EXACT * plant.tolerance)
    return _crossed(plant, branch, z, there, w) == 0


_first_event = bisection(_is_before_event)


@compiled
def _crossed(plant: np.record, branch: Branch, z: float, end: Moved, w: float) -> int:
    """Return which border a step from z (m), w (m/s) has crossed at its end, 0 for none."""
    floor = 0.0 if branch.stribeck or plant.kind >= FOREIGN else plant.v_edge
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


@compiled
def glide_of(arc: np.record, plant: np.record) -> Glide:
    """Return the steady slide that an arc is, mirrored."""
    mirror = arc.mirror
    w = mirror * arc.w
    if plant.slides != 0 and arc.settling == 0.0:
        # What little z is off goes at once, and damping makes a speed of it that stays.
        w += plant.sigma_1 * mirror * (arc.z - arc.z_slide) / plant.mass
    return Glide(w, arc.net, plant.sigma_2, plant.spring, plant.mass, mirror * arc.rate)


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
        if arc.settling == 0.0:
            return mirror * gone, arc.z_slide if plant.slides != 0 else z, mirror * w1
        left = (z - arc.z_slide) * math.exp(-arc.settling * gone)
        held_back = plant.sigma_0 / (arc.settling * mirror * arc.w) - plant.sigma_1
        w1 -= mirror * (z - arc.z_slide - left) * held_back / plant.mass
        return mirror * gone, arc.z_slide + left, mirror * w1
    if arc.kind == STIFF and t > 0.0:
        end = _implicit(arc, plant, t)
        return mirror * end.path, mirror * end.z, mirror * end.w
    return 0.0, z, 0.0


@compiled
def _implicit(arc: np.record, plant: np.record, t: float) -> Moved:
    """Return the state after t (s) of an implicit arc, mirrored."""
    mirror = arc.mirror
    z, w = mirror * arc.z, mirror * arc.w
    pull = mirror * (plant.force - plant.spring * arc.x)
    branch = branch_at(plant, z, w, pull, mirror * arc.rate, mirror)
    end, _ = stiff_step(branch, z, w, t, plant.inv_omega, _EXACT * plant.tolerance)
    return end


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
    if arc.kind == STIFF:
        return straight + arc.mirror * _implicit(arc, plant, h).moment  # type: ignore[no-any-return]
    if arc.kind == TAYLOR:
        return straight + arc.mirror * moment(arc.work, h)  # type: ignore[no-any-return]
    if arc.kind == GLIDE:
        impulse = (plant.force - plant.sigma_0 * z) * h - plant.sigma_1 * (z - arc.z)
        impulse -= plant.sigma_2 * arc.path + plant.mass * (w - arc.w)
        return impulse / plant.spring  # type: ignore[no-any-return]
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
        side = 1.0 if arc.path > 0.0 else -1.0
        z_end, w_end = side * arc.z_end, side * arc.w_end
        branch = branch_at(plant, z_end, w_end, side * plant.force, side * rate, side)
        expand(arc.work, branch, z_end, w_end)
        t = reaches(arc.work, W, -side * rate, -h)
        return h + t, arc.path + side * path(arc.work, t) + rate * (h + t)
    t = turn_from((arc, plant, -sign), 0.0, h)
    return t, within_arc(arc, plant, t)[0] + rate * t


@compiled
def _goes_to(t: float, args: tuple[np.record, np.record, int]) -> bool:
    """Return whether the runner moves to a side at t (s) of an arc; args: arc, plant, side."""
    arc, plant, side = args
    return side * (within_arc(arc, plant, t)[2] + arc.rate) > 0.0  # type: ignore[no-any-return]


#: When (s) the runner no longer moves to a side: of (arc, plant, side) and a bracket
turn_from = bisection(_goes_to)
