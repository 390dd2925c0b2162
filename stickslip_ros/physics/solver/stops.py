# SPDX-License-Identifier: Apache-2.0
"""Travel stops: where the runner hits a stop, how it is held, and when it is released.

A hit is perfectly inelastic: the velocity becomes 0. While the other forces press the runner
against the stop, it stands, and only the deflection changes, with w = -u'. The same arcs compute
this, with an infinitely heavy runner. When the force turns, the runner is free again.

Arcs that may reach a stop are shortened until they surely stay clear of it, or are short compared
with the ringing. The path of such short arcs is sampled to find the hit. All this follows from the
anchor, so the result does not depend on how a run is divided into calls.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.compiled import compiled
from stickslip_ros.physics.solver.arc_dispatch import find_arc, friction_at, place_contacts
from stickslip_ros.physics.solver.arc_motion import (
    actuator_path,
    end_at,
    motion_after,
    rate_after,
    turn_from,
)
from stickslip_ros.physics.solver.contact_arcs import stay
from stickslip_ros.physics.solver.layout import ELASTIC, GLIDE, REST, TABULATED, TAYLOR
from stickslip_ros.physics.solver.oscillator import bisection
from stickslip_ros.physics.solver.taylor import Z, integral

#: A short arc: a 32nd of the ringing period, in units of its angular frequency
_SHORT = 2.0 * math.pi / 32.0
#: Factor by which an arc is shortened at a time
_SHORTER = 8.0
#: Shortest lengths that an endless arc gets
_LONGEST = 64.0
#: Times within an arc of a held runner at which it is checked whether the force has turned
_PROBES = 8
#: Time (s) that turns the speeds of a held runner into lengths: no speed counts as negligible
_NEVER_STILL = 1e300
#: Position counts as beyond a stop above this fraction of it: a few roundings
_ROUNDING = 1e-15


@compiled
def holding_stop(plant: np.record, s: np.record, stops: np.record, contacts: NDArray | None) -> int:
    """Return which stop holds the runner at the anchor: -1 the lower, 1 the upper, 0 none."""
    if s.v != 0.0:
        return 0
    if contacts is not None:
        for c in contacts:
            c.now_z, c.now_second = c.z, c.second
    push = plant.force - plant.spring * s.x - friction_at(s.z, -s.rate, plant, contacts)
    for side in (-1, 1):
        at_stop = s.x == (stops.low if side < 0 else stops.high)
        if at_stop and (side * push > 0.0 or (push == 0.0 and s.stopped == side)):
            return side
    return 0


@compiled
def make_held_plant(plant: np.record, kernel: np.record) -> None:
    """Let kernel.held be the plant of an infinitely heavy runner on the same contact."""
    kernel.held = plant
    held = kernel.held
    held.sigma_2 = 0.0  # viscous friction moves nothing here
    held.mass = math.inf
    held.force = held.spring = 0.0
    held.delta = held.kappa = held.omega = 0.0
    held.inv_omega = _NEVER_STILL
    held.precomputed, held.burst_top, held.slides = -1, 0.0, 0  # without tables or a load


@compiled
def held_arc(
    arc: np.record,
    plant: np.record,
    held: np.record,
    contacts: NDArray | None,
    side: int,
    limit: float,
) -> None:
    """Find the end of the arc of the contacts while the stop ``side`` holds the runner.

    held is the plant from `make_held_plant`. The arc ends where the stop releases the runner.
    """
    arc.force = 0.0  # the runner is heavy beyond all loads
    if arc.rate == 0.0:
        arc.kind = REST
        end_at(arc, limit, arc.z, 0.0, 0.0)
        if contacts is not None:
            stay(arc, contacts, limit, 0.0)
        return
    find_arc(arc, held, contacts, limit, False)
    h, left = arc.length, 0.0
    pressed = (arc, plant, held, contacts, side)
    for probe in range(1, _PROBES + 1):
        right = h * probe / _PROBES
        if not _is_pressed(right, pressed):
            find_arc(arc, held, contacts, _release(pressed, left, right), False)
            return
        left = right


@compiled
def _is_pressed(
    t: float, args: tuple[np.record, np.record, np.record, NDArray | None, int]
) -> bool:
    """Return whether the runner is pressed against the stop at t (s) of an arc."""
    arc, plant, held, contacts, side = args
    dr, z, _ = motion_after(arc, held, t)
    z = place_contacts(arc, contacts, t, (dr, z))
    push = plant.force - plant.spring * arc.x - friction_at(z, -arc.rate, plant, contacts)
    return not side * push < 0.0


_release = bisection(_is_pressed)


@compiled
def held_friction_work(arc: np.record, plant: np.record) -> float:
    """Return the energy (J) of friction work over the arc of a held runner."""
    h, rate, z0, z1 = arc.length, arc.rate, arc.z, arc.z_end
    z_sum = 0.5 * (z0 + z1) * h  # of an arc along which z is linear
    if arc.kind == TAYLOR:
        z_sum = arc.mirror * integral(arc.work, Z, h)
    impulse = plant.sigma_0 * z_sum + plant.sigma_1 * (z1 - z0) - plant.sigma_2 * rate * h
    return -rate * impulse - 0.5 * plant.sigma_0 * (z1 * z1 - z0 * z0)


@compiled
def arc_to_stop(
    arc: np.record, plant: np.record, contacts: NDArray | None, stops: np.record
) -> int:
    """Let an arc end where it hits a stop; return which: -1 the lower, 1 the upper, 0 none."""
    short = _SHORT * plant.inv_omega
    while True:
        lowest, highest = _reach(arc)
        if stops.low <= lowest and highest <= stops.high:
            return 0
        h = arc.length
        if h <= short and arc.kind != TABULATED:
            break
        shorter = max(short, min(h, _SHORTER * _LONGEST * short) / _SHORTER)
        find_arc(arc, plant, contacts, min(h, shorter), False)
    t, side = arc.length, 0
    for one in (-1, 1):
        at = _touch(arc, plant, one, stops.low if one < 0 else stops.high)
        if at <= t:
            t, side = at, one
    if side != 0:
        find_arc(arc, plant, contacts, t, False)
    return side


@compiled
def _reach(arc: np.record) -> tuple[float, float]:
    """Return a lowest and a highest position (m) that the arc does not pass."""
    h = arc.length
    moved = actuator_path(arc, h) if arc.rate != 0.0 or arc.bend != 0.0 else 0.0
    if arc.kind == ELASTIC:
        down = min(arc.z_min, arc.z_end) - arc.z
        up = max(arc.z_max, arc.z_end) - arc.z
    elif h < math.inf:  # w keeps its sign
        down = up = arc.path
    else:
        down = up = arc.mirror * math.inf if arc.kind == GLIDE else 0.0
    beyond = 0.125 * abs(arc.bend) * h * h if arc.bend != 0.0 else 0.0  # where the actuator turns
    low, high = min(moved, 0.0) - beyond, max(moved, 0.0) + beyond
    return arc.x + low + min(down, 0.0), arc.x + high + max(up, 0.0)


@compiled
def _touch(arc: np.record, plant: np.record, side: int, stop: float) -> float:
    """Return when (s) a short arc passes the stop (m) on that side, nan if it does not.

    An arc that passes it only in between turns there.
    """
    if not abs(stop) < math.inf:
        return math.nan
    h = arc.length
    beyond = _ROUNDING * abs(stop)
    if _over(arc, plant, side, stop, h) <= beyond:
        if not side * (arc.w + arc.rate) > 0.0 > side * (arc.w_end + rate_after(arc, h)):
            return math.nan
        h = turn_from((arc, plant, side, False), 0.0, h)
        if _over(arc, plant, side, stop, h) <= beyond:
            return math.nan
    return _hit((arc, plant, side, stop), 0.0, h)


@compiled
def _is_short_of(t: float, args: tuple[np.record, np.record, int, float]) -> bool:
    arc, plant, side, stop = args
    return not _over(arc, plant, side, stop, t) > 0.0


_hit = bisection(_is_short_of)


@compiled
def _over(arc: np.record, plant: np.record, side: int, stop: float, t: float) -> float:
    """Return how far (m) beyond the stop the runner would be after t (s)."""
    return side * (arc.x + motion_after(arc, plant, t)[0] + actuator_path(arc, t) - stop)
