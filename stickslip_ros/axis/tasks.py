# SPDX-License-Identifier: Apache-2.0
"""The tasks of an axis: a number of steps, a jog, a scan, the way home; and their supervisor.

A task starts motions of the actuator, and decides whether it is done when a motion has ended. The
closed loop is a task as well, see `closed_loop.py`. The supervisor checks the axis a hundred times
a second: velocity, closed loop, ends of the travel.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from stickslip_ros.axis.actuation import ENDLESS, RAMP, Actuation
from stickslip_ros.axis.closed_loop import ClosedLoop
from stickslip_ros.axis.command import HOMING, JOGGING, SCANNING, STEPPING

#: Checks of the supervisor a second (Hz): a runner at 10 mm/s is caught within 0.1 mm
_RATE = 100.0


class _OpenLoop:
    """A task of an axis; by itself, one whose motion is all of it."""

    state: str  #: of the axis during the task
    due = math.inf  #: time at which `tick` has to be called next, s

    def begin(self, actuation: Actuation) -> None:
        """Start the task; the actuator rests."""

    def arrived(self, actuation: Actuation) -> bool:
        """Go on after the motion has ended; return whether the task is done."""
        return True

    def tick(self, actuation: Actuation) -> str:
        """Do the work that is due; return the reason of a fault, or nothing."""
        return ""


AxisTask = _OpenLoop | ClosedLoop


@dataclass(eq=False)
class StepTask(_OpenLoop):
    """A number of steps."""

    steps: int  #: the sign is the direction
    state = STEPPING

    def begin(self, actuation: Actuation) -> None:
        actuation.step(self.steps)


@dataclass(eq=False)
class JogTask(_OpenLoop):
    """Stepping without end at the frequency of the jog."""

    hertz: float  #: the sign is the direction
    state = JOGGING

    def begin(self, actuation: Actuation) -> None:
        actuation.step(ENDLESS if self.hertz > 0.0 else -ENDLESS, hertz=abs(self.hertz))


@dataclass(eq=False)
class ScanTask(_OpenLoop):
    """The actuator goes to a level and stays there, or before a soft limit."""

    volts: float  #: the level
    note_limit: Callable[[str], None]  #: called with a soft limit that ends the scan early
    state = SCANNING

    def begin(self, actuation: Actuation) -> None:
        self._k = actuation.config.sensor.number_at(actuation.t)  # reading of the next check
        actuation.scan_to(self.volts * actuation.config.gain)
        self.tick(actuation)

    def tick(self, actuation: Actuation) -> str:
        """Stop if a soft limit could be passed before the next reading of the sensor is due."""
        self.due = math.inf
        if actuation.kind == RAMP:
            sensor = actuation.config.sensor
            if limit := actuation.ends_beyond(1.0 / sensor.rate):
                actuation.halt()
                self.note_limit(limit)
            else:
                self._k += 1
                self.due = sensor.time_of(self._k)
        return ""


@dataclass(eq=False)
class EndTask(_OpenLoop):
    """Steps to an end of the travel, which is home."""

    high: bool  #: the upper end
    note: Callable[..., None]  #: reports that it is there
    state = HOMING

    def begin(self, actuation: Actuation) -> None:
        self._sign = 1 if self.high else -1
        self._hits = actuation.travel.hits
        self._farthest, self._since = -math.inf, actuation.t  # on the way there, m, and since when
        actuation.step(self._sign * ENDLESS)
        self.due = actuation.t + 1.0 / _RATE

    def tick(self, actuation: Actuation) -> str:
        """End at the end; a fault where the runner gets no nearer to it for too long."""
        t, config, x = actuation.t, actuation.config, self._sign * actuation.x
        if actuation.travel.hits > self._hits:
            self.due = math.inf
            self.note("home", "finished", position=actuation.x)
            actuation.shorten()
            return ""
        self.due = t + 1.0 / _RATE
        if x > self._farthest + 0.01 * config.stroke(config.amplitude):
            self._farthest, self._since = x, t
        timeout = config.parameters.closed_loop.target_timeout
        if timeout is None or t - self._since < timeout + 1.0 / config.frequency:
            return ""
        return (
            f"the {'upper' if self.high else 'lower'} end of travel, which is home: the runner has "
            f"come no nearer for {timeout:g} s: raise the amplitude, free the runner or raise "
            "target_timeout"
        )


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

    def check(self, actuation: Actuation) -> None:
        """Take the velocity up to the present."""
        self._number += 1
        x = actuation.x
        self.velocity, self._x = (x - self._x) * _RATE, x

    def pass_by(self, actuation: Actuation, t: float) -> bool:
        """Leave out the checks up to time t (s); return False if one could find something.

        They cannot where the runner stands since the last one.
        """
        if self._x != actuation.x or self._hits != actuation.travel.hits:
            return False
        number, self._number = self._number, max(self._number, math.floor(t * _RATE))
        while self.due <= t:
            self._number += 1
        if self._number > number:
            self.velocity = 0.0
        return True

    def hit(self, actuation: Actuation) -> str:
        """Return the end of the travel that was hit since the last call, empty if none is new.

        An end that is hit again and again is reported once in a task.
        """
        x, hits = actuation.x, actuation.travel.hits
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
            return (
                f"velocity is {self.velocity:g} m/s, the limit is {limit:g} m/s: lower the "
                "frequency, the amplitude or the load, or raise max_velocity"
            )
        return task.why_lost(actuation) if isinstance(task, ClosedLoop) else ""
