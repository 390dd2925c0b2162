# SPDX-License-Identifier: Apache-2.0
"""The axis in other programs, and its linear form."""

from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
from scipy.signal import lsim

import stickslip_ros as ss
from stickslip_ros.axis.sensor import low_pass_of
from stickslip_ros.library.exchange import SampledAxis
from stickslip_ros.model import Plant, drive_of
from stickslip_ros.model.waveforms import ramp
from stickslip_ros.solver import Simulation
from stickslip_ros.solver.driven import simulation_of

PERIOD = 1e-3


def held(t: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    return 40.0 * np.sin(2.0 * np.pi * 50.0 * t) ** 2


def positions(axis: SampledAxis, volts: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    found = [0.0]
    for one in volts:
        axis.hold(float(one), PERIOD)
        found.append(axis.position)
    return np.array(found)


def test_samples_of_a_sawtooth_are_steps() -> None:
    """The rise in samples that are as steep as the sawtooth, then the slip: the same steps."""
    p = ss.Parameters.of(frequency=500.0, slewrate=0.3, amplitude=200.0)
    rise, fall = drive_of(p).durations
    axis = SampledAxis(p)
    rising = SampledAxis(p.replace(slewrate=200.0 / rise / 1e6 * 1.0000001))
    for _ in range(2):
        rising.hold(200.0, rise)
        rising.parameters = p
        rising.hold(0.0, fall * (1.0 + 1e-12))
        rising.parameters = p.replace(slewrate=200.0 / rise / 1e6 * 1.0000001)
    assert rising.position == pytest.approx(ss.simulate(p, steps=2).position[-1], abs=1e-12)
    with pytest.raises(ss.ParameterError, match=r"take 0\.000666667 s at the slewrate"):
        axis.hold(200.0, 1e-4)


@pytest.mark.parametrize("values", [{}, {"actuator_resonance": 1e4, "creep": 0.02, "contacts": 3}])
def test_python_control_runs_the_axis(values: dict[str, Any]) -> None:
    system = ss.control_system(values, period=PERIOD)
    t = np.arange(20) * PERIOD
    run = control.input_output_response(system, t, held(t), np.zeros(4))
    assert (run.outputs == positions(SampledAxis(values), held(t))[:-1]).all()
    assert (run.states[3, 1:] == held(t)[:-1]).all()


def test_a_discrete_controller_holds_an_event_driven_plant() -> None:
    """An integrator of python-control around the axis leads it to 20 nm, as a loop by hand does."""
    axis = ss.control_system(period=PERIOD)
    integrator = control.ss(1.0, 1.0, 3e8, 0.0, PERIOD, inputs="error", outputs="voltage")
    error = control.summing_junction(["target", "-position"], "error")
    loop = control.interconnect([axis, integrator, error], inputs="target", outputs="position")
    t = np.arange(60) * PERIOD
    run = control.input_output_response(loop, t, np.full(60, 20e-9), np.zeros(loop.nstates))
    assert run.outputs[-1] == pytest.approx(20e-9, abs=2e-10)
    by_hand, total = SampledAxis(), 0.0
    for wanted in run.outputs:
        assert by_hand.position == pytest.approx(wanted, abs=1e-18)
        volts, total = 3e8 * total, total + 20e-9 - by_hand.position
        by_hand.hold(volts, PERIOD)


def test_states_that_never_were() -> None:
    axis = ss.control_system()
    with pytest.raises(ValueError, match="never was in this state: begin at rest"):
        control.input_output_response(axis, np.arange(3) * 1e-3, np.zeros(3), np.ones(4))
    with pytest.raises(ss.ParameterError, match="set actuator_memory"):
        ss.control_system(actuator="hysteresis")


def test_a_unit_for_co_simulation(tmp_path: Path) -> None:
    pytest.importorskip("pythonfmu3")
    fmpy = pytest.importorskip("fmpy")
    values = {"preload": 0.6, "actuator_resonance": 2e4}
    unit = ss.write_fmu(tmp_path, values)
    t = np.arange(20) * PERIOD
    inputs = np.array(
        list(zip(t, held(t), strict=True)), dtype=[("time", float), ("voltage", float)]
    )
    found = fmpy.simulate_fmu(
        str(unit), stop_time=20 * PERIOD, step_size=PERIOD, output_interval=PERIOD, input=inputs,
        output=["position"],
    )  # fmt: skip
    wanted = positions(SampledAxis(values), held(t))
    np.testing.assert_allclose(found["position"], wanted, atol=1e-15)


@pytest.mark.slow
@pytest.mark.parametrize(
    "values", [{}, {"mu_s": 0.3, "sigma_2": 2.0, "force": 0.01, "spring": 1e5}]
)
def test_mujoco_runs_a_lugre_contact(values: dict[str, Any]) -> None:
    """MuJoCo's own method is of first order: half the step halves the error."""
    mujoco = pytest.importorskip("mujoco")
    p = ss.Parameters.of(values | {"model": "lugre", "frequency": 2000.0})
    drive = drive_of(p)
    kinks = np.concatenate([[0.0], np.cumsum(drive.durations)])
    levels = np.concatenate([[0.0], np.cumsum(drive.durations * drive.rates)])
    ends = []
    for timestep in (1e-7, 5e-8):
        model = mujoco.MjModel.from_xml_string(ss.mujoco_model(p, timestep=timestep))
        data = mujoco.MjData(model)
        times = (np.arange(round(2 * drive.period / timestep)) + 1e-6) * timestep % drive.period
        segment = np.searchsorted(kinks, times) - 1
        course = zip(np.interp(times, kinks, levels), drive.rates[segment], strict=True)
        for data.qpos[0], data.qvel[0] in course:
            mujoco.mj_step(model, data)
        ends.append(data.qpos[1])
    wanted = ss.simulate(p, steps=2).position[-1]
    assert ends[1] == pytest.approx(wanted, rel=2e-3)
    assert 2.0 * ends[1] - ends[0] == pytest.approx(wanted, rel=1e-4)


def test_mujoco_knows_lugre_alone() -> None:
    with pytest.raises(ss.ParameterError, match="MuJoCo knows LuGre friction alone: set model"):
        ss.mujoco_model(preload=0.4)


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
    seen = low_pass_of(p.sensor, 1e-7, 0.0).filter(linear[:, 0], np.gradient(linear[:, 0], times))
    np.testing.assert_allclose(linear[:, 2], seen, atol=1e-14)
