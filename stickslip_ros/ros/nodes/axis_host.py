# SPDX-License-Identifier: Apache-2.0
"""Several axes in one process: a node for each, and a host node that advances their time.

The host is called ``stickslip_axis`` and has the parameter ``axes``. Each axis is a node with its
name from ``axes``, in the namespace of the host: its topics are ``/x/command/steps``,
``/x/events``, and all publish on one ``/joint_states``. A parameter of the host applies to every
axis that does not set it. In YAML a name such as y, n or on needs quotes.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

from stickslip_ros.axis import Axis
from stickslip_ros.axis.axis import AxisGroup
from stickslip_ros.axis.command import Command
from stickslip_ros.axis.commands import COMMANDS
from stickslip_ros.axis.device import STEPS_OF_TIME
from stickslip_ros.axis.faults import VANISH
from stickslip_ros.base.compiled import report_compilation
from stickslip_ros.emulator import CONTROLLERS
from stickslip_ros.physics.parameters import PARAMETERS, ParameterError, Parameters
from stickslip_ros.physics.parameters.groups import AXIS_NODE
from stickslip_ros.ros.nodes import node_parameters
from stickslip_ros.ros.nodes.axis_node import AxisNode
from stickslip_ros.ros.nodes.diagnostics import Diagnostics
from stickslip_ros.ros.nodes.guarded_node import GuardedNode, refused
from stickslip_ros.ros.nodes.messages import (
    fill_joints,
    message_of,
    offer,
    publisher_of,
    read_command,
    why_not,
)
from stickslip_ros.ros.nodes.node_parameters import AXES, EMULATE, EMULATE_PORT, OF_PROCESS
from stickslip_ros.ros.nodes.process import Runnable, run
from stickslip_ros.ros.nodes.sim_loop import SimLoop
from stickslip_ros.ros.nodes.topics import RUNNER_TOPIC

TRAJECTORY, SET_POINT = COMMANDS["trajectory"], COMMANDS["joint_command"]
_OF_TIME = ("real_time_factor", *STEPS_OF_TIME)  # that the host takes for all axes, at any time
#: Parameters of the process as a whole: those of the host hold for all axes.
_OF_PROCESS = ("publish_rate", "real_time_priority", "publish_clock", "start_paused", *_OF_TIME)


def axis_or_host(arguments: Sequence[str] | None = None, **options: Any) -> Runnable:
    """Return the axis, or the host of those that the parameter ``axes`` names.

    They are also served as the controller that the parameter ``emulate`` names, if it does.
    arguments is the command line of the process (``sys.argv`` if None), options are those of
    `rclpy.node.Node`. Raises ParameterError.
    """
    quiet: dict[str, Any] = {"start_parameter_services": False, "enable_rosout": False, **options}
    arguments = sys.argv if arguments is None else arguments
    early = Node(AXIS_NODE, automatically_declare_parameters_from_overrides=True, **quiet)
    try:
        names = _names(early)
    finally:
        early.destroy_node()
    made: AxisHost | AxisNode = (
        AxisHost(names, arguments, **options) if names else AxisNode(arguments=arguments, **options)
    )
    called = [node.get_fully_qualified_name() for node in made.nodes]
    for text in node_parameters.unused_files(arguments, called):
        made.get_logger().warning(text)
    name, port = (node_parameters.declare_own(made, one) for one in (EMULATE, EMULATE_PORT))
    if not name:
        return made
    from stickslip_ros.ros.nodes.emulation import Emulation  # asyncio, 0.1 s

    if name in CONTROLLERS and port < 0:
        port = CONTROLLERS[name].port
    return Emulation(made, name, port)


class AxisHost(GuardedNode):
    """Hosts axes and runs until :attr:`finished` is done."""

    def __init__(self, names: Sequence[str], arguments: Sequence[str], **options: Any) -> None:
        """Set up an axis for each name and start them; as `axis_or_host`."""
        super().__init__(AXIS_NODE, **options)
        given = node_parameters.of_axes(self, arguments)
        values = Parameters.of(given)
        node_parameters.declare_own(self, AXES)
        sim_loop = SimLoop(self, values.node)
        common = {name: value for name, value in given.items() if name not in _OF_PROCESS}
        # A wish for another name of the node would otherwise rename every one of them.
        mine = {"cli_args": without_name(arguments), "use_global_arguments": False}
        options = {**mine, **options}
        options["namespace"] = self.get_namespace()
        of_process = {name: getattr(values.node, name) for name in _OF_PROCESS}
        self.axes = [
            AxisNode(
                name=name,
                sim_loop=sim_loop,
                given={"axis_name": name, **common},
                of_process=of_process,
                together=self.resolve_topic_name(f"~/{TRAJECTORY.interface}"),
                arguments=arguments,
                **options,
            )
            for name in names
        ]
        self.nodes = [self, *self.axes]
        for node in self.axes:  # with less, an axis would pass over its own in silence
            if node.followed and not self.followed:
                raise ParameterError(
                    f"use_sim_time is true for {node.get_name()} alone, and all axes of a process "
                    f"have one time: give it to {AXIS_NODE}, or to all nodes"
                )
        called = sorted(node.axis.parameters.node.axis_name for node in self.axes)
        for one, other in pairwise(called):
            if one == other:
                raise ParameterError(f"axis_name is {one!r} for two axes; leave it out")
        for name in _OF_TIME:
            if self.has_parameter(name):
                self.undeclare_parameter(name)
            row = node_parameters.descriptor(PARAMETERS[name])
            row.dynamic_typing = True  # a whole number for a float; the axis checks it
            self.declare_parameter(name, of_process[name], row, ignore_override=True)
        pause = COMMANDS["pause"]
        offer(self, pause, partial(self.axes[0].serve, pause))  # of all, by one
        for name in ("stop", "home"):
            offer(self, COMMANDS[name], partial(self._for_all, COMMANDS[name]))
        offer(self, SET_POINT, self._on_set_points)
        offer(self, TRAJECTORY, self._follow)
        self._sim_loop = sim_loop
        self._joints = publisher_of(self, RUNNER_TOPIC, values.node.publish_rate)
        self._together = AxisGroup([node.axis for node in self.axes])
        sim_loop.start(self.axes, self._together.end, self._publish_joints)

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set the parameters of the time of all axes; the first axis executes the change."""
        first = self.axes[0]
        foreign = [p.name for p in parameter_list if p.name not in _OF_TIME]
        if foreign:
            cure = f"set it at the axes, as /{first.get_name()}"
            return refused(f"{foreign[0]}: {cure}")
        new = [
            p
            for p in parameter_list
            if p.name in STEPS_OF_TIME or first.get_parameter(p.name).value != p.value
        ]
        result = first.set_parameters_atomically(new)
        return super().set_parameters_atomically(parameter_list) if result.successful else result

    def _for_all(self, command: Command, request: Any, response: Any) -> Any:
        """Have every axis carry out a command that is a service."""
        there = [node for node in self.axes if VANISH not in node.axis.config.faults]
        done = [(node.get_name(), node.carry_out(command, lambda: request)) for node in there]
        reasons = [f"{name}: {reason}" for name, reason in done if reason]
        response.success, response.message = not reasons, "; ".join(reasons)
        return response

    def _publish_joints(self) -> None:
        """Publish the sliders of all axes that have readings in one message."""
        is_read = self._joints.get_subscription_count() > 0
        for node in self.axes:  # nor do they rest
            node.is_read = node.is_read or is_read
        if not is_read:
            return
        joints = [
            (f"{node.axis.parameters.node.axis_name}{end}", x, v, force)
            for node in self.axes
            if VANISH not in node.axis.config.faults
            for end, x, v, force in node.reported[:1]
        ]
        if joints:
            self._joints.publish(fill_joints(JointState(), self._sim_loop.stamp(), "", joints))

    def _on_set_points(self, data: bytes) -> None:
        """Hand set points of several joints to their axes; each refuses its own."""
        for node in self.axes:
            if VANISH not in node.axis.config.faults:
                node.carry_out(SET_POINT, lambda: message_of(data, SET_POINT))

    def _follow(self, data: bytes) -> None:
        """Carry out a trajectory of several joints, or refuse it at all that it names."""
        nodes = {node.axis.config.joint: node for node in self.axes}
        named = list(nodes.values())
        joints: list[str] = []
        try:
            message = message_of(data, TRAJECTORY)
            joints = list(message.joint_names)
            named = [nodes[name] for name in dict.fromkeys(joints) if name in nodes] or named
            if any(VANISH in node.axis.config.faults for node in named):
                return
            self._sim_loop.act(*named)
            self._sim_loop.check([TRAJECTORY.name])
            self._together.named(joints)
            now = self._sim_loop.pace.stamp
            orders = {one: read_command(TRAJECTORY, message, now, one) or () for one in joints}
            self._together.follow({one: ([one], *order[1:]) for one, order in orders.items()})
        except Exception as error:  # of any kind: a peer may send anything
            for node in named:
                node.refuse(TRAJECTORY.name, joints, why_not(error))
            return
        for node in named:
            self._sim_loop.follow_up(node)
            node.publish_events()

    def close(self) -> None:
        """Publish the events since the last block."""
        for node in self.axes:
            node.close()


