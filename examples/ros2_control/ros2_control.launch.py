# SPDX-License-Identifier: Apache-2.0
"""A simulated axis under ros2_control, with a joint_trajectory_controller; docs/ros2_control.md.

ros2 launch stickslip_ros ros2_control.launch.py
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import RegisterEventHandler
from launch.event_handlers import OnProcessIO
from launch.events.process import ProcessIO
from launch.substitutions import Command
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description() -> LaunchDescription:
    here = Path(__file__).resolve().parent
    axis = Node(
        package="stickslip_ros",
        executable="axis_node",
        # At 500 Hz a state is 2 ms old at most when the controller reads it.
        parameters=[{"frequency": 1000.0, "publish_rate": 500.0}],
        output="screen",
    )
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
            RegisterEventHandler(OnProcessIO(target_action=axis, on_stderr=Spawner().after)),
            axis,
        ]
    )


class Spawner:
    """Starts the controllers once, when the axis is ready.

    Controllers that are active before it take NaN as the position to hold.
    """

    def __init__(self) -> None:
        self._started = False

    def after(self, event: ProcessIO) -> list[Node]:
        """Return the spawner if this is what the axis says when it is ready."""
        if self._started or b" ready: " not in event.text:
            return []
        self._started = True
        return [
            Node(
                package="controller_manager",
                executable="spawner",
                arguments=["joint_state_broadcaster", "axis_controller"],
            )
        ]
