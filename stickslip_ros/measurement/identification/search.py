# SPDX-License-Identifier: Apache-2.0
"""Where to begin: when each run began, and which constants are worth a descent.

The deviance of a trace has many local minima, so a descent from a guess ends in a wrong one. Some
models are laid over the record at many shifts, which tells when its runs began. Then points of a
Sobol sequence about what ringing and stroke ask for are compared on a few hundred blocks, a small
shift of the clock taken up by a column of the velocity, and the best of them descend a little.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.identification.experiment import Stepping
from stickslip_ros.measurement.identification.free import FreeParameters, stiffness_of
from stickslip_ros.measurement.identification.problem import Problem
from stickslip_ros.measurement.identification.trace import Look, Trace, sensor_basis
from stickslip_ros.measurement.motion_pair import lay_over
from stickslip_ros.physics.model import Plant
from stickslip_ros.physics.parameters import ParameterError, Parameters
from stickslip_ros.physics.solver import SolverError

#: Points of the design, those that are laid over records, and those that descend.
_POINTS, _LAID, _DESCENTS = 256, 24, 8
#: Rounds of a descent here, and ends that are handed on.
_ROUNDS, _HANDED_ON = 12, 3
#: Blocks and cycles that points are compared on, and that they descend on.
_COMPARED, _DESCENDED = (360, 8.5), (700, 10.0)
#: Deviation (logarithm) of the points about a start; that of the stiffness about the ringing, and
#: of the damping about its decay.
_NARROW, _STIFFNESS, _DAMPING = math.log(3.5), 0.05, 0.7
#: Blocks and samples of a model laid over a record; shifts in a swing; shifts at most.
_LAID_BLOCKS, _LAID_SAMPLES, _A_SWING, _SHIFTS = 500, 30_000, 14.0, 1500
#: How far a start may be off: swings, parts of a period, at most; periods where cycles are unclear.
_SWINGS, _PERIODS, _WITHIN, _FAR = 2.0, 0.06, 0.45, 1.3
#: Part of the squares that another number of steps has to leave.
_CLEARLY = 0.9
#: Differences (logarithm) by which ends are two; deviance above the best beyond which none is kept.
_APART, _WORSE = {"sigma_0": 0.004, "z_ba": 0.3}, (4.0, 40.0)
_APART_OTHERS = 0.8


def search(problem: Problem, seed: int, progress: Callable[[float, Array], None]) -> list[Array]:
    """Return logarithms of parameters to descend from, the best first.

    The starts of the runs are moved, and their numbers of steps corrected, unless there are no
    traces. progress is called with the part that is done and the best logarithms so far.
    """
    traces, tables, free = problem.traces, problem.tables, problem.free
    points = design(traces, free, seed)
    for trace in traces:
        if not trace.placed:
            place_runs(trace, [free.applied_or_none(trace.parameters, y) for y in points[:_LAID]])
    looks = [Look(trace, *_COMPARED) for trace in traces]
    coarse = Problem([*looks, *tables], free)
    costs = np.array([_cost(coarse, y) for y in points])
    order = np.argsort(costs)
    progress(0.5, points[order[0]])
    fine = Problem([*(Look(trace, *_DESCENDED) for trace in traces), *tables], free)
    ends: list[tuple[float, Array]] = []
    for done, k in enumerate(order[:_DESCENTS], 1):
        begun = fine.point(fine.begin(points[k])) if np.isfinite(costs[k]) else None
        if begun is not None:
            end = fine.descend(begun, _ROUNDS)
            ends.append((end.deviance, end.unknowns[: fine.count]))
            ends.sort(key=lambda one: one[0])
            progress(0.5 + 0.5 * done / _DESCENTS, ends[0][1])
    kept: list[Array] = []
    apart = np.array([_APART.get(name, _APART_OTHERS) for name in free.names])
    for cost, theta in ends:
        near = cost < _WORSE[0] * ends[0][0] + _WORSE[1]
        if near and all((np.abs(theta - other) > apart).any() for other in kept):
            kept.append(theta)
    return kept[:_HANDED_ON]


def design(traces: Sequence[Trace], free: FreeParameters, seed: int) -> Array:
    """Return logarithms of parameters to compare, (points, parameters).

    Three of four lie about the starting values, all others anywhere between the bounds; stiffness
    and damping of most are such as the ringing asks for.
    """
    count = len(free.names)
    u = scipy.stats.qmc.Sobol(count, seed=seed).random(_POINTS)
    anywhere = free.low + u * (free.high - free.low)
    about = np.clip(free.start + (2.0 * u - 1.0) * _NARROW, free.low, free.high)
    some = np.arange(_POINTS) % 4 == 3
    points = np.where(some[:, None], anywhere, about)
    points[0] = free.start
    seen = next((one.experiment for one in traces if one.experiment.ringing), None)
    if seen is not None and seen.ringing is not None:
        mass = Plant.of(seen.parameters).mass
        stiff, _ = stiffness_of([seen])
        for name, value, width in (
            ("sigma_0", stiff, _STIFFNESS),
            ("sigma_1", 2.0 * mass * seen.ringing.decay, _DAMPING),
        ):
            if name in free.names and value > 0.0:
                k = free.names.index(name)
                near = math.log(value) + (2.0 * u[:, k] - 1.0) * width
                points[:, k] = np.where(some & (name == "sigma_0"), points[:, k], near)
    if {"z_ba", "z_ss"} <= {*free.names}:  # it breaks away before it slides
        first, last = free.names.index("z_ba"), free.names.index("z_ss")
        points[:, last] = points[:, first] + 0.1 + 1.5 * u[:, last]
    return np.asarray(np.clip(points, free.low + 1e-6, free.high - 1e-6))


def _cost(problem: Problem, theta: Array) -> float:
    """Return the deviance of a point, with the best small shift of each clock; infinite if none."""
    at = problem.point(problem.begin(theta))
    if at is None:
        return math.inf
    cost, row = at.deviance, 0
    for fit, seen in zip(problem.fits, at.seen, strict=True):
        if fit.clocks:
            speed, own = fit.changed(seen.v), at.residuals[row : row + fit.size]
            cost -= float(speed @ own) ** 2 / max(float(speed @ speed), 1e-30)
        row += fit.size
    return cost


# -- when runs began


@dataclass(frozen=True)
class Placed:
    """A run laid over the measurement."""

    left: float  #: sum of squares that is left, m^2
    start: float  #: s
    steps: int


class Window:
    """The blocks about one run, with a basis of the errors of the sensor."""

    def __init__(self, trace: Trace, k: int) -> None:
        """Take the blocks between the middles of the rests about run k."""
        self._experiment, self.run = trace.experiment, trace.experiment.runs[k]
        starts, runs = trace.starts, trace.experiment.runs
        ends = [s + abs(run.steps) / run.frequency for s, run in zip(starts, runs, strict=True)]
        begin = 0.5 * (ends[k - 1] + starts[k]) if k > 0 else -math.inf
        end = 0.5 * (ends[k] + starts[k + 1]) if k + 1 < len(runs) else math.inf
        sure, blocks = trace.experiment.unsure, trace.blocks
        inside = (blocks.t >= max(begin, sure[0])) & (blocks.t <= min(end, sure[1]))
        which = np.flatnonzero(inside & blocks.full)
        number = min(_LAID_BLOCKS, len(which))
        which = which[np.linspace(0, len(which) - 1, number).astype(np.int64)]
        self.t, self._x = blocks.t[which], blocks.x[which]
        self._basis = sensor_basis(self.t)

    def placed(self, p: Parameters, begun: Placed, far: float) -> Placed:
        """Return the best place of a model near a start, far periods off at most.

        It is the start itself if the model makes no contact.
        """
        frequency, steps = self.run.frequency, begun.steps
        try:
            ringing = Plant.of(p).ringing_frequency
            swings = max(_SWINGS / max(ringing, frequency), _PERIODS / frequency)
            reach = max(min(swings, _WITHIN / frequency), far / frequency)
            ringing = max(ringing, 10.0 * frequency)
            only = replace(self._experiment, runs=(Stepping(0.0, steps, frequency),), beyond=False)
            first, last = self.t[0] - begun.start - reach, self.t[-1] - begun.start + reach
            count = int(min((last - first) * _A_SWING * ringing, _LAID_SAMPLES))
            grid = np.linspace(first, last, max(count, 2))
            x, _ = only.simulate(p, np.zeros(1), grid)
        except (ParameterError, SolverError):
            return begun
        number = int(min(2.0 * reach * _A_SWING * ringing, _SHIFTS)) // 2 * 2 + 1
        shifts = np.linspace(-reach, reach, number)
        sums = lay_over(
            self.t - begun.start, self._x, lambda t: np.interp(t, grid, x), shifts,
            lambda left: left - self._basis @ (self._basis.T @ left),
        )  # fmt: skip
        k = int(np.argmin(sums))
        found = Placed(float(sums[k]), begun.start + float(shifts[k]), steps)
        return min([begun, found], key=lambda one: one.left)


def place_runs(trace: Trace, sets: Sequence[Parameters | None]) -> None:
    """Move the starts of an experiment's runs to where one of some models fits best.

    Hum may have made a step more or less; the numbers of steps are corrected, too.
    """
    runs = list(trace.experiment.runs)
    far = _FAR if trace.experiment.doubtful else 0.0
    for k, run in enumerate(trace.experiment.runs):
        window, begun = Window(trace, k), Placed(math.inf, float(trace.starts[k]), run.steps)
        places = [(window.placed(p, begun, far), p) for p in sets if p is not None]
        best, p = min(places, key=lambda one: one[0].left, default=(begun, trace.parameters))
        if not math.isfinite(best.left):
            continue
        # Other runs that may look the same: a step more or less, at the start or the end.
        sign, period = 1 if best.steps > 0 else -1, 1.0 / run.frequency
        others = [
            window.placed(p, Placed(math.inf, best.start + shift * period, steps), 0.0)
            for shift, more in ((0, 1), (0, -1), (-1, 1), (1, -1), (-1, 0), (1, 0))
            if (steps := best.steps + sign * more) * sign > 0
        ]
        other = min(others, key=lambda one: one.left)
        if other.left < _CLEARLY * best.left:
            best = other
        trace.starts[k] = best.start
        runs[k] = replace(run, start=best.start, steps=best.steps)
    trace.experiment = replace(trace.experiment, runs=tuple(runs), doubtful=False)
    trace.placed = True


def clock_of(trace: Trace, p: Parameters) -> Array:
    """Return the clock that aligns a model best with the runs, in the form of `Trace`."""
    clock = np.zeros(trace.clocks)
    for k, run in enumerate(trace.experiment.runs):
        begun = Placed(math.inf, float(trace.starts[k]), run.steps)
        clock[k] = (Window(trace, k).placed(p, begun, 0.0).start - begun.start) / 1e-6
    return clock
