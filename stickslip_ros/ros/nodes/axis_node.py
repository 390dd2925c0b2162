# SPDX-License-Identifier: Apache-2.0
"""Node of one simulated axis: commands over topics and services in, state and events out.

The executable of this name runs one, ``stickslip_axis``, or one for each name in the parameter
``axes``. When they advance is the business of the `SimLoop`.
"""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

from stickslip_ros.axis import Axis, CommandRefused
from stickslip_ros.axis.command import JOINT_STATE, TRAJECTORY, Command
from stickslip_ros.axis.commands import COMMANDS
from stickslip_ros.axis.events import WARNED, Event, is_set_point, pack_set_points, shorten
from stickslip_ros.axis.faults import LATE, VANISH
from stickslip_ros.axis.joints import JointReport, Joints
from stickslip_ros.axis.pace import overload
from stickslip_ros.base.compiled import report_compilation
from stickslip_ros.base.reporting import format_si
from stickslip_ros.physics.model.idle import idle_settings
from stickslip_ros.physics.parameters import PARAMETERS, ParameterError, parameter
from stickslip_ros.physics.parameters.groups import AXIS_NODE
from stickslip_ros.physics.parameters.named_files import check_place
from stickslip_ros.ros.nodes import node_parameters, topics
from stickslip_ros.ros.nodes.diagnostics import Diagnostics, description
from stickslip_ros.ros.nodes.guarded_node import NoAnswer, refused
from stickslip_ros.ros.nodes.messages import (
    NoSetPoint,
    diagnostic_array,
    event_status,
    fill_joints,
    message_of,
    offer,
    publisher_of,
    read_command,
    why_not,
)
from stickslip_ros.ros.nodes.neighbours import Commanders
from stickslip_ros.ros.nodes.sim_loop import AxisOfLoop, SimLoop
from stickslip_ros.ros.nodes.topics import OUTPUTS, OutputTopic

_WARN_PERIOD = 1.0  # s, between warnings of the same kind


