# SPDX-License-Identifier: Apache-2.0
"""The channel of a controller with a sensor: its origin, steps, and a closed loop that is held."""

from __future__ import annotations

import math
from typing import ClassVar

from stickslip_ros.axis import Axis, CommandRefused
from stickslip_ros.axis.state_machine import DISABLED, FAULT, HOLDING, TARGETING


class Channel:
    """One channel: an axis and the state of the controller for it."""

    most_volts: ClassVar = math.inf  #: largest amplitude of the controller, V

    def __init__(self, axis: Axis) -> None:
        """Use an axis; limit its amplitude to the largest of the controller."""
        self.axis = axis
        self._origin = 0.0  # reading of the axis (m) that counts as 0
        self._target = math.nan  # of the closed loop that was begun here, m
        self._hold_s = math.inf  # that it is kept
        self._held_since: float | None = None
        if axis.status.amplitude > self.most_volts:
            axis.command_amplitude(self.most_volts)

    @property
    def position(self) -> float:
        """Measured position, m. Raises CommandRefused while the sensor gives none."""
        return self._reading - self._origin

    @property
    def _reading(self) -> float:
        reading = self.axis.status.position
        if math.isnan(reading):
            raise CommandRefused("the sensor gives no reading")
        return reading

    def set_position(self, x: float) -> None:
        """Let the present position count as x (m)."""
        self._origin = self._reading - x

    @property
    def target(self) -> float:
        """Target of the closed loop, m; the position if there is none."""
        target = self.axis.status.target
        return self.position if math.isnan(target) else target - self._origin

    def limit(self, name: str) -> float:
        """Return a soft limit, "soft_low" or "soft_high", as positions count, m."""
        return float(getattr(self.axis.parameters.limits, name) - self._origin)

    def set_limits(self, **limits: float) -> None:
        """Set soft limits by name, as positions count, m."""
        self.axis.set_parameters({name: x + self._origin for name, x in limits.items()})

    @property
    def moving(self) -> bool:
        """Whether it moves, or its closed loop has not reached the target yet."""
        return self.axis.moving or self.axis.mode == TARGETING

    @property
    def locked(self) -> bool:
        """Whether no motion is allowed: the axis is in fault, or disabled."""
        return self.axis.mode in (FAULT, DISABLED)

    def step(self, steps: int, volts: float, hertz: float, endless: bool) -> None:
        """Run steps with an amplitude (V) and frequency (Hz); endless: only the sign counts."""
        axis = self.axis
        if not volts or not steps:
            axis.stop()
            return
        # First the one that eases the drive.
        if hertz < axis.status.frequency:
            axis.command_frequency(hertz)
            axis.command_amplitude(volts)
        else:
            axis.command_amplitude(volts)
            axis.command_frequency(hertz)
        if endless:
            axis.command_jog(math.copysign(hertz, steps))
        else:
            axis.command_steps(steps)

    def go_to(self, x: float, hold_s: float) -> None:
        """Go to a position (m) in closed loop, hold it for a time (s)."""
        target = x + self._origin
        self.axis.command_position(target)
        self._target, self._hold_s, self._held_since = target, hold_s, None

    def tick(self) -> None:
        """End the hold of a target after its time, unless another client began it."""
        axis = self.axis
        if axis.mode != HOLDING or axis.status.target != self._target:
            self._held_since = None
            return
        if self._held_since is None:
            self._held_since = axis.state.t
        if axis.state.t - self._held_since >= self._hold_s:
            axis.stop()
