# SPDX-License-Identifier: Apache-2.0
"""My node under test, as a process beside an axis: `launch_test launch_test_my_node.py`."""

import sys
import unittest
from pathlib import Path

from launch import LaunchDescription
from launch.actions import ExecuteProcess, RegisterEventHandler
from launch_ros.actions import LifecycleNode
from launch_ros.event_handlers import OnStateTransition
from launch_testing.actions import ReadyToTest

from stickslip_ros.client import AxisClient


def generate_test_description():
    axis = LifecycleNode(
        package="stickslip_ros",
        executable="axis_node",
        name="stickslip_axis",
        namespace="",
        parameters=[{"frequency": 1000.0}],
    )
    mine = Path(__file__).with_name("my_node.py")
    guard = ExecuteProcess(cmd=[sys.executable, str(mine), "--ros-args", "-p", "farthest:=3.0e-6"])
    ready = OnStateTransition(
        target_lifecycle_node=axis, goal_state="active", entities=[ReadyToTest()], handle_once=True
    )
    return LaunchDescription([RegisterEventHandler(ready), guard, axis]), {"guard": guard}


class TestGuard(unittest.TestCase):
    def test_the_axis_is_stopped_where_it_may_not_go(self, proc_output, guard):
        with AxisClient() as axis:
            axis.send("jog", 1000.0)
            axis.wait_for_state("stopped")
            assert axis.position > 3e-6
        proc_output.assertWaitFor("stopped the axis at", process=guard, timeout=10)