def _names(node: Node) -> list[str]:
    """Return the names that the parameter axes of a node holds; ParameterError if one is bad."""
    names = [name for name in node_parameters.declare_own(node, AXES) if name]
    for name in names:
        PARAMETERS["axis_name"].check(name)
    if len(set(names)) < len(names) or AXIS_NODE in names:
        raise ParameterError(
            f"axes is [{', '.join(names)}]; give different names, none of them {AXIS_NODE}"
        )
    return names


def without_name(arguments: Sequence[str]) -> list[str]:
    """Return a command line without the remapping of the node's own name."""
    kept: list[str] = []
    for argument in arguments:
        if re.match(r"(.*:)?__(node|name):=", argument) and kept and kept[-1] in ("-r", "--remap"):
            kept.pop()
        else:
            kept.append(argument)
    return kept


def compile_axis() -> None:
    """Have all compiled that a node of an axis needs, before there is one."""
    with report_compilation():
        axis = Axis({})
        axis.compile_ahead()
        Diagnostics("").prepare(axis)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node; return 0 when it was asked to end, 2 on bad use."""
    return run("axis_node", args, lambda: axis_or_host(args), compile_axis, _usage, many=True)


def _usage() -> str:
    rows = [
        f"  {row.name:<24}{row.description} (default: {row.default} {row.unit}".rstrip() + ")"
        for row in PARAMETERS.values()
    ]
    meaning = "Simulates a stick-slip axis, or several."
    return "\n".join([node_parameters.usage_of(meaning, OF_PROCESS), *rows])
