# SPDX-License-Identifier: Apache-2.0
"""Types of messages: names, times, and schemas (``ros2msg``) made of definitions.

A schema holds the definitions of a type and of all types inside. Where these come from is the
caller's affair: a callable gives the ``.msg`` text of a type.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Any

STATUS_TYPE = "diagnostic_msgs/msg/DiagnosticArray"
JOINT_STATE_TYPE = "sensor_msgs/msg/JointState"
_NUMBERS = {f"{kind}{bits}" for kind in ("int", "uint") for bits in (8, 16, 32, 64)}
_PRIMITIVES = _NUMBERS | {"bool", "byte", "char", "float32", "float64", "string", "wstring"}

_SEPARATOR = "=" * 80


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
    while waiting:
        current = waiting.pop(0)
        for inner in _referenced_types(definitions[current], current.split("/")[0]):
            if inner not in definitions:
                definitions[inner] = definition_of(inner)
                waiting.append(inner)
    top, *others = definitions.items()
    parts = [top[1].rstrip() + "\n"]
    for name, definition in others:
        package, _, kind = name.split("/")
        parts.append(f"{_SEPARATOR}\nMSG: {package}/{kind}\n{definition.rstrip()}\n")
    return "".join(parts)


def _referenced_types(definition: str, package: str) -> Iterator[str]:
    """Yield the message types (``package/msg/Type``) named in the fields of a ``.msg`` text.

    package: the package of the definition itself, for types written without one.
    """
    for line in definition.splitlines():
        words = line.split("#", 1)[0].split()
        item = re.split(r"[\[<]", words[0], maxsplit=1)[0] if words else "bool"
        if item not in _PRIMITIVES:
            *given_package, kind = item.split("/")
            yield f"{given_package[0] if given_package else package}/msg/{kind}"
