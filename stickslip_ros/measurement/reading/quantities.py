# SPDX-License-Identifier: Apache-2.0
"""What a measurement holds, and how much of the SI unit one of a column is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from stickslip_ros.measurement.reading.table import Column, MeasurementError
from stickslip_ros.measurement.reading.units import Scale, Unit


@dataclass(frozen=True)
class Quantity:
    """Something that a measurement holds."""

    key: str  #: as options name it
    what: str  #: for people
    dimension: str
    names: tuple[str, ...]  #: that are understood unaided
    example: str  #: a unit
    required: bool = True
    default: str | None = None  #: unit where none is stated

    def factor(
        self, column: Column, units: Mapping[str, str], scales: Mapping[str, str]
    ) -> float | Question:
        """Return the factor to SI of a column, or what has to be asked.

        units and scales are those given, by key. Raises MeasurementError where they do not fit.
        """
        if column.stamped:
            return 1.0
        key, example = self.key, self.example
        stated = units.get(key, column.unit)
        unit = Unit.of(stated)
        if key in units and unit is None:
            raise MeasurementError(
                f"{key}={stated}: the unit {stated!r} is not known; write it as {example}"
            )
        where = f"column {column} ({self.what})"
        if key in scales:
            return _scaled(self, where, scales[key], stated)
        if unit is None and not stated and self.default:
            unit = Unit.of(self.default)
        if unit is None:
            says = f"has the unit {stated!r}, which is not known" if stated else "states no unit"
            return Question(f"{where} {says}", "units", key, example)
        if unit.dimension == self.dimension:
            return unit.factor
        if unit.dimension == "voltage" and self.dimension == "length":
            return Question(f"{where} is a voltage; what is one volt?", "scale", key, "50nm/V")
        raise MeasurementError(
            f"{where} is in {stated}, which is no unit of {self.dimension}; name another column "
            f"with --columns {key}=NAME, or say with --scale {key}=... what one {stated} is"
        )


TIME = Quantity(
    "t", "time", "time", ("t", "time", "times", "timestamp", "zeit", "__time", "x_value"), "ms"
)
POSITION = Quantity(
    "x", "position", "length",
    ("x", "position", "pos", "runner", "slider", "displacement", "distance", "weg"), "nm",
)  # fmt: skip
DEFLECTION = Quantity(
    "u", "actuator deflection", "length", ("u", "actuator", "piezo"), "nm", required=False
)
VELOCITY = Quantity("v", "runner velocity", "velocity", ("runner velocity",), "m/s", required=False)
#: Of a motion.
MOTION = (TIME, POSITION, DEFLECTION, VELOCITY)
#: Of the loops of an actuator: the first two columns, in V and m, where nothing else is said.
LOOP = (
    Quantity("t", "time", "time", TIME.names, "ms", required=False),
    Quantity("voltage", "voltage", "voltage", ("voltage", "volt", "volts"), "V", default="V"),
    Quantity(
        "deflection", "deflection", "length",
        ("deflection", "displacement", "position", "x", "elongation", "stroke"), "um",
        default="m",
    ),
)  # fmt: skip


@dataclass(frozen=True)
class Question:
    """What is not known, and the option that gives it: ``--option key=value``."""

    text: str
    option: str
    key: str = ""
    value: str = ""
    columns: Sequence[Column] = ()  #: among which to choose


def _scaled(quantity: Quantity, where: str, text: str, stated: str | None) -> float | Question:
    scale = Scale.of(text, quantity.dimension)
    unit = Unit.of(stated)
    example = f"--scale {quantity.key}=50{quantity.example}/{stated}"
    if scale.unit is None:  # a factor on what the unit says
        if unit is None:
            return Question(f"{where} states no unit", "units", quantity.key, quantity.example)
        if unit.dimension == quantity.dimension:
            return scale.factor * unit.factor
        raise MeasurementError(f"{where} is in {stated}; the scale needs units, such as {example}")
    if scale.per is None:
        if unit is None:
            return scale.factor
        raise MeasurementError(f"{where} is in {stated}; the scale has to say per what: {example}")
    if unit is None:
        return scale.factor / scale.per.factor
    if unit.dimension == scale.per.dimension:
        return scale.factor * unit.factor / scale.per.factor
    raise MeasurementError(f"{where} is in {stated}, but the scale is per {scale.per.dimension}")
