# SPDX-License-Identifier: Apache-2.0
"""Messages: those of an axis, its state and its commands; the types of any others by name."""

from __future__ import annotations

import importlib
import math
import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cache, reduce
from pathlib import Path
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from stickslip_ros.axis import Event
from stickslip_ros.axis.command import INT32_RANGE, JOINT_STATE, TRAJECTORY, Command
from stickslip_ros.axis.events import event_texts, value_text
from stickslip_ros.axis.joints import Joints
from stickslip_ros.base.errors import StickslipError
from stickslip_ros.recordings.schemas import nanoseconds
from stickslip_ros.ros.nodes.topics import OutputTopic

MOST_BYTES = 1_000_000  #: of a command: room for the longest trajectory that an axis takes


def stamp(nanoseconds: int) -> Time:
    """Return the time message of nanoseconds since the epoch."""
    seconds, rest = divmod(nanoseconds, 1_000_000_000)
    return Time(sec=seconds, nanosec=rest)


def fill_joints(message: JointState, time: Time, axis_name: str, joints: Joints) -> JointState:
    """Fill the state message of an axis; filling one anew costs less than making another."""
    if not message.name:
        message.name = [f"{axis_name}{end}" for end, *_ in joints]
    _, positions, velocities, efforts = zip(*joints, strict=True)
    message.header.stamp = time
    message.position, message.velocity = positions, velocities
    message.effort = [math.nan if effort is None else effort for effort in efforts]
    return message


def diagnostic_status(
    node: str, what: str, level: bytes, message: str, values: Mapping[str, Any]
) -> DiagnosticStatus:
    """Return a status of a node with every value as text; floats in full, lists as JSON."""
    pairs = [KeyValue(key=key, value=value_text(value)) for key, value in values.items()]
    return DiagnosticStatus(
        level=level, name=f"{node}: {what}", message=message, hardware_id=node, values=pairs
    )


def diagnostic_array(time: Time, statuses: list[DiagnosticStatus]) -> DiagnosticArray:
    """Return an array with its time."""
    message = DiagnosticArray(status=statuses)
    message.header.stamp = time
    return message


def event_status(node: str, event: Event) -> DiagnosticStatus:
    """Return an event as message, with all digits of its simulation time."""
    text = f"{event.name} {event.outcome}"
    return diagnostic_status(node, "event", bytes([event.level]), text, event_texts(event))


# -- commands


class MalformedCommand(StickslipError, ValueError):
    """The form of a message is wrong; the text names the field."""


class NoSetPoint(StickslipError, ValueError):
    """A set point for the joint that is not a number: no controller is active, or one is wrong."""


def why_not(error: Exception) -> str:
    """Return why what a peer has sent is refused."""
    if isinstance(error, StickslipError):
        return str(error)
    return f"it cannot be understood ({type(error).__name__}: {error})"


def message_of(data: bytes, command: Command) -> Any:
    """Return the message of a command of its bytes; MalformedCommand if they are too many."""
    if len(data) > MOST_BYTES:
        raise MalformedCommand(f"message of {len(data)} bytes; {MOST_BYTES} is the limit")
    return deserialize_message(data, message_class(command.type))


def read_command(command: Command, message: Any, now: int, joint: str) -> tuple[Any, ...] | None:
    """Return the arguments of a command from its message or request, None if it holds none.

    now is the stamp of the present time, ns; joint the name of the runner. Raises MalformedCommand
    and NoSetPoint.
    """
    if command.type == JOINT_STATE:
        return _set_point(message, joint)
    if command.type == TRAJECTORY:
        begin = nanoseconds(message.header.stamp)
        wait = max(0, begin - now) * 1e-9 if begin else 0.0
        names = list(message.joint_names)
        return names, _points(message, now, names.index(joint) if joint in names else 0), wait
    return (reduce(getattr, command.field.split("."), message),) if command.arguments else ()


def write_command(command: Command, *arguments: Any) -> Any:
    """Return the message or request of a command with arguments; the inverse of `read_command`."""
    kind = message_class(command.type)
    message = kind.Request() if command.is_service else kind()
    if command.type == TRAJECTORY:
        message.joint_names, message.points = list(arguments[0]), _trajectory_points(arguments[1])
    elif command.type == JOINT_STATE:
        joint, interface, value = arguments
        message.name = [joint]
        setattr(message, interface, [float(value)])
    elif command.arguments:
        *path, last = command.field.split(".")
        place = reduce(getattr, path, message)
        setattr(place, last, type(getattr(place, last))(arguments[0]))
    return message


def _set_point(message: JointState, joint: str) -> tuple[str, str, float] | None:
    """Return joint, interface and value; None for a short array.

    Raises NoSetPoint for nan, MalformedCommand where any joint has several set points.
    """
    names = list(message.name)
    if joint not in names:
        return None
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise MalformedCommand(f"joint {twice} is given {names.count(twice)} times; give it once")
    most = max(len(message.position), len(message.velocity))
    if most > len(names):
        raise MalformedCommand(f"{most} set points for {len(names)} joints; give one for each")
    k = names.index(joint)
    found = [
        (joint, interface, values[k])
        for interface in ("position", "velocity")
        if k < len(values := getattr(message, interface))
    ]
    numbers = [set_point for set_point in found if not math.isnan(set_point[2])]
    if found and not numbers:
        raise NoSetPoint(
            f"the {found[0][1]} of {joint} is NaN; start the controllers when the axis is ready, "
            "so that they begin where it is"
        )
    return numbers[0] if numbers else None


