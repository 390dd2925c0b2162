# SPDX-License-Identifier: Apache-2.0
"""The wanted position over time, and what a trajectory has to be."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from itertools import pairwise

from stickslip_ros.physics.parameters import ParameterError

#: Points of a trajectory: a message of them stays below a megabyte
MOST_POINTS = 10_000
Point = tuple[float, float]  #: time since the start (s), measured position (m)


class Trajectory:
    """The wanted position over time; before the first point, the way to it."""

    def __init__(
        self,
        start: float,
        x: float,
        points: Sequence[Point],
        wait: float = 0.0,
        lasts: float = math.inf,
    ) -> None:
        """Begin at time start (s) and position x (m); the times of the points count from there.

        For a time of wait (s) nothing moves. After the time that it lasts (s), the runner stays
        where it is, unless it has reached the last point.
        """
        self.expires = start + lasts  #: s
        self.begin = start + wait  #: time until which nothing moves, s
        points = [(wait, x), *points] if wait else points
        self._times = [start, *(start + t for t, _ in points)]
        self._positions = [x, *(position for _, position in points)]
        self.start = start  #: s
        self.end = self._times[-1]  #: time of the last point, s
        self.goal = self._positions[-1]  #: position of the last point, m

    def at(self, t: float) -> float:
        """Return the position (m) at time t (s)."""
        k = bisect_right(self._times, t)
        if k == len(self._times):
            return self.goal
        t0, t1 = self._times[k - 1 : k + 1]
        x0, x1 = self._positions[k - 1 : k + 1]
        return x0 + (x1 - x0) * (t - t0) / (t1 - t0)

    def velocity_at(self, t: float) -> tuple[float, float]:
        """Return the velocity (m/s) at time t (s) and how long (s) until it changes."""
        k = bisect_right(self._times, t)
        if k == len(self._times):
            return 0.0, math.inf
        t0, t1 = self._times[k - 1 : k + 1]
        x0, x1 = self._positions[k - 1 : k + 1]
        return (x1 - x0) / (t1 - t0), t1 - t

    def too_fast(self, up: float, down: float) -> tuple[float, float]:
        """Return the fastest velocity (m/s) and the lag (m) where nothing goes so fast.

        up and down are the speeds (m/s) that can be reached in either direction. Both results are 0
        for a trajectory that can be followed. What jumps, at no time at all, counts as nothing.
        """
        fastest, lag, gap = 0.0, 0.0, 0.0
        for (t0, x0), (t1, x1) in pairwise(zip(self._times, self._positions, strict=True)):
            if t1 == t0:
                continue
            left, v = t1 - t0, (x1 - x0) / (t1 - t0)
            if gap:  # made up for first, if the way is slow enough
                closing = up - v if gap > 0.0 else down + v
                takes = abs(gap) / closing if closing > 0.0 else math.inf
                gap = 0.0 if takes <= left else gap - math.copysign(1.0, gap) * closing * left
                left = max(left - takes, 0.0)
            if not gap and not -down <= v <= up:
                gap = (v - up if v > 0.0 else v + down) * left
            if not -down <= v <= up:
                fastest = v if abs(v) > abs(fastest) else fastest
                lag = max(lag, abs(gap))
        return fastest, lag


def check_trajectory(
    joints: Sequence[str],
    points: Sequence[Point],
    joint: str,
    check_target: Callable[[float], None],
) -> list[Point]:
    """Return the points of a trajectory of the one joint; ParameterError if it is malformed."""
    if list(joints) != [joint]:
        raise ParameterError(f"trajectory for {', '.join(joints) or 'no joint'}; give {joint} only")
    if len(points) > MOST_POINTS:
        raise ParameterError(
            f"trajectory of {len(points)} points; {MOST_POINTS} is the limit: send it in parts, or "
            "leave points out; the axis moves straight between points"
        )
    if not points:
        raise ParameterError("trajectory without points; give at least one point")
    checked: list[Point] = []
    for number, point in enumerate(points, 1):
        if len(point) != 2:
            raise ParameterError(f"point {number} is {point!r}; give a time and a position")
        t, x = float(point[0]), float(point[1])
        before = checked[-1][0] if checked else 0.0
        if not (math.isfinite(t) and math.isfinite(x)):
            raise ParameterError(f"point {number} is ({t:g} s, {x:g} m); give finite numbers")
        if t < before or (checked and t == before):
            raise ParameterError(
                f"point {number} is at {t:g} s, not after {before:g} s: times have to increase"
            )
        try:
            check_target(x)
        except ParameterError as error:
            raise ParameterError(f"point {number}: {error}") from None
        checked.append((t, x))
    return checked
