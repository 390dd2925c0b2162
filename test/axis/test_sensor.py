# SPDX-License-Identifier: Apache-2.0
"""The simulated sensor: noise that hangs on seed and number only, grid, latency."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline
from scipy.signal import welch
from table_1 import TABLE_1, table_1

from stickslip_ros.axis import Axis, CommandRefused
from stickslip_ros.axis.sensor import Sensor
from stickslip_ros.physics.model import Plant
from stickslip_ros.physics.model.low_pass import LowPass
from stickslip_ros.physics.parameters import ParameterError, Parameters
from stickslip_ros.physics.solver import Samples, Simulation
from stickslip_ros.simulation.motion import Motion
from stickslip_ros.simulation.readings import read_steps, through_bandwidth
from stickslip_ros.simulation.sampling import trace_steps


def _sensor(**changes: Any) -> Sensor:
    return Sensor(table_1(**{"sensor_resolution": 0.0, **changes}).sensor)


def test_the_noise_has_its_standard_deviation() -> None:
    sensor = _sensor(sensor_noise=2e-9)
    noise = np.array([sensor.reading(1e-6, k) - 1e-6 for k in range(20_000)])
    assert noise.std() == pytest.approx(2e-9, rel=0.03)
    assert abs(noise.mean()) < 5e-11
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.03


@pytest.mark.parametrize("corner", [0.0, 10.0])
def test_a_reading_hangs_on_seed_and_number_only(corner: float) -> None:
    """Whatever was read before."""
    numbers = [3, 70_000, 10**9, 2**43 + 5, 3, 0, 1023, 1024]  # 50 days of the fastest are 2**42
    one, other = (_sensor(sensor_noise_corner=corner) for _ in range(2))
    backwards = [other.reading(0.0, k) for k in reversed(numbers)]
    assert [one.reading(0.0, k) for k in numbers] == backwards[::-1]
    for another in ({"sensor_seed": 2}, {"sensor_noise_corner": 20.0}):
        assert one.reading(0.0, 3) != _sensor(**another).reading(0.0, 3)
    tried = range(0, 5000, 500 if corner else 7)
    assert not any(one.reading(0.0, k) == one.reading(0.0, k + 1024) for k in tried)  # no block


def test_drift_adds_up_with_the_time_of_the_reading() -> None:
    sensor = _sensor(sensor_noise=0.0, sensor_drift=3e-9, sensor_rate=500.0)
    assert sensor.reading(1e-6, 1000) == pytest.approx(1e-6 + 2.0 * 3e-9, abs=1e-21)


def test_readings_lie_on_the_grid() -> None:
    sensor = _sensor(sensor_resolution=5e-9, sensor_noise=0.0)
    assert sensor.reading(12.4e-9, 0) == pytest.approx(10e-9)
    assert sensor.reading(12.6e-9, 0) == pytest.approx(15e-9)


def test_a_position_that_the_solver_lost_ends_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each status of the axis raised an error, so that its node said nothing more."""
    axis = Axis(TABLE_1)
    axis.trip("the solver failed")
    monkeypatch.setattr(Simulation, "x", property(lambda simulation: math.nan))
    assert math.isnan(axis.status.position)
    assert axis.status.fault == "the solver failed"
    with pytest.raises(CommandRefused, match="start the node anew"):
        axis.command("reset")


@pytest.mark.parametrize(("latency", "readings"), [(0.0, 0), (1e-3, 1), (1.01e-3, 2), (7e-3, 7)])
def test_latency_is_rounded_up_to_readings(latency: float, readings: int) -> None:
    assert _sensor(sensor_rate=1e3, sensor_latency=latency).delay == readings


def test_zero_counts_from_the_present_reading() -> None:
    axis = Axis(TABLE_1)
    axis.command("steps", 20)
    axis.advance(1.0)
    before = axis.status.position
    axis.command("zero")
    assert axis.status.position == 0.0
    assert axis.status.zero_offset == before == pytest.approx(axis.state.x, abs=6e-9)
    axis.command("steps", -20)
    axis.advance(2.0)
    axis.command("zero")
    assert axis.status.zero_offset == pytest.approx(axis.state.x, abs=6e-9)


_QUIET = {"sensor_noise": 0.0, "sensor_resolution": 0.0, "sensor_latency": 0.0}


