# SPDX-License-Identifier: Apache-2.0
"""Trajectories and set points: refused as a whole, followed within two steps, held at the end."""

import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from table_1 import TABLE_1

from stickslip_ros.axis import Axis, CommandRefused, Event
from stickslip_ros.axis.axis import AxisGroup
from stickslip_ros.axis.events import event_texts
from stickslip_ros.axis.resimulation import Rerun
from stickslip_ros.axis.trajectory import Trajectory
from stickslip_ros.physics.parameters import ParameterError

JOINT = "axis_slider"
FAST = {"frequency": 1000.0}
#: Up, back, a rest and a slow bit
POINTS = [(0.3, 15e-6), (0.6, 2e-6), (0.8, 2e-6), (1.3, 3e-6)]


def test_it_follows_and_holds_the_last_point() -> None:
    axis = Axis({**TABLE_1, **FAST})
    axis.advance(0.5)
    axis.command("trajectory", [JOINT], POINTS)
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
    axis.command("steps", 20)
    axis.advance(1.0)
    start = axis.state.x
    axis.command("trajectory", [JOINT], [(0.1, start), (0.3, start + 4e-6)])
    for t, x in ((0.05, 0.0), (0.2, 2e-6), (0.25, 3e-6), (0.4, 4e-6)):
        axis.advance(1.0 + t)
        assert axis.status.target == pytest.approx(start + x, abs=1e-15)


def test_it_starts_from_a_scanned_level() -> None:
    """The level is brought back first; the course is caught up with."""
    axis = Axis({**TABLE_1, "scan_rate": 1e4, **FAST})
    axis.command("scan", 200.0)
    axis.advance(0.1)
    axis.command("trajectory", [JOINT], [(0.4, 5e-6)])
    axis.advance(0.4)
    assert abs(axis.status.following_error) < 4e-7
    axis.advance(1.0)
    assert axis.state.x == pytest.approx(5e-6, abs=5e-9)


def test_one_that_is_too_fast_is_a_following_error() -> None:
    axis = Axis({**TABLE_1, "max_following_error": 2e-6, **FAST})
    axis.command("trajectory", [JOINT], [(0.1, 10e-6)])
    axis.advance(0.09)
    assert axis.status.state == "targeting"
    axis.command("trajectory", [JOINT], [(0.1, 1e-3)])
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
]


@pytest.mark.parametrize(("joints", "points", "complaint"), BAD)
def test_a_malformed_trajectory_is_refused_as_a_whole(
    joints: list[str], points: list[Any], complaint: str
) -> None:
    axis = Axis({**TABLE_1, "soft_high": 5e-5})
    axis.command("steps", 50)
    axis.advance(0.015)
    with pytest.raises(CommandRefused) as refusal:
        axis.command("trajectory", joints, points)
    assert complaint in str(refusal.value)
    assert (axis.status.state, axis.status.steps_left) == ("stepping", 49)


def test_a_trajectory_that_begins_later_leaves_the_runner_where_it_is_until_then() -> None:
    axis = Axis({"frequency": 1000.0})
    axis.command("position", 3e-7)
    axis.advance(1.0)
    axis.command("trajectory", ["axis_slider"], [[1.0, 1e-6], [2.0, 2e-6]], 1.0)
    axis.advance(1.95)
    assert axis.state.x == pytest.approx(3e-7, abs=5e-9)
    axis.advance(2.5)
    assert axis.state.x == pytest.approx(1.5e-6, abs=3e-7)
    axis.advance(4.0)
    assert axis.state.x == pytest.approx(2e-6, abs=5e-9)


BLOCK = 0.01  # s, as of a node
HERTZ = 1000.0
NAMES = "xyz"
Points = list[tuple[float, list[float]]]


def three(seed: int = 0) -> list[Axis]:
    return [
        Axis({"axis_name": name, "frequency": HERTZ, "sensor_seed": seed + k, "soft_high": 1e-4})
        for k, name in enumerate(NAMES)
    ]


def parts(points: Points) -> dict[str, tuple[list[str], list[list[float]]]]:
    joints = [f"{name}_slider" for name in NAMES]
    return {j: ([j], [[t, x[k]] for t, x in points]) for k, j in enumerate(joints)}


def run(axes: Sequence[Axis], together: AxisGroup, t: float) -> None:
    """Let a time (s) pass, block by block."""
    start = axes[0].state.t
    for block in range(1, round(t / BLOCK) + 1):
        for axis in axes:
            axis.advance(start + block * BLOCK)
        together.end()


def finished(axis: Axis) -> list[tuple[float, float]]:
    """Return when (s) and where (m) trajectories of an axis have ended."""
    events = [event for event in axis.take_events() if event.outcome == "finished"]
    return [(event.time, axis.state.x) for event in events]


