# SPDX-License-Identifier: Apache-2.0
"""Node that records topics, as they come off the wire, into a rosbag2 folder.

It ends on SIGINT, SIGTERM or a call of ``~/stop``, always with a closed bag.
"""

from __future__ import annotations

import difflib
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from datetime import datetime
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from std_srvs.srv import Trigger

from stickslip_ros.bag import BagError, BagWriter
from stickslip_ros.nodes.message_types import UnknownTypeError
from stickslip_ros.nodes.process import UsageError, given_parameters, run
from stickslip_ros.nodes.recorded_topic import RecordedTopic, Taken

NODE_NAME = "stickslip_recorder"

POLL_PERIOD = 0.1  # s, between looks at the graph for new topics and publishers
FLUSH_PERIOD = 0.5  # s, the most that is lost with the process
# The answer to ~/stop leaves on a reliable channel, which needs us alive to repeat what got lost.
STOP_LINGER = 0.3  # s

_STRING = Parameter.Type.STRING
_STRINGS = Parameter.Type.STRING_ARRAY
PARAMETERS: dict[str, tuple[Parameter.Type, Any, str]] = {
    "output": (_STRING, "", "folder of the new bag; empty: stickslip_<date>-<time> right here"),
    # An empty list has no element type in ROS, hence the empty name.
    "topics": (_STRINGS, [""], "topics to record; none: all topics of the axis"),
    "axis": (_STRING, "/stickslip_axis", "full name of the axis node whose topics are recorded"),
}


def axis_topics(axis: str) -> dict[str, str]:
    """Return the topics of an axis node and their types, known before the node exists.

    :param axis: full name of the node, such as ``/stickslip_axis``.
    """
    namespace = axis.rpartition("/")[0]
    topics = {
        f"{namespace}/joint_states": "sensor_msgs/msg/JointState",
        f"{axis}/contact": "sensor_msgs/msg/JointState",
        f"{axis}/events": "diagnostic_msgs/msg/DiagnosticArray",
        "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
        f"{axis}/joint_trajectory": "trajectory_msgs/msg/JointTrajectory",
        f"{axis}/command/steps": "std_msgs/msg/Int32",
    }
    for command in ("amplitude", "frequency", "jog", "scan", "position"):
        topics[f"{axis}/command/{command}"] = "std_msgs/msg/Float64"
    return topics


