# SPDX-License-Identifier: Apache-2.0
"""Types of messages: names, times, and schemas (``ros2msg``) made of definitions.

A schema holds the definitions of a type and of all types inside. Where these come from is the
caller's affair: a callable gives the ``.msg`` text of a type.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mcap_ros2._vendor.rosidl_adapter.parser import parse_message_string

STATUS_TYPE = "diagnostic_msgs/msg/DiagnosticArray"
JOINT_STATE_TYPE = "sensor_msgs/msg/JointState"


def nanoseconds(stamp: Any) -> int:
    """Return a builtin_interfaces/Time in ns; it may be negative, which rclpy refuses."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def stamp_of(message: Any) -> int | None:
    """Return the time (ns) in the header of a message; None if it has no header."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return None if stamp is None else nanoseconds(stamp)


def schema_text(type_name: str, definition_of: Callable[[str], str]) -> str:
    """Return the full ``ros2msg`` schema of a message type.

    type_name: such as ``sensor_msgs/msg/JointState``; definition_of: gives the ``.msg`` text of a
    type named that way; what it raises for a type it does not know goes through to the caller.
    """
    definitions = {type_name: definition_of(type_name)}
    waiting = [type_name]
    for current in waiting:
        package, _, kind = current.split("/")
        for field in parse_message_string(package, kind, definitions[current]).fields:
            inner = f"{field.type.pkg_name}/msg/{field.type.type}"
            if field.type.pkg_name and inner not in definitions:
                definitions[inner] = definition_of(inner)
                waiting.append(inner)
    parts = [f"{definitions[type_name].rstrip()}\n"]
    for name in waiting[1:]:
        title = f"{'=' * 80}\nMSG: {name.replace('/msg/', '/')}"
        parts.append(f"{title}\n{definitions[name].rstrip()}\n")
    return "".join(parts)
