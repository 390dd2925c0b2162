# SPDX-License-Identifier: Apache-2.0
"""The joints that messages name: slider, piezo and contact of an axis, and their state."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import TYPE_CHECKING

from stickslip_ros.axis.command import HOLDING, STOPPED
from stickslip_ros.physics.parameters.groups import CONTACT_SUFFIX, PIEZO, SLIDER
from stickslip_ros.physics.parameters.row import SMALLEST

if TYPE_CHECKING:
    from stickslip_ros.axis.axis import Axis

#: Of each joint in a state message: the end of its name, position, velocity, effort (None: unknown)
Joints = Sequence[tuple[str, float, float, float | None]]

#: Reports that a controller may send back: those of a second or two
_REMEMBERED = 200
#: The parameter that says what a report is, and its value for the model's own state
SOURCE, TRUTH = "joint_state_source", "truth"


class JointReport:
    """What a driver of the real axis would say, report after report.

    The position is that of the reading which has arrived last, counted from the zero that was set;
    of the actuator it is the commanded deflection. Velocities are means since the last report, so
    they depend on when reports were made: make one at every instant, whether anybody reads it or
    not.
    """

    def __init__(self) -> None:
        """Start without a report."""
        self._last: tuple[float, float, float] | None = None  # s, reading and deflection (m)
        self._velocities = 0.0, 0.0  # m/s, since the one before it
        self._said: deque[float] = deque(maxlen=_REMEMBERED)  # positions (m) of the slider
        self._echo = math.nan  # one of them that somebody has sent back

    def take(self, axis: Axis) -> Joints:
        """Return slider and piezo at the present time; none where the sensor gives no reading.

        With the parameter joint_state_source "truth" they are the model's, from the zero that was
        set, at this instant.
        """
        sim, reading = axis.simulation, axis.arrived
        deflection = sim.commanded
        if not math.isnan(reading) and (self._last is None or sim.t > self._last[0]):
            now = sim.t, reading + axis.config.offset, deflection  # the zero moves nothing
            if self._last:
                dt, dx, du = (new - old for new, old in zip(now, self._last, strict=True))
                self._velocities = dx / dt, du / dt
            self._last = now
        if axis.parameters.node.joint_state_source == TRUTH:
            (end, x, v, force), piezo = joints_of(axis)
            self._said.append(x - axis.config.offset)
            return (end, x - axis.config.offset, v, force), piezo
        if math.isnan(reading):
            return ()
        v, rate = self._velocities
        self._said.append(reading)
        force = said_force(sim.force)
        # Taken from 0.0, so that none is not -0.0.
        return (SLIDER, reading, v, 0.0 - force), (PIEZO, deflection, rate, force)

    def echoes(self, axis: Axis, x: float) -> bool:
        """Return whether a position (m) is one that was reported, sent back while the axis rests.

        Controllers do so when they start, and repeat it. Followed from reading to reading, the
        noise of the sensor would carry the axis away.
        """
        if axis.mode not in (STOPPED, HOLDING):
            return False
        if x in self._said:
            self._echo = x
        return x == self._echo


def said_force(newtons: float) -> float:
    """Return a force as messages say it: 0 for -0.0, and for what only decays towards 0."""
    return 0.0 if abs(newtons) < SMALLEST else newtons


def joints_of(axis: Axis) -> Joints:
    """Return slider and piezo of the model; the friction force is -F on the one, +F on the other.

    Positions count from the model's origin.
    """
    state = axis.state
    return (
        (SLIDER, state.x, state.v, said_force(-state.force)),
        (PIEZO, state.u, state.rate, said_force(state.force)),
    )


def contact_joints(axis: Axis) -> Joints:
    """Return deflection and differential velocity of the contact, and the friction force.

    Of several contacts that is their mean, and the whole force; the deflections of each follow.
    """
    state = axis.state
    each = axis.simulation.deflections.tolist() if axis.parameters.friction.contacts > 1 else ()
    return (
        (CONTACT_SUFFIX, state.z, state.w, said_force(state.force)),
        *((f"{CONTACT_SUFFIX}_{k}", z, state.w, None) for k, z in enumerate(each, 1)),
    )
