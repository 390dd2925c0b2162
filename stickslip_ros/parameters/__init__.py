# SPDX-License-Identifier: Apache-2.0
"""The one table of parameters: name, default, unit, range, description, mutability.

Command line, YAML files, ROS descriptors, documentation and bag snapshots all read it. It knows no
physics and no ROS: what a value means is said in ``model/``, how it is declared in ``ros/``.
"""

from stickslip_ros.parameters.groups import (
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
from stickslip_ros.parameters.parameters import (
    OF_EVERY_NODE,
    PARAMETERS,
    Parameters,
    parameter,
    parse_assignment,
    read_yaml,
    yaml_text,
)
from stickslip_ros.parameters.row import Parameter, ParameterError, Value

__all__ = [
    "OF_EVERY_NODE",
    "PARAMETERS",
    "ActuatorParameters",
    "ClosedLoopParameters",
    "DriveParameters",
    "FrictionParameters",
    "LimitParameters",
    "NodeParameters",
    "Parameter",
    "ParameterError",
    "Parameters",
    "RunnerParameters",
    "SensorParameters",
    "SolverParameters",
    "Value",
    "parameter",
    "parse_assignment",
    "read_yaml",
    "yaml_text",
]
