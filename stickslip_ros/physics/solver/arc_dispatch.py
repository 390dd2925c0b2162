# SPDX-License-Identifier: Apache-2.0
"""The next arc, its limits and friction, and samples within it, on one contact or on several.

A sample is the state at the time asked for; it moves nothing.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.compiled import compiled
from stickslip_ros.physics.model.friction import friction_force
from stickslip_ros.physics.solver.arc_motion import (
    actuator_path,
    begin_arc,
    motion_after,
    rate_after,
    turning_point,
)
from stickslip_ros.physics.solver.contact_arcs import contacts_arc, deflection_after
from stickslip_ros.physics.solver.general_arcs import (
    force_of,
    general_arc,
    needs_steps,
    second_after,
)
from stickslip_ros.physics.solver.layout import TABULATED
from stickslip_ros.physics.solver.single_contact_arcs import next_arc

#: Arcs that a tabulated one is made of, at most: three branches, in a few steps each
_MOST_PARTS = 100


class ArcLimits(NamedTuple):
    """Limits of the next arc."""

    resting: bool  #: the drive cycle is over
    limit: float  #: s until the next kink, or until t_end where that is an event
    ahead: float  #: s until t_end
    last: bool  #: t_end is an event and comes before the next kink


@compiled
def arc_limits(s: np.record, request: np.record, drive: NDArray, period: float) -> ArcLimits:
    """Set s.rate and s.bend and return the limits of the next arc."""
    resting = s.done >= s.count
    s.bend = 0.0 if resting else drive[2, s.segment]
    if resting:
        s.rate = 0.0
    elif s.bend == 0.0 or s.tau == 0.0:  # else it has got there: w = 0 at a turn has to stay exact
        s.rate = drive[1, s.segment]
    limit = math.inf if resting else drive[0, s.segment] - s.tau
    ahead = (request.t_end - s.start) - s.done * period - s.since - s.tau
    last = request.cut != 0 and ahead < limit
    return ArcLimits(resting, ahead if last and ahead > 0.0 else limit, ahead, last)


@compiled
def find_arc(
    arc: np.record, plant: np.record, contacts: NDArray | None, limit: float, tables: bool
) -> None:
    """Find the end of the arc that `begin_arc` started, at most limit (s) long.

    u' is constant for at least limit. tables allows arcs that are tabulated, which have an end but
    nothing within.
    """
    arc.z_max, arc.z_min = -math.inf, math.inf
    if contacts is None:
        next_arc(arc, plant, limit, tables)
    elif needs_steps(contacts[0]):
        general_arc(arc, plant, contacts, limit)
    else:
        contacts_arc(arc, plant, contacts, limit)


@compiled
def friction_at(z: float, w: float, plant: np.record, contacts: NDArray | None) -> float:
    """Return F (N) of Eq. 1 at z (m), or at the ``now_z`` of several contacts, and w (m/s)."""
    if contacts is None:
        return friction_force(z, w, plant)
    force = 0.0
    for c in contacts:
        force += force_of(c, c.now_z, c.now_second, w)
    return force


@compiled
def place_contacts(
    arc: np.record, contacts: NDArray | None, t: float, at: tuple[float, float]
) -> float:
    """Set the ``now_z`` of several contacts to those after t (s) of the arc; return their mean.

    at is the path (m) and the deflection of a single contact, which is its mean (m).
    """
    if contacts is None:
        return at[1]
    force = stiffness = 0.0
    for c in contacts:
        c.now_z, c.now_second = deflection_after(arc, c, at[0], t), second_after(arc, c, t)
        force += c.sigma_0 * c.now_z
        stiffness += c.sigma_0
    return force / stiffness


@compiled
def sample_anchor(s: np.record, contacts: NDArray | None, drive: NDArray, tracking: int) -> None:
    """Store the state at the anchor as the result."""
    s.now_segment, s.now_tracking = s.segment, tracking
    s.now_x, s.now_v, s.now_z, s.now_rate = s.x, s.v, s.z, s.rate
    _place_sample(s, drive, s.tau)
    if contacts is not None:
        for c in contacts:
            c.now_z, c.now_second = c.z, c.second


@compiled
def sample_within(
    s: np.record,
    kernel: np.record,
    plant: np.record,
    contacts: NDArray | None,
    drive: NDArray,
    limits: ArcLimits,
) -> None:
    """Store the state at t_end, which lies within the arc; a backstep may be complete by then.

    plant is that of the arc: for a runner held by a stop, that of `stops.make_held_plant`. At rest
    the last arc never ends.
    """
    arc, stops, ahead, tracking = kernel.arc, kernel.stops, limits.ahead, s.tracking
    if tracking and limits.resting:
        t, dr = turning_point(arc, plant, s.sign)
        if t <= ahead:
            s.backstep = s.x_top - min(s.x_low, s.sign * (s.x + dr))
            tracking = 0
    sample_anchor(s, contacts, drive, tracking)
    if not 0.0 < ahead < math.inf:
        return
    at = ahead
    if contacts is None and arc.kind == TABULATED:  # through the arcs that it is made of
        limit = limits.limit
        next_arc(arc, plant, limit, False)
        while arc.length <= at:
            at -= arc.length
            limit -= arc.length
            _next_part(arc, plant, limit)
    dr, z, w = motion_after(arc, plant, at)
    z = place_contacts(arc, contacts, at, (dr, z))
    if s.stopped == 0:
        s.now_x = min(max(arc.x + dr + actuator_path(arc, at), stops.low), stops.high)
    s.now_rate = rate_after(arc, at)
    s.now_v, s.now_z = w + s.now_rate, z
    _place_sample(s, drive, s.tau + ahead)


@compiled
def turn_of_arc(
    arc: np.record, part: np.record, plant: np.record, contacts: NDArray | None, sign: int
) -> tuple[float, float]:
    """Return when (s) the runner turns towards sign within any arc, and its path (m) up to there.

    The time is nan where it does not. A tabulated arc along which it turns away before is gone
    through in the arcs that it is made of, in part.
    """
    if contacts is not None:  # which have no tables
        return turning_point(arc, plant, sign)
    if arc.kind != TABULATED or sign * (arc.w + arc.rate) < 0.0:
        return turning_point(arc, plant, sign)
    if not sign * arc.path < 0.0 < sign * (arc.w_end + rate_after(arc, arc.length)):
        return math.nan, 0.0
    part.weight, part.trial = arc.weight, arc.trial
    begin_arc(part, plant, (arc.x, arc.z, arc.w), (arc.rate, arc.bend, arc.length))
    next_arc(part, plant, arc.length, False)
    gone = moved = 0.0
    for _ in range(_MOST_PARTS):
        t, dr = turning_point(part, plant, sign)
        if t == t:
            return gone + t, moved + dr
        gone += part.length
        if not gone < arc.length:
            break
        moved += part.path + actuator_path(part, part.length)
        _next_part(part, plant, arc.length - gone)
    return math.nan, 0.0


@compiled
def _next_part(part: np.record, plant: np.record, limit: float) -> None:
    """Let a part of a tabulated arc be the one that follows, at most limit (s) long."""
    h = part.length
    state = part.x + part.path + actuator_path(part, h), part.z_end, part.w_end
    begin_arc(part, plant, state, (rate_after(part, h), part.bend, limit))
    next_arc(part, plant, limit, False)


@compiled
def _place_sample(s: np.record, drive: NDArray, tau: float) -> None:
    """Set the deflection of the actuator at tau (s) into the segment."""
    s.now_u = 0.0
    if s.done < s.count:
        s.now_u = (drive[1, s.segment] + 0.5 * drive[2, s.segment] * tau) * tau
    for k in range(s.segment):
        s.now_u += drive[0, k] * (drive[1, k] + 0.5 * drive[2, k] * drive[0, k])
    s.now_u += s.level
