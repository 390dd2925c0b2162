# SPDX-License-Identifier: Apache-2.0
"""A campaign for accuracy: many sets of parameters, each run at two tolerances and by a judge.

What the solver promises is an error in position per cycle. So each set is run at the default
tolerance and at a thousandth of it, and some of them by `judge`, which shares no code with the
solver. A motion that is unstable by itself makes more of any error in each cycle; what such a run
may be off by, `unstable.py` finds out. Besides, a run may fail only by exceeding its budget, no |z|
may pass its limit, and no cycle may give back more energy than rounding explains.
"""

from __future__ import annotations

import contextlib
import itertools
import multiprocessing
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model import DriveCycle, Plant, drive_of
from stickslip_ros.parameters import PARAMETERS, Parameters
from stickslip_ros.solver import CycleResults, Simulation, SolverError
from validation.benchmark import judge
from validation.benchmark.random_sets import random_sets
from validation.benchmark.unstable import growth_of

#: What a cycle may be off by (m): a hundredth of a nanometre
BAR = 1e-11
CYCLES = 6
#: One set of so many is held against the judge, over so many cycles and up to so many ringings
_JUDGED, _JUDGED_CYCLES, _RINGINGS = 10, 2, 200.0
#: Arcs that a cycle may take here, a tenth of what the solver allows: a campaign has many sets
_BUDGET = 200_000
#: Share of the energy in the contact that counts as rounding, and of z as passing its limit
_ROUNDING = 1e-9
#: Share of the kinetic energy of a runner as fast as the actuator that counts as rounding: a speed
#: against the actuator and one in space differ by its rate.
_ROUNDING_OF_SPEED = 1e-15
#: Share of the distance gone that counts as rounding
_ROUNDING_OF_PLACE = 1e-15
#: Sets that a process takes at a time
_PORTION = 20


@dataclass
class Accuracy:
    """What a campaign found; errors are per cycle, in m."""

    errors: list[float] = field(default_factory=list)
    judged: list[float] = field(default_factory=list)
    over_budget: list[str] = field(default_factory=list)  #: runs that were ended, one line each
    unstable: list[str] = field(default_factory=list)  #: runs that `unstable` explains, a line each
    findings: list[str] = field(default_factory=list)  #: what must not be, one line each

    @property
    def sets(self) -> int:
        """How many sets were run."""
        return len(self.errors) + len(self.over_budget)

    def add(self, other: Accuracy) -> None:
        """Take in what another part of the campaign found."""
        self.errors += other.errors
        self.judged += other.judged
        self.over_budget += other.over_budget
        self.unstable += other.unstable
        self.findings += other.findings

    def as_json(self) -> dict[str, Any]:
        """Return all of it as plain data, SI units."""
        return {
            "sets": self.sets,
            "over_budget": self.over_budget,
            "unstable": self.unstable,
            "bar": BAR,
            "error": _statistics(self.errors),
            "judged": _statistics(self.judged),
            "findings": self.findings,
        }

    def text(self) -> str:
        """Return all of it for a reader."""
        lines = [
            f"{self.sets} sets, {len(self.over_budget)} over their budget, {len(self.unstable)} "
            "judged by single cycles because they are unstable"
        ]
        for name, values in (
            ("tolerance against a thousandth of it", self.errors),
            ("against an independent integrator", self.judged),
        ):
            found = _statistics(values)
            lines.append(
                f"{name}, nm a cycle: median {1e9 * found['median']:.2g}, "
                f"worst {1e9 * found['worst']:.2g} of {found['count']}"
            )
        ends = [*self.over_budget, *self.unstable, *self.findings, f"{len(self.findings)} findings"]
        return "\n".join([*lines, *ends])


def _statistics(errors: list[float]) -> dict[str, Any]:
    if not errors:
        return {"count": 0, "median": 0.0, "worst": 0.0}
    return {"count": len(errors), "median": float(np.median(errors)), "worst": max(errors)}


def campaign(
    count: int,
    seed: int = 0,
    corners: bool = False,
    jobs: int = 1,
    judged: bool = True,
    done: Callable[[int], object] = int,
) -> Accuracy:
    """Run count sets in so many processes; done is called with the number of sets just done.

    The result does not depend on jobs. Without judged, no set is held against the judge, which
    takes most of the time.
    """
    starts = range(0, count, _PORTION)
    portions = [(k, min(_PORTION, count - k), seed, corners, judged) for k in starts]
    # The first is run here, so that one process alone compiles the kernel where that is to be done.
    found = _run_portion(portions[0])
    done(portions[0][1])
    with _mapping(jobs if len(portions) > 1 else 1) as run_all:
        for portion, work in zip(run_all(_run_portion, portions[1:]), portions[1:], strict=True):
            found.add(portion)
            done(work[1])
    return found


