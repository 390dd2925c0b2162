# SPDX-License-Identifier: Apache-2.0
"""Parameters of nodes: the table of an axis as ROS parameters, and those of the other nodes."""

from __future__ import annotations

import difflib
import math
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from stickslip_ros.base.errors import UsageError
from stickslip_ros.emulator import CONTROLLERS
from stickslip_ros.physics.laws import LAWS
from stickslip_ros.physics.parameters import PARAMETERS, Parameter, ParameterError, Parameters
from stickslip_ros.physics.parameters.bounded_files import OF_EVERY_NODE, nodes_in, values_in
from stickslip_ros.physics.parameters.row import file_names
from stickslip_ros.physics.waveforms import WAVEFORMS
from stickslip_ros.ros.nodes.process import Runnable, parameter_files, run


@dataclass(frozen=True)
class OwnParameter:
    """Name, default and meaning of a parameter; its type is that of the default.

    An empty list has no element type in ROS: the default of a list of texts is one empty text.
    """

    name: str
    default: Any
    description: str
    unit: str = ""
    #: a number lies between these, both included
    low: float = -math.inf
    high: float = math.inf
    off: str = ""  #: what 0 stands for, which is allowed then

    def check(self, value: Any) -> None:
        """Raise UsageError for a number out of range."""
        limited = -math.inf < self.low and isinstance(value, float)
        if not limited or self.low <= value <= self.high or (self.off and value == 0.0):
            return
        unit = f" {self.unit}" if self.unit else ""
        off = f", or be 0 for {self.off}" if self.off else ""
        raise UsageError(
            f"parameter {self.name} is {value:g}{unit}; "
            f"it has to lie between {self.low:g} and {self.high:g}{unit}{off}"
        )


#: Parameters of the process, not of an axis. An empty name stands for no axes.
AXES = OwnParameter("axes", [""], "names of the axes to host; none: one axis")
EMULATE = OwnParameter(
    "emulate", "", f"controller to emulate beside the topics, {', '.join(CONTROLLERS)}; empty: none"
)
EMULATE_PORT = OwnParameter(
    "emulate_port", -1, "its TCP port on loopback, -1: the controller's own, 0: a free one"
)
OF_PROCESS = (AXES, EMULATE, EMULATE_PORT)
_OF_PROCESS = [row.name for row in OF_PROCESS]


def declare_axis(node: Node, given: Mapping[str, object]) -> Parameters:
    """Declare every parameter of the table and return their values.

    Those that the node itself was given are declared already, without a description; they are
    declared once more. Raises ParameterError for an unknown name or a bad value.
    """
    values = Parameters.of(given)
    flat = values.flat()
    for name, row in PARAMETERS.items():
        if node.has_parameter(name):
            node.undeclare_parameter(name)
        node.declare_parameter(name, flat[name], descriptor(row), ignore_override=True)
    return values


def of_axes(node: Node, arguments: Sequence[str] | None = None) -> dict[str, Any]:
    """Return the given parameters of axes, not checked yet.

    arguments are those of the command line, by default of this process.
    Relative paths in a parameter file of the command line are tried from its own folder first.
    """
    values = {
        name: node.get_parameter(name).value for name in _given(node) if name not in _OF_PROCESS
    }
    files = [Path(file) for file in parameter_files(sys.argv if arguments is None else arguments)]
    for name in set(file_names(PARAMETERS)) & set(values):
        for file in files:
            beside = file.parent / str(values[name])
            if values[name] in values_in(file, name) and beside.is_file():
                values[name] = str(beside)
                break
    return values


def _given(node: Node) -> list[str]:
    """Return the names given from outside, without those that every node has.

    The node has to be made with ``automatically_declare_parameters_from_overrides``: only so can a
    misspelt name be found, which ROS would pass over in silence.
    """
    names = node.get_parameters_by_prefix("")
    return [name for name in names if not name.startswith(OF_EVERY_NODE)]


def unused_files(arguments: Sequence[str], nodes: Sequence[str]) -> list[str]:
    """Return a warning about parameter files of a command line that are for other nodes.

    nodes are full names. ROS ignores such a file without a message, and the defaults apply.
    """
    found = []
    for file in parameter_files(arguments):
        try:
            named = nodes_in(file)
        except ParameterError:
            continue  # ROS itself refuses other files
        if not any(_names(pattern).fullmatch(node) for pattern in named for node in nodes):
            mine = ", ".join(nodes)
            found.append(f"no parameters for {mine} in {file}; it names {', '.join(named)}")
    return found


