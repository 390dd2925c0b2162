# SPDX-License-Identifier: Apache-2.0
"""A sweep: which points, which metrics, and how its parts go through an executor in order."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Executor, Future
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.parameters import Parameters
from stickslip_ros.studies.operating_points import batch_of, fault_of
from stickslip_ros.studies.sweep.grid import Axis, SweepError
from stickslip_ros.studies.sweep.metrics import METRICS, Points

#: Cycles in a part of a sweep, about: some tens of milliseconds of computing.
_CYCLES = 24_000
#: Points looked at together where nothing is run.
_GLANCE = 10_000
#: Parts that wait for each worker, so that none runs dry while results are written.
_AHEAD = 3


@dataclass(frozen=True)
class Sweep:
    """Metrics over a grid. Points are numbered along the last axis first, as in the CSV."""

    base: Parameters  #: full set of parameters; the axes replace some
    axes: tuple[Axis, ...]  #: one or two
    metrics: tuple[str, ...]
    steps: int  #: from rest, to judge a point by; sign: direction

    def __post_init__(self) -> None:
        """Raise SweepError if axes or metrics make no sense together."""
        names = [axis.name for axis in self.axes]
        if not 1 <= len(names) <= 2 or len(set(names)) < len(names):
            raise SweepError("a sweep varies one or two different parameters")
        for name in self.metrics:
            if name not in METRICS:
                raise SweepError(f"there is no metric {name!r}; known: {', '.join(METRICS)}")
        if not self.metrics or len(set(self.metrics)) < len(self.metrics):
            raise SweepError("a sweep asks for one or several different metrics")
        if self.steps == 0:
            raise SweepError("steps is 0; ask for at least one, negative ones go backward")

    @property
    def shape(self) -> tuple[int, ...]:
        """Values along each axis."""
        return tuple(axis.count for axis in self.axes)

    @property
    def points(self) -> int:
        """Number of operating points."""
        return math.prod(self.shape)

    def coordinates(self, first: int, stop: int) -> list[NDArray[np.float64]]:
        """Return the values of each axis at points first .. stop - 1, each (stop - first,)."""
        index = np.arange(first, stop)
        indices = np.unravel_index(index, self.shape)
        return [axis.values(i) for axis, i in zip(self.axes, indices, strict=True)]

    def columns(self, first: int, stop: int) -> Parameters:
        """Return points first .. stop - 1 as a column set."""
        names = (axis.name for axis in self.axes)
        return self.base.replace(**dict(zip(names, self.coordinates(first, stop), strict=True)))

    def evaluate(self, first: int, stop: int) -> NDArray[np.float64]:
        """Return the metrics of points first .. stop - 1, shape (stop - first, metrics)."""
        points = Points(self.columns(first, stop), stop - first, self.steps)
        return np.stack([METRICS[name].evaluate(points) for name in self.metrics], axis=1)

    def point(self, index: int) -> Parameters:
        """Return the plain set of parameters of one point."""
        return self.columns(index, index + 1).point(0)

    def why_empty(self, index: int) -> str:
        """Return where a point without a value lies, and why it has none."""
        p = self.point(index)
        at = p.flat()
        place = ", ".join(f"{a.name} {at[a.name]:g} {a.unit}".strip() for a in self.axes)
        fault = fault_of(p)
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
        direction = 1 if self.steps > 0 else -1
        for first in range(0, self.points, _GLANCE):
            stop = min(first + _GLANCE, self.points)
            if batch_of(self.columns(first, stop), stop - first, direction)[1].any():
                return
        fault = fault_of(self.point(0)) or "it is impossible"
        raise SweepError(f"no point of the sweep is possible; the first: {fault}")


def evaluate(sweep: Sweep, first: int, stop: int) -> NDArray[np.float64]:
    """Return ``sweep.evaluate(first, stop)``: what an executor is handed."""
    return sweep.evaluate(first, stop)


def results(
    sweep: Sweep, executor: Executor, workers: int, first: int = 0
) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """Yield (number of the first point, metrics (points, metrics)) in order, from point first on.

    workers says how many parts the executor runs at once. No more than a few parts wait or run at
    a time; those that have not begun are cancelled when the caller stops early.
    """
    size = part_size(sweep, workers, sweep.points - first)
    starts = iter(range(first, sweep.points, size))
    waiting: deque[tuple[int, Future[NDArray[np.float64]]]] = deque()
    try:
        while True:
            while len(waiting) < _AHEAD * workers and (start := next(starts, None)) is not None:
                stop = min(start + size, sweep.points)
                waiting.append((start, executor.submit(evaluate, sweep, start, stop)))
            if not waiting:
                return
            start, future = waiting[0]
            values = future.result()
            waiting.popleft()
            yield start, values
    finally:
        for _, future in waiting:
            future.cancel()


def part_size(sweep: Sweep, workers: int, points: int) -> int:
    """Return how many points go into a part: a moment's work, and some parts for each worker."""
    cycles = abs(sweep.steps) * sum(METRICS[name].runs for name in sweep.metrics)
    return max(1, min(_CYCLES // cycles, -(-points // (4 * workers))))
