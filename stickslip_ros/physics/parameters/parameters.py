# SPDX-License-Identifier: Apache-2.0
"""A full set of parameters: groups with typed attributes, by flat name, and as YAML."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import Any, get_args, get_type_hints

from stickslip_ros.base.shared_files import config_file
from stickslip_ros.physics.parameters.extensions import ROW_PROVIDERS, register_packages
from stickslip_ros.physics.parameters.groups import (
    ActuatorParameters,
    ClosedLoopParameters,
    DriveParameters,
    FaultParameters,
    FrictionParameters,
    LimitParameters,
    NodeParameters,
    RunnerParameters,
    SensorParameters,
    SolverParameters,
)
from stickslip_ros.physics.parameters.row import (
    Extended,
    Parameter,
    ParameterError,
    Value,
    is_column,
    registered_rows,
)


@dataclass(frozen=True)
class Parameters:
    """A full set of parameters; ``Parameters()`` are the defaults.

    Numbers may also be columns: arrays (points,) that hold the values of many operating points, as
    sweeps use them. In a column of an optional parameter nan stands for "not set". Columns are not
    checked against the ranges: the caller decides which of their points are possible.
    """

    friction: FrictionParameters = field(default_factory=FrictionParameters)
    runner: RunnerParameters = field(default_factory=RunnerParameters)
    actuator: ActuatorParameters = field(default_factory=ActuatorParameters)
    drive: DriveParameters = field(default_factory=DriveParameters)
    sensor: SensorParameters = field(default_factory=SensorParameters)
    closed_loop: ClosedLoopParameters = field(default_factory=ClosedLoopParameters)
    limits: LimitParameters = field(default_factory=LimitParameters)
    faults: FaultParameters = field(default_factory=FaultParameters)
    solver: SolverParameters = field(default_factory=SolverParameters)
    node: NodeParameters = field(default_factory=NodeParameters)

    @classmethod
    def of(cls, source: ParameterSource = None, /, **values: Any) -> Parameters:
        """Return a full set of parameters, each value checked.

        Parameters
        ----------
        source : Parameters, mapping, str or path, optional
            Replaces defaults: a full set, values by flat name, or a ROS parameter file, given by
            its path or its name in ``config/``.
        **values
            Values by flat name, SI units; they replace those of the source.

        Returns
        -------
        Parameters
            The full set; the source itself if it is a full set and there are no values.

        Raises
        ------
        ParameterError
            For an unknown name, a wrong type, a value out of range or a file that cannot be read.
        """
        if source is None:
            return cls()._with(values)
        if isinstance(source, Parameters):
            return source._with(values) if values else source
        if isinstance(source, Mapping):
            return cls()._with({**source, **values})
        if not isinstance(source, str | PathLike):
            raise ParameterError(
                f"{source!r} is no set of parameters; give a file, or values by name, such as "
                "preload=0.6"
            )
        return read_yaml(config_file(Path(source), ParameterError))._with(values)

    def replace(self, **values: Any) -> Parameters:
        """Return the set with some values replaced by flat name, each one checked, as `of` does."""
        return self._with(values)

    def value(self, name: str) -> Any:
        """Return the value of a row: None, or in a column nan, where it is not set."""
        row = PARAMETERS[name]
        return getattr(_holder(getattr(self, row.group), row), name)

    def flat(self) -> dict[str, Any]:
        """Return all values by name, as ROS, YAML, JSON and bags hold them: 0 or "" if not set."""
        return {name: row.to_flat(self.value(name)) for name, row in PARAMETERS.items()}

    def point(self, index: int) -> Parameters:
        """Return the parameters of one point of columns."""
        found = {}
        for name, row in PARAMETERS.items():
            value = self.value(name)
            if is_column(value):
                one = value[index].item()
                found[name] = None if row.optional and one != one else one
        return self._filled(found)

    def _with(self, values: Mapping[str, Any]) -> Parameters:
        return self._filled({name: parameter(name).from_flat(v) for name, v in values.items()})

    def _filled(self, values: Mapping[str, Any]) -> Parameters:
        groups: dict[str, Any] = {}
        for name, value in values.items():
            row = PARAMETERS[name]
            group = groups.get(row.group, getattr(self, row.group))
            holder = dataclasses.replace(_holder(group, row), **{name: value})
            if row.rows is not type(group):
                holder = dataclasses.replace(group, added=_added(group, row, holder))
            groups[row.group] = holder
        return dataclasses.replace(self, **groups)


#: A full set, values by flat name, or a YAML file: a path, or the name of one in ``config/``.
ParameterSource = Parameters | Mapping[str, Any] | str | PathLike[str] | None


def _holder(group: Any, row: Parameter) -> Any:
    """Return the dataclass object with the value of a row: the group, or one of its extensions."""
    return group if row.rows is type(group) else group.own(row.rows)


def _added(group: Any, row: Parameter, holder: Any) -> tuple[Any, ...]:
    """Return the extensions of a group with one replaced, in the order of the registry.

    An extension with all defaults is left out, so that equal sets compare as equal.
    """
    held = {type(one): one for one in (*group.added, holder)}
    return tuple(
        held[rows]
        for rows in registered_rows(row.group)
        if rows in held
        and any(
            is_column(value := getattr(held[rows], one.name)) or value != one.default
            for one in dataclasses.fields(rows)
        )
    )


class _Table(Mapping[str, Parameter]):
    """All rows by name; built when first read, and again when more are registered."""

    def __init__(self) -> None:
        self._made_of: tuple[type, ...] = ()
        self._loads = False
        self._rows: dict[str, Parameter] = {}

    def __getitem__(self, name: str) -> Parameter:
        return self._current()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._current())

    def __len__(self) -> int:
        return len(self._current())

    def _current(self) -> dict[str, Parameter]:
        if not self._loads:
            self._loads = True  # a package may read the table while it is loaded
            for provider in ROW_PROVIDERS:
                import_module(provider)
            register_packages()
        added = (*registered_rows("friction"), *registered_rows("drive"))
        if not self._rows or added != self._made_of:
            self._rows, self._made_of = _rows(), added
        return self._rows


def _rows() -> dict[str, Parameter]:
    rows: dict[str, Parameter] = {}
    for group, kind in get_type_hints(Parameters).items():
        for holder in (kind, *registered_rows(group)):
            hints = get_type_hints(holder)
            for one in dataclasses.fields(holder):
                if one.name in _OF_EXTENDED:
                    continue
                if one.name in rows:
                    owner = rows[one.name].rows.__name__
                    raise ValueError(
                        f"{holder.__name__} brings {one.name}, which {owner} has; call one of them "
                        "otherwise"
                    )
                kinds = get_args(hints[one.name]) or (hints[one.name],)
                default: Any = one.default
                rows[one.name] = Parameter(
                    name=one.name,
                    group=group,
                    rows=holder,
                    kind=kinds[0],
                    optional=type(None) in kinds,
                    default=kinds[0]() if default is None else default,
                    **one.metadata,
                )
    return rows


_OF_EXTENDED = {one.name for one in dataclasses.fields(Extended)}

#: All parameters by name, in the order of the table; those of a law or a waveform end its group.
PARAMETERS: Mapping[str, Parameter] = _Table()


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
    return row.name, row.read(value.strip().strip("\"'"))


def read_yaml(path: str | PathLike[str]) -> Parameters:
    """Return the defaults with the values of a ROS parameter file laid over them.

    As `Parameters.of` with a path. Raises ParameterError that names the file.
    """
    from stickslip_ros.physics.parameters.bounded_files import read_values  # most runs name no file

    values = read_values(path, PARAMETERS)
    try:
        return Parameters.of(values)
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from None


def yaml_text(p: Parameters, given: Collection[str] = ()) -> str:
    """Return the text of a ROS parameter file with the values that differ from the defaults.

    Those with a name in given are in it, too.
    """
    from stickslip_ros.physics.parameters.bounded_files import parameter_file_text

    usual = Parameters().flat()
    return parameter_file_text(
        {name: value for name, value in p.flat().items() if value != usual[name] or name in given}
    )
