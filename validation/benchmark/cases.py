# SPDX-License-Identifier: Apache-2.0
"""Operating points of the benchmark, and the equations as every general solver gets them.

The state is (w, z, r): differential velocity, asperity deflection and plastic slide. With
x = u + z + r nothing depends on time, u' enters as a jump of w at each kink, and r stands still
while the contact is elastic. Lengths count in z_ba and times in the period of the ringing over
2 pi, so that one tolerance suits all three. On the ten cases CyRK DOP853 took 0.8 to 1.4 times as
long with x, v, z in SI units and a tolerance for each, a tenth longer on average.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from stickslip_ros.physics.laws.law import ELASTOPLASTIC
from stickslip_ros.physics.model import DriveCycle, Plant, drive_of
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.physics.solver import Simulation, State

#: damping, viscous, pull, z_ss, z_lim: what `rates` takes beside the state
Constants = tuple[float, float, float, float, float]


@numba.njit(error_model="numpy")  # type: ignore[untyped-decorator, unused-ignore]
def rates(
    w: float, z: float, damping: float, viscous: float, pull: float, z_ss: float, z_lim: float
) -> tuple[float, float, float]:
    """Return (w', z', r') of the CEIM in scaled units (Eq. 1, 5, 16); z_ba is 1."""
    slide = 0.0
    if z * w > 0.0 and abs(z) > 1.0:
        alpha = 1.0
        if abs(z) < z_ss:
            alpha = 0.5 - 0.5 * math.cos(math.pi * (abs(z) - 1.0) / (z_ss - 1.0))
        slide = alpha * abs(w) / z_lim * z
    bend = w - slide
    return pull - z - damping * bend - viscous * w, bend, slide


@dataclass(frozen=True)
class Scaled:
    """A plant with its drive in scaled units."""

    length: float  #: m
    time: float  #: s
    constants: Constants
    durations: NDArray[np.float64]  #: of the segments of a cycle
    jumps: NDArray[np.float64]  #: of w at the start of each segment
    last_rate: float  #: u' before the first of these jumps, m/s

    def start(self, state: State) -> NDArray[np.float64]:
        """Return (w, z, r) at the end of the cycle before, r counted from here."""
        w = (state.v - self.last_rate) * self.time / self.length
        return np.array([w, state.z / self.length, 0.0])

    def displacement(self, start: NDArray[np.float64], end: NDArray[np.float64]) -> float:
        """Return how far (m) the runner has come over whole cycles."""
        return float((end[1] - start[1]) + (end[2] - start[2])) * self.length

    @classmethod
    def of(cls, plant: Plant, drive_cycle: DriveCycle) -> Scaled:
        """Scale a plant on which no spring acts, with a contact of the CEIM."""
        contact = plant.contact
        if contact.kind != ELASTOPLASTIC or contact.z_k != contact.z_s or plant.spring != 0.0:
            raise ValueError(
                "the benchmark needs an elastoplastic contact with one limit, no spring"
            )
        length, time = contact.z_ba, math.sqrt(plant.mass / contact.sigma_0)
        speed = length / time
        rates_of_u = drive_cycle.rates / speed
        return cls(
            length=length,
            time=time,
            constants=(
                contact.sigma_1 * time / plant.mass,
                contact.sigma_2 * time / plant.mass,
                plant.force / (contact.sigma_0 * length),
                contact.z_ss / length,
                contact.z_k / length,
            ),
            durations=np.ascontiguousarray(drive_cycle.durations / time),
            jumps=np.roll(rates_of_u, 1) - rates_of_u,
            last_rate=float(drive_cycle.rates[-1]),
        )


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

    def problem(self, cycles: int) -> Problem:
        """Warm the case up from rest and keep the states in which its next cycles start."""
        p = Parameters.of({"preload": self.preload, "mass": self.mass, "frequency": self.frequency})
        plant, drive_cycle = Plant.of(p), drive_of(p)
        simulation = Simulation(plant, FINEST, replay=False)  # every cycle counts
        simulation.start(drive_cycle, _ENDLESS)
        simulation.run_cycles(max(_FEWEST, math.ceil(_SETTLING_TIME * self.frequency)))
        kept = []
        for _ in range(cycles):
            kept.append(copy.deepcopy(simulation))
            simulation.run_cycles(1)
        return Problem(
            p,
            plant,
            drive_cycle,
            Scaled.of(plant, drive_cycle),
            tuple(simulation.state for simulation in kept),
            tuple(kept),
        )


CASES = tuple(
    Case(preload, mass, frequency)
    for preload, mass in ((0.4, 4e-3), (1.0, 3e-3))
    for frequency in (100.0, 1e3, 10e3, 18.5e3, 100e3)
)


@dataclass(frozen=True)
class Problem:
    """A case made ready: the settled cycles that every method is asked to repeat."""

    parameters: Parameters
    plant: Plant
    drive_cycle: DriveCycle
    scaled: Scaled
    starts: tuple[State, ...]  #: the state in which each measured cycle starts
    _simulations: tuple[Simulation, ...]

    @property
    def cycles(self) -> int:
        """Number of measured cycles."""
        return len(self.starts)

    def simulation(self, cycle: int) -> Simulation:
        """Return a simulation of this package at the start of a measured cycle."""
        return copy.deepcopy(self._simulations[cycle])
