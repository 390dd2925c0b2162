# SPDX-License-Identifier: Apache-2.0
"""Soft limits, ends of the travel, velocity and following error."""

import pytest
from table_1 import TABLE_1

from stickslip_ros.axis import Axis, CommandRefused, Event
from stickslip_ros.axis.commands import COMMANDS

FAST = {"frequency": 1000.0}
STROKE = 160e-9  # m


def _told(axis: Axis, name: str) -> list[Event]:
    return [event for event in axis.take_events() if event.name == name]


# -- soft limits


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("jog", [False, True])
def test_steps_end_before_the_cycle_that_could_cross(sign: int, jog: bool) -> None:
    """Not even the actuator's stroke within a cycle takes the runner beyond."""
    axis = Axis({**TABLE_1, "soft_low": -2e-6, "soft_high": 2e-6, **FAST})
    if jog:
        axis.command("jog", sign * 1000.0)
    else:
        axis.command("steps", sign * 1000)
    farthest = 0.0
    while axis.state.t < 0.1:
        axis.advance(axis.state.t + 5e-5)
        farthest = max(farthest, sign * axis.state.x)
    assert farthest < 2e-6
    assert sign * axis.state.x > 2e-6 - 2.0 * STROKE
    assert (axis.status.state, axis.status.limits_hit) == ("stopped", 1)
    events = axis.take_events()
    assert [f"{event.name} {event.outcome}" for event in events[-2:]] == [
        "limit hit",
        "move finished",
    ]
    assert events[-2].details["limit"] == ("soft_high" if sign > 0 else "soft_low")
    assert abs(events[-1].details["steps"]) == abs(axis.status.step_count) < 20


def test_targets_may_lie_within_the_travel_counted_from_the_zero() -> None:
    """What the description says of them is what the axis takes."""
    axis = Axis({**TABLE_1, **FAST})
    axis.command("steps", 2000)
    axis.advance(2.5)
    zero = axis.measured
    axis.command("zero")
    low, high = axis.parameters.limits.travel_low - zero, axis.parameters.limits.travel_high - zero
    position = COMMANDS["position"]
    assert position.limits
    assert position.limits(axis) == (low, high)
    assert axis.why_not("position", low) == ""
    assert axis.why_not("position", low - 1e-6)
    assert axis.why_not("position", high + 1e-6)


def test_at_a_soft_limit_only_the_way_back_is_open() -> None:
    axis = Axis({**TABLE_1, "soft_high": 1e-6, **FAST})
    axis.command("steps", 100)
    axis.advance(0.1)
    x = axis.state.x
    axis.command("steps", 5)
    assert axis.status.state == "stopped"
    axis.advance(0.2)
    assert axis.state.x == pytest.approx(x, abs=1e-9)
    assert axis.status.limits_hit == 2
    axis.command("steps", -5)
    axis.advance(0.3)
    assert axis.state.x < x - 5e-7


def test_a_soft_limit_set_on_the_way_holds_from_the_next_cycle() -> None:
    axis = Axis({**TABLE_1, **FAST})
    axis.command("steps", 100)
    axis.advance(0.0105)
    axis.command("parameters", {"soft_high": 1e-6})
    axis.advance(0.2)
    assert axis.status.steps_done == 11


@pytest.mark.parametrize("actuator", ["linear", "hysteresis"])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_scan_stops_before_a_soft_limit(sign: int, actuator: str) -> None:
    """At its level, within what it goes between two readings; the way back is open."""
    start = 0.0 if sign > 0 else 300.0
    axis = Axis({**TABLE_1, "actuator": actuator, **FAST})
    axis.command("scan", start)
    axis.advance(0.1)
    axis.command("zero")
    axis.command("parameters", {"soft_low": -5e-8, "soft_high": 5e-8})
    axis.take_events()
    axis.command("scan", 300.0 - start)
    farthest = 0.0
    while axis.state.t < 0.2:
        axis.advance(axis.state.t + 1e-4)
        farthest = max(farthest, sign * (axis.state.x - axis.status.zero_offset))
    assert 5e-8 - 1.5e-8 < farthest < 5e-8
    assert (axis.status.state, axis.status.limits_hit) == ("stopped", 1)
    level = axis.status.scan_level
    assert 50.0 < abs(level - start) < 150.0
    events = axis.take_events()
    assert [f"{event.name} {event.outcome}" for event in events] == [
        "scan applied",
        "limit hit",
        "scan finished",
    ]
    assert events[1].details["limit"] == ("soft_high" if sign > 0 else "soft_low")
    assert events[2].details["level"] == level
    axis.command("scan", 300.0 - start)
    assert (axis.status.state, axis.status.limits_hit) == ("stopped", 2)
    axis.command("scan", start)
    axis.advance(0.3)
    assert axis.status.scan_level == pytest.approx(start, abs=1e-9)
    assert axis.status.limits_hit == 2


