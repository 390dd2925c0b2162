# SPDX-License-Identifier: Apache-2.0
"""Every topic that an axis publishes, each defined once: name, type, QoS, content.

The node, the recorder and the tests of the layouts read this table; `python docs/tables.py` writes
it into the page docs/node.md and the policy for SROS 2. A new topic that is published with every
state is one more line of it; others also need a call of the node's `publish`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from stickslip_ros.axis.command import FLOAT64, JOINT_STATE, TRAJECTORY
from stickslip_ros.axis.joints import Joints, contact_joints, joints_of
from stickslip_ros.recordings.schemas import STATUS_TYPE as STATUSES

if TYPE_CHECKING:
    from rclpy.node import Node

    from stickslip_ros.axis import Axis


@dataclass(frozen=True)
class OutputTopic:
    """A topic that the node of an axis publishes."""

    name: str  #: as ROS expands it: "~/" below the node, bare in its namespace, "/" anywhere
    type: str
    content: str  #: for docs/node.md
    kept: int = 0  #: messages that those get who come late; 0: none
    of_process: bool = False  #: published once, whatever the number of axes
    #: The axis and its report -> what a JointState holds that is published with every state; none:
    #: it stays away
    joints: Callable[[Axis, Joints], Joints] | None = None

    def full_name(self, node: str) -> str:
        """Return the name for a node of this full name."""
        if self.name.startswith("/"):
            return self.name
        below = node if self.name.startswith("~") else node.rpartition("/")[0]
        return f"{below}/{self.name.removeprefix('~/')}"


# The description is published before the events, so that a subscriber of events knows, or is
# about to know, the state it led to.
STATUS = OutputTopic(
    "~/status",
    STATUSES,
    "the status `axis` described below, with every event, and five times a second in motion",
    kept=1,
)
EVENTS = OutputTopic("~/events", STATUSES, "what happened, but for set points", kept=1000)
SET_POINTS = OutputTopic("~/set_points", STATUSES, "set points of `~/joint_commands` as events")
SET_POINT_LOG = OutputTopic(
    "~/set_point_log", STATUSES, "up to 1000 of them in a message, for recorders", kept=1000
)
DESCRIPTION = OutputTopic(
    "~/description",
    STATUSES,
    "parameters with unit and range, ranges of commands, joints, version",
    kept=1,
)
JOINTS = OutputTopic(
    "joint_states",
    JOINT_STATE,
    "`<axis_name>_slider`: position as the sensor reads it, from the zero that was set, mean "
    "velocity since the last instant with a reading, friction force; `<axis_name>_piezo`: "
    "commanded deflection; this and the next three only while somebody subscribes, and this and "
    "the next only while the sensor gives readings",
    joints=lambda _, reported: reported,
)
RUNNER_TOPIC = OutputTopic(
    "~/joint_states",
    JOINT_STATE,
    "`<axis_name>_slider` alone",
    joints=lambda _, reported: reported[:1],
)
TRUTH_TOPIC = OutputTopic(
    "~/truth",
    JOINT_STATE,
    "the model's own `<axis_name>_slider` and `<axis_name>_piezo`: position from the model's "
    "origin, velocity at that instant, friction force",
    joints=lambda axis, _: joints_of(axis),
)
CONTACT_TOPIC = OutputTopic(
    "~/contact",
    JOINT_STATE,
    "`<axis_name>_contact`: asperity deflection, differential velocity, friction force; of several "
    "contacts that is the mean, and `<axis_name>_contact_1` .. have the deflection of each",
    joints=lambda axis, _: contact_joints(axis),
)
DIAGNOSTICS = OutputTopic("/diagnostics", STATUSES, "once a second: `axis`, `friction`, `timing`")
CLOCK = OutputTopic(
    "/clock", "rosgraph_msgs/msg/Clock", "only with the parameter `publish_clock`", of_process=True
)
READY = OutputTopic(
    "~/transition_event",
    "lifecycle_msgs/msg/TransitionEvent",
    "`active`, once the axis, or all axes of the host, take commands; again for new subscribers",
    kept=1,
    of_process=True,
)

#: All of them by name, in the order in which the node makes them
OUTPUTS = {one.name: one for one in tuple(globals().values()) if isinstance(one, OutputTopic)}


def axes_in(node: Node) -> list[str]:
    """Return the full names of the axes whose topics a node of ROS sees."""
    ending = SET_POINT_LOG.full_name("")
    topics = [name for name, _ in node.get_topic_names_and_types()]
    found = (name for name in topics if name.endswith(ending))
    return sorted(n.removesuffix(ending) for n in found if node.count_publishers(n))


#: What a twin publishes beside an axis
TWIN_OUTPUTS = (
    OutputTopic(
        "~/joint_states",
        JOINT_STATE,
        "the joint as it was expected, effort: half its 95 % band (m); `<joint>_measured`",
    ),
    OutputTopic("~/residual", FLOAT64, "measured less expected position (m)"),
    OutputTopic("~/step_size", FLOAT64, "the step as known now (m)", kept=1),
    OutputTopic(
        "~/estimates",
        STATUSES,
        "parameters with 95 % intervals, and the last changes, once a second",
    ),
    OutputTopic(
        "~/prediction",
        TRAJECTORY,
        "begin and end of the move that was asked for; `/diagnostics` has its steps and band",
    ),
    OutputTopic("/diagnostics", STATUSES, "once a second: level, reason, drift, troubles"),
)
