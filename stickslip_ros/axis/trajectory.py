# SPDX-License-Identifier: Apache-2.0
"""The wanted position over time."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from operator import itemgetter

#: Points of a trajectory: a message of them stays below a megabyte
MOST_POINTS = 10_000
Point = tuple[float, float]  #: time since the start (s), measured position (m)


class Trajectory:
    """The wanted position over time; before the first point, the way to it."""

    def __init__(self, start: float, x: float, points: Sequence[Point], wait: float = 0.0) -> None:
        """Begin at time start (s) and position x (m); the times of the points count from there.

        For a time of wait (s) nothing moves.
        """
        #: s: from then on the runner stays where it is, unless it has reached the last point
        self.expires = math.inf
        self.begin = start + wait  #: time until which nothing moves, s
        points = [(wait, x), *points] if wait else points
        self._points = [(start, x), *((start + t, position) for t, position in points)]
        self.start = start  #: s
        self.end, self.goal = self._points[-1]  #: time (s) and position (m) of the last point

    def at(self, t: float) -> float:
        """Return the position (m) at time t (s)."""
        if t >= self.end:
            return self.goal
        (t0, x0), (t1, x1) = self._leg(t)
        return x0 + (x1 - x0) * (t - t0) / (t1 - t0)

    def velocity_at(self, t: float) -> tuple[float, float]:
        """Return the velocity (m/s) at time t (s) and how long (s) until it changes."""
        if t >= self.end:
            return 0.0, math.inf
        (t0, x0), (t1, x1) = self._leg(t)
        return (x1 - x0) / (t1 - t0), t1 - t

    def too_fast(self, up: float, down: float) -> tuple[float, float]:
        """Return the fastest velocity (m/s) and the lag (m) where nothing goes so fast.

        up and down are the speeds (m/s) that can be reached in either direction. Both results are 0
        for a trajectory that can be followed. What jumps, at no time at all, counts as nothing.
        """
        fastest, lag, gap = 0.0, 0.0, 0.0
        for (t0, x0), (t1, x1) in pairwise(self._points):
            if t1 == t0:
                continue
            left, v = t1 - t0, (x1 - x0) / (t1 - t0)
            if gap:  # made up for first, if the way is slow enough
                closing = up - v if gap > 0.0 else down + v
                takes = abs(gap) / closing if closing > 0.0 else math.inf
                gap = 0.0 if takes <= left else gap - math.copysign(1.0, gap) * closing * left
                left = max(left - takes, 0.0)
            if not -down <= v <= up:
                gap = gap or (v - up if v > 0.0 else v + down) * left
                fastest = max(fastest, v, key=abs)
                lag = max(lag, abs(gap))
        return fastest, lag

    def _leg(self, t: float) -> list[Point]:
        """Return the points before and after time t (s)."""
        k = bisect_right(self._points, t, key=itemgetter(0))
        return self._points[k - 1 : k + 1]