@contextlib.contextmanager
def _mapping(jobs: int) -> Iterator[Callable[..., Iterator[Accuracy]]]:
    """Yield what maps a function over work: in this process, or in several."""
    if jobs == 1:
        yield map
        return
    # A copy of a process with threads may hang; so each process begins afresh.
    pool = ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn"))
    try:
        yield pool.map
    finally:
        pool.shutdown(cancel_futures=True)


def _run_portion(work: tuple[int, int, int, bool, bool]) -> Accuracy:
    first, count, seed, corners, judged = work
    found = Accuracy()
    sets = itertools.islice(random_sets(seed, corners, first), count)
    for number, p in enumerate(sets, first):
        try:
            _run_set(found, p, judged and number % _JUDGED == 0)
        except SolverError as error:
            line = f"{_changed(p)}: {error}"
            if str(error).startswith("a cycle takes more than"):
                found.over_budget.append(f"over budget: {line}")
            else:
                found.findings.append(f"failed: {line}")
    return found


def _run_set(found: Accuracy, p: Parameters, judged: bool) -> None:
    tolerance = p.solver.tolerance
    ours = _cycles(p, tolerance)
    finer = _cycles(p, 1e-3 * tolerance)
    error = float((np.abs(ours.position - finer.position) / np.arange(1.0, CYCLES + 1.0)).max())
    bar = BAR + _ROUNDING_OF_PLACE * float(np.abs(finer.position).max())
    if not error <= bar:
        growth = growth_of(p, CYCLES, bar, _BUDGET)
        if error <= growth.explained:
            found.unstable.append(
                f"unstable: off by {1e9 * error:.3g} nm a cycle, by {1e9 * growth.committed:.3g} "
                f"from equal starts: {_changed(p)}"
            )
            error = growth.committed
    found.errors.append(error)
    if not error <= bar:
        found.findings.append(f"off by {1e9 * error:.3g} nm a cycle: {_changed(p)}")
    plant = Plant.of(p)
    drive = drive_of(p)
    for name in _unphysical(plant, drive, ours):
        found.findings.append(f"{name}: {_changed(p)}")
    slow = plant.ringing_frequency > _RINGINGS * p.drive.frequency
    if slow or not judged or plant.contact.printed:
        return
    true = judge.positions(plant, drive, _JUDGED_CYCLES)
    if not np.isfinite(true).all():
        return
    error = float(np.abs(ours.position[:_JUDGED_CYCLES] - true).max()) / _JUDGED_CYCLES
    found.judged.append(error)
    if not error <= BAR:
        found.findings.append(f"judged off by {1e9 * error:.3g} nm a cycle: {_changed(p)}")


def _cycles(p: Parameters, tolerance: float) -> CycleResults:
    simulation = Simulation(Plant.of(p), tolerance, budget=_BUDGET)
    simulation.start(drive_of(p), CYCLES)
    return simulation.run_cycles(CYCLES)


def _unphysical(plant: Plant, drive: DriveCycle, cycles: CycleResults) -> list[str]:
    """Return what cannot be in the results of a run."""
    c = plant.contact
    size: NDArray[np.float64] = np.maximum(np.abs(cycles.z_max), np.abs(cycles.z_min))
    found = []
    if not all(np.isfinite(one).all() for one in (cycles.position, size, cycles.lost)):
        found.append("not a number")
    held = abs(plant.force) / c.sigma_0  # below breakaway the load may swing the contact
    most = max(c.z_k, c.z_s, c.z_ba if c.kind < 2 else 0.0, c.z_ss if c.kind == 0 else 0.0)
    if (size > max(most, 2.0 * held) * (1.0 + _ROUNDING) + 1e-12).any():
        found.append(f"|z| of {size.max():.3g} m, its limit is {most:.3g} m")
    energy = c.sigma_0 * size**2 + abs(plant.force) * (np.abs(cycles.position).max() + size)
    moved = plant.mass * float(np.max(np.abs(drive.rates))) ** 2
    rounding = _ROUNDING * energy + _ROUNDING_OF_SPEED * moved
    if c.z_k == c.z_s and (cycles.lost < -rounding).any():
        found.append(f"heat of {cycles.lost.min():.3g} J")
    return found


def _changed(p: Parameters) -> str:
    """Return what is not at its default, as the command line takes it."""
    flat = p.flat()
    changed = {k: v for k, v in flat.items() if v != PARAMETERS[k].default}
    return " ".join(f"--set {name}={value}" for name, value in changed.items())
