# SPDX-License-Identifier: Apache-2.0
"""Jog and scan: held against cycles put together by hand, and against the stick range."""

from __future__ import annotations

import pytest
from expected_motion import Cycles
from table_1 import TABLE_1, table_1

from stickslip_ros.axis import Axis, CommandRefused

GAIN: float = table_1().actuator.gain  # m/V
FAST = {"frequency": 1000.0}
T = 1e-3  # s, the period at 1 kHz


# -- jog


@pytest.mark.parametrize("hertz", [1000.0, -1000.0])
def test_a_jog_steps_until_it_is_told_to_stop(hertz: float) -> None:
    """Each of its cycles is that of a move; 0 ends it with the cycle."""
    axis = Axis(TABLE_1)
    axis.command_jog(hertz)
    axis.advance(10.4 * T)
    assert (axis.status.state, axis.status.frequency) == ("jogging", 1000.0)
    assert axis.status.steps_left == 0
    axis.command_jog(0.0)
    assert axis.moving
    axis.advance(0.1)
    assert axis.state.x == Cycles().run(11 if hertz > 0.0 else -11, **FAST).rest(0.1).x
    assert (axis.status.state, abs(axis.status.steps_done)) == ("stopped", 11)
    assert axis.status.frequency == 100.0


def test_amplitude_and_frequency_change_a_jog_with_the_next_cycle() -> None:
    axis = Axis(TABLE_1)
    axis.command_jog(1000.0)
    axis.advance(3.5 * T)
    axis.command_amplitude(200.0)
    axis.advance(6.5 * T)
    axis.command_frequency(2000.0)
    assert axis.status.frequency == 2000.0
    axis.advance(9.9 * T)
    axis.stop()
    axis.advance(0.1)
    expected = Cycles().run(4, **FAST).run(3, amplitude=200.0).run(6, frequency=2000.0)
    assert axis.state.x == expected.rest(0.1).x


def test_a_jog_turns_round_at_the_end_of_a_cycle() -> None:
    axis = Axis(TABLE_1)
    axis.command_jog(1000.0)
    axis.advance(3.5 * T)
    axis.command_jog(-500.0)
    axis.advance(7.0 * T)
    axis.stop()
    axis.advance(0.1)
    expected = Cycles().run(4, **FAST).run(-2, frequency=500.0)
    assert axis.state.x == expected.rest(0.1).x
    assert axis.status.step_count == 2


@pytest.mark.parametrize("hertz", [float("nan"), float("inf"), 2e5, 1e-9])
def test_a_jog_that_cannot_be_is_refused(hertz: float) -> None:
    axis = Axis(TABLE_1)
    with pytest.raises(CommandRefused, match="frequency is"):
        axis.command_jog(hertz)
    assert axis.status.state == "stopped"


# -- scan


def test_a_scan_takes_the_runner_along_without_a_slip() -> None:
    """It sticks all the way, at the set rate, and stays where the level stays."""
    axis = Axis({**TABLE_1, "scan_rate": 1000.0})
    axis.command_scan(250.0)
    axis.advance(0.1)
    assert axis.status.state == "scanning"
    assert axis.status.scan_level == pytest.approx(100.0)
    assert axis.state.x == pytest.approx(100.0 * GAIN, rel=0.01)
    axis.advance(0.2501)
    assert axis.status.state == "stopped"
    axis.advance(10.0)
    assert axis.status.scan_level == pytest.approx(250.0)
    assert axis.state.x == pytest.approx(250.0 * GAIN, rel=1e-3)
    assert abs(axis.state.z) < axis.plant.contact.z_ba


def test_a_scan_back_takes_the_runner_back() -> None:
    axis = Axis(TABLE_1)
    for volts in (300.0, 0.0):
        axis.command_scan(volts)
        axis.advance(axis.state.t + 0.1)
    assert axis.state.x == pytest.approx(0.0, abs=1e-12)


