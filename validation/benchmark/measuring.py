# SPDX-License-Identifier: Apache-2.0
"""Measures what every method costs and how far it is off, all in one run."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from validation.benchmark.cases import FINEST, Case, Problem
from validation.benchmark.methods import (
    DEFAULT_TOLERANCE,
    METHODS,
    OURS,
    SCIPY_LSODA,
    Method,
    MissingPeer,
)
from validation.whole_system import WholeSystem

#: Error per cycle (m) that a peer may have where its speed is quoted.
LIMIT = 1e-11
#: Accuracy of the reference, and a coarser one that has to give the same; as `whole_system` has it.
_REFERENCE, _COARSER = (1e-14, 1e-11), (1e-13, 1e-10)
#: A method has failed, rather than been inaccurate, beyond this error per cycle, m.
_LOST = 1e-6

#: Reads a clock, s.
Clock = Callable[[], float]
#: Is called with the number of steps of the work done.
Progress = Callable[[int], object]


@dataclass(frozen=True)
class Effort:
    """How much time to spend on a case."""

    cycles: int  #: whose error is measured
    repeats: int  #: of every timing
    quoted: float  #: shortest repeat of a setting that may be quoted, s
    plotted: float  #: shortest repeat of any other, s


FULL = Effort(cycles=6, repeats=5, quoted=20e-3, plotted=4e-3)
QUICK = Effort(cycles=3, repeats=3, quoted=10e-3, plotted=2e-3)


@dataclass
class Point:
    """One method at one setting."""

    setting: float  #: tolerance: ours in m, the others' in scaled units
    error: float  #: per cycle, m; inf if it failed
    cycles: int = 0  #: in each repeat
    times: list[float] = field(default_factory=list)  #: of each repeat, s per cycle

    @property
    def median(self) -> float:
        """Time per cycle, s."""
        return statistics.median(self.times) if self.times else math.inf


@dataclass
class Measured:
    """One method on one case."""

    method: str
    points: list[Point]  #: loosest setting first
    missing: str = ""  #: why there are none

    @property
    def quoted(self) -> Point | None:
        """Ours at its default tolerance; a peer's fastest setting within `LIMIT`."""
        if self.method == OURS:
            return next(point for point in self.points if point.setting == DEFAULT_TOLERANCE)
        return self.fastest(LIMIT)

    def fastest(self, limit: float) -> Point | None:
        """Return the fastest setting with an error per cycle of at most limit, m."""
        within = [point for point in self.points if point.error <= limit and point.times]
        return min(within, key=lambda point: point.median, default=None)

    @property
    def dependable(self) -> Point | None:
        """The fastest within `LIMIT` for which all tighter settings are within it too.

        Coarse settings sometimes hit the answer by chance; nobody could have chosen them.
        """
        sound: list[Point] = []
        for point in reversed(self.points):
            if not point.error <= LIMIT:
                break
            sound.append(point)
        return min(sound, key=lambda point: point.median, default=None)


@dataclass
class CaseResult:
    """All methods on one case."""

    case: Case
    gap: float  #: between the reference and our kernel at its finest, m per cycle
    reference_gap: float  #: between the reference and itself at a coarser accuracy, m per cycle
    measured: dict[str, Measured]

    @property
    def fastest_peer(self) -> str | None:
        """Name of the peer with the fastest quoted setting."""
        return self._fastest({name: one.quoted for name, one in self._peers})

    @property
    def fastest_dependable_peer(self) -> str | None:
        """The same among the settings that are not right by chance."""
        return self._fastest({name: one.dependable for name, one in self._peers})

    @property
    def _peers(self) -> list[tuple[str, Measured]]:
        return [(name, one) for name, one in self.measured.items() if name != OURS]

    @staticmethod
    def _fastest(points: Mapping[str, Point | None]) -> str | None:
        times = {name: point.median for name, point in points.items() if point is not None}
        return min(times, key=times.__getitem__, default=None)

    def ratio(self, method: str | None, dependable: bool = False) -> float | None:
        """Return a method's time by ours, as quoted; None if there is nothing to compare."""
        if method is None or method not in self.measured:
            return None
        one, ours = self.measured[method], self.measured[OURS].quoted
        point = one.dependable if dependable else one.quoted
        if point is None or ours is None:
            return None
        return point.median / ours.median

    @property
    def scipy_ratio(self) -> float | None:
        """SciPy LSODA's time by ours."""
        return self.ratio(SCIPY_LSODA)


