# SPDX-License-Identifier: Apache-2.0
"""Trajectories of several axes: all of them take their part or none does, and they end together.

Each axis moves as it would alone, so its run repeats from its own events. But it says that the end
is reached only when all are there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from stickslip_ros.axis.axis import Axis
from stickslip_ros.axis.closed_loop import ClosedLoop
from stickslip_ros.axis.commands import COMMANDS
from stickslip_ros.parameters import ParameterError

TRAJECTORY = COMMANDS["trajectory"]


class Together:
    """The axes of a process by the names of their joints, and their common trajectories."""

    def __init__(self, axes: Sequence[Axis]) -> None:
        """Take the axes, which have one time."""
        self._axes = {axis.config.joint: axis for axis in axes}
        self._moves: list[list[tuple[Axis, ClosedLoop]]] = []

    def named(self, joints: Sequence[str]) -> list[Axis]:
        """Return the axes of joints; ParameterError if one is unknown or named twice."""
        for number, joint in enumerate(joints):
            if joint not in self._axes:
                raise ParameterError(f"no joint {joint!r} here; give {', '.join(self._axes)}")
            if joint in joints[:number]:
                raise ParameterError(f"joint {joint} is given twice; give it once")
        if not joints:
            raise ParameterError(f"trajectory for no joint; give some of {', '.join(self._axes)}")
        return [self._axes[joint] for joint in joints]

    def follow(self, parts: Mapping[str, tuple[Any, ...]]) -> None:
        """Let axes follow a trajectory from now on; parts: arguments of its command by joint.

        Raises ParameterError with the reason if one of them refuses; then none moves.
        """
        axes = self.named(list(parts))
        for axis in axes:
            joint = axis.config.joint
            if reason := axis.why_not(TRAJECTORY.name, *parts[joint]):
                raise ParameterError(f"{joint}: {reason}")
        move = []
        for axis in axes:
            axis.command(TRAJECTORY.name, *parts[axis.config.joint])
            if loop := axis.closed_loop:
                loop.waits = True
                move.append((axis, loop))
        self._moves.append(move)

    def end(self) -> None:
        """End the moves whose axes are all there; those that one has left go on alone."""
        for move in list(self._moves):
            still = [loop for axis, loop in move if axis.closed_loop is loop and loop.waits]
            if len(still) < len(move) or all(loop.there for loop in still):
                for loop in still:
                    loop.wait_no_more()
                self._moves.remove(move)
