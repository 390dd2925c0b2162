# SPDX-License-Identifier: Apache-2.0
"""A JointTrajectory message as points from now on: (time, position)."""

from __future__ import annotations

from rclpy.duration import Duration
from rclpy.time import Time
from trajectory_msgs.msg import JointTrajectory


class MalformedTrajectory(ValueError):
    """A trajectory whose form is wrong, whatever its numbers; the message names what."""


def points_of(message: JointTrajectory, now: int) -> list[tuple[float, float]]:
    """Return the points of a trajectory of one joint: s from now on, m.

    now is the stamp of the present time, ns. The trajectory begins at the stamp of its header, at
    once if that is 0; what of it lies in the past then is left out. Velocities, accelerations
    and efforts are not used: the closed loop goes from position to position.
    """
    begin = Time.from_msg(message.header.stamp).nanoseconds
    delay = begin - now if begin else 0
    points = []
    for number, point in enumerate(message.points, 1):
        if len(point.positions) != 1:
            raise MalformedTrajectory(
                f"point {number} has {len(point.positions)} positions; give one, for one joint"
            )
        at = delay + Duration.from_msg(point.time_from_start).nanoseconds
        if at >= 0 or not begin:
            points.append((at * 1e-9, float(point.positions[0])))
    if message.points and not points:
        raise MalformedTrajectory(
            f"all {len(message.points)} points lie in the past; give a header stamp of 0 to begin "
            "at once"
        )
    return points
