# SPDX-License-Identifier: Apache-2.0
"""The axis as a device: its commands, state, status and events. Does not use ROS."""

from stickslip_ros.axis.axis import Axis
from stickslip_ros.axis.command import AxisStatus
from stickslip_ros.axis.events import CommandRefused, Event
from stickslip_ros.axis.pace import Pace, Pacer

__all__ = ["Axis", "AxisStatus", "CommandRefused", "Event", "Pace", "Pacer"]
