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
from stickslip_ros.solver.stops import LOOKS, holding_against, shortening


@compiled
def holding(plant: np.record, s: np.record, on: Contacts) -> int:
    """Return which stop holds the runner at the anchor: -1 the lower, 1 the upper, 0 none."""
    force = plant.force - plant.spring * s.x
    return holding_against(s, force - force_of(on.constants, on.z, -s.rate))  # type: ignore[no-any-return]


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
def _go(args: tuple[np.record, np.record, Contacts], t: float) -> None:
    contact_arc(*args, t)


arc_to_stop = shortening(_go)
