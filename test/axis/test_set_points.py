# SPDX-License-Identifier: Apache-2.0
"""Set points of a controller, one by one: followed, ignored where they ask for nothing new."""

import math

import pytest

from stickslip_ros.axis import Axis, CommandRefused, Event
from stickslip_ros.axis.events import event_texts
from stickslip_ros.axis.resimulation import Rerun

FAST = {"frequency": 1000.0}
JOINT = "axis_slider"
PERIOD = 0.01  # s, of the controller


def _applied(axis: Axis) -> list[Event]:
    return [event for event in axis.take_events() if event.outcome == "applied"]


def _stream(axis: Axis, interface: str, values: list[float]) -> None:
    for value in values:
        axis.command("joint_command", JOINT, interface, value)
        axis.advance(axis.state.t + PERIOD)


def test_a_streamed_ramp_is_followed_and_its_end_held() -> None:
    axis = Axis(FAST)
    ramp = [2e-5 * k * PERIOD for k in range(101)]  # 20 um/s for 1 s
    worst = 0.0
    for goal in ramp:
        _stream(axis, "position", [goal])
        if goal > 2e-6:
            worst = max(worst, abs(axis.state.x - goal))
    assert worst < 1e-6
    _stream(axis, "position", [ramp[-1]] * 100)
    assert axis.mode == "holding"
    assert axis.state.x == pytest.approx(ramp[-1], abs=4e-9)


def test_a_set_point_that_is_repeated_on_the_way_asks_for_nothing_new() -> None:
    axis = Axis(FAST)
    _stream(axis, "position", [2e-5] * 5)
    assert axis.moving
    assert [event.name for event in _applied(axis)] == ["start", "joint_command"]


def test_a_new_set_point_waits_for_the_hold_time_of_its_own() -> None:
    """The runner is within the tolerance when the way there ends, and was so at the old one."""
    axis = Axis({**FAST, "hold_time": 0.4, "target_tolerance": 1e-7})
    for goal in (5e-7, 6.5e-7):
        _stream(axis, "position", [goal])
        axis.advance(axis.state.t + 0.3)
        assert axis.mode == "targeting"
        axis.advance(axis.state.t + 0.5)
        assert axis.mode == "holding"


def test_a_velocity_is_kept_up_and_0_holds() -> None:
    axis = Axis(FAST)
    _stream(axis, "velocity", [3e-5] * 200)
    assert axis.state.x == pytest.approx(6e-5, abs=1e-6)
    _stream(axis, "velocity", [0.0] * 50)
    x = axis.state.x
    _stream(axis, "velocity", [0.0] * 100)
    assert axis.state.x == pytest.approx(x, abs=4e-9)


def test_a_velocity_is_a_command_once_until_it_is_renewed() -> None:
    """At whatever time it begins: each further one would be a new trajectory, and an event."""
    axis = Axis(FAST)
    axis.advance(7.0)
    _applied(axis)
    _stream(axis, "velocity", [3e-5] * 40)  # 0.4 s of the second that one lasts
    assert len(_applied(axis)) == 1
    _stream(axis, "velocity", [3e-5] * 40)
    assert len(_applied(axis)) == 1


def test_a_velocity_that_nobody_renews_ends() -> None:
    """A controller that dies must not leave the runner on its way."""
    axis = Axis(FAST)
    _stream(axis, "velocity", [1e-5])
    axis.advance(3.0)
    assert axis.mode == "holding"
    assert axis.state.x == pytest.approx(1e-5, abs=4e-9)


def test_a_velocity_ends_at_the_soft_limit() -> None:
    axis = Axis({**FAST, "soft_high": 5e-6})
    _stream(axis, "velocity", [2e-5] * 100)
    assert axis.state.x == pytest.approx(5e-6, abs=4e-9)
    assert axis.status.fault == ""


@pytest.mark.slow
@pytest.mark.parametrize("moved", [0.0, 1.7e-6])
def test_commanding_back_what_was_read_moves_nothing(moved: float) -> None:
    """At rest and in closed loop, for two seconds of 100 readings a second."""
    axis = Axis(FAST)
    axis.zero()
    if moved:
        axis.command_position(moved)
        axis.advance(2.0)
    x = axis.state.x
    axis.take_events()
    for _ in range(200):
        _stream(axis, "position", [axis.state.x - axis.config.offset])
    assert axis.state.x == pytest.approx(x, abs=4e-9)
    assert len(_applied(axis)) <= 2


def test_what_is_no_set_point_leaves_no_trace() -> None:
    for joint, interface, value in [
        (JOINT, "position", math.nan),
        (JOINT, "velocity", math.nan),
        ("other", "position", 1e-6),
    ]:
        axis = Axis(FAST)
        axis.take_events()
        axis.command("joint_command", joint, interface, value)
        assert (axis.take_events(), axis.mode) == ([], "stopped")


def test_a_set_point_out_of_reach_is_refused() -> None:
    axis = Axis({**FAST, "soft_high": 1e-6})
    with pytest.raises(CommandRefused, match="soft limits allow"):
        axis.command("joint_command", JOINT, "position", 2e-6)
    with pytest.raises(CommandRefused, match="has to be a finite number"):
        axis.command("joint_command", JOINT, "velocity", math.inf)


def test_set_points_take_over_from_a_jog_and_come_out_again_bit_for_bit() -> None:
    axis = Axis(FAST)
    axis.command_jog(700.0)
    axis.advance(0.0333)
    _stream(axis, "position", [4e-6 + 1e-7 * k for k in range(30)])
    _stream(axis, "velocity", [-1e-5] * 30)
    axis.command("trajectory", [JOINT], [[0.3, 1e-6], [0.5, 2e-6]], 0.1)
    axis.advance(axis.state.t + 0.2)
    axis.command_trajectory([JOINT], [(0.2, 1e-6)])
    axis.advance(axis.state.t + 0.5)
    texts = [event_texts(event) for event in axis.take_events()]
    events = [Event.of(text) for text in texts]
    again = Rerun([event for event in events if event])
    assert again.advance(axis.state.t).state == axis.state


@pytest.mark.parametrize("value", [1.5e308, -1.7976931348623157e308, 5e-324])
def test_what_an_axis_takes_can_be_repeated_however_large(value: float) -> None:
    """An event with a velocity above 1e300 m/s was said to come from no axis."""
    axis = Axis({**FAST, "soft_high": 3e-6, "soft_low": -3e-6})
    axis.command("joint_command", JOINT, "velocity", value)
    axis.advance(0.3)
    axis.command_trajectory([JOINT], [(1e304, 1e-6)])
    axis.advance(0.5)
    events = [Event.of(event_texts(event)) for event in axis.take_events()]
    again = Rerun([event for event in events if event]).advance(0.5)
    assert again.state == axis.state
