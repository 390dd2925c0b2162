# SPDX-License-Identifier: Apache-2.0
"""What an axis publishes is one table; set points have a log of their own, for late recorders."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from live import MakeAxis, Ros
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from stickslip_ros.axis.command import JOINT_STATE
from stickslip_ros.recordings import BagReader, open_bag, resimulate
from stickslip_ros.ros.client import AxisClient
from stickslip_ros.ros.nodes.recorder_node import RecorderNode
from stickslip_ros.ros.nodes.topics import EVENTS, OUTPUTS, OutputTopic

Record = Callable[[Callable[[], Any]], BagReader]
HEAT = OutputTopic("~/heat", JOINT_STATE, "heat", joints=lambda *_: [("_contact", 1e-9, 0.0, 0.0)])


@pytest.fixture
def record(ros: Ros, tmp_path: Path) -> Record:
    """Give a function that records while another one runs, and opens the bag."""

    def during(action: Callable[[], Any]) -> BagReader:
        wanted = Parameter("output", value=str(tmp_path / "bag"))
        recorder = RecorderNode(context=ros.context, parameter_overrides=[wanted])
        ros.add(recorder)
        action()
        user = ros.node("who_stops")
        assert ros.call(user, Trigger, "/stickslip_recorder/stop", Trigger.Request()).success
        return open_bag(tmp_path / "bag")

    return during


def test_a_new_topic_is_a_line_of_the_table_and_stands_in_a_bag(
    ros: Ros, make_axis: MakeAxis, monkeypatch: pytest.MonkeyPatch, record: Record
) -> None:
    monkeypatch.setitem(OUTPUTS, HEAT.name, HEAT)
    axis = make_axis()

    def wait() -> None:
        ros.wait_until(lambda: axis.count_subscribers("/stickslip_axis/heat"), "the recorder")
        since = axis.axis.state.t
        ros.wait_until(lambda: axis.axis.state.t > since + 0.1, "ten states")

    bag = record(wait)
    assert bag.counts["/stickslip_axis/heat"] > 0
    assert bag.counts["/stickslip_axis/joint_states"] > 0  # what ros2_control reads


@pytest.mark.long
@pytest.mark.parametrize("kept", [30, pytest.param(1000, marks=pytest.mark.long)])
def test_a_late_recorder_has_what_it_takes_to_repeat_a_run_under_ros2_control(
    ros: Ros, make_axis: MakeAxis, record: Record, monkeypatch: pytest.MonkeyPatch, kept: int
) -> None:
    """As many set points as would push the start out of the log of events."""
    monkeypatch.setitem(OUTPUTS, EVENTS.name, replace(EVENTS, kept=kept))
    axis = make_axis(frequency=1000.0)
    heard = ros.hear(DiagnosticArray, "/stickslip_axis/set_points")
    node = ros.node("controller")
    out = ros.publisher(node, JointState, "/stickslip_axis/joint_commands", 1)

    def have(count: int) -> bool:
        return sum(len(one.status) for one in list(heard)) >= count

    def send(first: int, count: int) -> None:
        for k in range(first, first + count):
            out.publish(JointState(name=["axis_slider"], position=[1e-8 * k]))
            ros.wait_until(partial(have, k), "the set point in force")

    AxisClient(node=ros.node("user")).send("amplitude", 250.0)

    def send_more() -> None:
        """And let the second pass in which the axis logs what came before its new reader."""
        send(kept + 31, 60)
        since = axis.axis.state.t
        ros.wait_until(lambda: axis.axis.state.t > since + 1.2, "the log of set points")

    send(1, kept + 30)
    bag = record(send_more)
    (run,) = resimulate(bag)
    assert run.commands == kept + 91
    assert run.states > 50
    assert run.bit_for_bit


def test_set_points_of_nan_are_counted_and_warned_of_once(ros: Ros, make_axis: MakeAxis) -> None:
    make_axis()
    client = AxisClient(node=ros.node("user"))
    node = ros.node("controller")
    out = ros.publisher(node, JointState, "/stickslip_axis/joint_commands", 1)
    said = ros.hear(DiagnosticArray, "/diagnostics")
    ros.wait_until(lambda: said, "diagnostics")
    for _ in range(3):
        ros.send(out, JointState(name=["axis_slider"], position=[math.nan]))
    ros.wait_until(lambda: "set points of NaN ignored" in str(said[-1]), "the count")
    assert client.state == "stopped"


def test_states_are_published_to_those_who_subscribe_only(ros: Ros, make_axis: MakeAxis) -> None:
    """Messages for nobody cost half of an axis at 1 kHz."""
    axis = make_axis()
    ros.wait_until(lambda: axis.axis.state.t > 0.5, "fifty states")
    numbers: list[int] = []

    def hear(message: JointState, info: dict[str, int]) -> None:
        numbers.append(info["publication_sequence_number"])

    node = ros.node("late")
    node.create_subscription(JointState, "/joint_states", hear, 10)  # type: ignore[arg-type]
    ros.wait_until(lambda: numbers, "a state")
    assert numbers[0] < 25