class RecorderNode(Node):
    """Records until :attr:`finished` is done; the bag is closed then."""

    def __init__(self, stop_requested: Callable[[], bool] = lambda: False) -> None:
        """Read the parameters, make the bag, subscribe.

        :param stop_requested: looked at ten times a second; true ends the recording.
        :raises UsageError: a parameter is unknown or wrong.
        :raises BagError: the bag cannot be made.
        """
        super().__init__(NODE_NAME, automatically_declare_parameters_from_overrides=True)
        self.finished: Future = Future()
        self._stop_requested = stop_requested
        output, chosen, axis = self._read_parameters()
        self._chosen = frozenset(chosen)
        self._command_prefix = f"{axis}/command/"
        self._topics: dict[str, RecordedTopic] = {}
        self._refused: set[str] = set()
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._bag = BagWriter(output, ros_distro=os.environ.get("ROS_DISTRO", "jazzy"))
        try:
            for name, type_name in axis_topics(axis).items():
                if not chosen or name in self._chosen:
                    self._open(name, type_name)
            self._add_new_topics()
            self.create_service(Trigger, "~/stop", self._on_stop)
            self.create_timer(POLL_PERIOD, self._poll, clock=self._steady)
            self.create_timer(FLUSH_PERIOD, self._bag.flush, clock=self._steady)
        except BaseException:
            self._bag.discard()
            raise
        what = ", ".join(chosen) if chosen else f"all topics of {axis}"
        self.get_logger().info(f"recording {what} to {self._bag.folder}")

    @property
    def nodes(self) -> Sequence[Node]:
        """The nodes to spin."""
        return [self]

    def close(self) -> None:
        """Record what has arrived, close the bag, say what is in it; twice does no harm.

        :raises BagError: the disk does not take it.
        """
        if self._bag.closed:
            return
        try:
            for topic in self._topics.values():
                topic.close()
                if not topic.received:
                    self._bag.add_topic(topic.description())
            losses = [topic.losses for topic in self._topics.values()]
            lost = sum(loss.lost for loss in losses)
            early = sum(loss.before_joining for loss in losses)
            self._bag.custom_data["lost_messages"] = str(lost)
            self._bag.custom_data["messages_before_joining"] = str(early)
        finally:
            self._bag.close()
        counts = ", ".join(f"{name} {n}" for name, n in sorted(self._bag.counts.items()) if n)
        self.get_logger().info(
            f"recorded {self._bag.message_count} messages to {self._bag.folder}"
            f"{f' ({counts})' if counts else ''}, lost {lost}, sent before joining {early}"
        )

    def _read_parameters(self) -> tuple[str, list[str], str]:
        """Return folder, topics and axis.

        Values given from outside are declared already, which is how misspelt names are found.
        They are declared once more to get a description.
        """
        for name in given_parameters(self):
            if name not in PARAMETERS:
                close = difflib.get_close_matches(name, PARAMETERS, n=1)
                cure = f"did you mean {close[0]}?" if close else f"known: {', '.join(PARAMETERS)}"
                raise UsageError(f"unknown parameter '{name}'; {cure}")
        values: dict[str, Any] = {}
        for name, (kind, default, text) in PARAMETERS.items():
            if self.has_parameter(name):
                given = self.get_parameter(name)
                if given.type_ != kind:
                    wanted = kind.name.lower().replace("_", " ")
                    raise UsageError(f"parameter {name} is {given.value!r}; give a {wanted}")
                self.undeclare_parameter(name)
            descriptor = ParameterDescriptor(
                name=name, type=kind.value, description=text, read_only=True
            )
            values[name] = self.declare_parameter(name, default, descriptor).value
        output = values["output"] or datetime.now().strftime("stickslip_%Y_%m_%d-%H_%M_%S")
        topics = [self._full_name("topics", name) for name in values["topics"] if name]
        return output, topics, self._full_name("axis", values["axis"])

    def _full_name(self, parameter: str, name: str) -> str:
        try:
            return str(self.resolve_topic_name(name))
        except RuntimeError as error:  # rclpy's own class for it is not public
            raise UsageError(
                f"parameter {parameter}: '{name}' is not a valid name; "
                "use letters, digits and _ between slashes, such as /stickslip_axis"
            ) from error

    def _poll(self) -> None:
        """Look for new topics, for publishers that want another QoS, and for a wish to stop."""
        if self._bag.closed:
            return
        if self._stop_requested():
            self.close()
            self.finished.set_result(None)
            return
        for topic in self._topics.values():
            topic.follow_publishers()
        for name in self._add_new_topics():
            self.get_logger().info(f"recording {name} ({self._topics[name].type_name}) as well")

    def _add_new_topics(self) -> list[str]:
        return [
            name
            for name, type_names in self.get_topic_names_and_types()
            if name not in self._topics and self._wanted(name) and self._open(name, type_names[0])
        ]

    def _wanted(self, name: str) -> bool:
        return name in self._chosen if self._chosen else name.startswith(self._command_prefix)

    def _open(self, name: str, type_name: str) -> bool:
        if name in self._refused:
            return False
        try:
            self._topics[name] = RecordedTopic(self, name, type_name, self._record)
        except UnknownTypeError as error:
            self._refused.add(name)
            self.get_logger().warning(f"not recording {name}: {error}")
            return False
        return True

    def _record(self, topic: RecordedTopic, messages: Iterable[Taken]) -> None:
        for data, info in messages:
            if not topic.received:
                topic.received = True
                self._bag.add_topic(topic.description())
                self.get_logger().info(f"first message of {topic.name}")
            number = info["publication_sequence_number"]
            topic.note_number(number)
            received = info["received_timestamp"] or Clock().now().nanoseconds
            self._bag.write(
                topic.name,
                data,
                log_ns=received,
                publish_ns=info["source_timestamp"] or received,
                sequence=(number or 0) & 0xFFFFFFFF,  # MCAP has room for 32 bits of it
            )

    def _on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        first = not self._bag.closed
        try:
            self.close()
        except BagError as error:
            self.finished.set_exception(error)
            response.message = str(error)
            return response
        response.success = True
        response.message = f"{self._bag.folder}: {self._bag.message_count} messages"
        if first:
            self.create_timer(STOP_LINGER, self._end, clock=self._steady)
        return response

    def _end(self) -> None:
        self.finished.set_result(None)


def main(args: Sequence[str] | None = None) -> int:
    """Run the recorder; return 0 when the bag is whole, 1 if writing failed, 2 on bad use.

    :param args: the command line with the program's name, that of the process if None.
    """
    return run("recorder_node", args, RecorderNode)


if __name__ == "__main__":
    sys.exit(main())
