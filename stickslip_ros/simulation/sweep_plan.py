# SPDX-License-Identifier: Apache-2.0
"""The plan of a sweep: metrics over a grid of one or two parameters.

A parameter varies over an even grid, or over listed values, which may be texts. This file loads no
solver, so that a worker of another process has the laws and waveforms that others registered before
the solver is loaded, which is compiled with them. A worker whose solver is loaded already answers
with the error and goes on: one that failed to unpack its task would hang.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
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
class SweepAxis:
    """A parameter that varies.

    >>> import numpy as np
    >>> SweepAxis.parse("preload=0.5:1.5:3").values.tolist()
    [0.5, 1.0, 1.5]
    >>> str(SweepAxis.parse("preload=500mN:1.5N:3"))
    'preload=0.5:1.5:3'
    >>> SweepAxis.of("model", ["ceim", "lugre"]).values.tolist()
    ['ceim', 'lugre']
    """

    name: str
    values: NDArray[Any] = field(compare=False)  #: in its unit, (count,); texts are objects
    text: str  #: as `parse` reads a grid
    log: bool = False  #: whether plots have a logarithmic axis

    @classmethod
    def of(cls, name: str, values: Any) -> SweepAxis:
        """Return an axis of values one by one. Raises SweepError or ParameterError."""
        row = parameter(name)
        checked = [row.check(value) for value in np.ravel(np.asarray(values)).tolist()]
        if not checked:
            raise SweepError(f"{name} has no values; give one or more")
        kind = np.float64 if row.kind is float else object
        return cls(row.name, np.array(checked, kind), f"{name}={','.join(map(str, checked))}")

    @classmethod
    def parse(cls, text: str) -> SweepAxis:
        """Read ``NAME=START:STOP:COUNT[:log]``; raise SweepError or ParameterError.

        Both ends are included, and may have a unit, such as in ``preload=100mN:6N:60``.
        """
        name, _, values = text.partition("=")
        *ends, given = values.removesuffix(":log").split(":")
        if len(ends) != 2 or not given.strip().isdecimal():
            raise SweepError(f"{text!r} is not of the form {_FORM}")
        row, count, log = parameter(name.strip()), int(given), values.endswith(":log")
        if row.kind is not float:
            raise SweepError(
                f"{row.name} has no range; list its values in Python, or use --set for one"
            )
        start, stop = (float(row.check(row.read(end.strip()))) for end in ends)
        if count < 1 or (count == 1) != (start == stop):
            raise SweepError(
                f"{row.name} from {start:g} to {stop:g} in {count} values is an empty range; two "
                "different ends need two values or more"
            )
        if count > _MOST_VALUES:
            raise SweepError(f"{count} values of {row.name} are too many; lower COUNT")
        if log and not min(start, stop) > 0.0:
            raise SweepError(f"{row.name} varies by factors (log); both ends have to be above 0")
        numbers = np.linspace(start, stop, count)
        if log:
            numbers = start * (stop / start) ** (np.arange(count) / max(count - 1, 1))
            numbers[-1] = stop
        scale = ":log" if log else ""
        return cls(row.name, numbers, f"{row.name}={start!r}:{stop!r}:{count}{scale}", log)

    def __str__(self) -> str:
        """Return its name and values in short."""
        return self.text

    @property
    def unit(self) -> str:
        """Unit of the values."""
        return parameter(self.name).unit

    @property
    def count(self) -> int:
        """How many values there are."""
        return len(self.values)


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
        return [axis.values[i] for axis, i in zip(self.axes, indices, strict=True)]

    def groups(self, first: int, stop: int) -> Iterator[tuple[NDArray[np.int64], Parameters]]:
        """Yield points first .. stop - 1 as columns, those together that differ in numbers alone.

        Each with its rows, counted from first.
        """
        coordinates = self.coordinates(first, stop)
        varied = {axis.name: one for axis, one in zip(self.axes, coordinates, strict=True)}
        kinds = {name: one for name, one in varied.items() if one.dtype == object}
        keys = list(zip(*kinds.values(), strict=True)) or [()] * (stop - first)
        for key in dict.fromkeys(keys):
            rows = np.flatnonzero([one == key for one in keys])
            numbers = {name: one[rows] for name, one in varied.items() if name not in kinds}
            yield rows, self.base.replace(**dict(zip(kinds, key, strict=True)), **numbers)

    def evaluate(self, first: int, stop: int) -> Array:
        """Return the metrics of points first .. stop - 1, shape (stop - first, metrics)."""
        found = np.full((stop - first, len(self.metrics)), math.nan)
        for rows, p in self.groups(first, stop):
            points = Points(p, len(rows), self.steps)
            for k, name in enumerate(self.metrics):
                found[rows, k] = METRICS[name].evaluate(points)
        return found

    def evaluate_part(self, part: range) -> Array:
        """Return the metrics of a part of `parts_of`, shape (points, metrics)."""
        return self.evaluate(part.start, part.stop)

    def point(self, index: int) -> Parameters:
        """Return the parameters of one point."""
        names = [axis.name for axis in self.axes]
        values = [one.tolist()[0] for one in self.coordinates(index, index + 1)]
        return self.base.replace(**dict(zip(names, values, strict=True)))

    def why_empty(self, index: int) -> str:
        """Return the coordinates of a point without a value, and the reason."""
        from stickslip_ros.simulation.operating_points import why_impossible  # with the solver

        at = zip(self.axes, self.coordinates(index, index + 1), strict=True)
        texts = [(a.name, f"{v[0]:g}" if v.dtype != object else v[0], a.unit) for a, v in at]
        place = ", ".join(f"{name} {text} {unit}".strip() for name, text, unit in texts)
        p = self.point(index)
        if fault := why_impossible(p):
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
        from stickslip_ros.simulation.operating_points import batch_of

        direction = 1 if self.steps is None or self.steps > 0 else -1
        for first in range(0, self.points, _GLANCE):
            stop = min(first + _GLANCE, self.points)
            for rows, p in self.groups(first, stop):
                if batch_of(p, len(rows), direction)[1].any():
                    return
        raise SweepError(f"no point of the sweep is possible; the first: {self.why_empty(0)}")


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