@pytest.mark.parametrize("count", [3, pytest.param(200, marks=pytest.mark.long)])
def test_axes_end_within_a_cycle_of_each_other_and_2_nm(count: int) -> None:
    lot = np.random.default_rng(count)
    for seed in range(count):
        axes = three(10 * seed)
        together = AxisGroup(axes)
        times = np.cumsum(lot.uniform(0.1, 0.4, lot.integers(1, 4))).tolist()
        points = [(t, lot.uniform(-8e-6, 8e-6, 3).tolist()) for t in times]
        together.follow(parts(points))
        run(axes, together, times[-1] + 0.4)
        (ends,) = zip(*map(finished, axes), strict=True)
        assert max(t for t, _ in ends) - min(t for t, _ in ends) <= 1.0 / HERTZ
        for (_, reached), wanted in zip(ends, points[-1][1], strict=True):
            assert reached == pytest.approx(wanted, abs=2e-9)


def test_each_moves_as_it_would_alone() -> None:
    """So its run repeats from its own events."""
    points: Points = [(0.2, [1e-6, 2e-6, -3e-6])]
    axes, alone = three(), three()
    together = AxisGroup(axes)
    together.follow(parts(points))
    for axis, part in zip(alone, parts(points).values(), strict=True):
        axis.command("trajectory", *part)
    run([*axes, *alone], AxisGroup([]), 0.4)
    assert {axis.status.state for axis in axes} == {"targeting"}
    assert {axis.status.state for axis in alone} == {"holding"}
    run([*axes, *alone], together, 0.2)
    assert {axis.status.state for axis in axes} == {"holding"}
    assert [axis.state for axis in axes] == [axis.state for axis in alone]


@pytest.mark.parametrize(
    ("changed", "complaint"),
    [
        ({"z_slider": (["z_slider"], [[0.1, 2e-4]])}, "z_slider: point 1: target is 0.0002 m"),
        ({"z_slider": (["z_slider"], [])}, "z_slider: trajectory without points"),
        ({"w_slider": (["w_slider"], [[0.1, 0.0]])}, "no joint 'w_slider' here; give x_slider"),
    ],
)
def test_one_bad_part_refuses_the_whole(changed: dict[str, tuple], complaint: str) -> None:
    axes = three()
    together = AxisGroup(axes)
    with pytest.raises(ParameterError) as refusal:
        together.follow({**parts([(0.1, [1e-6, 1e-6, 1e-6])]), **changed})
    assert complaint in str(refusal.value)
    assert {axis.status.state for axis in axes} == {"stopped"}
    for joints in ([], ["x_slider", "x_slider"]):
        with pytest.raises(ParameterError):
            together.named(joints)


def test_an_axis_in_fault_refuses_for_all() -> None:
    axes = three()
    axes[1].trip("a test")
    with pytest.raises(ParameterError, match="y_slider: the axis is in fault"):
        AxisGroup(axes).follow(parts([(0.1, [1e-6, 1e-6, 1e-6])]))
    assert axes[0].status.state == "stopped"


def test_those_that_one_has_left_end_alone() -> None:
    axes = three()
    together = AxisGroup(axes)
    together.follow(parts([(0.1, [1e-6, 1e-6, 1e-6])]))
    run(axes, together, 0.05)
    axes[2].command("stop")
    run(axes, together, 0.4)
    assert [axis.status.state for axis in axes] == ["holding", "holding", "stopped"]
    assert [len(finished(axis)) for axis in axes] == [1, 1, 0]


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
    """A controller that dies must not leave the runner on its way, however far it was to go."""
    for velocity, gone in ((1e-5, 1e-5), (1.0, None)):
        axis = Axis(FAST)
        _stream(axis, "velocity", [velocity])
        axis.advance(1.05)
        x = axis.state.x
        axis.advance(3.0)
        assert axis.mode == "holding"
        assert axis.state.x == pytest.approx(x, abs=1e-6)
        assert axis.state.x == pytest.approx(gone or x, abs=2e-7)
    assert [event.outcome for event in axis.take_events() if event.name == "joint_command"] == [
        "applied", "warned",
    ]  # fmt: skip


def test_a_set_point_turns_a_velocity_at_once() -> None:
    """It went 45 um farther the wrong way, and the steps that the loop ordered were a fault."""
    axis = Axis(FAST)
    _stream(axis, "velocity", [1.0] * 180)
    x = axis.state.x
    _stream(axis, "position", [5e-6])
    furthest = max(_positions(axis, 2.0))
    assert furthest < x + 2e-6 and axis.mode == "holding"
    assert axis.state.x == pytest.approx(5e-6, abs=4e-9)


def _positions(axis: Axis, seconds: float) -> list[float]:
    begin, found = axis.state.t, []
    for k in range(1, 101):
        axis.advance(begin + 0.01 * k * seconds)
        found.append(axis.state.x)
    return found


