# SPDX-License-Identifier: Apache-2.0
"""A simulated axis under ros2_control, with a joint_trajectory_controller; docs/ros2_control.md."""

from pathlib import Path

from launch import LaunchDescription
from launch.substitutions import Command
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description() -> LaunchDescription:
    here = Path(__file__).resolve().parent
    robot = ParameterValue(Command(["xacro ", str(here / "axis.urdf.xacro")]), value_type=str)
    return LaunchDescription(
        [
            # What may be missing on this machine comes first.
            Node(
                package="robot_state_publisher",
                executable="robot_state_publisher",
                parameters=[{"robot_description": robot}],
            ),
            Node(
                package="controller_manager",
                executable="ros2_control_node",
                parameters=[str(here / "controllers.yaml")],
                output="screen",
            ),
            Node(
                package="controller_manager",
                executable="spawner",
                arguments=["joint_state_broadcaster", "axis_controller"],
            ),
            Node(
                package="stickslip_ros",
                executable="axis_node",
                parameters=[{"frequency": 1000.0}],
                output="screen",
            ),
        ]
    )
