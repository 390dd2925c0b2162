# SPDX-License-Identifier: Apache-2.0
"""Checks the axis a hundred times a second: velocity, closed loop, ends of the travel."""

from __future__ import annotations

from stickslip_ros.axis.actuation import Actuation
from stickslip_ros.axis.closed_loop import ClosedLoop
from stickslip_ros.axis.tasks import AxisTask

#: Checks a second (Hz): a runner at 10 mm/s is caught within 0.1 mm
_RATE = 100.0


class Supervisor:
    """Checks one axis for faults."""

    def __init__(self) -> None:
        """Start at time 0 with the axis at rest at 0."""
        self.velocity = 0.0  #: mean between the last two checks, m/s
        self._x = 0.0  # at the last check, m
        self._number = 1  # of the next check
        self._hits = 0  # of the ends of the travel, as seen so far
        self._reported = False  # an end was hit in the present task

    @property
    def due(self) -> float:
        """Time (s) of the next check."""
        return self._number / _RATE

    def task_began(self, actuation: Actuation) -> None:
        """Report the next hit of an end: hits during the last task were reported already."""
        self._hits, self._reported = actuation.travel.hits, False

    def check(self, actuation: Actuation) -> str:
        """Check the present state; return the end of the travel that was hit, empty if none is new.

        An end that is hit again and again is reported once in a task.
        """
        self._number += 1
        x, hits = actuation.x, actuation.travel.hits
        self.velocity, self._x = (x - self._x) * _RATE, x
        new, self._hits = hits > self._hits and not self._reported, hits
        if not new:
            return ""
        self._reported = True
        limits = actuation.config.parameters.limits
        return "travel_high" if limits.travel_high - x < x - limits.travel_low else "travel_low"

    def fault(self, actuation: Actuation, task: AxisTask | None) -> str:
        """Return the reason of a fault: too fast, or the closed loop lost or stuck; else empty."""
        limit = actuation.config.parameters.limits.max_velocity
        if limit is not None and abs(self.velocity) > limit:
            return f"velocity is {self.velocity:g} m/s, the limit is {limit:g} m/s"
        return self._loop_fault(actuation, task) if isinstance(task, ClosedLoop) else ""

    def _loop_fault(self, actuation: Actuation, loop: ClosedLoop) -> str:
        p, config, t = actuation.config.parameters, actuation.config, actuation.t
        x = config.reading(actuation.sensed, config.sensor.number_at(t))
        limit = p.limits.max_following_error
        error = loop.trajectory.at(t) - x
        if limit is not None and loop.on_trajectory(t) and abs(error) > limit:
            return f"following error is {error:g} m, the limit is {limit:g} m"
        return loop.why_lost(x, actuation)
