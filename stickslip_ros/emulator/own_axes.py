# SPDX-License-Identifier: Apache-2.0
"""Axes that belong to the emulator alone, advanced by the steady clock of the machine."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from stickslip_ros.axis import Axis, Timeline


class OwnAxes:
    """Axes in the time that has gone by since `begin`."""

    def __init__(self, axes: Sequence[Axis], clock_ns: Callable[[], int] = time.monotonic_ns):
        """Take axes at time 0; clock_ns: a steady clock (ns)."""
        self.axes = axes
        self._clock_ns = clock_ns
        self._timeline = Timeline(0, 0, 0.0)

    def begin(self) -> None:
        """Let the time begin, with everything compiled that commands will need."""
        spare = Axis(self.axes[0].parameters)
        spare.command_steps(1)
        spare.advance(0.5 / spare.status.frequency)
        spare.stop()
        spare.advance(2.0 / spare.status.frequency)
        self._timeline = Timeline(self._clock_ns(), 0, 1.0)

    async def run(self, action: Callable[[], Any]) -> Any:
        """Advance the axes to the present and carry out an action."""
        self._timeline.follow(self._clock_ns())
        for axis in self.axes:
            axis.advance(self._timeline.seconds)
            axis.take_events()  # nobody reads them, and they would pile up
        return action()
