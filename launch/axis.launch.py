# SPDX-License-Identifier: Apache-2.0
"""One simulated axis, with a recorder beside it on request: `bringup.launch.py` without the rest.

ros2 launch stickslip_ros axis.launch.py config:=table1_vibration.yaml record:=true
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription


def generate_launch_description() -> LaunchDescription:
    bringup = Path(__file__).resolve().with_name("bringup.launch.py")
    return LaunchDescription([IncludeLaunchDescription(str(bringup))])
