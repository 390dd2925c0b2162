# SPDX-License-Identifier: Apache-2.0
"""Messages of the axis: what `axis_node` publishes, built from plain state."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from sensor_msgs.msg import JointState

from stickslip_ros.axis import Event
from stickslip_ros.axis.event_texts import event_texts, value_text
from stickslip_ros.solver import State

_LEVELS = {
    "applied": DiagnosticStatus.OK,
    "finished": DiagnosticStatus.OK,
    "fault": DiagnosticStatus.ERROR,
}


def stamp(nanoseconds: int) -> Time:
    """Return the time message of nanoseconds since the epoch."""
    seconds, rest = divmod(nanoseconds, 1_000_000_000)
    return Time(sec=seconds, nanosec=rest)


class StateMessages:
    """The two state messages of an axis; filled anew each time, which costs less than new ones."""

    def __init__(self, axis_name: str) -> None:
        """Name the joints after the axis."""
        self.joints = JointState(name=[f"{axis_name}_slider", f"{axis_name}_piezo"])
        self.contact = JointState(name=[f"{axis_name}_contact"])

    def fill(self, state: State, time: Time) -> None:
        """Take over a state; the friction force on the slider is -F, on the piezo +F."""
        self.joints.header.stamp = time
        self.joints.position = [state.x, state.u]
        self.joints.velocity = [state.v, state.rate]
        self.joints.effort = [-state.force, state.force]
        self.contact.header.stamp = time
        self.contact.position = [state.z]
        self.contact.velocity = [state.w]
        self.contact.effort = [state.force]


def diagnostic_status(
    name: str, level: bytes, message: str, values: Mapping[str, Any], hardware_id: str
) -> DiagnosticStatus:
    """Return a status with every value as text; floats in full, lists as JSON."""
    pairs = [KeyValue(key=key, value=value_text(value)) for key, value in values.items()]
    return DiagnosticStatus(
        level=level, name=name, message=message, hardware_id=hardware_id, values=pairs
    )


def diagnostic_array(time: Time, statuses: list[DiagnosticStatus]) -> DiagnosticArray:
    """Return an array with its time."""
    message = DiagnosticArray(status=statuses)
    message.header.stamp = time
    return message


def event_status(node: str, event: Event) -> DiagnosticStatus:
    """Return an event: what happened, with its simulation time in full."""
    return diagnostic_status(
        f"{node}: event",
        _LEVELS.get(event.outcome, DiagnosticStatus.WARN),
        f"{event.name} {event.outcome}",
        event_texts(event),
        node,
    )
