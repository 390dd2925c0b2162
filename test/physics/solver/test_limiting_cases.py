# SPDX-License-Identifier: Apache-2.0
"""Constants that tend to a limit: the run at that limit, to the last digits."""

import math
from typing import Any

import pytest
from table_1 import table_1

from stickslip_ros.physics.model import Plant, drive_of
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.physics.solver import Simulation

SMALL = [10.0**-k for k in (6, 8, 12, 15, 20, 30, 50, 100, 200, 300)]
#: A ten-thousandth of a nanometre
CLOSE = 1e-13


def end(values: dict[str, Any], cycles: int = 20) -> float:
    """Return x (m) after cycles from rest."""
    p = Parameters.of(values)
    simulation = Simulation(Plant.of(p), p.solver.tolerance)
    simulation.start(drive_of(p), cycles)
    return float(simulation.run_cycles(cycles).position[-1])


@pytest.mark.parametrize(
    "values", [{}, {"model": "lugre"}, {"spring": 1e5, "force": 0.05}], ids=str
)
def test_viscous_friction_that_tends_to_none(values: dict[str, Any]) -> None:
    dry = end({**values, "frequency": 1e3})
    for sigma_2 in filter(lambda one: one >= 1e-30, SMALL):  # the least that the table takes
        wet = end({**values, "frequency": 1e3, "sigma_2": sigma_2})
        assert wet == pytest.approx(dry, abs=CLOSE), sigma_2


@pytest.mark.parametrize("model", ["lugre", "epm_fix", "epm_calc"])
def test_static_friction_that_tends_to_kinetic(model: str) -> None:
    values = {"model": model, "preload": 1.0, "frequency": 1e3, "mu_s": 0.2, "mu_k": 0.2}
    level = end(values)
    for excess in (1e-7, 1e-9, 1e-12, 3e-16):
        found = end({**values, "mu_s": 0.2 * (1.0 + excess)})
        assert found == pytest.approx(level, abs=CLOSE + 1e-6 * excess), excess


@pytest.mark.parametrize("model", ["lugre", "epm_fix"])
def test_a_stribeck_curve_that_tends_to_nothing(model: str) -> None:
    """Down to the least v_stribeck: a curve that is there at rest alone loses its part."""
    values = {"model": model, "preload": 0.4, "frequency": 1e3}
    level = end({**values, "mu_s": 0.2})
    apart = [abs(end({**values, "v_stribeck": v_s}) - level) for v_s in (1e-4, 1e-5, 1e-6)]
    assert apart[2] < 0.2 * apart[1] < 0.04 * apart[0]


def test_a_spring_that_tends_to_none() -> None:
    free = end({"frequency": 1e3})
    for spring in [1e-2, 1e-3, *SMALL]:
        assert end({"frequency": 1e3, "spring": spring}) == pytest.approx(free, abs=CLOSE), spring


def test_damping_that_tends_to_critical() -> None:
    """Tables end there: 20 cycles agree within a fortieth of their tolerance."""
    critical = 2.0 * math.sqrt(9e6 * 4e-3)
    at = end({"sigma_1": critical})
    for apart in (1e-6, 1e-9, 1e-12, 1e-14, 1e-15):
        for sign in (-1.0, 1.0):
            found = end({"sigma_1": critical * (1.0 + sign * apart)})
            assert found == pytest.approx(at, abs=5e-12 + 5e-6 * apart), (apart, sign)


def test_a_mass_that_tends_to_none() -> None:
    """A runner without inertia: what is left of the mass tells in proportion to it."""
    ends = [end({"mass": mass, "frequency": 1e3}) for mass in (1e-4, 1e-5, 1e-6)]
    assert abs(ends[2] - ends[1]) < 0.3 * abs(ends[1] - ends[0])


@pytest.mark.parametrize("cycles", [20_000, pytest.param(100_000, marks=pytest.mark.long)])
@pytest.mark.parametrize(("preload", "mass", "most"), [(0.4, 4e-3, 1e-14), (1.0, 3e-3, 1e-15)])
def test_no_bias_adds_up(preload: float, mass: float, most: float, cycles: int) -> None:
    """18.5 kHz: below 1e-5 nm a cycle, so 100 000 cycles are off by less than 1 nm."""
    p = table_1(frequency=18.5e3, preload=preload, mass=mass, tolerance=1e-11)
    ends = []
    for tolerance in (p.solver.tolerance, 1e-14):
        simulation = Simulation(Plant.of(p), tolerance, replay=False)
        simulation.start(drive_of(p), cycles)
        ends.append(simulation.run_cycles(cycles).position[-1])
    assert abs(ends[0] - ends[1]) / cycles < most


def test_a_slide_settles_however_long_it_lasts() -> None:
    """After a second, a correction smaller than rounding was waited for, and the solver failed."""
    friction = {"mu": 0.1405525, "sigma_0": 7027641.698338617, "sigma_2": 1e6}
    contact = {
        "sigma_0ss": 7027641.698338617,
        "sigma_1": 5.0,
        "preload": 0.00552834,
        "z_ba": 1.0110566793354467e-08,
        "z_ss": 1e-3,
    }
    p = Parameters.of({**friction, **contact, "mass": 1000.0, "force": -47.434934970337984})
    simulation = Simulation(Plant.of(p), p.solver.tolerance)
    for k in range(1, 201):
        simulation.advance(0.01 * k)
    assert simulation.state.v == pytest.approx(-2.242609e-5, rel=1e-6)
