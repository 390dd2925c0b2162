# SPDX-License-Identifier: Apache-2.0
"""A nanorobot of three axes in one process, its model for RViz or Foxglove, and its task.

ros2 launch stickslip_ros nanorobot.launch.py square:=true
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, SetEnvironmentVariable
from launch.conditions import IfCondition
from launch.substitutions import EnvironmentVariable, LaunchConfiguration
from launch_ros.actions import Node

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"


def generate_launch_description() -> LaunchDescription:
    share = Path(get_package_share_directory("stickslip_ros"))
    robot = (share / "urdf" / "nanorobot.urdf").read_text(encoding="utf-8")
    return LaunchDescription(
        [
            # Nobody beyond this machine commands the axis, unless the user says so.
            SetEnvironmentVariable(RANGE, EnvironmentVariable(RANGE, default_value="LOCALHOST")),
            DeclareLaunchArgument("square", default_value="false", description="draw it"),
            # First, for it may not be installed: then nothing else runs or is left behind.
            Node(
                package="robot_state_publisher",
                executable="robot_state_publisher",
                parameters=[{"robot_description": robot}],
            ),
            Node(
                package="stickslip_ros",
                executable="axis_node",
                # Not among `parameters`: written to YAML there, y without quotes is read as "yes".
                ros_arguments=["-p", "axes:=[x, 'y', z]"],
                parameters=[{"frequency": 1000.0}],
                output="screen",
            ),
            Node(
                package="stickslip_ros",
                executable="square",
                condition=IfCondition(LaunchConfiguration("square")),
                output="screen",
            ),
        ]
    )
