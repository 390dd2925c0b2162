# SPDX-License-Identifier: Apache-2.0
"""Axes that no parameters explain, from an integrator of their own; lagging ones that some do."""

import re
from dataclasses import replace

import numpy as np
import pytest
from bench_traces import Axis, Drive, integrate_pieces
from experiments import holds, truth_of
from other_axes import Other, other_trace
from scipy.signal import lfilter

from stickslip_ros.measurement.identification import Fit, identify
from stickslip_ros.measurement.identification.experiment import (
    Experiment,
    IdentificationError,
    Stepping,
)
from stickslip_ros.physics.model.waveforms import drive_of
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.simulation.motion import Motion

AXIS = Axis(preload=0.6, mass=5e-3, sigma_1=7.0)
KNOWN = {"preload": 0.6, "mass": 5e-3, "frequency": 400.0, "amplitude": 280.0}


def trace(other: Other, noise: float = 1e-9) -> Motion:
    drive = Drive(12, frequency=400.0, amplitude=280.0, pause=5e-3)
    return Motion("lab", *other_trace(AXIS, other, drive, 5e5, noise, 3))


def fitted(other: Other, fit_lag: bool | None = False) -> Fit:
    start = {name: 1.5 * value for name, value in truth_of(AXIS).items()}
    return identify([(Parameters.of({**KNOWN, **start}), trace(other))], fit_lag=fit_lag)


@pytest.mark.long
def test_an_axis_of_the_model_is_no_misfit() -> None:
    found = fitted(Other())
    assert found.misfit is None
    for name, true in truth_of(AXIS).items():
        assert found.parameters[name].value == pytest.approx(true, rel=0.1)


@pytest.mark.long
@pytest.mark.parametrize("other", [Other(second=0.15), Other(jump=0.2)])
def test_another_axis_is_told(other: Other) -> None:
    found = fitted(other)
    assert found.misfit is not None
    assert "repeats with the drive" in found.misfit.text
    assert found.as_json()["misfit"].startswith("lab: ")


@pytest.mark.long
def test_another_amplitude_is_told() -> None:
    """The parameters and a wander of the sensor take most of it up."""
    start = {name: 1.5 * value for name, value in truth_of(AXIS).items()}
    known = Parameters.of({**KNOWN, **start, "amplitude": 290.0})
    found = identify([(known, trace(Other()))])
    assert found.misfit is not None
    assert "another gain of the actuator, or amplitude (-3." in found.misfit.text


@pytest.mark.long
def test_noise_that_comes_with_the_motion_is_told() -> None:
    """The fit printed 22 nm of noise where the record showed 1.5 nm, and said nothing."""
    motion = trace(Other())
    moving = (motion.t > 5e-3) & (motion.t < 3.5e-2)
    noise = 3e-9 * moving * np.random.default_rng(6).standard_normal(len(motion.t))
    start = {name: 1.5 * value for name, value in truth_of(AXIS).items()}
    found = identify([(Parameters.of({**KNOWN, **start}), replace(motion, x=motion.x + noise))])
    assert found.misfit is not None
    assert "times that at rest" in found.misfit.text


@pytest.mark.long
def test_a_value_held_after_the_run_moves_no_interval() -> None:
    motion = trace(Other())
    x = motion.x[:17_503]  # in the ringing after the last slip
    x = np.append(x, np.full(10_000, x[-1]))
    start = {name: 1.5 * value for name, value in truth_of(AXIS).items()}
    held = Motion("lab", np.arange(len(x)) / 5e5, x)
    found = identify([(Parameters.of({**KNOWN, **start}), held)])
    assert found.misfit is None
    note, _ = found.notes  # the other one says that the last slip is not clear
    assert "for 20.0 ms from 0.035 s on; they are no data" in note
    for name, true in truth_of(AXIS).items():
        one = found.parameters[name]
        assert holds(one.low, true, one.high), name


@pytest.mark.long
def test_a_lag_of_the_amplifier_is_named() -> None:
    found = fitted(Other(lag=1.5e-6))
    assert found.misfit is not None
    assert re.search(r"a lag of the amplifier \(1\.\d µs\): identify again", found.misfit.text)


@pytest.mark.long
def test_a_slow_sensor_is_named_unless_its_bandwidth_is_set() -> None:
    """It moved sigma_0ss by 13 %, out of its interval, and nothing was said."""
    drive, rate = Drive(12, frequency=400.0, amplitude=280.0, pause=5e-3), 4e6
    t, x = other_trace(AXIS, Other(), drive, rate, 0.0, 3)
    share = 1.0 - np.exp(-2.0 * np.pi * 4e4 / rate)
    x = lfilter([share], [1.0, share - 1.0], x)[::8]
    motion = Motion("lab", t[::8], x + 1e-9 * np.random.default_rng(3).standard_normal(len(x)))
    start = {name: 1.5 * value for name, value in truth_of(AXIS).items()}
    point = identify([(Parameters.of({**KNOWN, **start}), motion)], samples="point")
    assert point.misfit is not None
    assert "a slow sensor (" in point.misfit.text
    assert "set sensor_bandwidth" in point.misfit.text
    unsaid = identify([(Parameters.of({**KNOWN, **start}), motion)])
    assert unsaid.parameters["sensor_width"].value == pytest.approx(4e-6, rel=0.1)
    for name, true in truth_of(AXIS).items():
        assert holds(unsaid.parameters[name].low, true, unsaid.parameters[name].high), name
    found = identify([(Parameters.of({**KNOWN, **start, "sensor_bandwidth": 4e4}), motion)])
    assert found.misfit is None
    for name, true in truth_of(AXIS).items():
        one = found.parameters[name]
        assert holds(one.low, true, one.high), name


