# SPDX-License-Identifier: Apache-2.0
"""The plan of a sweep: metrics over a grid of one or two parameters.

A parameter varies over an even grid, or over listed values. This file loads no solver, so that a
worker of another process has the laws and waveforms that others registered before the solver is
loaded, which is compiled with them. A worker whose solver is loaded already answers with the error
and goes on: one that failed to unpack its task would hang.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.errors import StickslipError
from stickslip_ros.physics import laws, waveforms
from stickslip_ros.physics.laws import Law, RegistrationError, register_law
from stickslip_ros.physics.parameters import Parameters, parameter
from stickslip_ros.physics.waveforms import register_waveform
from stickslip_ros.simulation.left_out import left_out
from stickslip_ros.simulation.settled import TRIAL_STEPS
from stickslip_ros.simulation.sweep_metrics import METRICS, Points

#: Cycles in a part of a sweep, about: some tens of milliseconds of computing.
_CYCLES = 24_000
#: Points evaluated together by metrics that need no run.
_GLANCE = 10_000
#: Values that a sweep may have: they are kept in memory
_MOST_VALUES = 10_000_000
_FORM = "NAME=START:STOP:COUNT[:log], such as preload=0.1:6:60"


class SweepError(StickslipError, ValueError):
    """The sweep is impossible; the message says what to change."""


@dataclass(frozen=True)
class _Axis:
    """A parameter that varies."""

    name: str

    @property
    def unit(self) -> str:
        """Unit of the values."""
        return parameter(self.name).unit

    def check(self, values: Iterable[float]) -> None:
        """Raise SweepError or ParameterError if these are no values of the parameter."""
        row = parameter(self.name)
        if row.kind is not float:
            raise SweepError(f"{self.name} is not a number and cannot be varied; use --set")
        for value in values:
            row.check(value)


@dataclass(frozen=True)
class GridAxis(_Axis):
    """``count`` values of a parameter from start to stop (both included), in its unit.

    >>> import numpy as np
    >>> GridAxis.parse("preload=0.5:1.5:3").values(np.arange(3)).tolist()
    [0.5, 1.0, 1.5]
    >>> str(GridAxis.parse("preload=500mN:1.5N:3"))
    'preload=0.5:1.5:3'
    """

    start: float
    stop: float
    count: int
    log: bool = False

    def __post_init__(self) -> None:
        """Raise SweepError or ParameterError if that is no range of a parameter."""
        self.check((self.start, self.stop))
        if self.count < 1 or (self.count == 1) != (self.start == self.stop):
            raise SweepError(
                f"{self.name} from {self.start:g} to {self.stop:g} in {self.count} values is an "
                "empty range; two different ends need two values or more"
            )
        if self.log and not min(self.start, self.stop) > 0.0:
            raise SweepError(f"{self.name} varies by factors (log); both ends have to be above 0")

    @classmethod
    def parse(cls, text: str) -> GridAxis:
        """Read ``NAME=START:STOP:COUNT[:log]``; raise SweepError or ParameterError.

        Both ends may have a unit, such as in ``preload=100mN:6N:60``.
        """
        name, _, values = text.partition("=")
        *ends, count = values.removesuffix(":log").split(":")
        if len(ends) != 2 or not count.strip().isdecimal():
            raise SweepError(f"{text!r} is not of the form {_FORM}")
        row = parameter(name.strip())
        start, stop = (row.read(end.strip()) for end in ends) if row.kind is float else (0.0, 0.0)
        return cls(row.name, float(start), float(stop), int(count), values.endswith(":log"))

    def __str__(self) -> str:
        """Return the text that `parse` reads."""
        scale = ":log" if self.log else ""
        return f"{self.name}={self.start!r}:{self.stop!r}:{self.count}{scale}"

    def values(self, index: NDArray[np.int64]) -> Array:
        """Return the values with these indices (0 .. count - 1), shape as index."""
        pieces = max(self.count - 1, 1)
        between: NDArray[np.floating]
        if self.log:
            between = self.start * (self.stop / self.start) ** (index / pieces)
        else:
            between = self.start + (self.stop - self.start) / pieces * index
        return np.where(index == self.count - 1, self.stop, between).astype(np.float64, copy=False)


@dataclass(frozen=True)
class ListedAxis(_Axis):
    """Values of a parameter, in its unit, one by one."""

    listed: tuple[float, ...]
    log: bool = False  #: whether plots have a logarithmic axis

    def __post_init__(self) -> None:
        """Raise SweepError or ParameterError if these are no values of a parameter."""
        self.check(self.listed)
        if not self.listed:
            raise SweepError(f"{self.name} has no values; give one or more")

    @property
    def count(self) -> int:
        """How many values there are."""
        return len(self.listed)

    def values(self, index: NDArray[np.int64]) -> Array:
        """Return the values with these indices (0 .. count - 1), shape as index."""
        return np.array(self.listed)[index]


SweepAxis = GridAxis | ListedAxis


@dataclass(frozen=True)
class Sweep:
    """Metrics over a grid. Points are numbered along the last axis first, as in the CSV."""

    base: Parameters  #: full set of parameters; the axes replace some
    axes: tuple[SweepAxis, ...]  #: one or two
    metrics: tuple[str, ...]
    steps: int | None  #: from rest, to judge a point by; sign: direction; None: as many as settle

    def __post_init__(self) -> None:
        """Raise SweepError if axes or metrics make no sense together."""
        names = [axis.name for axis in self.axes]
        if not 1 <= len(names) <= 2 or len(set(names)) < len(names):
            raise SweepError("a sweep varies one or two different parameters")
        for name in self.metrics:
            if name not in METRICS:
                near = difflib.get_close_matches(name, METRICS, 1)
                hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(METRICS)}"
                raise SweepError(f"there is no metric {name!r}; {hint}")
        if not self.metrics or len(set(self.metrics)) < len(self.metrics):
            raise SweepError("a sweep asks for one or several different metrics")
        if self.points * len(self.metrics) > _MOST_VALUES:
            raise SweepError(
                f"{self.points} points of {len(self.metrics)} metrics are too many; a sweep has at "
                f"most {_MOST_VALUES} values: lower COUNT, or sweep one part after the other"
            )
        if self.steps == 0:
            raise SweepError("steps is 0; ask for at least one; a negative number goes backward")

    def __reduce__(self) -> Any:
        """Take the laws and waveforms of others along, to workers in other processes."""
        parts = self.base.flat(), self.axes, self.metrics, self.steps
        return sweep_with, (type(self), laws.of_others(), waveforms.of_others(), *parts)

    @property
    def left_out(self) -> tuple[str, ...]:
        """Effects of the base that the settled cycle is without; runs of steps from rest have all.

        Metrics other than those of steps are of the settled cycle.
        """
        runs = self.steps is not None and all(METRICS[name].runs == 1 for name in self.metrics)
        return () if runs else left_out(self.base)

    @property
    def shape(self) -> tuple[int, ...]:
        """Values along each axis."""
        return tuple(axis.count for axis in self.axes)

    @property
    def points(self) -> int:
        """Number of operating points."""
        return math.prod(self.shape)

    def coordinates(self, first: int, stop: int) -> list[Array]:
        """Return the values of each axis at points first .. stop - 1, each (stop - first,)."""
        index = np.arange(first, stop)
        indices = np.unravel_index(index, self.shape)
        return [axis.values(i) for axis, i in zip(self.axes, indices, strict=True)]

    def columns(self, first: int, stop: int) -> Parameters:
        """Return points first .. stop - 1 as columns."""
        names = (axis.name for axis in self.axes)
        return self.base.replace(**dict(zip(names, self.coordinates(first, stop), strict=True)))

    def evaluate(self, first: int, stop: int) -> Array:
        """Return the metrics of points first .. stop - 1, shape (stop - first, metrics)."""
        points = Points(self.columns(first, stop), stop - first, self.steps)
        return np.stack([METRICS[name].evaluate(points) for name in self.metrics], axis=1)

    def evaluate_part(self, part: range) -> Array:
        """Return the metrics of a part of `parts_of`, shape (points, metrics)."""
        return self.evaluate(part.start, part.stop)

    def point(self, index: int) -> Parameters:
        """Return the parameters of one point."""
        return self.columns(index, index + 1).point(0)

    def why_empty(self, index: int) -> str:
        """Return the coordinates of a point without a value, and the reason."""
        from stickslip_ros.simulation.operating_points import why_impossible  # with the solver

        p = self.point(index)
        at = p.flat()
        place = ", ".join(f"{a.name} {at[a.name]:g} {a.unit}".strip() for a in self.axes)
        fault = why_impossible(p)
        if fault:
            return f"{place}: {fault}"
        values = self.evaluate(index, index + 1)[0]
        missing = [
            f"{name}: {METRICS[name].why_empty(p, self.steps)}"
            for name, value in zip(self.metrics, values, strict=True)
            if not math.isfinite(value)
        ]
        return f"{place}: {'; '.join(missing)}"

    def refuse_if_impossible(self) -> None:
        """Raise SweepError if not one of the points is possible."""
        from stickslip_ros.simulation.operating_points import batch_of, why_impossible

        direction = 1 if self.steps is None or self.steps > 0 else -1
        for first in range(0, self.points, _GLANCE):
            stop = min(first + _GLANCE, self.points)
            if batch_of(self.columns(first, stop), stop - first, direction)[1].any():
                return
        fault = why_impossible(self.point(0)) or "it is impossible"
        raise SweepError(f"no point of the sweep is possible; the first: {fault}")


def parts_of(sweep: Sweep, workers: int) -> Iterator[range]:
    """Yield the points in parts: a moment's work each, and some parts for each worker."""
    cycles = abs(sweep.steps or TRIAL_STEPS) * sum(METRICS[name].runs for name in sweep.metrics)
    size = max(1, min(_CYCLES // cycles, -(-sweep.points // (4 * workers))))
    for first in range(0, sweep.points, size):
        yield range(first, min(first + size, sweep.points))


def sweep_with(
    kind: Callable[..., Any],
    laws: Mapping[str, Law],
    waveforms: Mapping[str, Callable[..., Any]],
    flat: Mapping[str, Any],
    *parts: Any,
) -> Any:
    """Register laws and waveforms; return a sweep of a kind, of flat parameters and other parts."""
    try:
        for name, law in laws.items():
            register_law(name, law)
        for name, waveform in waveforms.items():
            register_waveform(name, waveform)
    except RegistrationError as error:
        return Refused(str(error))
    return kind(Parameters.of(flat), *parts)


class Refused:
    """In place of a sweep that a worker cannot compute."""

    def __init__(self, why: str) -> None:
        """Say why."""
        self._why = why

    def evaluate(self, first: int, stop: int) -> Any:
        """Raise RegistrationError."""
        raise RegistrationError(f"in a worker: {self._why}; or start the workers anew")
