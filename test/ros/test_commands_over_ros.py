# SPDX-License-Identifier: Apache-2.0
"""A new command, set points as ros2_control sends them, and faults on demand."""

import math
import time

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from heard import Heard
from live import MakeAxis, Ros
from rclpy.node import Node
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import JointState
from table_1 import TABLE_1

from stickslip_ros.axis import Axis, Event
from stickslip_ros.axis.command import FLOAT64, SCANNING, Command, row
from stickslip_ros.axis.commands import COMMANDS, state_table
from stickslip_ros.axis.resimulation import Rerun
from stickslip_ros.axis.tasks import ScanTask
from stickslip_ros.ros.client import AxisClient, AxisFault, CommandRefused
from stickslip_ros.ros.nodes.axis_node import AxisNode
from stickslip_ros.ros.nodes.recording import axis_topics

#: Moves the level of the actuator by a share of the highest voltage.
SHARE = Command(
    "share",
    FLOAT64,
    "level as a share of the highest voltage",
    row(SCANNING),
    check=lambda axis, share: axis.config.check_level(share * axis.parameters.actuator.max_voltage),
    task=lambda axis, share: ScanTask(
        share * axis.parameters.actuator.max_voltage, axis.note_limit
    ),
    limits=lambda p: (0.0, 1.0),
)


@pytest.fixture
def registered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(COMMANDS, SHARE.name, SHARE)


@pytest.mark.usefixtures("registered")
def test_an_axis_carries_it_out_and_refuses_it() -> None:
    axis = Axis(TABLE_1)
    axis.command("share", 0.5)
    assert axis.mode == "scanning"
    axis.advance(1.0)
    assert axis.status.scan_level == pytest.approx(150.0)
    with pytest.raises(CommandRefused, match="330 V"):
        axis.command("share", 1.1)
    axis.command("enable", False)
    with pytest.raises(CommandRefused, match="enable it first"):
        axis.command("share", 0.5)
    assert state_table()["share"]["fault"] == "refused"


@pytest.mark.usefixtures("registered")
def test_node_client_recorder_and_resimulation_know_it(ros: Ros) -> None:
    node = AxisNode(context=ros.context, given=TABLE_1)
    ros.add(node)
    heard = Heard(ros)
    client = AxisClient(node=ros.node("user"))
    client.send("share", 0.25).wait()
    assert client.status["scan level (V)"] == repr(75.0)
    with pytest.raises(CommandRefused, match="share refused: "):
        client.send("share", 2.0)
    ros.wait_until(lambda: len(heard.events) == 4, "start, applied, finished, refused")

    assert axis_topics("/stickslip_axis")["/stickslip_axis/command/share"] == FLOAT64
    events = [Event.of(values) for _, values in heard.events]
    start, applied, finished, _ = filter(None, events)
    again = Rerun([start, applied]).advance(finished.time + 1e-9)
    assert again.take_events() == [start, applied, finished]
    described = ros.hear(DiagnosticArray, "/stickslip_axis/description", ros.latched(1))
    ros.wait_until(lambda: described, "the description")
    texts = {status.name: status.message for status in described[0].status}
    assert texts["stickslip_axis: command share"] == SHARE.meaning


PERIOD = 0.01  # s, of the controller manager


class Hardware:
    """Keeps the last message of its state topic; writes all its joints in one message.

    Its state topic is subscribed as sensor data, its commands leave with depth 1, and without a
    controller the commands are NaN.
    """

    def __init__(self, node: Node, axis: str, joints: list[str]) -> None:
        self.joints = joints
        self.state: dict[str, float] = {}
        self._out = node.create_publisher(JointState, f"{axis}/joint_commands", QoSProfile(depth=1))
        node.create_subscription(
            JointState, f"{axis}/joint_states", self._keep, qos_profile_sensor_data
        )

    def _keep(self, message: JointState) -> None:
        self.state = dict(zip(message.name, message.position, strict=True))

    def write(self, *positions: float) -> None:
        self._out.publish(JointState(name=self.joints, position=positions))
        time.sleep(PERIOD)


