# SPDX-License-Identifier: Apache-2.0
"""The YAML files that ROS nodes take: ``/**:`` or a node, below it ``ros__parameters:``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import yaml

from stickslip_ros.parameters.bounded_files import load_values
from stickslip_ros.parameters.groups import AXIS_NODE
from stickslip_ros.parameters.row import Parameter, ParameterError, file_names

#: Prefixes of the parameters that every ROS node has; the table does not contain them.
OF_EVERY_NODE = ("use_sim_time", "start_type_description_service", "qos_overrides.")

_VALUES = "ros__parameters"
_FORM = f"a file starts with '/**:' and below it '{_VALUES}:', or holds names with values alone"


def read_values(path: str | PathLike[str], known: Mapping[str, Parameter]) -> dict[str, Any]:
    """Return the values that a parameter file gives the node of an axis, not checked yet.

    known are the names of the table. The sections for the node of an axis, or for all nodes, are
    used; without any, those that contain a name of the table; names and values without a section
    are for commands, not for nodes. Relative paths in the file are tried from its own folder first.
    Raises ParameterError that names the file.
    """
    path = Path(path)
    content = _content(path)
    if isinstance(content, dict) and set(content) & set(known):
        content = {"/**": {_VALUES: content}}
    found = list(_sections(content, "", path))
    own = [values for node, values in found if node.rpartition("/")[2] in (AXIS_NODE, "*", "**")]
    if not own:
        own = [values for _, values in found if len(found) == 1 or set(values) & set(known)]
    if not own:
        nodes = ", ".join(node for node, _ in found)
        raise ParameterError(f"{path} configures {nodes}, none with a parameter of an axis")
    merged = {name: value for values in own for name, value in values.items()}
    for name in file_names(known):
        if merged.get(name) and (beside := path.parent / str(merged[name])).is_file():
            merged[name] = str(beside)
    return {name: v for name, v in merged.items() if not name.startswith(OF_EVERY_NODE)}


def nodes_in(path: str | PathLike[str]) -> list[str]:
    """Return the full names of the nodes, wildcards among them, that a parameter file configures.

    Raises ParameterError that names the file.
    """
    path = Path(path)
    return [node for node, _ in _sections(_content(path), "", path)]


def values_in(path: Path, name: str) -> list[object]:
    """Return the values that a file gives a parameter, for any node; none if it is broken."""
    try:
        sections = list(_sections(_content(path), "", path))
    except ParameterError:
        return []
    return [values[name] for _, values in sections if name in values]


def parameter_file_text(values: Mapping[str, Any]) -> str:
    """Return the text of a parameter file with values by name."""
    return yaml.safe_dump({"/**": {_VALUES: dict(values)}}, sort_keys=False)


def _content(path: Path) -> Any:
    try:
        return load_values(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ParameterError(f"cannot read {path}: {error.strerror or error}") from None
    except ValueError as error:
        found = "it is not text" if isinstance(error, UnicodeDecodeError) else error
        raise ParameterError(f"{path} is not a YAML file: {found}") from None


def _sections(content: object, above: str, path: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the name of each node, namespaces before it, and its values."""
    if not isinstance(content, dict):
        raise ParameterError(f"{path} holds no names with values; {_FORM}")
    for name, body in content.items():
        node = f"{above}/{str(name).strip('/')}"
        if not isinstance(body, dict):
            raise ParameterError(f"{path}: {str(name)!r} has no {_VALUES}; {_FORM}")
        if _VALUES not in body:
            yield from _sections(body, node, path)
            continue
        if not isinstance(body[_VALUES], dict):
            raise ParameterError(f"{path} holds no names with values; {_FORM}")
        yield node, dict(_flat(body[_VALUES], ""))


def _flat(values: Mapping[Any, Any], above: str) -> Iterator[tuple[str, Any]]:
    """Yield names with values; ROS writes a nested mapping as one name with dots."""
    for name, value in values.items():
        if isinstance(value, dict) and value:
            yield from _flat(value, f"{above}{name}.")
        else:
            yield f"{above}{name}", value