def test_a_velocity_ends_at_the_soft_limit() -> None:
    axis = Axis({**FAST, "soft_high": 5e-6})
    _stream(axis, "velocity", [2e-5] * 100)
    assert axis.state.x == pytest.approx(5e-6, abs=4e-9)
    assert axis.status.fault == ""


@pytest.mark.parametrize("moved", [0.0, 1.7e-6])
def test_commanding_back_what_was_read_moves_nothing(moved: float) -> None:
    """At rest and in closed loop, for two seconds of 100 readings a second."""
    axis = Axis(FAST)
    axis.command("zero")
    if moved:
        axis.command("position", moved)
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


def test_a_set_point_is_held_against_the_reading_not_the_truth() -> None:
    """A sensor that had drifted by 1 um hid a way of 1 um, and its own reading was one."""
    axis = Axis({**FAST, "sensor_drift": 1e-7})
    axis.advance(10.0)
    axis.take_events()
    axis.command("joint_command", JOINT, "position", axis.measured)
    assert (axis.take_events(), axis.mode) == ([], "stopped")
    axis.command("joint_command", JOINT, "position", 0.0)
    assert axis.mode == "targeting"


def test_a_set_point_out_of_reach_is_refused() -> None:
    axis = Axis({**FAST, "soft_high": 1e-6})
    with pytest.raises(CommandRefused, match="soft limits allow"):
        axis.command("joint_command", JOINT, "position", 2e-6)
    with pytest.raises(CommandRefused, match="has to be a finite number"):
        axis.command("joint_command", JOINT, "velocity", math.inf)


def test_set_points_take_over_from_a_jog_and_come_out_again_bit_for_bit() -> None:
    axis = Axis(FAST)
    axis.command("jog", 700.0)
    axis.advance(0.0333)
    _stream(axis, "position", [4e-6 + 1e-7 * k for k in range(30)])
    _stream(axis, "velocity", [-1e-5] * 30)
    axis.command("trajectory", [JOINT], [[0.3, 1e-6], [0.5, 2e-6]], 0.1)
    axis.advance(axis.state.t + 0.2)
    axis.command("trajectory", [JOINT], [(0.2, 1e-6)])
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
    axis.command("trajectory", [JOINT], [(1e304, 1e-6)])
    axis.advance(0.5)
    events = [Event.of(event_texts(event)) for event in axis.take_events()]
    again = Rerun([event for event in events if event]).advance(0.5)
    assert again.state == axis.state


def test_a_trajectory_that_is_too_fast_is_warned_of_when_it_comes() -> None:
    """It had lagged in silence; what was said is what the steps reach under the load."""
    for load in (0.0, 0.05):
        axis = Axis({**TABLE_1, "frequency": 1000.0})
        axis.command("load", load)
        axis.command("jog", -1000.0)
        axis.advance(0.2)
        begin = axis.state.x
        axis.advance(1.2)
        down = begin - axis.state.x
        axis.command("stop")
        axis.advance(1.5)
        axis.take_events()
        x = axis.status.position
        axis.command("trajectory", ["axis_slider"], [(1.0, x - 0.9 * down), (1.5, x - 0.9 * down)])
        assert [event.outcome for event in axis.take_events()] == ["applied"]
        axis.command("trajectory", ["axis_slider"], [(1.0, x - 1.5 * down), (2.0, x - 1.5 * down)])
        _, warning = axis.take_events()
        assert warning.outcome == "warned" and warning.level == 1
        found = re.search(
            r"at -(\S+) um/s, (\S+) um/s .* stay (\S+) um behind", warning.details["reason"]
        )
        assert found
        wanted, reached, lag = map(float, found.groups())
        assert wanted == pytest.approx(1.5e6 * down, rel=1e-3)
        assert reached == pytest.approx(1e6 * down, rel=0.02)
        assert lag == pytest.approx(wanted - reached, rel=0.02)


@pytest.mark.parametrize(
    ("points", "fastest", "lag"),
    [
        ([(1.0, 1.0), (2.0, -1.0)], 0.0, 0.0),
        ([(1.0, 3.0), (2.0, 3.0)], 3.0, 1.0),  # 2 m/s upwards
        ([(1.0, -5.0)], -5.0, 3.0),  # and 2 m/s downwards
        ([(1.0, 3.0), (2.0, 6.0)], 3.0, 2.0),  # it adds up
        ([(1.0, 3.0), (3.0, 3.0), (4.0, 6.0)], 3.0, 1.0),  # or is made up for
        ([(0.0, 9.0), (1.0, 9.0)], 0.0, 0.0),  # a target, for which there is no time
    ],
)
def test_what_cannot_be_followed(
    points: list[tuple[float, float]], fastest: float, lag: float
) -> None:
    assert Trajectory(0.0, 0.0, points).too_fast(2.0, 2.0) == (fastest, lag)
