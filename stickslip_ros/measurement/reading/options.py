# SPDX-License-Identifier: Apache-2.0
"""How a measurement is read: what its user says where the file does not."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from stickslip_ros.measurement.reading.table import MeasurementError
from stickslip_ros.physics.parameters.row import read_quantity

#: Wavelengths (m) of light that interferometers use, ultraviolet to infrared.
_LIGHT = (1e-7, 2e-5)


@dataclass(frozen=True)
class Reading:
    """How a measurement is read, where the file does not say it.

    Each field takes what the option of its name takes, as text: ``Reading(units="x=nm")``.
    """

    columns: Mapping[str, str] = field(default_factory=dict)  #: name or number, from 1
    units: Mapping[str, str] = field(default_factory=dict)  #: such as {"x": "nm"}
    scale: Mapping[str, str] = field(default_factory=dict)  #: such as {"x": "-50nm/V"}
    rate: float | None = None  #: Hz, in place of a column of time
    angle: float = 0.0  #: between the sensor's axis and the motion, rad
    #: of an interferometer, m: jumps by whole halves of it are taken out
    wavelength: float | None = None
    rows: tuple[int, int] | None = None  #: first and last row, from 1
    decimal: str | None = None  #: sign of the table

    def __post_init__(self) -> None:
        """Turn texts into values, and hold these against their bounds; MeasurementError."""
        for name in ("columns", "units", "scale"):
            given = getattr(self, name)
            if isinstance(given, str):
                object.__setattr__(self, name, pairs(name, given))
            elif not isinstance(given, Mapping):
                raise MeasurementError(
                    f'{name} is {given!r}; give a value for each key, such as {{"x": ...}}'
                )
        for name, read in _TEXTS.items():
            try:
                if isinstance(given := getattr(self, name), str):
                    object.__setattr__(self, name, read(given))
            except ValueError as error:
                raise MeasurementError(f"{name}: {error}") from None
        if self.rate is not None and not 0.0 < self.rate < math.inf:
            raise MeasurementError(f"rate is {self.rate:g} Hz; it has to be above 0")
        shortest, longest = _LIGHT
        if self.wavelength is not None and not shortest <= self.wavelength <= longest:
            raise MeasurementError(
                f"the wavelength is {self.wavelength:g} m; that of an interferometer lies between "
                f"{shortest:g} and {longest:g} m, such as 633nm"
            )


def pairs(name: str, *texts: str) -> dict[str, str]:
    """Return the values by key of texts of an option, ``t=NAME,x=NAME``. MeasurementError."""
    found = {}
    for text in filter(None, texts):
        for part in re.split(r",(?=\s*\w+=)", text):
            key, sign, value = (piece.strip() for piece in part.partition("="))
            if not sign or not value or not key:
                raise MeasurementError(f"{name}: {text!r} is not of the form t=...,x=...")
            found[key] = value
    return found


def _rows(text: str) -> tuple[int, int]:
    """Return the first and the last row of a text such as ``1:5000`` or ``5001:``. ValueError."""
    first, sign, last = text.partition(":")
    if not sign or not all(part.strip().isdecimal() or not part for part in (first, last)):
        raise ValueError(f"{text!r} is no range; write it as 1:5000 or 5001:")
    rows = int(first or 1), int(last or sys.maxsize)
    if not 1 <= rows[0] <= rows[1]:
        raise ValueError(f"{text!r}: rows count from 1, and the last must not be before the first")
    return rows


_TEXTS: dict[str, Callable[[str], Any]] = {
    "rows": _rows,
    "rate": lambda text: read_quantity(text, "Hz"),
    "wavelength": lambda text: read_quantity(text, "m"),
}