class AxisNode(AxisOfLoop):
    """One axis."""

    def __init__(
        self,
        *,
        name: str = AXIS_NODE,
        sim_loop: SimLoop | None = None,
        given: Mapping[str, Any] | None = None,
        of_process: Mapping[str, Any] | None = None,
        together: str = "",
        arguments: Sequence[str] | None = None,
        **options: Any,
    ) -> None:
        """Read the parameters, set up the axis; without a sim_loop start one of its own.

        given are defaults for parameters, of_process are parameters that override all others,
        together is the topic of the host for several joints, if there is one, arguments are those
        of the command line if not of this process; options are those of `rclpy.node.Node`. Raises
        ParameterError.
        """
        super().__init__(name, **options)
        named = {**(given or {}), **node_parameters.of_axes(self, arguments)}
        values = node_parameters.declare_axis(self, {**named, **(of_process or {})})
        if idle := idle_settings(values, set(named)):
            self.get_logger().warning(idle)
        self.axis = Axis(values)
        # state, overload and, while the axis moves, the time as published last
        self._published = ("", False, -1.0)
        self.is_read = True  #: somebody subscribed to a state when one was published last
        self._together = together
        self._doubles = 0  # others that publish the events of an axis of this name
        self._joint_is_double = False  # somebody else publishes it
        self._name = self.get_fully_qualified_name().lstrip("/")
        self._diagnostics = Diagnostics(self._name)
        #: What advances the axis, and all others of the process
        self.sim_loop = sim_loop or SimLoop(self, values.node)
        with report_compilation():
            self.axis.compile_ahead()
            self._diagnostics.prepare(self.axis, patience=1.0)

        self._outputs = {
            topic.name: publisher_of(self, topic, values.node.publish_rate)
            for topic in OUTPUTS.values()
            if not topic.of_process
        }
        self._states = {topic: JointState() for topic in OUTPUTS.values() if topic.joints}
        self.joint_topic = self._outputs[topics.JOINTS.name].topic_name
        self._report = JointReport()
        self.reported: Joints = ()  #: what joint_states said last; empty without a reading
        self._commanders = Commanders()
        self._set_points: list[Event] = []  # that are not in the log yet
        self._readers = 0  # of set points
        self._nan_set_points = 0
        for command in COMMANDS.values():
            if command.arguments is not None:  # parameters have services of their own
                serve = partial(self.serve, command)
                offer(self, command, serve if command.is_service else self._subscriber(command))
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._set_parameters)
        self.get_logger().info(
            f"axis {values.node.axis_name} ready: {values.friction.model}, "
            f"preload {values.friction.preload:g} N, mass {values.runner.mass:g} kg"
        )
        if sim_loop is None:
            self.sim_loop.start([self])

    def close(self) -> None:
        """Publish the events since the last block."""
        self.publish_events()
        self._log_set_points()

    def publish_events(self) -> None:
        """Publish the events since the last call, and the status with them or while it moves."""
        if not self.sim_loop.begun or VANISH in self.axis.config.faults:
            return  # there is no time yet to stamp it with, or nobody to hear of: it is kept
        events = self.axis.take_events()
        self._log(events)
        set_points = [event for event in events if is_set_point(event)]
        if set_points:
            # Many a second, so they have topics of their own: "start" has to stay in the events.
            self._publish_events(topics.SET_POINTS, set_points)
            self._set_points += set_points
            events = [event for event in events if not is_set_point(event)]
            if len(self._set_points) >= 1000:  # ten seconds of a usual controller
                self._log_set_points()
        too_slow = overload(self.axis, self.sim_loop.last_report)
        # While it moves, the status comes every 0.2 s.
        period = self.sim_loop.elapsed() // 0.2 if self.axis.moving else -1.0
        state = (self.axis.mode, bool(too_slow), period)
        if events or state != self._published:
            self._published = state
            self._publish_statuses(
                topics.STATUS, [self._diagnostics.axis_status(self.axis, too_slow)]
            )
            if events:
                self._publish_events(topics.EVENTS, events)

    def publish(self, topic: OutputTopic, message: Any) -> None:
        """Publish a message on a topic of the table."""
        if VANISH not in self.axis.config.faults:
            self._outputs[topic.name].publish(message)

    def _log(self, events: Sequence[Event]) -> None:
        """Log what has ended a motion, or kept it from its way, without a command."""
        for event in events:
            if event.outcome == "fault":
                self.get_logger().error(f"fault: {event.details['reason']}")
            elif event.outcome == WARNED:
                self.get_logger().warning(
                    str(event.details["reason"]), throttle_duration_sec=_WARN_PERIOD
                )
            elif event.outcome == "hit":
                place = format_si(event.details["position"], "m")
                self.get_logger().warning(
                    f"{event.details['limit']} was hit, at {place}",
                    throttle_duration_sec=_WARN_PERIOD,
                )

    def _publish_statuses(self, topic: OutputTopic, statuses: list[DiagnosticStatus]) -> None:
        self.publish(topic, diagnostic_array(self.sim_loop.stamp(), statuses))

    def _publish_events(self, topic: OutputTopic, events: Iterable[Event]) -> None:
        self._publish_statuses(topic, [event_status(self._name, event) for event in events])

    def _log_set_points(self) -> None:
        """Publish the set points since the last time for those who come late."""
        if self._set_points:
            self._publish_events(topics.SET_POINT_LOG, pack_set_points(self._set_points))
            self._set_points.clear()

    # -- called by the SimLoop

    def begin(self) -> None:
        """Publish the description of the axis and its first event."""
        self._publish_description()
        self.publish_events()

    def publish_state(self) -> None:
        """Publish the present state to those who subscribe, and the events before it."""
        if VANISH in self.axis.config.faults:
            return
        # Messages for nobody cost half of a fast axis.
        read = [one for one in self._states if self._outputs[one.name].get_subscription_count()]
        self.is_read = bool(read)
        name, now = self.axis.parameters.node.axis_name, self.sim_loop.stamp()
        self.sim_loop.speakers.said(now)
        self.reported = self._report.take(self.axis)  # its velocities are from instant to instant
        for topic in read:
            assert topic.joints
            if joints := topic.joints(self.axis, self.reported):
                self.publish(topic, fill_joints(self._states[topic], now, name, joints))
        self.publish_events()

    def report(self) -> None:
        """Publish the diagnostics."""
        several = self._commanders.look(self)
        if several:
            self.get_logger().warning(
                f"{' and '.join(several)} both command this axis: the last command wins; let one "
                "of them command it",
                throttle_duration_sec=10.0,
            )
        statuses = self._diagnostics.statuses(
            self.axis, self.sim_loop, self._nan_set_points, several, self._doubles
        )
        self._publish_statuses(topics.DIAGNOSTICS, statuses)
        readers = self._outputs[topics.SET_POINTS.name].get_subscription_count()
        if readers > self._readers:  # late subscribers get the log, and new events from now on
            self._log_set_points()
        self._readers = readers
        self._warn_of_doubles()
        self._warn_of_overload()

    # -- inside

    def _warn_of_doubles(self) -> None:
        """Warn of others that speak as this axis, or of its joint: the states of all mix."""
        topic = self._outputs[topics.EVENTS.name].topic_name
        before, self._doubles = self._doubles, self.count_publishers(topic) - 1
        if self._doubles > before:
            self.get_logger().warning(
                f"somebody else publishes as /{self._name}: a second axis, a bag that is played, "
                "or one that was killed a moment ago; end it, or give it another name"
            )
        joint, before = self.axis.config.joint, self._joint_is_double
        self._joint_is_double = joint in self.sim_loop.speakers.joints and not self._doubles
        if self._joint_is_double and not before:
            self.get_logger().warning(
                f"somebody else publishes the joint {joint} on {self.joint_topic}: start this axis "
                "with another axis_name, so that readers can tell them apart"
            )

    def _warn_of_overload(self) -> None:
        """Warn of an axis that does not keep its pace; a fault after the limit of the user."""
        report = self.sim_loop.last_report
        if report.overload:
            why = overload(self.axis, report)
            logger = self.sim_loop.node.get_logger()  # one for all axes together
            logger.warning(why, throttle_duration_sec=10.0)
            limit = self.axis.parameters.node.overload_limit
            if 0.0 < limit < report.overload and not self.axis.fault:
                lasted = f"overloaded for {report.overload:.1f} s"
                self.axis.trip(f"{lasted}, overload_limit is {limit:g} s; {why}")
        self.publish_events()

    def _publish_description(self) -> None:
        self._publish_statuses(topics.DESCRIPTION, description(self._name, self.axis))

    # -- commands

    def _subscriber(self, command: Command) -> Callable[..., None]:
        topic = self.resolve_topic_name(f"~/{command.interface}")

        def callback(*taken: Any) -> None:
            # The executor of events hands over both as one.
            data, info = taken if len(taken) == 2 else taken[0]
            if VANISH not in self.axis.config.faults:
                self._commanders.note(topic, info["publication_sequence_number"])
                self.carry_out(command, lambda: message_of(data, command))

        # rclpy looks at this to see that a callback wants to know about its message.
        wanted = inspect.signature(lambda data, info: None)
        callback.__signature__ = wanted  # type: ignore[attr-defined]
        return callback

    def serve(self, command: Command, request: Any, response: Any) -> Any:
        """Carry out a command that is a service; return the response with what came of it."""
        if VANISH in self.axis.config.faults:
            raise NoAnswer(f"the injected fault {VANISH} leaves {command.name} unanswered")
        response.message = self.carry_out(command, lambda: request)
        response.success = not response.message
        return response

    def carry_out(self, command: Command, message: Callable[[], Any]) -> str:
        """Carry out a command now; return why it was refused, empty if it was not."""
        if LATE in self.axis.config.faults:  # like a controller with one line, busy with it
            time.sleep(self.axis.config.faults.value(LATE))
        self.sim_loop.act(self)
        reason = self._command(command, message)
        if command.moves and self.axis.moving and not reason:
            self.sim_loop.follow_up(self)
        self.publish_events()
        return reason

    def _command(self, command: Command, message: Callable[[], Any]) -> str:
        try:
            now, joint = self.sim_loop.pace.stamp, self.axis.config.joint
            arguments = read_command(command, message(), now, joint)
            if arguments is not None and not self._is_echo(command, arguments):
                self.sim_loop.check([command.name])
                if command.type == TRAJECTORY and len(arguments[0]) > 1 and self._together:
                    wanted = f"give {joint} only, or all of them to {self._together}"
                    raise ParameterError(f"trajectory for {', '.join(arguments[0])}; {wanted}")
                zero = self.axis.config.offset
                self.axis.command(command.name, *arguments)
                if self.axis.config.offset != zero:
                    self._publish_description()  # the range of targets has moved
                if self.axis.paused != self.sim_loop.paused:
                    self.sim_loop.pause(self.axis.paused)
            return ""
        except NoSetPoint as missing:
            self._nan_set_points += 1
            self.get_logger().warning(f"set point ignored: {missing}", once=True)
            return ""
        except CommandRefused as refusal:
            return self._report_refusal(refusal)
        except Exception as error:  # of any kind: a peer may send anything
            return self.refuse(command.name, None, why_not(error))

    def _is_echo(self, command: Command, arguments: tuple[Any, ...]) -> bool:
        """Return whether a controller sends back what it has read, and so asks for nothing."""
        if command.type != JOINT_STATE or arguments[1] != "position":
            return False
        return self._report.echoes(self.axis, arguments[2])

    def refuse(self, name: str, value: object, reason: str) -> str:
        """Count, note and report a command that is refused before it reaches the axis."""
        refusal = self._report_refusal(self.axis.refuse(name, reason, value=value))
        self.publish_events()
        return refusal

    def _report_refusal(self, refusal: CommandRefused) -> str:
        self.get_logger().warning(f"command refused: {refusal}", throttle_duration_sec=_WARN_PERIOD)
        return str(refusal)

    def note_failure(self, source: str, error: Exception) -> None:
        """Count a callback that raised among the refusals too, which the diagnostics show."""
        super().note_failure(source, error)
        self.axis.refuse(source, why_not(error), value=None)

    # -- parameters

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set parameters, all or none; every refusal counts, also those by rclpy itself."""
        # Before rclpy, whose own refusals do not name the parameter or the cure.
        unknown = [p.name for p in parameter_list if not self.has_parameter(p.name)]
        result = self._check_parameters(parameter_list, unknown)
        if result.successful:
            declared = [_as_declared(p) for p in parameter_list]
            result = super().set_parameters_atomically(declared)
        if not result.successful:
            wanted = {p.name: p.value for p in parameter_list}
            result.reason = shorten(result.reason)
            self.sim_loop.act(self)
            self.refuse("parameters", wanted, result.reason)
        return result

    def _check_parameters(
        self, changes: list[Parameter], unknown: Sequence[str] = ()
    ) -> SetParametersResult:
        axis_changes = {p.name: p.value for p in changes if p.name in PARAMETERS}
        try:
            for name in unknown:
                parameter(name)  # raises, and says which one may be meant
            if axis_changes:  # others are of the process, declared before the time may begin
                self.sim_loop.check(list(axis_changes))
            check_place(self.axis.parameters, axis_changes)
            self.axis.checked(axis_changes)
        except Exception as error:  # of any kind: a peer may send anything
            return refused(why_not(error))
        return SetParametersResult(successful=True)

    def _set_parameters(self, changes: list[Parameter]) -> None:
        axis_changes = {p.name: p.value for p in changes if p.name in PARAMETERS}
        if axis_changes:
            self.sim_loop.act(self)
            self.axis.command("parameters", axis_changes)
            self.sim_loop.pace.expect_change()
            self.sim_loop.take(self, axis_changes)
            self.publish_events()
            self._publish_description()


def _as_declared(change: Parameter) -> Parameter:
    """Return a change in the type of its parameter: 1 and "1e-9", which YAML takes for a text."""
    row = PARAMETERS.get(change.name)
    if row and row.kind is float and change.type_ != Parameter.Type.DOUBLE:
        return Parameter(change.name, value=row.check(change.value))
    return change
