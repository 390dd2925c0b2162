# SPDX-License-Identifier: Apache-2.0
"""The contact that ages within a cycle, against a general integrator of the whole system."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from table_1 import table_1

from stickslip_ros.model import Plant, drive_of
from stickslip_ros.model.drive_cycle import ramp
from stickslip_ros.model.waveforms import command_of
from stickslip_ros.parameters import Parameters
from stickslip_ros.solver import Simulation
from stickslip_ros.solver.driven import simulation_of

_NM, _SPEED, _MS = 1e-9, 1e-4, 1e-3


def simulated(p: Parameters, cycles: int) -> NDArray[np.float64]:
    """Positions (m) at the ends of cycles from rest."""
    simulation = Simulation(Plant.of(p), p.solver.tolerance)
    simulation.start(drive_of(p), cycles)
    return simulation.run_cycles(cycles).position


def integrated(cycles: int, beta: float, d_c: float, theta_0: float, **v: float) -> Any:
    """The same of x, v, z, theta by DOP853, from the equations; loads are a force and a spring."""
    f, m = v["preload"], v["mass"]
    z_ba = 2e-8 * f + 1e-8
    sigma_0 = 5e6 * min(f, math.inf) + 7e6
    z_lim = f * 0.2 / 1e7
    stroke = 160e-9 * v.get("amplitude", 300.0) / 300.0
    fall = v.get("amplitude", 300.0) / 1e8
    period = 1.0 / v["frequency"]

    def rates(_: float, y: NDArray[np.float64], rate: float) -> list[float]:
        x, speed, z, theta = y[0] * _NM, y[1] * _SPEED, y[2] * _NM, y[3] * _MS
        w = speed - rate
        age = 1.0 + beta * math.log(1.0 + theta / theta_0)
        alpha = 0.0
        if z * w > 0.0 and abs(z) > age * z_ba:
            turn = math.pi * (abs(z) - 1.5 * age * z_ba) / (age * z_ba)
            alpha = 1.0 if abs(z) >= 2.0 * age * z_ba else 0.5 * math.sin(turn) + 0.5
        z_rate = w - alpha * abs(w) / (age * z_lim) * z
        push = v.get("force", 0.0) - v.get("spring", 0.0) * x - sigma_0 * z - 5.0 * z_rate
        return [speed / _NM, push / m / _SPEED, z_rate / _NM, (1 - abs(w) * theta / d_c) / _MS]

    def turns(_: float, y: NDArray[np.float64], rate: float) -> float:
        return float(y[1]) * _SPEED - rate

    turns.terminal = True  # type: ignore[attr-defined]
    y, found = np.zeros(4), []
    for _ in range(cycles):
        for span, way in ((period - fall, stroke), (fall, -stroke)):
            t, rate = 0.0, way / span
            while t < span:
                done = solve_ivp(
                    rates, (t, span), y, "DOP853", args=(rate,), events=turns,
                    rtol=1e-11, atol=1e-9, max_step=2e-6 if way > 0.0 else 2e-8,
                )  # fmt: skip
                y, t = done.y[:, -1], done.t[-1]
                if done.status == 1:  # on over the turn, at which the event would stop it again
                    step = min(1e-12, span - t)
                    y, t = y + step * np.array(rates(t, y, rate)), t + step
        found.append(y[0] * _NM)
    return np.array(found)


@pytest.mark.slow
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
        off = np.abs(simulated(p, cycles) - integrated(cycles, beta, d_c, theta_0, **values))
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
