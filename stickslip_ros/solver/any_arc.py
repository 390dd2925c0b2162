# SPDX-License-Identifier: Apache-2.0
"""The next arc, its deflections and its friction, on one contact or on several."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled
from stickslip_ros.model.friction import friction_force
from stickslip_ros.solver.arcs import next_arc
from stickslip_ros.solver.contact_arcs import contacts_arc, deflection_after
from stickslip_ros.solver.general_arcs import force_of, general_arc, inner_after, is_general
from stickslip_ros.solver.within_arc import within_arc


@compiled
def find_arc(
    arc: np.record, plant: np.record, contacts: NDArray | None, limit: float, tables: bool
) -> None:
    """Find the end of the arc that `begin_arc` started, at most limit (s) long.

    u' is constant for at least limit. tables allows arcs that are tabulated, which have an end but
    nothing within.
    """
    if contacts is None:
        next_arc(arc, plant, limit, tables)
    elif is_general(contacts):
        general_arc(arc, plant, contacts, limit)
    else:
        contacts_arc(arc, plant, contacts, limit)


@compiled
def friction_at_anchor(s: np.record, plant: np.record, contacts: NDArray | None) -> float:
    """Return F (N) of Eq. 1 at the anchor, for a runner at rest."""
    if contacts is None:
        return friction_force(s.z, -s.rate, plant)
    force = 0.0
    for c in contacts:
        force += force_of(c, c.z, c.inner[0], -s.rate)
    return force


@compiled
def friction_after(
    arc: np.record, plant: np.record, held: np.record, contacts: NDArray | None, t: float
) -> float:
    """Return F (N) of Eq. 1 after t (s) of an arc of a runner at rest.

    held is the plant from `stops.make_held_plant`.
    """
    dr, z, _ = within_arc(arc, held, t)
    if contacts is None:
        return friction_force(z, -arc.rate, plant)
    force = 0.0
    for c in contacts:
        z = deflection_after(arc, c, dr, t)
        force += force_of(c, z, inner_after(arc, c, t), -arc.rate)
    return force