def load(names: Sequence[str], progress: Progress) -> tuple[dict[str, Method], dict[str, str]]:
    """Return the methods by name, and of those that are missing why."""
    found: dict[str, Method] = {}
    missing: dict[str, str] = {}
    for name in names:
        try:
            found[name] = METHODS[name].load()
        except MissingPeer as error:
            missing[name] = str(error)
        progress(1)
    return found, missing


def work(cases: int, methods: int, effort: Effort) -> int:
    """Return how many steps of progress `load` and `measure` report together."""
    return methods + cases * (methods + effort.repeats)


def measure(
    case: Case,
    methods: Mapping[str, Method],
    missing: Mapping[str, str],
    effort: Effort,
    clock: Clock,
    progress: Progress,
) -> CaseResult:
    """Measure one case. The repeats of all methods are interleaved, so that noise hits all."""
    problem = case.problem(effort.cycles)
    singles, drift = _truth(problem, _REFERENCE)
    gap = _error(problem, methods[OURS], FINEST, singles, drift)
    reference_gap = _distance(*_truth(problem, _COARSER), singles, drift)
    measured = {}
    for name in METHODS:
        if name in missing:
            measured[name] = Measured(name, [], missing[name])
        elif name in methods:
            method = methods[name]
            points = [
                Point(setting, _error(problem, method, setting, singles, drift))
                for setting in method.settings
            ]
            measured[name] = Measured(name, points)
            progress(1)
    progress(len(missing))
    _time(problem, methods, measured, effort, clock, progress)
    return CaseResult(case, gap, reference_gap, measured)


def _truth(problem: Problem, accuracy: tuple[float, float]) -> tuple[list[float], float]:
    """Return the displacements (m) over each single cycle and over all of them in one run."""

    def displacement(cycle: int, count: int) -> float:
        start, drive = problem.starts[cycle], problem.drive_cycle
        system = WholeSystem.moving(problem.parameters, start.v, start.z, accuracy)
        segments = list(zip(drive.durations.tolist(), drive.rates.tolist(), strict=True))
        for duration, rate in count * segments:
            system.segment(duration, rate / problem.parameters.actuator.gain)
        return system.x

    singles = [displacement(k, 1) for k in range(problem.cycles)]
    return singles, displacement(0, problem.cycles)


def _distance(
    singles: Sequence[float], drift: float, true_singles: Sequence[float], true_drift: float
) -> float:
    """Return the error per cycle, m: the worst single one, or the drift of the run if larger."""
    errors = [abs(one - true) for one, true in zip(singles, true_singles, strict=True)]
    worst = max(*errors, abs(drift - true_drift) / len(errors))
    return worst if worst <= _LOST else math.inf  # nan too


def _error(
    problem: Problem, method: Method, setting: float, singles: Sequence[float], drift: float
) -> float:
    every = range(problem.cycles)
    found = [method.prepare(problem, setting, k, 1)() for k in every]
    run = method.prepare(problem, setting, 0, problem.cycles)()
    return _distance(found, run, singles, drift)


def _time(
    problem: Problem,
    methods: Mapping[str, Method],
    measured: Mapping[str, Measured],
    effort: Effort,
    clock: Clock,
    progress: Progress,
) -> None:
    """Fill in the times of all points that have an error."""
    timed = [
        (methods[name], point)
        for name, one in measured.items()
        for point in one.points
        if math.isfinite(point.error)
    ]

    def once(method: Method, point: Point, cycles: int) -> float:
        run = method.prepare(problem, point.setting, 0, cycles)
        started = clock()
        run()
        return clock() - started

    for method, point in timed:
        quotable = point.error <= LIMIT
        wanted = effort.quoted if quotable else effort.plotted
        cycles = problem.cycles
        took = once(method, point, cycles)
        if took < wanted / 10.0:  # too short to measure: look again
            cycles *= 20
            took = once(method, point, cycles)
        point.cycles = max(1, math.ceil(1.2 * wanted * cycles / max(took, 1e-9)))
    for _ in range(effort.repeats):
        for method, point in timed:
            point.times.append(once(method, point, point.cycles) / point.cycles)
        progress(1)