@pytest.mark.long
@pytest.mark.parametrize(("lag", "within"), [(5e-7, 0.1), (1.5e-6, 0.2)])
def test_a_lag_is_allowed_for_unasked(lag: float, within: float) -> None:
    """Half a microsecond moved sigma_0ss far out of its interval, and was taken for hum."""
    found = fitted(Other(lag=lag), fit_lag=None)
    assert found.misfit is None
    assert found.runs[0].mains == ()
    for name, true in {**truth_of(AXIS), "amplifier_lag": lag}.items():
        one = found.parameters[name]
        assert holds(one.low, true, one.high), name
        if lag > 1e-6 and name != "amplifier_lag":
            assert one.value == pytest.approx(true, rel=0.15), name
    assert found.parameters["amplifier_lag"].unit == "s"
    bandwidth = 1.0 / (2.0 * np.pi * lag)
    assert found.base.actuator.amplifier_bandwidth == pytest.approx(bandwidth, rel=within)
    assert found.posterior is not None
    assert "amplifier_lag" not in found.posterior.names


@pytest.mark.long
@pytest.mark.parametrize("lag", [0.0, 1e-6])
def test_hysteresis_of_the_drive_file_is_no_misfit(lag: float) -> None:
    """The lag, free by default, sent the voltage along the virgin curve: 6 nm were left."""
    p = Parameters.of({**KNOWN, **truth_of(AXIS), "actuator": "hysteresis", "hysteresis": 0.15})
    cycle = drive_of(p)
    kinks = 5e-3 + np.concatenate([k / 400.0 + np.cumsum(cycle.durations) for k in range(12)])
    rates = [0.0, *np.tile(cycle.rates, 12).tolist(), 0.0]
    steps = [5e-7, *np.tile(np.minimum(cycle.durations / 30.0, 5e-7), 12).tolist(), 5e-7]
    t = np.arange(0.0, 0.04, 2e-6)
    ends = [0.0, 5e-3, *kinks.tolist(), 0.041]
    x = integrate_pieces(AXIS, ends, rates, steps, lag, t)
    x = x + 1e-9 * np.random.default_rng(3).standard_normal(len(t))
    start = {name: 1.5 * value for name, value in truth_of(AXIS).items()}
    found = identify([(p.replace(**start), Motion("lab", t, x))], samples="point")
    assert found.misfit is None
    for name, true in truth_of(AXIS).items():
        one = found.parameters[name]
        assert holds(one.low, true, one.high), name


@pytest.mark.long
@pytest.mark.parametrize("lag", [3e-7, 1.5e-6, 3e-6])
def test_twelve_lagging_cycles_are_those_of_the_integrator(lag: float) -> None:
    motion = trace(Other(lag=lag), noise=0.0)
    p = Parameters.of({**KNOWN, **truth_of(AXIS)})
    experiment = Experiment(p, motion, (Stepping(5e-3, 12, 400.0),))
    lagging, start = p.replace(amplifier_bandwidth=1.0 / (2.0 * np.pi * lag)), np.array([5e-3])
    found, _ = experiment.simulate(lagging, start, motion.t)
    without, _ = experiment.simulate(p, start, motion.t)
    seen, _ = experiment.simulate(lagging.replace(sensor_bandwidth=2e4), start, motion.t)
    share = 1.0 - np.exp(-2.0 * np.pi * 2e4 * 2e-6)  # of what is left, in a sample's time
    late = lfilter([share], [1.0, share - 1.0], motion.x)
    assert np.abs(seen - np.interp(motion.t, motion.t - 1e-6, late)).max() < 1e-8
    assert np.abs(found - motion.x).max() < 1e-10
    assert np.abs(found - motion.x).max() < 0.03 * np.abs(without - motion.x).max()


def test_an_amplifier_that_is_known_cannot_be_free() -> None:
    t = np.arange(0.0, 0.05, 2e-6)
    x = 1e-7 * np.floor(np.clip(400.0 * (t - 5e-3), 0.0, 10.0))
    known = Parameters.of({**KNOWN, "amplifier_bandwidth": 1e6 / (2.0 * np.pi)})
    with pytest.raises(IdentificationError, match="set amplifier_bandwidth"):
        identify([(known, Motion("lab", t, x))], fit_lag=True)
