# SPDX-License-Identifier: Apache-2.0
"""One simulated axis, with a recorder beside it on request.

ros2 launch stickslip_ros axis.launch.py config:=table1_vibration.yaml record:=true
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    namespace = LaunchConfiguration("namespace")
    # A full path stays as it is; a bare name is looked up in the package's config folder.
    config = PathJoinSubstitution(
        [FindPackageShare("stickslip_ros"), "config", LaunchConfiguration("config")]
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "namespace", default_value="", description="of both nodes: empty, or such as /left"
            ),
            DeclareLaunchArgument(
                "config", default_value="table1_typical.yaml", description="parameters of the axis"
            ),
            DeclareLaunchArgument("record", default_value="false", description="to a bag"),
            Node(
                package="stickslip_ros",
                executable="axis_node",
                namespace=namespace,
                parameters=[config],
                output="screen",
            ),
            Node(
                package="stickslip_ros",
                executable="recorder_node",
                namespace=namespace,
                # A relative name: the recorder takes it to be in its own namespace.
                parameters=[{"axis": "stickslip_axis"}],
                condition=IfCondition(LaunchConfiguration("record")),
                output="screen",
            ),
        ]
    )
