# SPDX-License-Identifier: Apache-2.0
"""ROS from the user's side: an axis as an object in a program."""

from stickslip_ros.axis import CommandRefused
from stickslip_ros.ros.client.axis_client import AxisClient, AxisFault
from stickslip_ros.ros.client.listener import AxisListener

__all__ = ["AxisClient", "AxisFault", "AxisListener", "CommandRefused"]
