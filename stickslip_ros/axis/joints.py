# SPDX-License-Identifier: Apache-2.0
"""The joints that messages name: slider, piezo and contact of an axis, and their state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from stickslip_ros.parameters.groups import CONTACT_SUFFIX, PIEZO, SLIDER

if TYPE_CHECKING:
    from stickslip_ros.axis.axis import Axis

#: Of each joint in a state message: the end of its name, position, velocity, effort (None: unknown)
Joints = Sequence[tuple[str, float, float, float | None]]


def joints_of(axis: Axis) -> Joints:
    """Return slider and piezo; the friction force on the slider is -F, on the piezo +F."""
    state = axis.state
    return (
        (SLIDER, state.x, state.v, -state.force),
        (PIEZO, state.u, state.rate, state.force),
    )


def contact_joints(axis: Axis) -> Joints:
    """Return deflection and differential velocity of the contact, and the friction force.

    Of several contacts that is their mean, and the whole force; the deflections of each follow.
    """
    state = axis.state
    each = axis.simulation.deflections.tolist() if axis.parameters.friction.contacts > 1 else ()
    return (
        (CONTACT_SUFFIX, state.z, state.w, state.force),
        *((f"{CONTACT_SUFFIX}_{k}", z, state.w, None) for k, z in enumerate(each, 1)),
    )
