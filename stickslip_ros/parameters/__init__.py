# SPDX-License-Identifier: Apache-2.0
"""The one table of parameters: name, default, unit, range, description, mutability.

Command line, YAML files, ROS descriptors, documentation and bag snapshots all read it. It contains
no physics and no ROS: ``model/`` uses the values, ``ros/`` declares them.
"""

from stickslip_ros.parameters.device_groups import (
    ClosedLoopParameters,
    LimitParameters,
    NodeParameters,
    SensorParameters,
    SolverParameters,
)
from stickslip_ros.parameters.drive_groups import ActuatorParameters, DriveParameters
from stickslip_ros.parameters.parameters import (
    PARAMETERS,
    Parameters,
    ParameterSource,
    parameter,
    parse_assignment,
    read_yaml,
    yaml_text,
)
from stickslip_ros.parameters.plant_groups import FrictionParameters, RunnerParameters
from stickslip_ros.parameters.row import Parameter, ParameterError, Value, register

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
    "parameter",
    "parse_assignment",
    "read_yaml",
    "register",
    "yaml_text",
]
