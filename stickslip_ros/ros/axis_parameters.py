# SPDX-License-Identifier: Apache-2.0
"""The parameter table as ROS parameters."""

from __future__ import annotations

from collections.abc import Mapping

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from stickslip_ros.parameters import PARAMETERS, Parameter, Parameters, Value, parameter
from stickslip_ros.ros.process import given_parameters

#: Parameters of the process, not of an axis: the names of the axes it hosts, what it emulates.
AXES = "axes"
_NOT_OF_AXES = (AXES, "emulate", "emulate_port")


def declare(
    node: Node, given: Mapping[str, object], of_process: Mapping[str, object]
) -> Parameters:
    """Declare every parameter of the table and return their values.

    given are values that hold where the node itself is not given any, which are declared already,
    without a description; they are checked and declared once more. of_process are values that hold
    whatever the node is given. Raises ParameterError for an unknown name or a bad value.
    """
    values = Parameters.of({**given, **of_axes(node), **of_process})
    flat = values.flat()
    for name, row in PARAMETERS.items():
        if node.has_parameter(name):
            node.undeclare_parameter(name)
        node.declare_parameter(name, flat[name], descriptor(row), ignore_override=True)
    return values


def of_axes(node: Node) -> dict[str, Value]:
    """Return the parameters of axes that a node is given; ParameterError if one is bad."""
    return {
        name: parameter(name).check(node.get_parameter(name).value)
        for name in given_parameters(node)
        if name not in _NOT_OF_AXES
    }


def descriptor(row: Parameter) -> ParameterDescriptor:
    """Return name, type, description with unit, range and mutability of a row."""
    message = ParameterDescriptor(
        name=row.name,
        type=RosParameter.Type.from_parameter_value(row.default).value,
        description=f"{row.description} ({row.unit})" if row.unit else row.description,
        read_only=not row.mutable,
    )
    if row.kind is float:
        message.floating_point_range = [FloatingPointRange(from_value=row.low, to_value=row.high)]
    elif row.kind is int:
        message.integer_range = [IntegerRange(from_value=int(row.low), to_value=int(row.high))]
    return message
