# SPDX-License-Identifier: Apache-2.0
"""The axis as a device: its commands, state, status and events. Does not use ROS.

Each name is loaded when it is used: a client needs the registry of commands, but no solver.
"""

from typing import TYPE_CHECKING

from stickslip_ros.base.lazy_names import lazy_names

_PLACES = {
    "axis": "Axis",
    "command": "AxisStatus",
    "events": "CommandRefused Event",
    "pace": "Pace",
}

if TYPE_CHECKING:
    from stickslip_ros.axis.axis import Axis
    from stickslip_ros.axis.command import AxisStatus
    from stickslip_ros.axis.events import CommandRefused, Event
    from stickslip_ros.axis.pace import Pace
else:
    __getattr__ = lazy_names(__name__, _PLACES)

__all__ = ["Axis", "AxisStatus", "CommandRefused", "Event", "Pace"]