def _names(pattern: str) -> re.Pattern[str]:
    """Return the nodes that a name in a parameter file matches: * is one part, ** any."""
    parts = {"/**": "(/[^/]+)*", "/*": "/[^/]+"}
    return re.compile(
        "".join(parts.get(part, re.escape(part)) for part in re.findall("/[^/]*", pattern))
    )


def descriptor(row: Parameter) -> ParameterDescriptor:
    """Return name, type, description with unit, range and mutability of a row."""
    message = ParameterDescriptor(
        name=row.name,
        type=RosParameter.Type.from_parameter_value(row.default).value,
        description=f"{row.description} ({row.unit})" if row.unit else row.description,
        read_only=not row.mutable,
    )
    registered = {"model": LAWS, "waveform": WAVEFORMS}.get(row.name)
    choices = list(registered or row.pattern.split("|"))  # one of any text, and of a number
    if len(choices) > 1:
        message.additional_constraints = f"one of: {', '.join(choices)}"
    if row.kind is float:
        message.floating_point_range = [FloatingPointRange(from_value=row.low, to_value=row.high)]
    elif row.kind is int:
        message.integer_range = [IntegerRange(from_value=int(row.low), to_value=int(row.high))]
    return message


# -- nodes without an axis: read once, at the start


def usage_of(meaning: str, table: Sequence[OwnParameter]) -> str:
    """Return the help text of a node: its purpose, its parameters with their defaults."""
    rows = []
    for row in table:
        many = isinstance(row.default, list)
        shown = str([one for one in row.default if one != ""] if many else row.default) or "none"
        rows.append(f"  {row.name:<24}{row.description} (default: {shown})")
    return "\n".join(["", meaning, "", "parameters:", *rows])


def run_node(
    program: str,
    make_node: Callable[[], Runnable],
    meaning: str,
    table: Sequence[OwnParameter],
    args: Sequence[str] | None = None,
) -> int:
    """Run a node with the parameters of a table, as `run`; return the exit code."""
    return run(program, args, make_node, usage=lambda: usage_of(meaning, table))


def read_own(node: Node, table: Sequence[OwnParameter]) -> dict[str, Any]:
    """Declare the parameters of a table, read-only, and return their values.

    Values given from outside are declared already, which is how misspelt names are found. They are
    declared once more to get a description. A whole number will do for a float. Raises UsageError.
    """
    names = [row.name for row in table]
    for name in _given(node):
        if name not in names:
            close = difflib.get_close_matches(name, names, n=1)
            cure = f"did you mean {close[0]}?" if close else f"known: {', '.join(names)}"
            raise UsageError(f"unknown parameter '{name}'; {cure}")
    return {row.name: declare_own(node, row) for row in table}


def declare_own(node: Node, row: OwnParameter) -> Any:
    """Declare a parameter, read-only, and return its value, as `read_own`."""
    value, kind = row.default, RosParameter.Type.from_parameter_value(row.default)
    if node.has_parameter(row.name):
        given = node.get_parameter(row.name)
        value = given.value
        if given.type_ != kind and given.type_.name == kind.name.replace("DOUBLE", "INTEGER"):
            value = np.asarray(given.value, dtype=np.float64).tolist()
        elif given.type_ != kind:
            wanted = kind.name.lower().replace("string_array", "list of names, as [x, 'y']")
            raise UsageError(f"parameter {row.name} is {given.value!r}; give a {wanted}")
        row.check(value)
        node.undeclare_parameter(row.name)
    descriptor = ParameterDescriptor(
        name=row.name, type=kind.value, description=row.description, read_only=True
    )
    return node.declare_parameter(row.name, value, descriptor, ignore_override=True).value


def full_name(node: Node, parameter: str, name: str) -> str:
    """Return the full name of a topic or node given in a parameter; UsageError if it is none."""
    try:
        return str(node.resolve_topic_name(name, only_expand=True))
    except RuntimeError as error:  # rclpy's own class for it is not public
        raise UsageError(
            f"parameter {parameter}: '{name}' is not a valid name; "
            "use letters, digits and _ between slashes, such as /stickslip_axis"
        ) from error
