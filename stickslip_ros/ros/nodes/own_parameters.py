# SPDX-License-Identifier: Apache-2.0
"""Parameters of nodes that are none of an axis. This needs no ROS."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from stickslip_ros.base.errors import UsageError
from stickslip_ros.emulator import CONTROLLERS


@dataclass(frozen=True)
class OwnParameter:
    """Name, default and meaning of a parameter; its type is that of the default.

    An empty list has no element type in ROS: the default of a list of texts is one empty text.
    """

    name: str
    default: Any
    description: str
    unit: str = ""
    #: a number lies between these, both included
    low: float = -math.inf
    high: float = math.inf
    off: str = ""  #: what 0 stands for, which is allowed then

    def check(self, value: Any) -> None:
        """Raise UsageError for a number out of range."""
        limited = -math.inf < self.low and isinstance(value, float)
        if not limited or self.low <= value <= self.high or (self.off and value == 0.0):
            return
        unit = f" {self.unit}" if self.unit else ""
        off = f", or be 0 for {self.off}" if self.off else ""
        raise UsageError(
            f"parameter {self.name} is {value:g}{unit}; "
            f"it has to lie between {self.low:g} and {self.high:g}{unit}{off}"
        )


#: Parameters of the process, not of an axis. An empty name stands for no axes.
AXES = OwnParameter("axes", [""], "names of the axes to host; none: one axis")
EMULATE = OwnParameter(
    "emulate", "", f"controller to emulate beside the topics, {', '.join(CONTROLLERS)}; empty: none"
)
EMULATE_PORT = OwnParameter(
    "emulate_port", -1, "its TCP port on loopback, -1: the controller's own, 0: a free one"
)
OF_PROCESS = (AXES, EMULATE, EMULATE_PORT)
