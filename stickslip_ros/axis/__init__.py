# SPDX-License-Identifier: Apache-2.0
"""The axis as a device: what it is told to do and what it says of itself. Knows no ROS."""

from stickslip_ros.axis.axis import Axis
from stickslip_ros.axis.events import CommandRefused, Event
from stickslip_ros.axis.status import AxisStatus
from stickslip_ros.axis.timing import Pacer, Timeline

__all__ = ["Axis", "AxisStatus", "CommandRefused", "Event", "Pacer", "Timeline"]
