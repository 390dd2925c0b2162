# SPDX-License-Identifier: Apache-2.0
"""Parameters of nodes that are none of an axis. This needs no ROS."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from stickslip_ros.emulator import CONTROLLERS


@dataclass(frozen=True)
class OwnParameter:
    """Name, default and meaning of a parameter; its type is that of the default.

    An empty list has no element type in ROS: the default of a list of texts is one empty text.
    """

    name: str
    default: Any
    description: str


#: Parameters of the process, not of an axis. An empty name stands for no axes.
AXES = OwnParameter("axes", [""], "names of the axes to host; none: one axis")
EMULATE = OwnParameter(
    "emulate", "", f"controller to emulate beside the topics, {', '.join(CONTROLLERS)}; empty: none"
)
EMULATE_PORT = OwnParameter(
    "emulate_port", -1, "its TCP port on loopback, -1: the controller's own, 0: a free one"
)
OF_PROCESS = (AXES, EMULATE, EMULATE_PORT)
