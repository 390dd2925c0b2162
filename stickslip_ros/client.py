# SPDX-License-Identifier: Apache-2.0
"""ROS from the user's side: an axis as an object in a program; the public name of `ros.client`."""

from stickslip_ros.ros.client import AxisClient, AxisFault, AxisListener, CommandRefused

__all__ = ["AxisClient", "AxisFault", "AxisListener", "CommandRefused"]
