# SPDX-License-Identifier: Apache-2.0
"""Implicit arcs: when one is worth its work, and where it ends."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled
from stickslip_ros.model.friction import ALWAYS_PLASTIC, z_limit
from stickslip_ros.solver.layout import STIFF
from stickslip_ros.solver.roots import bisection
from stickslip_ros.solver.stiff import Moved, stiff_step
from stickslip_ros.solver.taylor import BAND, Branch, W, Z
from stickslip_ros.solver.within_arc import end_at, resolve

#: Error allowed in a step, as a share of the tolerance per cycle
_PER_STEP = 1e-4
#: Least length of an implicit step that pays off, in steps of a series: it costs
#: as much as that many
_WORTH = 10.0
#: An implicit step is tried where z and w change by less than this share in a step of the series
_SLOW = 0.3
#: Arcs until the next try after a step that did not pay off
_WAIT = 20.0
#: Lengths that are tried for one arc: tenths of tenths, down to less than any motion takes
_TRIES = 60
#: Largest and smallest factor from one step to the next
_GROWS, _SHRINKS = 5.0, 0.1
#: Step taken, as a share of the one whose error would be just allowed: so the next try succeeds
_SAFETY = 0.9
#: Power of its length with which the error of a step grows; error (m) that counts as none
_ORDER, _NO_ERROR = 6.0, 1e-300
#: Cost of an implicit step in the budget, in arcs of other kinds
_COST = 15
#: Borders that a step may cross
_AT_REST_W, _AT_EDGE, _AT_Z_SS, _AT_LIMIT, _AT_Z_BA = 1, 2, 3, 4, 5


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
    return (abs(work[row, 1]) + abs(work[row, 2]) * t) * t  # type: ignore[no-any-return]


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
    end_at(arc, h, mirror * z_end, mirror * w_end, mirror * end.path)
    return end.z == end.z  # type: ignore[no-any-return]


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
