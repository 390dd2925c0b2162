# SPDX-License-Identifier: Apache-2.0
"""A node as yours may be: it stops an axis that goes farther than it may.

    python my_node.py --ros-args -p farthest:=5.0e-6

`test_my_node.py` tests it with pytest, `launch_test_my_node.py` with launch_testing.
"""

from __future__ import annotations

import contextlib
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger


class Guard(Node):
    """Stops the axis once, when its runner is farther from 0 than the parameter `farthest` (m)."""

    def __init__(self, **options: Any) -> None:
        """Listen to the axis; options are those of a node, such as the context of a test."""
        super().__init__("guard", **options)
        self._farthest = self.declare_parameter("farthest", 5e-6).value
        self._stop = self.create_client(Trigger, "/stickslip_axis/stop")
        self.create_subscription(JointState, "/joint_states", self._on_state, 10)
        self.stopped = False

    def _on_state(self, message: JointState) -> None:
        x = message.position[message.name.index("axis_slider")]
        if abs(x) > self._farthest and not self.stopped:
            self.stopped = True
            self._stop.call_async(Trigger.Request())
            self.get_logger().info(f"stopped the axis at {1e6 * x:.2f} um")


if __name__ == "__main__":
    rclpy.init()
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(Guard())