def _filtered(p: Parameters, steps: int, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """The low-pass of the trace by DOP853, times (s) counting from the start of the steps."""
    trace = trace_steps(p, steps)
    spline = CubicHermiteSpline(trace.t, trace.x, trace.v)
    omega, zeta = 2.0 * math.pi * float(p.sensor.sensor_bandwidth or 0.0), p.sensor.sensor_damping

    def rate(t: float, y: NDArray[np.float64]) -> list[float]:
        x = float(spline(t)) if t > 0.0 else 0.0
        if p.sensor.sensor_order == 1:
            return [omega * (x - y[0])]
        return [y[1], omega**2 * (x - y[0]) - 2.0 * zeta * omega * y[1]]

    found = solve_ivp(
        rate, (0.0, times[-1]), [0.0] * p.sensor.sensor_order, "DOP853", times,
        rtol=1e-9, atol=1e-15, max_step=5e-6,
    )  # fmt: skip
    return np.asarray(found.y[0])


@pytest.mark.parametrize(
    "filter_",
    [{"sensor_order": 1}, {"sensor_order": 2}, {"sensor_order": 2, "sensor_damping": 0.1}],
)
def test_readings_are_those_of_an_integrator_of_the_filter(filter_: dict[str, Any]) -> None:
    p = table_1(**_QUIET, sensor_rate=1e4, sensor_bandwidth=3e3, frequency=500.0, **filter_)
    readings = read_steps(p, 3)
    rest = 20 / 1e4
    during = (readings.t > rest) & (readings.t < rest + 3 / 500.0)
    expected = _filtered(p, 3, readings.t[during] - rest)
    assert np.ptp(expected) > 300e-9
    assert readings.x[during] == pytest.approx(expected, abs=0.005e-9)


def test_a_motion_behind_the_bandwidth_is_that_of_an_integrator() -> None:
    p = table_1(sensor_bandwidth=3e3, sensor_order=2, frequency=500.0)
    motion = Motion.of_trace(trace_steps(p, 3), "")
    seen = through_bandwidth(p, motion)
    some = slice(50, None, 97)
    assert seen.x[some] == pytest.approx(_filtered(p, 3, motion.t[some]), abs=0.01e-9)
    assert seen.v is not None
    change = np.interp(motion.t[some], motion.t, np.gradient(seen.x, motion.t))
    assert seen.v[some] == pytest.approx(change, abs=2e-5)


def test_the_response_to_a_cubic_is_that_of_the_textbook() -> None:
    p, dt = table_1(sensor_bandwidth=100.0).sensor, 1e-5
    t = np.linspace(dt, 1000 * dt, 1000)
    y = LowPass(p, dt, 5e-9).filter(5e-9 + 1e-3 * t**3, 3e-3 * t**2)
    lag = 1.0 / (2.0 * math.pi * 100.0)
    cubic = t**3 - 3.0 * lag * t**2 + 6.0 * lag**2 * t - 6.0 * lag**3 * (1.0 - np.exp(-t / lag))
    assert y == pytest.approx(5e-9 + 1e-3 * cubic, abs=1e-20)


def test_a_slow_sensor_of_a_long_move_keeps_its_gain() -> None:
    """It was 0.06 nm off after a millimetre, and 2.8 nm at 1 Hz: rounding of the filter."""
    p = table_1(sensor_bandwidth=10.0, sensor_order=2, sensor_damping=0.7).sensor
    t = np.linspace(1e-6, 1.0, 10**6)
    y = LowPass(p, 1e-6, 0.0).filter(1e-3 * t, np.full_like(t, 1e-3))
    behind = 2.0 * 0.7 / (2.0 * math.pi * 10.0)
    assert y[-1] == pytest.approx(1e-3 * (1.0 - behind), abs=1e-13)


def test_a_wide_bandwidth_reads_where_the_runner_is() -> None:
    plain = read_steps(table_1(**_QUIET, sensor_rate=1e4), 3)
    wide = read_steps(table_1(**_QUIET, sensor_rate=1e4, sensor_bandwidth=1e6), 3)
    lag = 2e-3 / (2.0 * math.pi * 1e6)  # at the speed of the ringing, 2 mm/s at most
    assert wide.x == pytest.approx(plain.x, abs=lag)
    none = read_steps(table_1(**_QUIET, sensor_rate=1e4, sensor_bandwidth=0.5), 3)
    assert (none.x == plain.x).all()


@pytest.mark.parametrize("filter_", [{}, {"sensor_bandwidth": 1e6}])
def test_a_load_moves_the_runner_in_the_rest_before_the_steps(filter_: dict[str, Any]) -> None:
    """It was read at 0 until the first step, and jumped there."""
    p = table_1(**_QUIET, sensor_rate=1e4, force=0.02, **filter_)
    readings, simulation = read_steps(p, 1), Simulation(Plant.of(p), p.solver.tolerance)
    x = simulation.sample(readings.t[:100]).x
    assert np.ptp(x) > 2e-9
    assert readings.x[:100] == pytest.approx(x, abs=3e-11 if filter_ else 0.0)  # of its lag


def _axis(**changes: Any) -> Axis:
    return Axis({**TABLE_1, **_QUIET, **changes})


def test_the_axis_reads_with_the_same_sensor() -> None:
    """Node, trace and comparison have one sensor: readings of an axis are those of a trace."""
    values = {"sensor_rate": 1e3, "sensor_bandwidth": 200.0, "sensor_noise": 1e-9}
    axis = _axis(**values)
    readings = read_steps(table_1(**{**_QUIET, **values}), 4)
    axis.advance(0.02)
    axis.command("steps", 4)
    found = []
    for t in readings.t[21:70]:
        axis.advance(float(t))
        found.append(axis.measured)
    assert found == pytest.approx(readings.x[21:70].tolist(), abs=1e-14)


def test_the_bandwidth_may_change_while_the_axis_runs() -> None:
    axis = _axis(sensor_bandwidth=2.0)
    axis.command("steps", 50)
    axis.advance(0.3)
    assert axis.measured < 0.9 * axis.state.x
    axis.command("parameters", {"sensor_bandwidth": 0.0})
    axis.advance(0.3101)
    assert axis.measured == axis.state.x
    axis.command("parameters", {"sensor_bandwidth": 1e4})
    axis.advance(1.0)
    assert axis.measured == pytest.approx(axis.state.x, abs=1e-13)


def test_noise_has_the_density_of_white_and_flicker() -> None:
    """By Welch's method of SciPy."""
    p = table_1(sensor_resolution=0.0, sensor_noise=1e-9, sensor_noise_corner=50.0)
    sensor = Sensor(p.sensor)
    noise = np.array([sensor.reading(0.0, k) for k in range(2**18)])
    f, density = welch(noise, 1e3, nperseg=2**13)
    for low, high in ((1.0, 2.0), (2.0, 5.0), (5.0, 20.0), (20.0, 100.0), (100.0, 400.0)):
        band = (f >= low) & (f < high)
        expected = 2.0 * 1e-18 / 1e3 * (1.0 + 50.0 / f[band])
        assert density[band].mean() == pytest.approx(expected.mean(), rel=0.08, abs=0.0)


CREEPING = {**TABLE_1, **_QUIET, "frequency": 1000.0, "creep": 0.02, "sensor_bandwidth": 3e3}


def test_a_runner_at_rest_is_looked_at_less_often_than_it_is_read(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Otherwise an axis that stands still takes a quarter of a processor."""
    samples: list[int] = []
    sample = Simulation.sample

    def counted(own: Simulation, times: NDArray[np.float64]) -> Samples:
        samples.append(len(times))
        return sample(own, times)

    monkeypatch.setattr(Simulation, "sample", counted)
    axis = Axis(CREEPING)
    axis.command("steps", 50)
    axis.advance(3.0)
    assert sum(samples) > 50 * 250
    samples.clear()
    axis.advance(4.0)
    still = sum(samples)
    assert 1.0 / 0.016 < still < 200  # of 1000 readings
    axis.command("steps", 1)
    axis.advance(4.001)
    assert sum(samples) > still + 250


def test_readings_at_rest_are_those_of_every_sample() -> None:
    """To 0.06 nm, with steps, a load and creep, and the same bits however time is divided."""
    lot = np.random.default_rng(1)
    whole, parts = Axis(CREEPING), Axis(CREEPING)
    exact, low_pass = Axis({**CREEPING, "sensor_bandwidth": 0.0}), LowPass(
        table_1(**CREEPING).sensor, 1.0 / 250e3, 0.0
    )  # fmt: skip
    for axis in (whole, parts, exact):
        axis.command("steps", 5)
    numbers = np.arange(1, 250)
    for k in range(1, 801):
        if k in (501, 700):
            for axis in (whole, parts, exact):
                axis.command("load", 2e-3 * (k == 501))
        t = k / 1000
        if k % 7 == 0:
            for between in sorted(lot.uniform(parts.state.t, t, 3)):
                parts.advance(between)
        times = np.append(((k - 1) * 250 + numbers) / 250 / 1000, t)
        samples = exact.actuation.sim.sample(times)
        y = low_pass.filter(samples.x, samples.v)[-1]
        exact.advance(t)
        whole.advance(t)
        parts.advance(t)
        assert whole.measured == parts.measured
        assert whole.measured == pytest.approx(y, abs=6e-11)


def test_a_ringing_too_fast_for_the_filter_is_refused() -> None:
    """Its samples, 2e9 in a second, took minutes in which nobody was heard."""
    stiff = {"sigma_0": 1e12, "mass": 1e-4, "sensor_bandwidth": 1e3}
    with pytest.raises(ParameterError, match=r"rings at 1\.59e\+07 Hz, 2\.5e\+06 Hz is the upper"):
        Axis({**TABLE_1, **stiff})
    axis = Axis({**TABLE_1, **stiff, "sensor_bandwidth": 0.0})
    with pytest.raises(CommandRefused, match="set sensor_bandwidth to 0"):
        axis.command("parameters", stiff)
