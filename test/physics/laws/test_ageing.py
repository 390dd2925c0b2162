# SPDX-License-Identifier: Apache-2.0
"""The contact that ages within a cycle, against a general integrator of the whole system."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from table_1 import table_1

from stickslip_ros.physics.model import Plant, drive_of
from stickslip_ros.physics.model.drive_cycle import ramp
from stickslip_ros.physics.model.waveforms import command_of
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.physics.solver import Simulation
from stickslip_ros.physics.solver.driven import simulation_of
from validation import whole_system


def simulated(p: Parameters, cycles: int) -> NDArray[np.float64]:
    """Positions (m) at the ends of cycles from rest."""
    simulation = Simulation(Plant.of(p), p.solver.tolerance)
    simulation.start(drive_of(p), cycles)
    return simulation.run_cycles(cycles).position


def test_it_agrees_with_an_integrator() -> None:
    """To 0.01 nm a cycle."""
    for beta, d_c, theta_0, values in [
        (0.05, 1e-7, 1e-5, {"preload": 0.4, "mass": 4e-3, "frequency": 5e3}),
        (0.2, 2e-8, 1e-6, {"preload": 1.0, "mass": 3e-3, "frequency": 1e4}),
        (0.02, 1e-6, 1e-4, {"preload": 0.8, "mass": 8e-3, "frequency": 2e3, "force": 0.01}),
        (0.1, 3e-7, 1e-5, {"preload": 0.4, "mass": 4e-3, "frequency": 1.85e4, "spring": 1e5}),
    ]:
        cycles = 3
        p = table_1(model="ceim_ageing", beta=beta, d_c=d_c, theta_0=theta_0, **values)
        off = np.abs(simulated(p, cycles) - whole_system.positions(p, cycles))
        assert (off <= 1e-11 * np.arange(1, cycles + 1)).all()
        assert np.abs(simulated(p.replace(beta=0.0), cycles) - simulated(p, cycles)).max() > 5e-11


@pytest.mark.parametrize("values", [{"frequency": 100.0}, {"frequency": 1e4, "preload": 1.0}])
def test_without_ageing_it_is_the_ceim(values: dict[str, float]) -> None:
    ceim = simulated(table_1(**values), 5)
    ageing = simulated(table_1(**values, model="ceim_ageing", beta=0.0), 5)
    np.testing.assert_allclose(ageing, ceim, rtol=0.0, atol=1e-11)


def test_it_ages_while_it_rests() -> None:
    """What it holds after a rest grows with the rest, and so changes the first step after it."""
    p = table_1(model="ceim_ageing", beta=0.1, theta_0=1e-3, frequency=1e3)
    steps = []
    for rest in (1e-2, 1e-1, 1.0):
        simulation = Simulation(Plant.of(p), p.solver.tolerance)
        simulation.start(drive_of(p), 8)
        simulation.run_cycles(8)
        before = simulation.x
        simulation.advance(simulation.t + rest)
        simulation.start(drive_of(p), 1)
        steps.append(simulation.run_cycles(1).position[0] - before)
    changes = np.diff(steps)
    assert changes[0] * changes[1] > 0.0
    assert np.abs(changes).min() > 2e-11


def test_a_long_rest_costs_little() -> None:
    """The ringing dies away, and the contact goes on ageing."""
    p = table_1(model="ceim_ageing", beta=0.1, frequency=1e3)
    simulation = Simulation(Plant.of(p), p.solver.tolerance, budget=3000)
    simulation.start(drive_of(p), 2)
    simulation.run_cycles(2)
    simulation.advance(1e3)
    assert simulation.state.v == 0.0


def test_several_contacts_age_as_one_does() -> None:
    """With equal shares they are the one contact, with loads and a spring, too."""
    values: dict[str, Any] = {"frequency": 5e3, "spring": 1e4, "force": 0.01, "beta": 0.05}
    one = simulated(table_1(**values, model="ceim_ageing"), 3)
    three = simulated(table_1(**values, model="ceim_ageing", contacts=3), 3)
    np.testing.assert_allclose(three, one, rtol=0.0, atol=1e-12)


def test_a_first_step_beyond_all_numbers_is_tried_shorter() -> None:
    """Damping renews the contact 1e5 times within the first step that is tried."""
    values = {"mass": 2e-5, "sigma_0": 356.2, "sigma_1": 49156.0, "sigma_2": 147.5, "d_c": 2.4e-10}
    p = Parameters.of({"model": "ceim_ageing", "preload": 0.229, "beta": 0.4, **values})
    simulation = Simulation(Plant.of(p), p.solver.tolerance)
    simulation.start(ramp(1e-12, 1e-5), 1)
    simulation.advance(1e-5)
    assert simulation.x == pytest.approx(1e-12, rel=1e-3)


def test_steps_stay_where_the_estimate_of_their_error_has_no_root() -> None:
    """At 5.6 of the fastest time of an overdamped contact, steps of 0.25 of the motion passed."""
    values = {
        "preload": 0.068472, "preload_ratio": 0.30528, "mu": 0.0863234, "sigma_0": 3082972.3,
        "sigma_0_cap": 0.01982, "sigma_1": 77.254342, "theta_0": 1.5694937507e-07,
        "mass": 1.0808052738e-4, "hysteresis": 0.17623341, "slewrate": 203.343089,
        "amplitude": 244.870779, "frequency": 230.573153,
    }  # fmt: skip
    options = {"model": "ceim_ageing", "actuator": "hysteresis", "actuator_memory": True}
    p = Parameters.of({**options, **values})

    def positions(tolerance: float) -> NDArray[np.float64]:
        q = p.replace(tolerance=tolerance)
        simulation = simulation_of(q, Plant.of(q))
        simulation.start(command_of(p), 2)
        return simulation.run_cycles(2).position

    np.testing.assert_allclose(positions(1e-11), positions(1e-14), rtol=0.0, atol=1e-13)
