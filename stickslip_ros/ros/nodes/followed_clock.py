# SPDX-License-Identifier: Apache-2.0
"""The topic /clock, which leads the time of a node with ``use_sim_time``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node

from stickslip_ros.base.errors import UsageError

CLOCK_TOPIC, USE_SIM_TIME = "/clock", "use_sim_time"
_AGAIN = 10.0  # s between warnings that there is no clock, or none that counts
_FAR = 60_000_000_000  # ns: a clock that goes on by more at once may have been set
_LAST = (2**31 - 1) * 10**9  # ns, the last time that a stamp can hold


def follows(node: Node) -> bool:
    """Return whether a node has ``use_sim_time``. Raises UsageError where it is no bool."""
    value = node.get_parameter(USE_SIM_TIME).value
    if not isinstance(value, bool):
        raise UsageError(f"parameter {USE_SIM_TIME} is {value!r}; it has to be true or false")
    return value


def passing_over_negatives(node: Node, take: Callable[[Any], None]) -> Callable[[Any], None]:
    """Return what takes the messages of /clock for rclpy, which raises for times below 0."""

    def hear(message: Any) -> None:
        if message.clock.sec >= 0:
            take(message)
            return
        node.get_logger().warning(
            f"/clock says {message.clock.sec + 1e-9 * message.clock.nanosec:g} s, which is passed "
            "over: ROS knows no times before 0; have whoever publishes it begin at 0 or later",
            throttle_duration_sec=_AGAIN,
        )

    return hear


class FollowedClock:
    """Readings of /clock that never run back, for what cannot be undone."""

    def __init__(self, node: Node) -> None:
        """Take the clock of a node that has ``use_sim_time``."""
        self._node = node
        self._back = self._last = 0  # ns by which it was set back, and its last reading
        self._begun = False

    def missing(self) -> bool:
        """Return whether there is no time yet, and say so now and then."""
        # Later on, 0 is a time as any other: a simulator that starts anew.
        self._begun = self._begun or self._node.get_clock().now().nanoseconds > 0
        if self._begun:
            return False
        self._node.get_logger().warning(
            "waits for the first message on /clock, which leads the time; publish it, or leave "
            "out use_sim_time",
            throttle_duration_sec=_AGAIN,
        )
        return True

    def reading(self) -> int:
        """Return the time, ns, from where it was set back; 0: there is none yet."""
        now = self._node.get_clock().now().nanoseconds + self._back
        if now < self._last:
            self._node.get_logger().warning(
                f"/clock was set back by {1e-9 * (self._last - now):g} s; time goes on from where "
                "it was, ahead of it: start the node anew for the new time"
            )
            self._back, now = self._back + self._last - now, self._last
        now = min(now, _LAST)
        if self._last and now - self._last > _FAR:
            self._node.get_logger().warning(
                f"/clock went on by {1e-9 * (now - self._last):g} s at once, and all of it counts: "
                "start the node anew if that was a change of the clock"
            )
        self._last = now
        return self._last
