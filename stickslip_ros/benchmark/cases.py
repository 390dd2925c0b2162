# SPDX-License-Identifier: Apache-2.0
"""Operating points of the benchmark, and where a measured cycle starts."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass

from stickslip_ros.benchmark.equations import Scaled, scaled_of
from stickslip_ros.model import Pattern, Plant, drive_of, plant_of
from stickslip_ros.parameters import Parameters
from stickslip_ros.solver import Simulation, State

#: Tolerance (m) of the run that gives the states from which every method starts.
FINEST = 1e-15
#: Ringing has died down after this time, s, and cycles count as settled.
_SETTLING_TIME, _FEWEST = 8e-3, 10
#: More cycles than any measurement runs.
_ENDLESS = 2**62


@dataclass(frozen=True)
class Case:
    """One operating point: 300 V, 100 V/us, CEIM."""

    preload: float  #: N
    mass: float  #: kg
    frequency: float  #: Hz

    @property
    def name(self) -> str:
        """As typed on the command line, such as 0.4N-100Hz."""
        return f"{self.preload:g}N-{self.frequency:.6g}Hz"

    @property
    def title(self) -> str:
        """For people."""
        hertz = self.frequency
        drive = f"{hertz / 1e3:g} kHz" if hertz >= 1e3 else f"{hertz:g} Hz"
        return f"{self.preload:g} N, {1e3 * self.mass:g} g, {drive}"


CASES = tuple(
    Case(preload, mass, frequency)
    for preload, mass in ((0.4, 4e-3), (1.0, 3e-3))
    for frequency in (100.0, 1e3, 10e3, 18.5e3, 100e3)
)


@dataclass(frozen=True)
class Problem:
    """A case made ready: the settled cycles that every method is asked to repeat."""

    case: Case
    plant: Plant
    pattern: Pattern
    scaled: Scaled
    starts: tuple[State, ...]  #: the state in which each measured cycle starts
    _simulations: tuple[Simulation, ...]

    @property
    def cycles(self) -> int:
        """Number of measured cycles."""
        return len(self.starts)

    def simulation(self, cycle: int) -> Simulation:
        """Return a simulation of our own, at the start of a measured cycle."""
        return copy.deepcopy(self._simulations[cycle])


def problem_of(case: Case, cycles: int) -> Problem:
    """Warm the case up from rest and keep the states in which its next cycles start."""
    p = Parameters.of({"preload": case.preload, "mass": case.mass, "frequency": case.frequency})
    plant, pattern = plant_of(p), drive_of(p)
    simulation = Simulation(plant, FINEST, replay=False)  # every cycle counts
    simulation.start(pattern, _ENDLESS)
    simulation.run_cycles(max(_FEWEST, math.ceil(_SETTLING_TIME * case.frequency)))
    kept = []
    for _ in range(cycles):
        kept.append(copy.deepcopy(simulation))
        simulation.run_cycles(1)
    return Problem(
        case,
        plant,
        pattern,
        scaled_of(plant, pattern),
        tuple(simulation.state for simulation in kept),
        tuple(kept),
    )
