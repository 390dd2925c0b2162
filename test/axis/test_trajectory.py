# SPDX-License-Identifier: Apache-2.0
"""Trajectories: refused as a whole when malformed, followed within two steps, held at the end."""

from typing import Any

import pytest
from table_1 import TABLE_1

from stickslip_ros.axis import Axis, CommandRefused

JOINT = "axis_slider"
FAST = {"frequency": 1000.0}
#: Up, back, a rest and a slow bit
POINTS = [(0.3, 15e-6), (0.6, 2e-6), (0.8, 2e-6), (1.3, 3e-6)]


def test_it_follows_and_holds_the_last_point() -> None:
    axis = Axis({**TABLE_1, **FAST})
    axis.advance(0.5)
    axis.command_trajectory([JOINT], POINTS)
    assert axis.status.state == "targeting"
    largest = 0.0
    while axis.state.t < 0.5 + 1.3:
        axis.advance(axis.state.t + 0.7e-3)
        largest = max(largest, abs(axis.status.following_error))
    assert largest < 4e-7  # two steps and the stroke of the actuator
    axis.advance(2.5)
    assert axis.status.state == "holding"
    assert axis.state.x == pytest.approx(3e-6, abs=5e-9)
    finished = [event for event in axis.take_events() if event.outcome == "finished"]
    assert [event.name for event in finished] == ["trajectory"]
    assert 1.8 < finished[0].time < 2.1


def test_the_course_lies_on_straight_lines_from_where_the_axis_is() -> None:
    axis = Axis({**TABLE_1, "sensor_noise": 0.0, "sensor_resolution": 0.0, **FAST})
    axis.command_steps(20)
    axis.advance(1.0)
    start = axis.state.x
    axis.command_trajectory([JOINT], [(0.1, start), (0.3, start + 4e-6)])
    for t, x in ((0.05, 0.0), (0.2, 2e-6), (0.25, 3e-6), (0.4, 4e-6)):
        axis.advance(1.0 + t)
        assert axis.status.target == pytest.approx(start + x, abs=1e-15)


def test_it_starts_from_a_scanned_level() -> None:
    """The level is brought back first; the course is caught up with."""
    axis = Axis({**TABLE_1, "scan_rate": 1e4, **FAST})
    axis.command_scan(200.0)
    axis.advance(0.1)
    axis.command_trajectory([JOINT], [(0.4, 5e-6)])
    axis.advance(0.4)
    assert abs(axis.status.following_error) < 4e-7
    axis.advance(1.0)
    assert axis.state.x == pytest.approx(5e-6, abs=5e-9)


def test_one_that_is_too_fast_is_a_following_error() -> None:
    axis = Axis({**TABLE_1, "max_following_error": 2e-6, **FAST})
    axis.command_trajectory([JOINT], [(0.1, 10e-6)])
    axis.advance(0.09)
    assert axis.status.state == "targeting"
    axis.command_trajectory([JOINT], [(0.1, 1e-3)])
    axis.advance(0.2)
    assert axis.status.state == "fault"
    assert "following error is" in axis.status.fault
    assert "limit is 2e-06 m" in axis.status.fault


BAD: list[tuple[list[str], list[Any], str]] = [
    ([], POINTS, "for no joint; give axis_slider only"),
    (["other"], POINTS, "for other; give axis_slider"),
    ([JOINT, "other"], POINTS, "for axis_slider, other; give"),
    ([JOINT], [], "without points"),
    ([JOINT], [(0.1, 1e-6), (0.1, 2e-6)], "point 2 is at 0.1 s, not after 0.1 s"),
    ([JOINT], [(0.2, 1e-6), (0.1, 2e-6)], "point 2 is at 0.1 s, not after 0.2 s"),
    ([JOINT], [(-0.1, 1e-6)], "point 1 is at -0.1 s"),
    ([JOINT], [(0.1, 1e-6), (float("nan"), 2e-6)], "point 2 is (nan s, 2e-06 m)"),
    ([JOINT], [(0.1, float("inf"))], "point 1 is (0.1 s, inf m)"),
    ([JOINT], [(0.1, 1e-6), (0.2, 0.02)], "point 2: target is 0.02 m"),
    ([JOINT], [(0.1, 6e-5)], "point 1: target is 6e-05 m"),
    ([JOINT], [(0.1, 1e-6, 5.0)], "give a time and a position"),
]


@pytest.mark.parametrize(("joints", "points", "complaint"), BAD)
def test_a_malformed_trajectory_is_refused_as_a_whole(
    joints: list[str], points: list[Any], complaint: str
) -> None:
    axis = Axis({**TABLE_1, "soft_high": 5e-5})
    axis.command_steps(50)
    axis.advance(0.015)
    with pytest.raises(CommandRefused) as refusal:
        axis.command_trajectory(joints, points)
    assert complaint in str(refusal.value)
    assert (axis.status.state, axis.status.steps_left) == ("stepping", 49)


def test_a_trajectory_that_begins_later_leaves_the_runner_where_it_is_until_then() -> None:
    axis = Axis({"frequency": 1000.0})
    axis.command_position(3e-7)
    axis.advance(1.0)
    axis.command("trajectory", ["axis_slider"], [[1.0, 1e-6], [2.0, 2e-6]], 1.0)
    axis.advance(1.95)
    assert axis.state.x == pytest.approx(3e-7, abs=5e-9)
    axis.advance(2.5)
    assert axis.state.x == pytest.approx(1.5e-6, abs=3e-7)
    axis.advance(4.0)
    assert axis.state.x == pytest.approx(2e-6, abs=5e-9)
