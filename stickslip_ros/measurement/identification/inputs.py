# SPDX-License-Identifier: Apache-2.0
"""What goes into an identification: drives whose inputs may be uncertain, and measured motions.

A drive is a path, a mapping or parameters. A number of a path or a mapping may have a standard
deviation, ``preload: 0.4 +- 0.02``. A motion is a `Motion`, a file, a DataFrame or an xarray object
with units, or times and positions. A velocity, as a Doppler vibrometer gives it, is integrated: its
offset becomes a drift and its noise a walk, both of which a fit takes out.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.shared_files import config_file, sample_file
from stickslip_ros.measurement.bags.load_motion import load_motion
from stickslip_ros.measurement.identification.experiment import IdentificationError
from stickslip_ros.measurement.reading import MeasurementError, Reading
from stickslip_ros.measurement.reading.formats import open_table
from stickslip_ros.measurement.reading.given import given_table
from stickslip_ros.measurement.reading.motion import motion_of
from stickslip_ros.measurement.reading.table import Column, Table
from stickslip_ros.measurement.reading.units import Unit
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
        """Return what is known of a drive. IdentificationError, ParameterError."""
        if isinstance(drive, Parameters):
            return cls(drive, {})
        if isinstance(drive, str | PathLike):
            path = config_file(Path(drive), ParameterError)
            values = read_values(path, PARAMETERS)
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
        found.append((Known.of(drive), motion_from(measured, f"run {k + 1}")))
    return found


def motion_from(measured: Sequence[Any], name: str) -> Motion:
    """Return a motion from one object that holds it, or from times (s) and positions (m)."""
    one = measured[0]
    if len(measured) == 1 and isinstance(one, Motion):
        return one
    if len(measured) == 1 and isinstance(one, str | PathLike):
        return read_motion(sample_file(Path(one), MeasurementError))
    try:
        return table_motion(given_table(*measured), name, Reading())
    except MeasurementError as error:
        raise IdentificationError(f"the motion of {name}: {error}") from None


def read_motion(path: Path, how: Reading | None = None, joint: str | None = None) -> Motion:
    """Return the motion in a file, also where it holds a velocity. MeasurementError, BagError."""
    how = how or Reading()
    velocity = how.units.get("x") or ""
    unit = Unit.of(velocity)
    if unit is None or unit.dimension != "velocity":
        try:
            return load_motion(path, how=how, joint=joint).motion
        except MeasurementError:
            if not path.is_file():
                raise
            try:
                table = open_table(path, how.decimal)
            except (MeasurementError, OSError):
                table = None
            if table is None or _velocity_in(table, how) is None:
                raise
    return table_motion(open_table(path, how.decimal), path.name, how)


def table_motion(table: Table, source: str, how: Reading) -> Motion:
    """Return the motion in a table, a velocity integrated. MeasurementError."""
    found = _velocity_in(table, how)
    if found is None:
        return motion_of(table, source, how)
    column, factor = found
    # Read as a position in metres: nothing but the unit differs.
    columns = [
        replace(one, unit="m") if one.number == column.number else one for one in table.columns
    ]
    units = {key: unit for key, unit in how.units.items() if key != "x"}
    named = {**how.columns, "x": str(column.number)}
    motion = motion_of(
        Table(columns, table.load, table.preview, table.notes), source,
        Reading(named, units, how.scale, how.rate, how.angle, None, how.rows, how.decimal),
    )  # fmt: skip
    v = factor * motion.x
    note = "a velocity, integrated; its offset is a drift, which is taken out"
    return Motion(source, motion.t, _integrated(motion.t, v), notes=(*motion.notes, note))


def _integrated(t: Array, v: Array) -> Array:
    """Return the integral (m) of a velocity (m/s) without its mean at the start and the end."""
    return np.concatenate([[0.0], np.cumsum(0.5 * np.diff(t) * (v[1:] + v[:-1]))])


def _velocity_in(table: Table, how: Reading) -> tuple[Column, float] | None:
    """Return the column of velocity, and its factor to m/s, where there is no position."""
    stated = Unit.of(how.units.get("x"))
    if stated is not None and stated.dimension == "velocity":
        wanted = how.columns.get("x")
        free = [c for c in table.columns if wanted in (c.name, str(c.number))]
        free = free or [c for c in table.columns if c.dimension in (None, "velocity")][-1:]
        return (free[0], stated.factor) if free else None
    speeds = [one for one in table.columns if one.dimension == "velocity"]
    places = [one for one in table.columns if one.dimension == "length"]
    if len(speeds) != 1 or places or "x" in how.columns:
        return None
    unit = Unit.of(speeds[0].unit)
    return None if unit is None else (speeds[0], unit.factor)


def _named(one: Any) -> str:
    """Return an argument in words."""
    return repr(one) if isinstance(one, str | PathLike) else f"a {type(one).__name__}"
