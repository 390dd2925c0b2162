# SPDX-License-Identifier: Apache-2.0
"""Travel stops of a runner on several contacts: what `stops` says, with the arcs of `contact_arcs`.

While a stop holds the runner, its contacts go on with w = -u'.
"""

from __future__ import annotations

import numpy as np

from stickslip_ros.compiled import compiled
from stickslip_ros.solver.arcs import end_at
from stickslip_ros.solver.contact_arcs import Contacts, contact_arc, deflections, force_of
from stickslip_ros.solver.layout import REST
from stickslip_ros.solver.roots import bisection
from stickslip_ros.solver.stops import LONGEST, LOOKS, SHORT, SHORTER, first_touch, reach


@compiled
def holding(plant: np.record, s: np.record, on: Contacts) -> int:
    """Return which stop holds the runner at the anchor: -1 the lower, 1 the upper, 0 none."""
    if s.v != 0.0:
        return 0
    for side in (-1, 1):
        if s.x == (s.low if side < 0 else s.high):
            force = plant.force - plant.spring * s.x
            push = side * (force - force_of(on.constants, on.z, -s.rate))
            if push > 0.0 or (push == 0.0 and s.stopped == side):
                return side
    return 0


@compiled
def held_arc(
    arc: np.record, plant: np.record, held: np.record, on: Contacts, side: int, limit: float
) -> None:
    """Find the end of the arc of the contacts while the stop ``side`` holds the runner.

    held is what `make_unmoved` makes of plant. The arc ends where the runner gets away.
    """
    if arc.rate == 0.0:
        arc.kind = REST
        end_at(arc, limit, arc.z, 0.0, 0.0)
        on.end[:] = on.z
        return
    contact_arc(arc, held, on, limit)
    h, left = arc.length, 0.0
    pushed = (arc, plant, held, on, side)
    for look in range(1, LOOKS + 1):
        right = h * look / LOOKS
        if not _is_pressed(right, pushed):
            contact_arc(arc, held, on, _release(pushed, left, right))
            return
        left = right


@compiled
def _is_pressed(t: float, args: tuple[np.record, np.record, np.record, Contacts, int]) -> bool:
    arc, plant, held, on, side = args
    z = np.empty(len(on.z))
    deflections(arc, held, on, t, z)
    force = plant.force - plant.spring * arc.x
    return not side * (force - force_of(on.constants, z, -arc.rate)) < 0.0


_release = bisection(_is_pressed)


@compiled
def arc_to_stop(arc: np.record, plant: np.record, on: Contacts, s: np.record) -> int:
    """Shorten the arc so that it ends where the runner hits a stop.

    Return which stop it hits at its end: -1 the lower, 1 the upper, 0 none.
    """
    short = SHORT * plant.inv_omega
    while True:
        lowest, highest = reach(arc)
        if s.low <= lowest and highest <= s.high:
            return 0
        h = arc.length
        if h <= short:
            break
        contact_arc(arc, plant, on, max(short, min(h, SHORTER * LONGEST * short) / SHORTER))
    t, side = first_touch(arc, plant, s)
    if side != 0:
        contact_arc(arc, plant, on, t)
    return side