def _points(message: JointTrajectory, now: int, k: int) -> list[tuple[float, float]]:
    """Return the points of a trajectory for its joint number k: s from now on, m.

    The trajectory begins at the stamp of its header, at once if that is 0; points in the past are
    left out. Velocities, accelerations and efforts are not used: the closed loop goes from position
    to position.
    """
    begin = nanoseconds(message.header.stamp)
    delay = begin - now if begin else 0
    points, joints = [], len(message.joint_names)
    wanted = f"{joints}, one for each joint" if joints > 1 else "one, for one joint"
    for number, point in enumerate(message.points, 1):
        if len(point.positions) != max(joints, 1):
            raise MalformedCommand(
                f"point {number} has {len(point.positions)} positions; give {wanted}"
            )
        at = delay + nanoseconds(point.time_from_start)
        if at >= 0 or not begin:
            points.append((at * 1e-9, float(point.positions[k])))
    if message.points and not points:
        raise MalformedCommand(
            f"all {len(message.points)} points lie in the past; give a header stamp of 0 to begin "
            "at once"
        )
    return points


def _trajectory_points(points: Sequence[tuple[float, Any]]) -> list[JointTrajectoryPoint]:
    """Return the points of a message; each has a position, or one for every joint."""
    found = []
    for number, (seconds, given) in enumerate(points, 1):
        if not abs(seconds) < INT32_RANGE:
            raise MalformedCommand(
                f"point {number} is at {seconds:g} s; a message holds up to {INT32_RANGE - 1} s"
            )
        at = Duration(nanoseconds=round(seconds * 1e9)).to_msg()
        positions = [float(x) for x in (given if isinstance(given, Sequence) else [given])]
        found.append(JointTrajectoryPoint(positions=positions, time_from_start=at))
    return found


# -- types by name


class UnknownTypeError(StickslipError, LookupError):
    """The package of a message type is not installed, or has no such message."""


@cache
def message_class(type_name: str) -> type[Any]:
    """Return the Python class of a message type such as ``std_msgs/msg/Int32``.

    Raises UnknownTypeError: it is not installed.
    """
    try:
        package, kind, name = type_name.split("/")
        found: type[Any] = getattr(importlib.import_module(f"{package}.{kind}"), name)
    except (ValueError, ImportError, AttributeError) as error:
        package = type_name.split("/")[0]
        raise UnknownTypeError(
            f"message type {type_name} is not installed; install the package {package}"
        ) from error
    return found


def offer(node: Node, command: Command, take: Callable[..., Any]) -> None:
    """Let a node take a command, below its name: requests and responses, or bytes of messages.

    Raw: what is too long or broken is refused before it costs anything.
    """
    kind, name = message_class(command.type), f"~/{command.interface}"
    if command.is_service:
        node.create_service(kind, name, take)
    else:
        node.create_subscription(kind, name, take, command.depth, raw=True)


def publisher_of(node: Node, topic: OutputTopic, rate: float = 0.0) -> Publisher:
    """Return a reliable publisher of a topic of the table; a reader may be late by half a second.

    rate: messages a second, where that is known.
    """
    qos = QoSProfile(depth=topic.kept or max(10, round(0.5 * rate)))
    if topic.kept:
        qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
    return node.create_publisher(message_class(topic.type), topic.name, qos)


@cache
def message_definition(type_name: str) -> str:
    """Return the ``.msg`` text of a message type: the installed file, else made from its fields.

    Raises UnknownTypeError: it is not installed.
    """
    # A sourced ROS names its prefixes; packages installed by pip lie below the interpreter's own.
    sourced = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    for prefix in filter(None, (*sourced, sys.prefix)):
        path = Path(prefix) / "share" / f"{type_name}.msg"
        if path.is_file():
            return path.read_text(encoding="utf-8")
    return definition_from_fields(message_class(type_name).get_fields_and_field_types())


_IDL_NAMES = {"boolean": "bool", "octet": "byte", "float": "float32", "double": "float64"}
#: What IDL calls a sequence, an array and a string with a limit, and the words of ``.msg`` for it
_IDL_FORMS = (
    (re.compile(r"sequence<(.+), *(\d+)>"), "[<={}]"),
    (re.compile(r"sequence<(.+)()>"), "[{}]"),
    (re.compile(r"(.+)\[(\d+)\]"), "[{}]"),
    (re.compile(r"(w?string)<(\d+)>"), "<={}"),
)


def definition_from_fields(fields: Mapping[str, str]) -> str:
    """Return a ``.msg`` text for fields as ``get_fields_and_field_types()`` gives them.

    Constants and defaults are not in there; they do not change how a message is read.
    """

    def type_of(idl: str) -> str:
        for form, end in _IDL_FORMS:
            if match := form.fullmatch(idl):
                return type_of(match[1]) + end.format(match[2])
        return _IDL_NAMES.get(idl, idl)

    return "".join(f"{type_of(idl)} {name}\n" for name, idl in fields.items())
