# SPDX-License-Identifier: Apache-2.0
"""When each run of a measurement began: models laid over it at many shifts.

Weak damping and hum shift the start found from the steps alone by a part of a period, far more
than the period of ringing that least squares can correct. Stiffness and damping of the contact are
roughly known from the ringing; of the other constants it is enough if some of the random draws fit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.identification.experiment import Stepping
from stickslip_ros.identification.settings import START
from stickslip_ros.identification.trace_fit import CLOCK, TraceFit
from stickslip_ros.model import Plant
from stickslip_ros.parameters import ParameterError, Parameters
from stickslip_ros.solver import SolverError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Placed:
    """A run laid over the measurement."""

    left: float  #: sum of squares that is left, m^2
    start: float  #: s
    steps: int


class Window:
    """The bins about one run, and what of them a sensor may have made."""

    def __init__(self, fit: TraceFit, k: int) -> None:
        """Take the bins between the middles of the rests about run k."""
        self._experiment = fit.experiment
        self.run: Stepping = fit.experiment.runs[k]
        starts = fit.starts
        runs = fit.experiment.runs
        begin, end = -math.inf, math.inf
        if k > 0:
            begin = 0.5 * (
                starts[k - 1] + abs(runs[k - 1].steps) / runs[k - 1].frequency + starts[k]
            )
        if k + 1 < len(runs):
            end = 0.5 * (starts[k] + abs(self.run.steps) / self.run.frequency + starts[k + 1])
        sure = fit.experiment.unsure
        begin, end = max(begin, sure[0]), min(end, sure[1])
        bins = fit.bins
        some = bins.some((bins.t >= begin) & (bins.t <= end), START.bins)
        self.t, self._x, self._basis = some.t, some.x, some.of_sensor()

    def placed(self, p: Parameters, start: float, reach: float, steps: int) -> Placed:
        """Return the best place within reach (s) of a start (s). ParameterError, SolverError."""
        ringing = max(Plant.of(p).ringing_frequency, 10.0 * self.run.frequency)
        only = replace(
            self._experiment,
            runs=(Stepping(0.0, steps, self.run.frequency),),
            beyond=False,
        )
        first, last = float(self.t[0]) - start - reach, float(self.t[-1]) - start + reach
        count = int(min((last - first) * START.density * ringing, START.most_samples))
        grid = np.linspace(first, last, max(count, 2))
        x, _ = only.simulation(p, np.zeros(1)).sample(grid)
        number = int(min(2.0 * reach * START.shifts * ringing, START.most_shifts)) // 2 * 2 + 1
        shifts = np.linspace(-reach, reach, number)
        best = Placed(math.inf, start, steps)
        for some in np.array_split(shifts, max(1, number // START.at_once)):
            seen = np.interp(self.t[:, None] - start - some, grid, x)
            left = self._x[:, None] - seen
            left -= self._basis @ (self._basis.T @ left)
            sums = np.sum(left * left, axis=0)
            k = int(np.argmin(sums))
            if sums[k] < best.left:
                best = Placed(float(sums[k]), start + float(some[k]), steps)
        return best


def place_runs(fit: TraceFit, sets: Sequence[Parameters]) -> None:
    """Move the starts of an experiment's runs to where one of some models fits best.

    Hum may have made a step more or less; the numbers of steps are corrected, too.
    """
    runs = list(fit.experiment.runs)
    far = START.far if fit.experiment.doubtful else 0.0
    for k, run in enumerate(fit.experiment.runs):
        window, begun = Window(fit, k), Placed(math.inf, float(fit.starts[k]), run.steps)
        places = [(_best(window, [begun], [p], far), p) for p in sets]
        best, p = min(
            places, key=lambda one: one[0].left, default=(begun, fit.experiment.parameters)
        )
        if not math.isfinite(best.left):
            continue
        others = _best(window, _others(best, 1.0 / run.frequency), [p], 0.0)
        if others.left < START.clearly * best.left:
            best = others
        fit.starts[k] = best.start
        runs[k] = replace(run, start=best.start, steps=best.steps)
    fit.take(replace(fit.experiment, runs=tuple(runs), doubtful=False))


def clock_of(fit: TraceFit, p: Parameters) -> Array:
    """Return the clock at which a model lies best on the runs, as `TraceFit` takes it."""
    clock = np.zeros(fit.clocks)
    for k, run in enumerate(fit.experiment.runs):
        begun = Placed(math.inf, float(fit.starts[k]), run.steps)
        best = _best(Window(fit, k), [begun], [p], 0.0)
        clock[k] = (best.start - begun.start) / CLOCK
    return clock


def _others(place: Placed, period: float) -> list[Placed]:
    """Return what else may have looked so: a step more or less, at the start or at the end."""
    sign = 1 if place.steps > 0 else -1
    changes = ((0, 1), (0, -1), (-1, 1), (1, -1), (-1, 0), (1, 0))
    return [
        Placed(math.inf, place.start + shift * period, place.steps + sign * more)
        for shift, more in changes
        if abs(place.steps) + more > 0
    ]


def _best(
    window: Window, begun: Sequence[Placed], sets: Sequence[Parameters], far: float
) -> Placed:
    """Return the best place of all models near places to begin at, far in periods of the drive.

    It is the first of these where none of the models makes a contact.
    """
    best, period = begun[0], 1.0 / window.run.frequency
    for p in sets:
        try:
            ringing = Plant.of(p).ringing_frequency
            near = max(START.swings / max(ringing, window.run.frequency), START.periods * period)
            reach = max(min(near, 0.45 * period), far * period)
            found = [window.placed(p, one.start, reach, one.steps) for one in begun]
        except (ParameterError, SolverError):
            continue
        best = min([best, *found], key=lambda one: one.left)
    return best
