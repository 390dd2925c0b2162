# SPDX-License-Identifier: Apache-2.0
"""The tables of swings, against a general integrator."""

import numpy as np
import pytest
from numpy.polynomial.chebyshev import chebval
from reference import z_rate_and_force
from scipy.integrate import solve_ivp
from table_1 import table_1

from stickslip_ros.model import Plant, drive_of
from stickslip_ros.solver import Simulation
from stickslip_ros.solver.layout import PLANT, open_record

TOLERANCE = 1e-12  # m


def _turn(plant: Plant, z: float) -> tuple[float, float, float]:
    """Return z (m) at the next turn after one at z, the time (s) and the path (m) until then."""

    def rate(_: float, y: np.ndarray) -> list[float]:
        z_rate, force = z_rate_and_force(y[0], y[1], plant.contact)
        return [z_rate, (plant.force - force) / plant.mass, y[1]]

    def turns(t: float, y: np.ndarray) -> float:
        return float(y[1]) if t > 1e-7 else plant.force - plant.contact.sigma_0 * z

    turns.terminal = True  # type: ignore[attr-defined]
    found = solve_ivp(
        rate, (0.0, 1.0), [z, 0.0, 0.0], "DOP853", events=turns, rtol=1e-11, atol=1e-18
    )
    return float(found.y[0, -1]), float(found.t[-1]), float(found.y[2, -1])


@pytest.mark.parametrize("force", [0.0, 0.01])
@pytest.mark.parametrize("side", [0, 1])
def test_swings_of_a_plastic_contact_are_those_of_an_integrator(side: int, force: float) -> None:
    """From one turn to the next: where it turns, when, and the way there, over the whole table."""
    p = table_1(model="lugre", force=force)
    plant = Plant.of(p)
    simulation = Simulation(plant, TOLERANCE)
    simulation.start(drive_of(p, 1), 1)
    simulation.run_cycles(1)  # which fills the tables
    tables = open_record(simulation._plant, PLANT)
    rest, top = force / plant.contact.sigma_0, float(tables["swing_top"][side])
    assert top > 1e-9
    sign = 1.0 if side == 0 else -1.0
    for share in (0.03, 0.31, 0.62, 0.97):
        # parts of the distance from rest that are left and gone, and the time in between
        left, time, gone = chebval(2.0 * share - 1.0, tables["swing"][side].T)
        z, t, path = _turn(plant, rest + sign * share * top)
        assert left * share * top == pytest.approx(abs(z - rest), abs=10 * TOLERANCE)
        assert time == pytest.approx(t, rel=1e-4)
        assert abs(gone) * share * top == pytest.approx(abs(path), abs=10 * TOLERANCE)
