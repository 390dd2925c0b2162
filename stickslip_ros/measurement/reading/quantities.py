# SPDX-License-Identifier: Apache-2.0
"""The quantities of a measurement, and the factors of their columns to SI units."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from stickslip_ros.measurement.reading.table import Column, MeasurementError, Unit
from stickslip_ros.parameters.row import NUMBER

_SCALE = re.compile(rf"(?P<number>{NUMBER}|[+-])?\s*(?P<unit>[^\d\s/*][^\s/]*)?"
                    r"\s*(?:/\s*(?P<count>\d+\.?\d*)?\s*(?P<per>\S+))?")  # fmt: skip
#: Wavelengths (m) of light that interferometers use, ultraviolet to infrared.
_LIGHT = (1e-7, 2e-5)
#: What a scale is per where the column has plain numbers.
_COUNTS = {"count", "counts", "digit", "digits", "lsb", "step", "steps", "sample", "samples", "1"}


@dataclass(frozen=True)
class Reading:
    """How a measurement is read, where the file does not say it; mappings by key of a quantity."""

    columns: Mapping[str, str] = field(default_factory=dict)  #: name or number, from 1
    units: Mapping[str, str] = field(default_factory=dict)  #: such as {"x": "nm"}
    scales: Mapping[str, str] = field(default_factory=dict)  #: such as {"x": "-50nm/V"}
    rate: float | None = None  #: Hz, in place of a column of time
    angle: float = 0.0  #: between the sensor's axis and the motion, rad
    #: of an interferometer, m: jumps by whole halves of it are taken out
    wavelength: float | None = None
    rows: tuple[int, int] | None = None  #: first and last row, from 1
    decimal: str | None = None  #: sign of the table

    def __post_init__(self) -> None:
        """Raise MeasurementError for a text in place of a mapping, or a wavelength of no light."""
        for name in ("columns", "units", "scales"):
            given = getattr(self, name)
            if not isinstance(given, Mapping):
                raise MeasurementError(
                    f'{name} is {given!r}; give a value for each key, such as {{"x": ...}}'
                )
        shortest, longest = _LIGHT
        if self.wavelength is not None and not shortest <= self.wavelength <= longest:
            raise MeasurementError(
                f"the wavelength is {self.wavelength:g} m; that of an interferometer lies between "
                f"{shortest:g} and {longest:g} m, such as 633nm"
            )


def typed_pairs(texts: Sequence[str]) -> dict[str, str]:
    """Return the values by key of texts such as ``t=NAME,x=NAME``. Raises MeasurementError."""
    pairs = {}
    for text in texts:
        for part in re.split(r",(?=\s*\w+=)", text) if text else []:
            key, sign, value = (piece.strip() for piece in part.partition("="))
            if not sign or not value or not key:
                raise MeasurementError(f"{text!r} is not of the form t=...,x=...")
            pairs[key] = value
    return pairs


@dataclass(frozen=True)
class Question:
    """An unknown property, and the option that gives it: ``--option key=value``."""

    text: str
    option: str
    key: str = ""
    value: str = ""
    columns: Sequence[Column] = ()  #: among which to choose


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

    def factor(self, column: Column, given: Reading) -> float | Question:
        """Return the factor of a column to SI, or the question to ask. MeasurementError."""
        if column.stamped:
            return 1.0
        key, example = self.key, self.example
        stated = given.units.get(key, column.unit)
        unit = Unit.of(stated)
        if key in given.units and unit is None:
            raise MeasurementError(
                f"{key}={stated}: the unit {stated!r} is not known; write it as {example}"
            )
        where = f"column {column} ({self.what})"
        if key in given.scales:
            return self._scaled(where, given.scales[key], stated, unit)
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

    def _scaled(
        self, where: str, text: str, stated: str | None, unit: Unit | None
    ) -> float | Question:
        """Return the factor by a scale as typed: ``50nm/V``, ``-0.5um/V``, ``2nm`` or ``-1``."""
        found = _SCALE.fullmatch(text.strip())
        number, given, count, per = found.group("number", "unit", "count", "per") if found else (
            None, None, None, None)  # fmt: skip
        to, of = Unit.of(given), None if per is None or per.lower() in _COUNTS else Unit.of(per)
        factor = float(f"{number}1" if number in ("+", "-") else number or 1.0)
        if (to is None if given or per else number is None) or not 0.0 < abs(factor) < 1e30:
            raise MeasurementError(
                f"the scale {text!r} is not understood; write it as 50nm/V, -0.5um/V or -1"
            )
        if per and per.lower() not in _COUNTS and of is None:
            raise MeasurementError(f"the scale {text!r}: {per!r} is not a known unit")
        if to is None:  # a factor on what the unit says
            if unit is None:
                return Question(f"{where} states no unit", "units", self.key, self.example)
            to = of = Unit(self.dimension, 1.0)
        if to.dimension != self.dimension:
            raise MeasurementError(
                f"the scale {text!r} gives a {to.dimension}; it has to give a {self.dimension}"
            )
        factor *= to.factor / float(count or 1.0)
        if unit is None:
            return factor / (of.factor if of else 1.0)
        if of is None or unit.dimension != of.dimension:
            stands = f"the scale is per {of.dimension}" if of else "the scale has to say per what"
            example = f"--scale {self.key}=50{self.example}/{stated}"
            raise MeasurementError(f"{where} is in {stated}, but {stands}, such as {example}")
        return factor * unit.factor / of.factor


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
