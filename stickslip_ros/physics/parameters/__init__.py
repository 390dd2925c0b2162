# SPDX-License-Identifier: Apache-2.0
"""The one table of parameters: name, default, unit, range, description, mutability.

Command line, YAML files, ROS descriptors, documentation and bag snapshots all read it. It contains
no physics and no ROS: ``model/`` uses the values, ``ros/`` declares them.
"""

from stickslip_ros.physics.parameters.groups import (
    ActuatorParameters,
    ClosedLoopParameters,
    DriveParameters,
    FrictionParameters,
    LimitParameters,
    NodeParameters,
    RunnerParameters,
    SensorParameters,
    SolverParameters,
)
from stickslip_ros.physics.parameters.parameters import (
    PARAMETERS,
    Parameters,
    ParameterSource,
    parameter,
    parse_assignment,
    read_yaml,
    yaml_text,
)
from stickslip_ros.physics.parameters.row import Parameter, ParameterError, Value, number, register

__all__ = [
    "PARAMETERS",
    "ActuatorParameters",
    "ClosedLoopParameters",
    "DriveParameters",
    "FrictionParameters",
    "LimitParameters",
    "NodeParameters",
    "Parameter",
    "ParameterError",
    "ParameterSource",
    "Parameters",
    "RunnerParameters",
    "SensorParameters",
    "SolverParameters",
    "Value",
    "number",
    "parameter",
    "parse_assignment",
    "read_yaml",
    "register",
    "yaml_text",
]
