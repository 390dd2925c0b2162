# SPDX-License-Identifier: Apache-2.0
"""Jog and scan: held against cycles put together by hand, and against the stick range."""

import contextlib
import random
from typing import Any

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
    axis.command("jog", hertz)
    axis.advance(10.4 * T)
    assert (axis.status.state, axis.status.frequency) == ("jogging", 1000.0)
    assert axis.status.steps_left == 0
    axis.command("jog", 0.0)
    assert axis.moving
    axis.advance(0.1)
    assert axis.state.x == Cycles().run(11 if hertz > 0.0 else -11, **FAST).rest(0.1).x
    assert (axis.status.state, abs(axis.status.steps_done)) == ("stopped", 11)
    assert axis.status.frequency == 100.0


def test_amplitude_and_frequency_change_a_jog_with_the_next_cycle() -> None:
    axis = Axis(TABLE_1)
    axis.command("jog", 1000.0)
    axis.advance(3.5 * T)
    axis.command("amplitude", 200.0)
    axis.advance(6.5 * T)
    axis.command("frequency", 2000.0)
    assert axis.status.frequency == 2000.0
    axis.advance(9.9 * T)
    axis.command("stop")
    axis.advance(0.1)
    expected = Cycles().run(4, **FAST).run(3, amplitude=200.0).run(6, frequency=2000.0)
    assert axis.state.x == expected.rest(0.1).x


def test_a_jog_turns_round_at_the_end_of_a_cycle() -> None:
    axis = Axis(TABLE_1)
    axis.command("jog", 1000.0)
    axis.advance(3.5 * T)
    axis.command("jog", -500.0)
    axis.advance(7.0 * T)
    axis.command("stop")
    axis.advance(0.1)
    expected = Cycles().run(4, **FAST).run(-2, frequency=500.0)
    assert axis.state.x == expected.rest(0.1).x
    assert axis.status.step_count == 2


# -- scan


def test_a_scan_takes_the_runner_along_without_a_slip() -> None:
    """It sticks all the way, at the set rate, and stays where the level stays."""
    axis = Axis({**TABLE_1, "scan_rate": 1000.0})
    axis.command("scan", 250.0)
    axis.advance(0.1)
    assert axis.status.state == "scanning"
    assert axis.status.scan_level == pytest.approx(100.0)
    assert axis.state.x == pytest.approx(100.0 * GAIN, rel=0.01)
    axis.advance(0.2501)
    assert axis.status.state == "stopped"
    axis.advance(10.0)
    assert axis.status.scan_level == pytest.approx(250.0)
    assert axis.state.x == pytest.approx(250.0 * GAIN, rel=1e-3)
    assert abs(axis.state.z) < axis.simulation.plant.contact.z_ba


def test_a_scan_is_redirected_on_the_way() -> None:
    axis = Axis({**TABLE_1, "scan_rate": 1000.0})
    axis.command("scan", 300.0)
    axis.advance(0.2)
    axis.command("scan", 150.0)
    axis.advance(0.24)
    assert axis.status.scan_level == pytest.approx(160.0)
    axis.advance(0.3)
    assert axis.status.scan_level == pytest.approx(150.0)
    finished = [event for event in axis.take_events() if event.outcome == "finished"]
    assert [event.name for event in finished] == ["scan"]
    assert finished[0].time == pytest.approx(0.25)
    assert finished[0].details["level"] == pytest.approx(150.0)


def test_before_it_steps_the_level_is_brought_back() -> None:
    """At the rate of a scan, and the runner comes along; then the steps are those of a move."""
    axis = Axis({**TABLE_1, "scan_rate": 1000.0, **FAST})
    axis.command("scan", 200.0)
    axis.advance(0.3)
    axis.command("steps", -5)
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
    axis.command("scan", 200.0)
    axis.advance(0.3)
    axis.command("steps", 5)
    axis.advance(0.35)
    axis.command("stop")
    axis.advance(1.0)
    assert axis.status.scan_level == pytest.approx(150.0)
    assert (axis.status.state, axis.status.steps_done, axis.status.steps_left) == ("stopped", 0, 0)


# -- external load


