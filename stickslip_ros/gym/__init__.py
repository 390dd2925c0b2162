# SPDX-License-Identifier: Apache-2.0
"""Tasks and environments for those who design or learn the control of an axis.

``import stickslip_ros.gym`` registers the environments, where Gymnasium is installed (extra
``gym``); docs/control.md shows them.
"""

import contextlib

from stickslip_ros.gym.axis_batch import AxisBatch, DriveRanges, action_of
from stickslip_ros.gym.positioning import SCORES, TASKS, Positioning, Task, Weights

__all__ = [
    "SCORES", "TASKS", "AxisBatch", "DriveRanges", "Positioning", "Task", "Weights", "action_of",
]  # fmt: skip

with contextlib.suppress(ImportError):
    import gymnasium

    gymnasium.register(
        "stickslip_ros/Position-v0",
        entry_point="stickslip_ros.gym.environment:PositionEnv",
        vector_entry_point="stickslip_ros.gym.environment:PositionVectorEnv",
    )
