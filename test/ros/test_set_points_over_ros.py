# SPDX-License-Identifier: Apache-2.0
"""The topics of ros2_control: a peer that reads and writes as JointStateTopicSystem does."""

import math
import time

import pytest
from live import MakeAxis, Ros
from rclpy.node import Node
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import JointState

from stickslip_ros.ros.axis_node import AxisNode

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
