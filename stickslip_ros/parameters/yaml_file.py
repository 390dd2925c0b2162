# SPDX-License-Identifier: Apache-2.0
"""Parameters in the YAML files that ROS nodes take."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from stickslip_ros.parameters.parameters import Parameters
from stickslip_ros.parameters.row import ParameterError

#: Beginnings of the names of parameters that every ROS node has; they are none of this table.
OF_EVERY_NODE = ("use_sim_time", "start_type_description_service", "qos_overrides.")

_FORM = "a file starts with '/**:' and below it 'ros__parameters:'"


def read_yaml(path: Path) -> Parameters:
    """Return the defaults with the values of a ROS parameter file laid over them.

    A file has the form ``/**: ros__parameters: ...``. Raises ParameterError that names the file.
    """
    from stickslip_ros.parameters.bounded_yaml import load_values  # most runs name no file

    try:
        content = load_values(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ParameterError(f"cannot read {path}: {error.strerror or error}") from None
    except ValueError as error:
        raise ParameterError(f"{path} is not a YAML file: {error}") from None
    values = {}
    for node, body in _as_mapping(content, path).items():
        inner = body.get("ros__parameters") if isinstance(body, dict) else None
        if inner is None:
            raise ParameterError(f"{path}: {node!r} has no ros__parameters; {_FORM}")
        for name, value in _as_mapping(inner, path).items():
            if not str(name).startswith(OF_EVERY_NODE):
                values[str(name)] = value
    try:
        return Parameters.of(values)
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from None


def yaml_text(p: Parameters) -> str:
    """Return the text of a ROS parameter file with the values that differ from the defaults."""
    import yaml

    usual = Parameters().flat()
    changed = {name: value for name, value in p.flat().items() if value != usual[name]}
    return yaml.safe_dump({"/**": {"ros__parameters": changed}}, sort_keys=False)


def _as_mapping(content: object, path: Path) -> dict[object, Any]:
    if not isinstance(content, dict):
        raise ParameterError(f"{path} holds no names with values; {_FORM}")
    return content
