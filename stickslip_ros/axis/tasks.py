# SPDX-License-Identifier: Apache-2.0
"""Open-loop tasks of an axis: a number of steps, a jog, a scan.

A task starts motions of the actuator, and decides whether it is done when a motion has ended. The
closed loop is a task as well, see `closed_loop.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from stickslip_ros.axis import state_machine
from stickslip_ros.axis.actuation import ANY, RAMP, Actuation


class AxisTask(Protocol):
    """The execution of one command by an axis."""

    @property
    def state(self) -> str:
        """State of the axis during the task."""

    @property
    def due(self) -> float:
        """Time at which `tick` has to be called next, s."""

    def begin(self, actuation: Actuation) -> None:
        """Start the task; the actuator rests."""

    def arrived(self, actuation: Actuation) -> bool:
        """Go on after the motion has ended; return whether the task is done."""

    def tick(self, actuation: Actuation) -> str:
        """Do the work that is due; return the reason of a fault, or nothing."""


class _OpenLoop:
    """A task whose motion is all of it."""

    due = math.inf

    def arrived(self, actuation: Actuation) -> bool:
        return True

    def tick(self, actuation: Actuation) -> str:
        return ""


@dataclass(eq=False)
class StepTask(_OpenLoop):
    """A number of steps."""

    steps: int  #: the sign is the direction
    state = state_machine.STEPPING

    def begin(self, actuation: Actuation) -> None:
        """Start the cycles."""
        actuation.step(self.steps)


@dataclass(eq=False)
class JogTask(_OpenLoop):
    """Stepping without end at the frequency of the jog."""

    hertz: float  #: the sign is the direction
    state = state_machine.JOGGING

    def begin(self, actuation: Actuation) -> None:
        """Start cycles without end."""
        actuation.step(ANY if self.hertz > 0.0 else -ANY, hertz=abs(self.hertz))


class ScanTask(_OpenLoop):
    """The actuator goes to a level and stays there, or before a soft limit."""

    state = state_machine.SCANNING

    def __init__(self, volts: float, note_limit: Callable[[str], None]) -> None:
        """Take the level (V); note_limit is called with a soft limit that ends the scan early."""
        self._volts = volts
        self._note_limit = note_limit
        self._k = 0  # number of the reading at which it checks again
        self.due = math.inf

    def begin(self, actuation: Actuation) -> None:
        """Start to move the level."""
        self._k = actuation.config.sensor.number_at(actuation.t)
        actuation.scan_to(self._volts * actuation.config.gain)
        self.tick(actuation)

    def tick(self, actuation: Actuation) -> str:
        """Stop if a soft limit could be passed before the next reading of the sensor is due."""
        self.due = math.inf
        if actuation.kind == RAMP:
            sensor = actuation.config.sensor
            limit = actuation.ends_beyond(1.0 / sensor.rate)
            if limit:
                actuation.halt()
                self._note_limit(limit)
            else:
                self._k += 1
                self.due = sensor.time_of(self._k)
        return ""