@pytest.fixture
def node(make_axis: MakeAxis) -> AxisNode:
    return make_axis(frequency=1000.0)


def test_set_points_move_the_axis_and_nothing_else_does(ros: Ros, node: AxisNode) -> None:
    hardware = Hardware(ros.node("hardware"), "/stickslip_axis", ["other", "axis_slider"])
    ros.wait_until(lambda: hardware.state, "the state of the joint")
    for _ in range(10):
        hardware.write(5e-6, math.nan)  # no controller yet
        hardware.write(5e-6)  # short
    assert (node.axis.mode, node.axis.status.refused) == ("stopped", 0)
    for _ in range(20):
        hardware.write(0.0, hardware.state["axis_slider"])  # a controller that starts
    assert node.axis.state.x == 0.0
    for k in range(101):
        hardware.write(0.0, 2e-8 * k)
    # On a slow machine it holds on the way, until the next set point comes.
    ros.wait_until(
        lambda: node.axis.mode == "holding" and node.axis.state.x == pytest.approx(2e-6, abs=5e-9),
        "the end of the motion",
    )
    for _ in range(100):
        hardware.write(0.0, hardware.state["axis_slider"])
    assert node.axis.state.x == pytest.approx(2e-6, abs=5e-9)
    assert hardware.state["axis_slider"] == pytest.approx(2e-6, abs=5e-9)
    hardware.write(0.0, 1.0)
    ros.wait_until(lambda: node.axis.status.refused == 1, "the refusal")


def test_faults_are_seen_over_ros_and_end(ros: Ros, make_axis: MakeAxis) -> None:
    """One of each way to see them: in status and report, refused, in a fault, too late."""
    make_axis(frequency=1000.0, allow_faults=True)
    heard = Heard(ros)
    client = AxisClient(node=ros.node("user"))
    with client.fault("axis_stall 3"):
        assert client.send("steps", 200).wait().steps_done == 200
        assert client.position < 1e-6
        assert "axis_stall" in client.status["injected faults"]
    with client.fault("sensor_dropout"):
        with pytest.raises(AxisFault, match="the sensor gives no reading"):
            client.send("position", 2e-6).wait()
        client.send("reset")
        assert math.isnan(float(client.report()["axis"]["measured position (m)"]))
    with client.fault("refuse"), pytest.raises(CommandRefused, match="injected fault refuse"):
        client.send("steps", 1)
    with client.fault("late 0.3"):
        begin = time.monotonic()
        client.send("stop")
        assert time.monotonic() - begin > 0.3
    assert client.status["injected faults"] == ""
    client.send("steps", 5).wait()
    assert heard.compare_with_rerun() > 20


def test_an_axis_that_vanishes_says_and_answers_nothing_and_comes_back(
    ros: Ros, make_axis: MakeAxis
) -> None:
    make_axis(frequency=1000.0, allow_faults=True)
    heard = Heard(ros)
    client = AxisClient(node=ros.node("user"))
    client.send("steps", 10).wait()
    client.timeout = 1.0
    with client.fault("vanish"):
        seen = len(heard.joints)
        for send in (lambda: client.send("steps", 1), lambda: client.send("stop")):
            with pytest.raises(TimeoutError, match="does not answer"):
                send()
        assert len(heard.joints) <= seen + 1
    client = AxisClient(node=ros.node("user_again"))
    client.send("steps", 5).wait()
    assert client.steps_done == 5
    heard.event("injected fault", "ended")
    assert heard.compare_with_rerun() > 5


def test_faults_have_to_be_allowed(node: AxisNode, ros: Ros) -> None:
    with pytest.raises(CommandRefused, match="start the axis with allow_faults"):
        AxisClient(node=ros.node("user")).inject("axis_stuck")