@pytest.mark.parametrize("rate", [1e4, 1e9])
def test_a_scan_that_stays_within_the_soft_limits_is_left_alone(rate: float) -> None:
    """However fast it is."""
    axis = Axis({**TABLE_1, "soft_high": 5e-8, "scan_rate": rate})
    axis.command("scan", 90.0)
    axis.advance(0.1)
    assert axis.status.scan_level == pytest.approx(90.0)
    assert axis.status.limits_hit == 0


# -- ends of the travel


def test_an_end_that_lies_at_zero_is_named_by_its_side() -> None:
    """After a slip the runner lies below it. It is told before the move that ends there."""
    axis = Axis({**TABLE_1, "travel_high": 0.0, **FAST})
    axis.command("steps", 5)
    axis.advance(0.1)
    *_, hit, end = axis.take_events()
    assert (hit.details["limit"], axis.state.x < 0.0) == ("travel_high", True)
    assert (end.name, end.outcome) == ("move", "finished")


@pytest.mark.parametrize("sign", [1, -1])
def test_at_an_end_of_the_travel_the_runner_is_held_while_steps_go_on(sign: int) -> None:
    """It is told once a command and never passed."""
    axis = Axis({**TABLE_1, "travel_low": -1.5e-6, "travel_high": 1.5e-6, **FAST})
    axis.command("steps", sign * 50)
    farthest, held = 0.0, set()
    while axis.state.t < 0.06:
        axis.advance(axis.state.t + 5e-5)
        farthest = max(farthest, sign * axis.state.x)
        held.add(axis.status.held_at)
    assert farthest == 1.5e-6
    assert held == {"", "high" if sign > 0 else "low"}
    assert sign * axis.state.x > 1.4e-6
    assert (abs(axis.status.steps_done), axis.status.limits_hit) == (50, 1)
    (hit,) = _told(axis, "limit")
    assert hit.outcome == "hit"
    assert hit.details["limit"] == ("travel_high" if sign > 0 else "travel_low")
    axis.command("steps", sign * 5)
    axis.advance(0.1)
    assert axis.status.limits_hit == 2
    axis.command("steps", sign * -10)
    axis.advance(0.2)
    assert sign * axis.state.x < 0.5e-6
    assert len(_told(axis, "limit")) == 1


def test_a_load_takes_the_runner_to_the_end_and_is_told() -> None:
    axis = Axis({**TABLE_1, "travel_high": 1e-6})
    axis.command("load", 1.0)
    axis.advance(0.1)
    assert axis.state.x == 1e-6
    assert (axis.status.held_at, axis.status.limits_hit) == ("high", 1)


def test_a_target_that_the_end_of_the_travel_keeps_it_from_is_a_fault() -> None:
    """The sensor is 40 nm wrong there: the runner stands at the end and reads less."""
    axis = Axis(
        {**TABLE_1, "travel_high": 2.04e-6, "sensor_resolution": 1e-7, "sensor_noise": 0.0, **FAST}
    )
    axis.command("position", 2.04e-6)
    axis.advance(2.0)
    assert axis.status.state == "fault"
    assert "held by the high end of travel" in axis.status.fault


def test_targets_count_from_the_zero_and_end_with_the_travel() -> None:
    axis = Axis({**TABLE_1, "travel_low": -2e-6, "travel_high": 2e-6, **FAST})
    axis.command("steps", 10)
    axis.advance(0.1)
    axis.command("zero")
    for target in (1e-6, -3.5e-6):
        with pytest.raises(CommandRefused, match="travel and soft limits allow"):
            axis.command("position", target)
    axis.command("position", 5e-7)
    axis.advance(1.0)
    assert axis.state.x == pytest.approx(axis.status.zero_offset + 5e-7, abs=5e-9)


# -- velocity and following error


def test_too_fast_is_a_fault_until_it_is_reset() -> None:
    """134 nm a cycle: 600 Hz are below 100 um/s, 900 Hz above it."""
    axis = Axis({**TABLE_1, "max_velocity": 1e-4})
    axis.command("jog", 600.0)
    axis.advance(0.5)
    assert axis.status.velocity == pytest.approx(600 * 133e-9, rel=0.05)
    axis.command("jog", 900.0)
    axis.advance(1.0)
    status = axis.status
    assert (status.state, status.moving) == ("fault", False)
    assert "limit is 0.0001 m/s" in status.fault == status.last_error
    (fault,) = _told(axis, "fault")
    assert (fault.outcome, fault.details["reason"]) == ("fault", status.fault)
    assert 0.5 < fault.time < 0.53
    x = axis.state.x
    with pytest.raises(CommandRefused, match="reset it first"):
        axis.command("steps", 1)
    axis.command("reset")
    axis.command("steps", 1)
    axis.advance(1.1)
    assert axis.state.x > x


def test_a_held_target_that_is_lost_is_a_following_error() -> None:
    axis = Axis({**TABLE_1, "max_following_error": 3e-8, **FAST})
    axis.command("position", 1e-6)
    axis.advance(1.0)
    assert axis.status.state == "holding"
    axis.command("load", 0.5)
    axis.advance(1.05)
    assert axis.status.state == "fault"
    assert "following error" in axis.status.fault