def test_a_load_is_in_force_at_once_and_within_a_cycle() -> None:
    """It moves the runner by its force over the stiffness, and takes that back when it goes."""
    axis = Axis(TABLE_1)
    axis.command("load", 0.01)
    axis.advance(0.1)
    assert axis.state.x == pytest.approx(0.01 / axis.simulation.plant.contact.sigma_0, rel=1e-3)
    assert axis.status.load == 0.01
    axis.command("load", 0.0)
    axis.advance(0.2)
    assert axis.state.x == pytest.approx(0.0, abs=1e-13)
    plain = Axis(TABLE_1).simulation.plant
    assert axis.simulation.plant == plain


def test_a_load_within_a_cycle_takes_no_waiting_parameter_with_it() -> None:
    axis = Axis(TABLE_1)
    axis.command("steps", 3)
    axis.advance(0.0051)
    axis.command("parameters", {"mass": 0.006})
    axis.command("load", 0.01)
    assert (axis.simulation.plant.mass, axis.simulation.plant.force) == (0.004, 0.01)
    axis.advance(0.0101)
    assert (axis.simulation.plant.mass, axis.simulation.plant.force) == (0.006, 0.01)


@pytest.mark.parametrize("waits", [False, True], ids=["runs", "waits for the cycle before it"])
@pytest.mark.parametrize(
    ("command", "value"),
    [
        ("amplitude", 300.0),
        ("parameters", {"slewrate": 0.1}),
        ("parameters", {"max_frequency": 2000.0}),
    ],
)
def test_a_jog_cannot_be_made_impossible(waits: bool, command: str, value: object) -> None:
    """It has a frequency of its own, and the next cycle could not be made: the jog ended in it."""
    axis = Axis({**TABLE_1, "slewrate": 1.0, "amplitude": 100.0, "frequency": 100.0})
    if waits:
        axis.command("steps", 5)
        axis.advance(0.0012)
    axis.command("jog", 5000.0)
    axis.advance(0.0023)
    with pytest.raises(CommandRefused, match=r"frequency (is )?5000 Hz"):
        axis.command(command, value)
    axis.advance(0.1)
    assert (axis.mode, axis.status.frequency) == ("jogging", 5000.0)
    axis.command("stop")
    axis.command(command, value)  # the frequency of the steps suits it
    axis.command("steps", 2)
    axis.advance(0.2)
    assert axis.status.steps_done == 2


@pytest.mark.parametrize("at", [0.02, 0.06, 0.1])
def test_the_closed_loop_goes_on_with_what_the_amplifier_still_gives(at: float) -> None:
    """Its running steps had more volts than it was left with, and an exception ended them."""
    axis = Axis({**TABLE_1, **FAST})
    axis.command("position", 3e-5)
    axis.advance(at)
    assert axis.moving
    axis.command("amplitude", 150.0)
    axis.command("parameters", {"max_voltage": 160.0})
    axis.advance(3.0)
    assert axis.mode == "holding"
    assert axis.status.position == pytest.approx(3e-5, abs=4e-9)


DRIVES: tuple[tuple[Any, ...], ...] = (
    *(("steps", steps) for steps in (-50, 20, 1)),
    *(("jog", hertz) for hertz in (5000.0, -2500.0, 1500.0)),
    *(("position", x) for x in (2e-6, -1e-6)),
    *(("scan", volts) for volts in (0.0, 140.0)),
    *(("frequency", hertz) for hertz in (50.0, 100.0)),
    *(("amplitude", volts) for volts in (60.0, 150.0, 280.0)),
    *(("parameters", {"max_voltage": volts}) for volts in (70.0, 160.0, 300.0)),
    *(("parameters", {"slewrate": slope}) for slope in (0.1, 1.0, 100.0)),
    *(("parameters", {"max_frequency": hertz}) for hertz in (400.0, 1e5)),
)


def test_no_order_of_commands_makes_the_drive_impossible() -> None:
    """A command is refused, or its motion can be carried out; an axis that cannot is in fault."""
    dice = random.Random(5)
    for _ in range(60):
        axis, t, done = Axis({**TABLE_1, "frequency": 100.0}), 0.0, []
        for _ in range(25):
            done.append((t, *dice.choice(DRIVES)))
            with contextlib.suppress(CommandRefused):
                axis.command(*done[-1][1:])
            t += dice.choice([0.0, 4e-4, 3e-3, 0.05]) * dice.random()
            axis.advance(t)
            assert not axis.fault, done
