# SPDX-License-Identifier: Apache-2.0
"""The way home: to a reference mark, or to an end of the travel, from which positions count then.

What was counted before, by `zero`, is forgotten: at the reference the axis knows where it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from stickslip_ros.axis.actuation import ENDLESS, Actuation
from stickslip_ros.axis.closed_loop import ClosedLoop, StepSize
from stickslip_ros.axis.command import HOMING
from stickslip_ros.axis.config import Config
from stickslip_ros.axis.trajectory import Trajectory

#: Time (s) between two looks whether an end of the travel is reached.
_LOOKS = 0.01
Note = Callable[..., Any]


class MarkTask(ClosedLoop):
    """To the reference mark in closed loop."""

    def __init__(self, config: Config, t: float, steps: StepSize, note: Note) -> None:
        """Set out at time t (s); note reports that it is there."""
        mark = config.parameters.limits.home_mark - config.offset
        super().__init__("home", Trajectory(t, mark, []), steps, note)
        self._config = config

    @property
    def state(self) -> str:
        """Homing, until it is there."""
        return HOMING

    def arrived(self, actuation: Actuation) -> bool:
        """Go on as any closed loop does; it is done at the mark."""
        return self.reached or super().arrived(actuation)

    def tick(self, actuation: Actuation) -> str:
        """Take a reading as any closed loop does; at the mark nothing is due any more."""
        reason = super().tick(actuation)
        if self.reached:
            self.due = math.inf
        return reason

    def _note_end(self) -> None:
        super()._note_end()
        self._config.offset = 0.0


class EndTask:
    """Steps to an end of the travel."""

    state = HOMING

    def __init__(self, sign: int, note: Note) -> None:
        """Go to the upper end (sign 1) or the lower one (-1); note reports that it is there."""
        self._sign, self._note = sign, note
        self._hits, self._farthest, self._since = 0, -math.inf, 0.0
        self.due = math.inf

    def begin(self, actuation: Actuation) -> None:
        """Start cycles without end."""
        self._hits, self._since = actuation.travel.hits, actuation.t
        actuation.step(self._sign * ENDLESS)
        self.due = actuation.t + _LOOKS

    def arrived(self, actuation: Actuation) -> bool:
        """Be done with the last cycle."""
        return True

    def tick(self, actuation: Actuation) -> str:
        """End at the end; a fault where the runner gets no nearer to it for too long."""
        t, timeout = actuation.t, actuation.config.parameters.closed_loop.target_timeout
        if actuation.travel.hits > self._hits:
            self.due = math.inf
            actuation.config.offset = 0.0
            self._note("home", "finished", position=actuation.x)
            actuation.shorten()
            return ""
        self.due = t + _LOOKS
        stroke = actuation.config.stroke(actuation.config.amplitude)
        if self._sign * actuation.x > self._farthest + 0.01 * stroke:
            self._farthest, self._since = self._sign * actuation.x, t
        if timeout is None or t - self._since < timeout + 1.0 / actuation.config.frequency:
            return ""
        end = "upper" if self._sign > 0 else "lower"
        return (
            f"the {end} end of travel, which is home: the runner has come no nearer for "
            f"{timeout:g} s: raise the amplitude, free the runner or raise target_timeout"
        )
