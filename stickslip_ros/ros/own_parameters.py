# SPDX-License-Identifier: Apache-2.0
"""Parameters of a node of ours that has no axis: read once, at the start."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from stickslip_ros.ros.process import UsageError, given_parameters


@dataclass(frozen=True)
class OwnParameter:
    """Name, type, default and meaning of a parameter.

    An empty list has no element type in ROS: the default of a list of texts is one empty text.
    """

    name: str
    type: Parameter.Type
    default: Any
    description: str


def usage_of(meaning: str, table: Sequence[OwnParameter]) -> str:
    """Return what ``--help`` says of a node: its meaning, its parameters with their defaults."""
    rows = [f"  {row.name:<16}{row.description} (default: {_shown(row.default)})" for row in table]
    return "\n".join(["", meaning, "", "parameters:", *rows])


def _shown(default: Any) -> str:
    return str([one for one in default if one] if isinstance(default, list) else default) or "none"


def read_own_parameters(node: Node, table: Sequence[OwnParameter]) -> dict[str, Any]:
    """Declare the parameters of a table, read-only, and return their values.

    Values given from outside are declared already, which is how misspelt names are found. They are
    declared once more to get a description. A whole number will do for a float. Raises UsageError.
    """
    names = [row.name for row in table]
    for name in given_parameters(node):
        if name not in names:
            close = difflib.get_close_matches(name, names, n=1)
            cure = f"did you mean {close[0]}?" if close else f"known: {', '.join(names)}"
            raise UsageError(f"unknown parameter '{name}'; {cure}")
    return {row.name: _read(node, row) for row in table}


def full_name(node: Node, parameter: str, name: str) -> str:
    """Return the full name of a topic or node given in a parameter; UsageError if it is none."""
    try:
        return str(node.resolve_topic_name(name, only_expand=True))
    except RuntimeError as error:  # rclpy's own class for it is not public
        raise UsageError(
            f"parameter {parameter}: '{name}' is not a valid name; "
            "use letters, digits and _ between slashes, such as /stickslip_axis"
        ) from error


def _read(node: Node, row: OwnParameter) -> Any:
    value = row.default
    if node.has_parameter(row.name):
        given = node.get_parameter(row.name)
        value = given.value
        if row.type == Parameter.Type.DOUBLE and given.type_ == Parameter.Type.INTEGER:
            value = float(given.value)
        elif given.type_ != row.type:
            wanted = row.type.name.lower().replace("_", " ")
            raise UsageError(f"parameter {row.name} is {given.value!r}; give a {wanted}")
        node.undeclare_parameter(row.name)
    descriptor = ParameterDescriptor(
        name=row.name, type=row.type.value, description=row.description, read_only=True
    )
    return node.declare_parameter(row.name, value, descriptor, ignore_override=True).value
