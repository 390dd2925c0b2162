# SPDX-License-Identifier: Apache-2.0
"""The linear axis against the nonlinear one, by the simulators of python-control and SciPy."""

import control
import numpy as np
import pytest
from scipy.signal import lsim

import stickslip_ros as ss
from stickslip_ros.axis.sensor import LowPass
from stickslip_ros.model import Plant
from stickslip_ros.model.waveforms import ramp
from stickslip_ros.solver import Simulation
from stickslip_ros.solver.driven import simulation_of

P = ss.Parameters.of({"preload": 0.4, "mass": 0.004})


def test_it_rings_as_the_plant_does() -> None:
    poles = control.ss(*ss.linearise(P)).poles()
    assert abs(poles[0].imag) / (2 * np.pi) == pytest.approx(Plant.of(P).ringing_frequency)


def test_the_runner_follows_the_voltage_and_a_spring_gives_way() -> None:
    static = control.ss(*ss.linearise(P)).dcgain()
    assert static[0, 0] == pytest.approx(P.actuator.gain)
    assert static[1, 0] == pytest.approx(0.0, abs=1e-20)
    stiffness = Plant.of(P).contact.sigma_0
    pushed = control.ss(*ss.linearise(P, spring=1e6)).dcgain()
    assert pushed[0, 1] == pytest.approx(1.0 / (stiffness + 1e6))


def test_a_small_ramp_moves_the_nonlinear_axis_alike() -> None:
    """10 V in 0.1 ms deflect the contact by less than z_ba; then the runner rings."""
    volts, rise = 10.0, 1e-4
    simulation = Simulation(Plant.of(P), 1e-13)
    stroke = P.actuator.gain * volts
    simulation.start(ramp(stroke, rise), 1)
    times = np.linspace(0.0, 1e-3, 2001)
    found = simulation.sample(times)
    assert np.abs(found.z).max() < Plant.of(P).contact.z_ba
    driven = np.column_stack([np.clip(times / rise, 0.0, 1.0) * volts, np.zeros_like(times)])
    _, linear, _ = lsim(tuple(ss.linearise(P)), driven, times)
    # lsim is exact for inputs that are straight between the times, as these are.
    np.testing.assert_allclose(linear[:, 0], found.x, atol=1e-13)
    np.testing.assert_allclose(linear[:, 1], found.z, atol=1e-13)


def test_lag_and_resonance_are_those_of_the_nonlinear_axis() -> None:
    p = P.replace(amplifier_bandwidth=8e3, actuator_resonance=2e4, actuator_damping=0.1)
    axis = ss.linearise(p)
    assert axis.A.shape == (5, 5)
    volts, rise = 10.0, 1e-4
    simulation = simulation_of(p, Plant.of(p))
    simulation.start(ramp(p.actuator.gain * volts, rise), 1)
    times = np.linspace(0.0, 1e-3, 2001)
    found = simulation.sample(times)
    driven = np.column_stack([np.clip(times / rise, 0.0, 1.0) * volts, np.zeros_like(times)])
    _, linear, _ = lsim(tuple(axis), driven, times)
    np.testing.assert_allclose(linear[:, 0], found.x, atol=2e-12)


@pytest.mark.parametrize("order", [1, 2])
def test_the_reading_is_that_of_the_sensor(order: int) -> None:
    p = P.replace(sensor_bandwidth=3e3, sensor_order=order, sensor_damping=0.4)
    axis = ss.linearise(p)
    assert axis.outputs == ("position", "deflection", "reading")
    times = np.arange(5000) * 1e-7
    pushed = np.column_stack([np.zeros_like(times), np.full_like(times, 1e-3)])
    _, linear, _ = lsim(tuple(axis), pushed, times)
    seen = LowPass(p.sensor, 1e-7, 0.0).see(linear[:, 0], np.gradient(linear[:, 0], times))
    np.testing.assert_allclose(linear[:, 2], seen, atol=1e-14)
