# SPDX-License-Identifier: Apache-2.0
"""A campaign for accuracy: many sets of parameters, each run at two tolerances and by a judge.

What the solver promises is an error in position per cycle. So each set is run at the default
tolerance and at a thousandth of it, and some of them by `judge`, which shares no code with the
solver. Besides, a run may fail only by exceeding its budget, no |z| may pass its limit, and
no cycle may give back more energy than rounding explains.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.benchmark import judge
from stickslip_ros.benchmark.random_sets import random_sets
from stickslip_ros.model import Plant, drive_of, plant_of
from stickslip_ros.parameters import PARAMETERS, Parameters
from stickslip_ros.solver import Cycles, Simulation, SolverError

#: What a cycle may be off by (m): a hundredth of a nanometre
BAR = 1e-11
CYCLES = 6
#: One set of so many is held against the judge, over so many cycles and up to so many ringings
_JUDGED, _JUDGED_CYCLES, _RINGINGS = 10, 2, 200.0
#: Arcs that a cycle may take here, a tenth of what the solver allows: a campaign has many sets
_BUDGET = 200_000
#: Share of the energy in the contact that counts as rounding, and of z as passing its limit
_ROUNDING = 1e-9


@dataclass
class Accuracy:
    """What a campaign found; errors are per cycle, in m."""

    errors: list[float] = field(default_factory=list)
    judged: list[float] = field(default_factory=list)
    over_budget: int = 0
    findings: list[str] = field(default_factory=list)  #: what must not be, one line each

    def as_json(self) -> dict[str, Any]:
        """Return all of it as plain data, SI units."""
        return {
            "sets": len(self.errors) + self.over_budget,
            "over_budget": self.over_budget,
            "bar": BAR,
            "error": _told(self.errors),
            "judged": _told(self.judged),
            "findings": self.findings,
        }

    def text(self) -> str:
        """Return all of it for a reader."""
        lines = [
            f"{len(self.errors) + self.over_budget} sets, {self.over_budget} over their budget"
        ]
        for name, values in (
            ("tolerance against a thousandth of it", self.errors),
            ("against an independent integrator", self.judged),
        ):
            told = _told(values)
            lines.append(
                f"{name}, nm a cycle: median {1e9 * told['median']:.2g}, "
                f"worst {1e9 * told['worst']:.2g} of {told['count']}"
            )
        return "\n".join([*lines, *self.findings, f"{len(self.findings)} findings"])


def _told(errors: list[float]) -> dict[str, Any]:
    if not errors:
        return {"count": 0, "median": 0.0, "worst": 0.0}
    return {"count": len(errors), "median": float(np.median(errors)), "worst": max(errors)}


def campaign(
    count: int, seed: int = 0, corners: bool = False, done: Callable[[int], object] = int
) -> Accuracy:
    """Run count sets; done is called with 1 after each."""
    found = Accuracy()
    for number, p in enumerate(itertools.islice(random_sets(seed, corners), count)):
        try:
            _run_set(found, p, number)
        except SolverError:
            found.over_budget += 1
        done(1)
    return found


def _run_set(found: Accuracy, p: Parameters, number: int) -> None:
    tolerance = p.solver.tolerance
    ours = _cycles(p, tolerance)
    finer = _cycles(p, 1e-3 * tolerance)
    error = float(np.abs(ours.position - finer.position).max()) / CYCLES
    found.errors.append(error)
    if not error <= BAR:
        found.findings.append(f"off by {1e9 * error:.3g} nm a cycle: {_changed(p)}")
    plant = plant_of(p)
    for name in _unphysical(plant, ours):
        found.findings.append(f"{name}: {_changed(p)}")
    slow = plant.ringing_frequency > _RINGINGS * p.drive.frequency
    if number % _JUDGED or slow or plant.contact.printed:
        return
    true = judge.positions(plant, drive_of(p), _JUDGED_CYCLES)
    if not np.isfinite(true).all():
        return
    error = float(np.abs(ours.position[:_JUDGED_CYCLES] - true).max()) / _JUDGED_CYCLES
    found.judged.append(error)
    if not error <= BAR:
        found.findings.append(f"judged off by {1e9 * error:.3g} nm a cycle: {_changed(p)}")


def _cycles(p: Parameters, tolerance: float) -> Cycles:
    simulation = Simulation(plant_of(p), tolerance, budget=_BUDGET)
    simulation.start(drive_of(p), CYCLES)
    return simulation.run_cycles(CYCLES)


def _unphysical(plant: Plant, cycles: Cycles) -> list[str]:
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
    if c.z_k == c.z_s and (cycles.lost < -_ROUNDING * energy).any():
        found.append(f"heat of {cycles.lost.min():.3g} J")
    return found


def _changed(p: Parameters) -> str:
    """Return what is not at its default, as the command line takes it."""
    flat = p.flat()
    changed = {k: v for k, v in flat.items() if v != PARAMETERS[k].default}
    return " ".join(f"--set {name}={value}" for name, value in changed.items())
