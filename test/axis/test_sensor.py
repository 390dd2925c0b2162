# SPDX-License-Identifier: Apache-2.0
"""The simulated sensor: noise that hangs on seed and number only, grid, latency."""

import math
from typing import Any

import numpy as np
import pytest
from table_1 import TABLE_1, table_1

from stickslip_ros.axis import Axis, CommandRefused
from stickslip_ros.axis.sensor import Sensor
from stickslip_ros.solver import Simulation


def _sensor(**changes: Any) -> Sensor:
    return Sensor(table_1(**{"sensor_resolution": 0.0, **changes}).sensor)


def test_the_noise_has_its_standard_deviation() -> None:
    sensor = _sensor(sensor_noise=2e-9)
    noise = np.array([sensor.reading(1e-6, k) - 1e-6 for k in range(20_000)])
    assert noise.std() == pytest.approx(2e-9, rel=0.03)
    assert abs(noise.mean()) < 5e-11
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.03


def test_a_reading_hangs_on_seed_and_number_only() -> None:
    """Whatever was read before."""
    numbers = [3, 70_000, 3, 0, 1023, 1024]
    one, other = _sensor(), _sensor()
    backwards = [other.reading(0.0, k) for k in reversed(numbers)]
    assert [one.reading(0.0, k) for k in numbers] == backwards[::-1]
    assert one.reading(0.0, 3) != _sensor(sensor_seed=2).reading(0.0, 3)
    same = [k for k in range(0, 5000, 7) if one.reading(0.0, k) == one.reading(0.0, k + 1024)]
    assert same == []  # no block of numbers comes again


def test_drift_adds_up_with_the_time_of_the_reading() -> None:
    sensor = _sensor(sensor_noise=0.0, sensor_drift=3e-9, sensor_rate=500.0)
    assert sensor.reading(1e-6, 1000) == pytest.approx(1e-6 + 2.0 * 3e-9, abs=1e-21)


def test_readings_lie_on_the_grid() -> None:
    sensor = _sensor(sensor_resolution=5e-9, sensor_noise=0.0)
    assert sensor.reading(12.4e-9, 0) == pytest.approx(10e-9)
    assert sensor.reading(12.6e-9, 0) == pytest.approx(15e-9)


def test_a_perfect_sensor_reads_the_position() -> None:
    assert _sensor(sensor_noise=0.0).reading(1.23456789e-7, 5) == 1.23456789e-7


def test_a_position_that_the_solver_lost_ends_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each status of the axis raised an error, so that its node said nothing more."""
    axis = Axis(TABLE_1)
    axis.trip("the solver failed")
    monkeypatch.setattr(Simulation, "x", property(lambda simulation: math.nan))
    assert math.isnan(axis.status.position)
    assert axis.status.fault == "the solver failed"
    with pytest.raises(CommandRefused, match="start the node anew"):
        axis.reset()


@pytest.mark.parametrize(("latency", "readings"), [(0.0, 0), (1e-3, 1), (1.01e-3, 2), (7e-3, 7)])
def test_latency_is_rounded_up_to_readings(latency: float, readings: int) -> None:
    assert _sensor(sensor_rate=1e3, sensor_latency=latency).delay == readings


def test_zero_counts_from_the_present_reading() -> None:
    axis = Axis(TABLE_1)
    axis.command_steps(20)
    axis.advance(1.0)
    before = axis.status.position
    axis.zero()
    assert axis.status.position == 0.0
    assert axis.status.zero_offset == before == pytest.approx(axis.state.x, abs=6e-9)
    axis.command_steps(-20)
    axis.advance(2.0)
    axis.zero()
    assert axis.status.zero_offset == pytest.approx(axis.state.x, abs=6e-9)
