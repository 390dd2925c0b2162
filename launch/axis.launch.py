# SPDX-License-Identifier: Apache-2.0
"""One simulated axis, with a recorder beside it on request.

ros2 launch stickslip_ros axis.launch.py config:=table1_vibration.yaml record:=true
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable
from launch.conditions import IfCondition
from launch.substitutions import EnvironmentVariable, LaunchConfiguration
from launch_ros.actions import Node

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(
        [
            # Nobody beyond this machine commands the axis, unless the user says so.
            SetEnvironmentVariable(RANGE, EnvironmentVariable(RANGE, default_value="LOCALHOST")),
            DeclareLaunchArgument(
                "namespace", default_value="", description="of both nodes: empty, or such as /left"
            ),
            DeclareLaunchArgument(
                "config",
                default_value="table1_typical.yaml",
                description="parameters of the axis: a path, or a file in the folder config",
            ),
            DeclareLaunchArgument("record", default_value="false", description="to a bag"),
            OpaqueFunction(function=axis),
            Node(
                package="stickslip_ros",
                executable="recorder_node",
                namespace=LaunchConfiguration("namespace"),
                # A relative name: the recorder takes it to be in its own namespace.
                parameters=[{"axis": "stickslip_axis"}],
                condition=IfCondition(LaunchConfiguration("record")),
                output="screen",
            ),
        ]
    )


def axis(context: LaunchContext) -> list[Node]:
    """Return the node; launch itself would pass over a file that is not there."""
    share = Path(get_package_share_directory("stickslip_ros"))
    # A full path stays as it is.
    config = share / "config" / LaunchConfiguration("config").perform(context)
    if not config.is_file():
        raise FileNotFoundError(f"config: there is no file {config}; name one with config:=FILE")
    return [
        Node(
            package="stickslip_ros",
            executable="axis_node",
            namespace=LaunchConfiguration("namespace"),
            parameters=[str(config)],
            output="screen",
        )
    ]
