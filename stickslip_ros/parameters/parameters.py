# SPDX-License-Identifier: Apache-2.0
"""A full set of parameters: groups with typed attributes, by flat name, and as YAML."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any, get_args, get_type_hints

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
from stickslip_ros.parameters.row import Parameter, ParameterError, Value, is_column

#: Beginnings of the names of parameters that every ROS node has; they are none of this table.
OF_EVERY_NODE = ("use_sim_time", "start_type_description_service", "qos_overrides.")

#: Parameters that name a file.
FILES = ("waveform_table", "hysteresis_file")

_FORM = "a file starts with '/**:' and below it 'ros__parameters:'"


@dataclass(frozen=True)
class Parameters:
    """A full set of parameters; ``Parameters()`` are the defaults.

    Numbers may also be columns: arrays (points,) that hold the values of many operating points, as
    sweeps use them. In a column of an optional parameter nan stands for "not set". Columns are not
    checked against the ranges: which of their points are possible is for the user of them to say.
    """

    friction: FrictionParameters = field(default_factory=FrictionParameters)
    runner: RunnerParameters = field(default_factory=RunnerParameters)
    actuator: ActuatorParameters = field(default_factory=ActuatorParameters)
    drive: DriveParameters = field(default_factory=DriveParameters)
    sensor: SensorParameters = field(default_factory=SensorParameters)
    closed_loop: ClosedLoopParameters = field(default_factory=ClosedLoopParameters)
    limits: LimitParameters = field(default_factory=LimitParameters)
    solver: SolverParameters = field(default_factory=SolverParameters)
    node: NodeParameters = field(default_factory=NodeParameters)

    @classmethod
    def of(cls, values: Parameters | Mapping[str, Any]) -> Parameters:
        """Return a full set: the defaults with values laid over them by name, each one checked.

        A full set comes back as it is. Raises ParameterError for an unknown name, a wrong type or
        a value out of range.
        """
        return values if isinstance(values, Parameters) else _DEFAULTS._with(values)

    def replace(self, **values: Any) -> Parameters:
        """Return the set with some values replaced by flat name, each one checked, as `of` does."""
        return self._with(values)

    def flat(self) -> dict[str, Any]:
        """Return all values by name, as ROS, YAML, JSON and bags hold them: 0 or "" if not set."""
        return {
            name: row.plain(getattr(getattr(self, row.group), name))
            for name, row in PARAMETERS.items()
        }

    def point(self, index: int) -> Parameters:
        """Return the parameters of one point of columns."""
        found = {}
        for name, row in PARAMETERS.items():
            value = getattr(getattr(self, row.group), name)
            if is_column(value):
                one = value[index].item()
                found[name] = None if row.optional and one != one else one
        return self._filled(found)

    def _with(self, values: Mapping[str, Any]) -> Parameters:
        return self._filled({name: parameter(name).typed(v) for name, v in values.items()})

    def _filled(self, values: Mapping[str, Any]) -> Parameters:
        groups: dict[str, dict[str, Any]] = {}
        for name, value in values.items():
            groups.setdefault(PARAMETERS[name].group, {})[name] = value
        return dataclasses.replace(
            self, **{g: dataclasses.replace(getattr(self, g), **v) for g, v in groups.items()}
        )


_DEFAULTS = Parameters()


def _rows() -> dict[str, Parameter]:
    rows = {}
    for group in dataclasses.fields(Parameters):
        hints = get_type_hints(type(getattr(_DEFAULTS, group.name)))
        for one in dataclasses.fields(getattr(_DEFAULTS, group.name)):
            kinds = get_args(hints[one.name]) or (hints[one.name],)
            default: Any = one.default
            rows[one.name] = Parameter(
                name=one.name,
                group=group.name,
                kind=kinds[0],
                optional=type(None) in kinds,
                default=kinds[0]() if default is None else default,
                **one.metadata,
            )
    return rows


#: All parameters by name, in the order of the table.
PARAMETERS: Mapping[str, Parameter] = _rows()


def parameter(name: str) -> Parameter:
    """Return the row of ``name``; raise ParameterError with the nearest names."""
    try:
        return PARAMETERS[name]
    except KeyError:
        near = difflib.get_close_matches(name, PARAMETERS, n=3)
        hint = f"did you mean {' or '.join(near)}?" if near else f"known: {', '.join(PARAMETERS)}"
        raise ParameterError(f"there is no parameter {name!r}; {hint}") from None


def parse_assignment(text: str) -> tuple[str, Value]:
    """Read ``name=value`` as given to ``--set``, not checked yet; raise ParameterError."""
    name, sign, value = text.partition("=")
    if not sign:
        raise ParameterError(f"{text!r} is not of the form NAME=VALUE, such as preload=1.0")
    row = parameter(name.strip())
    return row.name, row.read(value.strip())


# -- the YAML files that ROS nodes take


def read_yaml(path: str | PathLike[str]) -> Parameters:
    """Return the defaults with the values of a ROS parameter file laid over them.

    A file has the form ``/**: ros__parameters: ...``. The files that it names in turn are looked
    for beside it first, then from the current folder. Raises ParameterError that names the file.
    """
    from stickslip_ros.parameters.bounded_yaml import load_values  # most runs name no file

    path = Path(path)
    try:
        content = load_values(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ParameterError(f"cannot read {path}: {error.strerror or error}") from None
    except ValueError as error:
        raise ParameterError(f"{path} is not a YAML file: {error}") from None
    values: dict[str, Any] = {}
    for node, body in _as_mapping(content, path).items():
        inner = body.get("ros__parameters") if isinstance(body, dict) else None
        if inner is None:
            raise ParameterError(f"{path}: {node!r} has no ros__parameters; {_FORM}")
        for name, value in _as_mapping(inner, path).items():
            if not str(name).startswith(OF_EVERY_NODE):
                values[str(name)] = value
    for name in FILES:
        if values.get(name) and (beside := path.parent / str(values[name])).is_file():
            values[name] = str(beside)
    try:
        return Parameters.of(values)
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from None


def values_in(path: Path, name: str) -> list[object]:
    """Return the values that a ROS parameter file gives a parameter, for any node; none if broken.

    For a file that rclpy has read already.
    """
    from stickslip_ros.parameters.bounded_yaml import load_values

    def within(content: object) -> list[object]:
        if not isinstance(content, dict):
            return []
        own = content.get("ros__parameters")
        found = [own[name]] if isinstance(own, dict) and name in own else []
        return found + [one for inner in content.values() for one in within(inner)]

    try:
        return within(load_values(path.read_text(encoding="utf-8")))
    except (OSError, ValueError):
        return []


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
