# SPDX-License-Identifier: Apache-2.0
"""Somebody else's axis for a twin: the whole system left to a general integrator, and read.

It changes in ways that the twin is not told: preload, payload, force, breakaway distance,
temperature, a worn place, an amplifier that weakens, a sensor that loses gain.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from stickslip_ros.measurement.twin import TwinCommand
from stickslip_ros.physics.model import Plant, drive_of
from stickslip_ros.physics.parameters import Parameters
from validation.whole_system import WholeSystem, aged

#: Accuracy of the integrator: a thousandth of a nanometre a cycle, far below any noise
_ACCURACY = (1e-9, 1e-5)


@dataclass(frozen=True)
class Hidden:
    """What the twin is not told of an axis at a time and place; factors, and kelvins."""

    preload: float = 1.0
    payload: float = 0.0  #: kg
    amplifier: float = 1.0
    sensor: float = 1.0
    warmer: float = 0.0  #: K
    force: float = 0.0  #: N
    breakaway: float = 1.0


#: time (s), position (m) -> what is hidden
Story = Callable[[float, float], Hidden]
Log = list[TwinCommand | tuple[float, float]]


class RealAxis:
    """An axis that steps and is read; `log` has commands and readings in the order of time."""

    def __init__(
        self, p: Parameters, story: Story, rate: float = 100.0, noise: float = 2e-9, seed: int = 1
    ) -> None:
        """Take parameters (a linear actuator), what is hidden, and rate (Hz) and noise of readings.

        Readings come at uneven times, up to a third of their spacing late.
        """
        self.p, self._story, self._noise = p, story, noise
        self._system = WholeSystem(p, _ACCURACY)
        self._random = np.random.default_rng(seed)
        self._spacing, self._next = 1.0 / rate, 0.0
        self.t = 0.0
        self.log: Log = []
        self._number = 0
        self._hidden: Hidden | None = None

    @property
    def x(self) -> float:
        """Position, m."""
        return self._system.x

    def command(self, name: str, value: float) -> None:
        """Set the drive for the next steps."""
        self.p = self.p.replace(**{name: value})
        self.log.append(TwinCommand(self.t, name, value))

    def rest(self, duration: float) -> None:
        """Stand still for a duration (s)."""
        self._go(duration, 0.0)

    def step(self, steps: int) -> None:
        """Make steps (sign: direction)."""
        self.log.append(TwinCommand(self.t, "steps", steps))
        cycle = drive_of(self.p, 1 if steps >= 0 else -1)
        gain, warm = self.p.actuator.gain_in_force, self.p.actuator.gain_temperature
        for _ in range(abs(steps)):
            hidden = self._story(self.t, self.x)
            if hidden != self._hidden:
                self._take(hidden)
            factor = hidden.amplifier * (1.0 + warm * hidden.warmer)
            for duration, rate in zip(cycle.durations, cycle.rates, strict=True):
                self._go(float(duration), factor * float(rate) / gain)

    def _take(self, hidden: Hidden) -> None:
        p = self.p.replace(
            preload=self.p.friction.preload * hidden.preload,
            payload=self.p.runner.payload + hidden.payload,
            temperature=self.p.actuator.temperature + hidden.warmer,
            force=self.p.runner.force + hidden.force,
        )
        if hidden.breakaway != 1.0:
            p = p.replace(z_ba=hidden.breakaway * Plant.of(p).contact.z_ba)
        self._hidden = hidden
        self._system.take(aged(p, 0.0, 0.0) if hidden.warmer else Plant.of(p))

    def _go(self, duration: float, slope: float) -> None:
        end = self.t + duration
        while self._next <= end:
            at = self._next
            self._system.segment(max(at - self.t, 0.0), slope) if at > self.t else None
            self.t = max(at, self.t)
            gain = self._hidden.sensor if self._hidden else 1.0
            seen = gain * self.x + self._noise * float(self._random.standard_normal())
            self.log.append((self.t, seen))
            self._number += 1
            late = float(self._random.random()) / 3.0
            self._next = (self._number + late) * self._spacing
        if end > self.t:
            self._system.segment(end - self.t, slope)
        self.t = end


def feed(twin: Any, log: Log) -> Iterator[Any]:
    """Give a whole log to a twin; yield what it says of each reading."""
    for one in log:
        if isinstance(one, TwinCommand):
            twin.command(one)
        else:
            yield twin.measure(*one)
    twin.settle()
