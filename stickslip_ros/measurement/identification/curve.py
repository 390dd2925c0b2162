# SPDX-License-Identifier: Apache-2.0
"""A table of measured metrics over varied parameters, such as step sizes over preloads."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.identification.experiment import IdentificationError
from stickslip_ros.measurement.identification.fit import FittedCurve
from stickslip_ros.measurement.identification.trace import Seen
from stickslip_ros.measurement.reading import MeasurementError
from stickslip_ros.measurement.reading.formats import open_table
from stickslip_ros.measurement.reading.table import Column
from stickslip_ros.measurement.reading.units import Unit
from stickslip_ros.physics.model.plant import Plant
from stickslip_ros.physics.parameters import PARAMETERS, ParameterError, Parameters
from stickslip_ros.simulation.sweep_metrics import METRICS, Points

#: The metric that no sweep has: it needs no run.
RINGING = "ringing_frequency"
#: The units of all metrics.
UNITS = {**{name: metric.unit for name, metric in METRICS.items()}, RINGING: "Hz"}
#: Endings of the column that holds the standard deviation of a metric.
_DEVIATIONS = ("_sd", "_error", "_uncertainty")
#: Standard deviation of a metric where the table states none: part of its median to begin with, of
#: its largest value at least where residuals tell it. Deviations of a point without a value.
_USUAL, _LEAST, _NO_VALUE = 0.02, 1e-4, 100.0
#: Other names of metrics and parameters.
_OTHER_NAMES = {
    "0_amplitude": "zero_amplitude",
    "step": "step_size",
    "force": "generated_force",
    "voltage": "amplitude",
}


@dataclass(frozen=True)
class Curve:
    """Measured metrics over varied parameters, SI units; arrays have shape (points,)."""

    source: str  #: where it comes from, for people
    varied: Mapping[str, Array]  #: parameters by name
    metrics: Mapping[str, Array]  #: by name; nan where a point lacks one
    deviations: Mapping[str, Array]  #: standard deviations of metrics, where they are known


def read_curve(path: Path, decimal: str | None = None) -> Curve:
    """Read a table whose columns are named after parameters and metrics.

    A metric may have a column of standard deviations, ``step_size_sd``. Raises MeasurementError.
    """
    try:
        table = open_table(path, decimal)
        loaded = table.load(table.columns)
    except OSError as error:
        raise MeasurementError(f"cannot read {path}: {error.strerror or error}") from None
    except MeasurementError as error:
        raise MeasurementError(f"{path}: {error}") from None
    varied, metrics, deviations = {}, {}, {}
    for column, values in zip(table.columns, loaded.values, strict=True):
        name = _plain(column.name)
        own = _plain(next((name.removesuffix(e) for e in _DEVIATIONS if name.endswith(e)), ""))
        if own in UNITS:
            deviations[own] = values * _factor(path, column, UNITS[own])
        elif name in UNITS:
            metrics[name] = values * _factor(path, column, UNITS[name])
        elif name in PARAMETERS and PARAMETERS[name].kind is float:
            varied[name] = values * _factor(path, column, PARAMETERS[name].unit)
        else:
            raise MeasurementError(
                f"{path}: column {column} is neither a parameter nor a metric; metrics are "
                f"{', '.join(UNITS)}, their standard deviations end in _sd"
            )
    if not varied or not metrics:
        raise MeasurementError(
            f"{path}: a curve has at least one column of a parameter and one of a metric; found "
            f"{', '.join((*varied, *metrics)) or 'neither'}"
        )
    for name, values in varied.items():
        if not np.isfinite(values).all():
            raise MeasurementError(f"{path}: a value of {name} is missing; leave the row out")
    for name, values in deviations.items():
        if not (values > 0.0).all():
            raise MeasurementError(f"{path}: the deviations of {name} have to be above 0")
    return Curve(path.name, varied, metrics, deviations)


def _plain(name: str) -> str:
    plain = name.strip().lower().replace(" ", "_").replace("-", "_")
    return _OTHER_NAMES.get(plain, plain)


def _factor(path: Path, column: Column, unit: str) -> float:
    """Return the factor of a column to SI. Raises MeasurementError."""
    if column.unit is None or column.unit.strip() == unit:
        return 1.0
    found, wanted = Unit.of(column.unit), Unit.of(unit)
    if found is None or wanted is None or found.dimension != wanted.dimension:
        raise MeasurementError(
            f"{path}: column {column} has to be in {unit or 'plain numbers'}, or in a unit of that "
            "kind that is known; convert it"
        )
    return found.factor / wanted.factor


class CurveFit:
    """A curve with the standard deviations of its values.

    It is fitted together with traces. It has no clock, and nothing is projected out of it.
    """

    clocks = 0
    clock_weight = 0.0
    step = 3e-3  # of differences by logarithms: searches for a 0-amplitude are not smooth

    def __init__(self, parameters: Parameters, curve: Curve) -> None:
        """Take the measured numbers in one row, metric by metric. IdentificationError."""
        self.parameters, self.curve = parameters, curve
        self._points = len(next(iter(curve.varied.values())))
        measured = np.concatenate(list(curve.metrics.values()))
        self._known = np.isfinite(measured)
        self.measured = measured[self._known]
        sizes, stated = [], []
        for name, values in curve.metrics.items():
            own = curve.deviations.get(name)
            usual = max(_USUAL * abs(float(np.nanmedian(values))), 1e-12)
            sizes.append(np.full(self._points, usual) if own is None else own)
            stated.append(np.full(self._points, own is not None))
        self._first = np.concatenate(sizes)[self._known]
        self.deviation = self._first.copy()
        self._stated = np.concatenate(stated)[self._known]
        number = np.repeat(np.arange(len(curve.metrics)), self._points)
        self._metric = number[self._known]
        self.size = len(self.measured)
        if not self.size:
            raise IdentificationError(f"{curve.source} has no measured number")

    @property
    def is_stated(self) -> bool:
        """Whether the table states the deviation of each number."""
        return bool(self._stated.all())

    @property
    def loudness(self) -> float:
        """Size of the deviations against what they were taken for, in -2 log likelihood."""
        return 2.0 * float(np.sum(np.log(self.deviation / self._first)))

    def sets(self) -> list[Parameters]:
        """Return the parameters of each point. ParameterError where one is out of range."""
        return [
            self.parameters.replace(
                **{name: float(values[k]) for name, values in self.curve.varied.items()}
            )
            for k in range(self._points)
        ]

    def model(self, p: Parameters, clock: Array, width: float = 0.0) -> Seen:
        """Return the metrics of the model, nan at points without one. ParameterError."""
        columns = p.replace(**self.curve.varied)
        points = Points(columns, self._points, None)
        found = []
        for name in self.curve.metrics:
            if name == RINGING:
                values = np.broadcast_to(Plant.column(columns).ringing_frequency, self._points)
            else:
                values = METRICS[name].evaluate(points)
            found.append(np.asarray(values, dtype=np.float64))
        x = np.concatenate(found)[self._known]
        if not np.isfinite(x).any():
            raise ParameterError("no point of the curve is possible")
        return Seen(x, np.zeros_like(x), np.zeros_like(x))

    def residuals(self, seen: Seen) -> Array:
        """Return the residuals in standard deviations, (size,)."""
        return np.nan_to_num((self.measured - seen.x) / self.deviation, nan=_NO_VALUE)

    def changed(self, change: Array) -> Array:
        """Return the change of the residuals for a change of the model, (size,) or (size, n)."""
        return np.asarray((np.nan_to_num(-change).T / self.deviation).T)

    def clock_derivatives(self, seen: Seen, clock: Array) -> Array:
        """Return no derivatives, (size, 0)."""
        return np.zeros((self.size, 0))

    def width_derivative(self, seen: Seen) -> Array:
        """Return 0: a metric has no width."""
        return np.zeros(self.size)

    def learn(self, seen: Seen) -> None:
        """Estimate deviations that the table does not state from the residuals of a good fit."""
        left = self.measured - seen.x
        for k in range(len(self.curve.metrics)):
            own = (self._metric == k) & ~self._stated & np.isfinite(left)
            if np.count_nonzero(own) > 2:
                usual = math.sqrt(float(np.mean(left[own] ** 2)))
                self.deviation[own] = max(usual, _LEAST * float(np.abs(self.measured[own]).max()))

    def fitted(self, seen: Seen) -> FittedCurve:
        """Return the table and the values of the model."""

        def spread(values: Array) -> dict[str, Array]:
            whole = np.full(len(self._known), np.nan)
            whole[self._known] = values
            return dict(zip(self.curve.metrics, whole.reshape(-1, self._points), strict=True))

        return FittedCurve(
            self.curve.source, self.curve.varied, self.curve.metrics, spread(seen.x),
            spread(self.deviation),
        )  # fmt: skip
