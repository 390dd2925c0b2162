# SPDX-License-Identifier: Apache-2.0
"""ROS from the user's side: an axis as an object in a program, and a thread that spins nodes."""

from stickslip_ros.ros.client import AxisClient, AxisFault, AxisListener, CommandRefused
from stickslip_ros.ros.nodes.process import SpinThread

__all__ = ["AxisClient", "AxisFault", "AxisListener", "CommandRefused", "SpinThread"]