def test_a_scan_is_redirected_on_the_way() -> None:
    axis = Axis({**TABLE_1, "scan_rate": 1000.0})
    axis.command_scan(300.0)
    axis.advance(0.2)
    axis.command_scan(150.0)
    axis.advance(0.24)
    assert axis.status.scan_level == pytest.approx(160.0)
    axis.advance(0.3)
    assert axis.status.scan_level == pytest.approx(150.0)
    finished = [event for event in axis.take_events() if event.outcome == "finished"]
    assert [event.name for event in finished] == ["scan"]
    assert finished[0].time == pytest.approx(0.25)
    assert finished[0].details["level"] == pytest.approx(150.0)


@pytest.mark.parametrize(
    ("volts", "words"),
    [
        (float("nan"), "finite"),
        (float("inf"), "finite"),
        (300.1, "more than max_voltage, 300 V"),
        (-0.1, "below min_voltage, 0 V, below which the actuator depolarises"),
    ],
)
def test_a_level_out_of_range_is_refused(volts: float, words: str) -> None:
    axis = Axis(TABLE_1)
    with pytest.raises(CommandRefused, match=f"scan level.*{words}"):
        axis.command_scan(volts)


def test_before_it_steps_the_level_is_brought_back() -> None:
    """At the rate of a scan, and the runner comes along; then the steps are those of a move."""
    axis = Axis({**TABLE_1, "scan_rate": 1000.0, **FAST})
    axis.command_scan(200.0)
    axis.advance(0.3)
    axis.command_steps(-5)
    assert (axis.status.state, axis.status.steps_left) == ("stepping", -5)
    axis.advance(0.4)
    assert axis.status.steps_done == 0
    assert axis.state.x == pytest.approx(100.0 * GAIN, rel=0.01)
    axis.advance(0.5 + 2.5 * T)
    assert (axis.status.steps_done, axis.status.steps_left) == (-2, -3)
    axis.advance(1.0)
    assert axis.status.scan_level == 0.0
    assert axis.state.x == pytest.approx(Cycles().run(-5, **FAST).rest(1.0).x, rel=0.02)


def test_a_stop_on_the_way_back_drops_the_steps() -> None:
    axis = Axis({**TABLE_1, "scan_rate": 1000.0})
    axis.command_scan(200.0)
    axis.advance(0.3)
    axis.command_steps(5)
    axis.advance(0.35)
    axis.stop()
    axis.advance(1.0)
    assert axis.status.scan_level == pytest.approx(150.0)
    assert (axis.status.state, axis.status.steps_done, axis.status.steps_left) == ("stopped", 0, 0)


# -- external load


def test_a_load_is_in_force_at_once_and_within_a_cycle() -> None:
    """It moves the runner by its force over the stiffness, and takes that back when it goes."""
    axis = Axis(TABLE_1)
    axis.set_load(0.01)
    axis.advance(0.1)
    assert axis.state.x == pytest.approx(0.01 / axis.plant.contact.sigma_0, rel=1e-3)
    assert axis.status.load == 0.01
    axis.set_load(0.0)
    axis.advance(0.2)
    assert axis.state.x == pytest.approx(0.0, abs=1e-13)
    plain = Axis(TABLE_1).plant
    assert axis.plant == plain


def test_a_load_within_a_cycle_takes_no_waiting_parameter_with_it() -> None:
    axis = Axis(TABLE_1)
    axis.command_steps(3)
    axis.advance(0.0051)
    axis.set_parameters({"mass": 0.006})
    axis.set_load(0.01)
    assert (axis.plant.mass, axis.plant.force) == (0.004, 0.01)
    axis.advance(0.0101)
    assert (axis.plant.mass, axis.plant.force) == (0.006, 0.01)


@pytest.mark.parametrize("newtons", [float("nan"), 1e9])
def test_a_load_out_of_range_is_refused(newtons: float) -> None:
    axis = Axis(TABLE_1)
    with pytest.raises(CommandRefused, match="load is"):
        axis.set_load(newtons)
    assert axis.plant == Axis(TABLE_1).plant


def test_gravity_makes_steps_up_smaller_than_steps_down() -> None:
    axis = Axis({**TABLE_1, "inclination": 1.5707963267948966, **FAST})
    axis.command_steps(50)
    axis.advance(0.1)
    up = axis.status.mean_step
    axis.command_steps(-50)
    axis.advance(0.2)
    down = -axis.status.mean_step
    assert up < 0.9 * down
