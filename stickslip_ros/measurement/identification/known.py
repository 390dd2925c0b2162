# SPDX-License-Identifier: Apache-2.0
"""What goes into an identification: drives, whose inputs may be uncertain, and measured motions."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

from stickslip_ros.base.shared_files import config_file
from stickslip_ros.measurement.identification.experiment import IdentificationError
from stickslip_ros.measurement.measurements import read_measurement
from stickslip_ros.measurement.reading import MeasurementError
from stickslip_ros.physics.parameters import PARAMETERS, ParameterError, Parameters, parameter
from stickslip_ros.physics.parameters.bounded_files import read_values
from stickslip_ros.physics.parameters.row import read_quantity
from stickslip_ros.simulation.motion import Motion

#: A number with its standard deviation.
_UNCERTAIN = re.compile(r"(?P<value>.+?)\s*(?:\+-|\+/-|±)\s*(?P<deviation>.+)")
#: Inputs that may be uncertain.
UNCERTAIN = ("preload", "mass", "payload", "amplitude", "gain", "slewrate", "spring", "force")
_FORM = (
    "each run is (drive, motion) or (drive, t, x): a drive is a parameter file, a mapping or "
    "Parameters; a motion is a Motion, a file, a DataFrame or an xarray object"
)


@dataclass(frozen=True)
class Known:
    """The parameters of a drive, and the standard deviations of those that are uncertain."""

    parameters: Parameters
    deviations: Mapping[str, float]  #: in the unit of the parameter

    @classmethod
    def of(cls, drive: Any) -> Known:
        """Return what a path, a mapping or Parameters say. IdentificationError, ParameterError."""
        if isinstance(drive, Parameters):
            return cls(drive, {})
        if isinstance(drive, str | PathLike):
            values = read_values(config_file(Path(drive), ParameterError), PARAMETERS)
        elif isinstance(drive, Mapping):
            values = dict(drive)
        else:
            raise IdentificationError(f"{_named(drive)} is no drive; {_FORM}")
        deviations = {}
        for name, value in values.items():
            found = _UNCERTAIN.fullmatch(value.strip()) if isinstance(value, str) else None
            if found:
                deviations[name] = deviation_of(name, found["deviation"])
        try:
            return cls(Parameters.of(values), deviations)
        except ParameterError as error:
            where = "" if isinstance(drive, Mapping) else f"{drive}: "
            raise ParameterError(f"{where}{error}") from None

    def parts(self, more: Mapping[str, float]) -> dict[str, float]:
        """Return these and more standard deviations as parts of the values. IdentificationError."""
        found = {}
        for name, deviation in {**self.deviations, **more}.items():
            value = self.parameters.value(_uncertain(name))
            if not deviation > 0.0 or not value:
                raise IdentificationError(
                    f"{name} is {value or 0.0:g} with a standard deviation of {deviation:g}; both "
                    "have to be above 0"
                )
            found[name] = deviation / abs(value)
        return found


def _uncertain(name: str) -> str:
    """Return the name of an input that may be uncertain. IdentificationError for any other."""
    if parameter(name).name not in UNCERTAIN:
        raise IdentificationError(
            f"{name} cannot be uncertain; those that can are {', '.join(UNCERTAIN)}"
        )
    return name


def deviation_of(name: str, text: str) -> float:
    """Return a standard deviation in the unit of a parameter. IdentificationError."""
    unit = parameter(_uncertain(name)).unit
    try:
        return read_quantity(text, unit)
    except ValueError as error:
        raise IdentificationError(f"{name}: the standard deviation {error}") from None


def known_runs(runs: Iterable[Any]) -> list[tuple[Known, Motion]]:
    """Return drives and motions of runs in any form. IdentificationError, MeasurementError."""
    if isinstance(runs, str | PathLike | Parameters | Mapping | Motion):
        raise IdentificationError(
            f"runs is {_named(runs)}; it has to be a list such as [('drive.yaml', 'trace.csv')]: "
            f"{_FORM}"
        )
    found = []
    for k, run in enumerate(runs):
        if isinstance(run, str | bytes) or not isinstance(run, Sequence) or len(run) not in (2, 3):
            raise IdentificationError(f"run {k + 1} is {_named(run)}; {_FORM}")
        drive, *measured = run
        if isinstance(drive, Motion) or (
            isinstance(drive, str | PathLike) and Path(drive).suffix.lower() in (".csv", ".txt")
        ):
            raise IdentificationError(
                f"run {k + 1} begins with {_named(drive)}, a measurement; give the drive first: "
                f"{_FORM}"
            )
        found.append((Known.of(drive), _motion_of(measured, f"run {k + 1}")))
    return found


def _motion_of(measured: Sequence[Any], name: str) -> Motion:
    """Return a motion from one object that holds it, or from times (s) and positions (m)."""
    one = measured[0]
    if isinstance(one, Motion):
        return one
    if isinstance(one, str | PathLike):
        return read_measurement(one)
    try:
        return replace(
            read_measurement(one if len(measured) == 1 else tuple(measured)), source=name
        )
    except MeasurementError as error:
        raise IdentificationError(f"the motion of {name}: {error}") from None


def _named(one: Any) -> str:
    """Return an argument in words."""
    return repr(one) if isinstance(one, str | PathLike) else f"a {type(one).__name__}"
