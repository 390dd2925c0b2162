# SPDX-License-Identifier: Apache-2.0
"""When the readings in the joint states of a simulated axis were taken.

Such a message has the time at which it was published, and the reading that had arrived by then: at
the usual 1 kHz and 1 ms it is 1 to 2 ms old, in which 100 Hz move the slider by tens of nanometres.
Rate, latency and the beginning of the time stand in the axis's events, so its age is known.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from stickslip_ros.axis.events import START, Event
from stickslip_ros.axis.joints import SOURCE, TRUTH
from stickslip_ros.axis.sensor import Sensor
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.physics.parameters.groups import SLIDER


class OwnSensor:
    """The sensor of one axis; until the axis has said that it starts, stamps count as they are."""

    def __init__(self) -> None:
        """Know nothing yet."""
        self._sensor: Sensor | None = None
        self._said: dict[str, Any] = {"sensor_rate": 0.0, "sensor_latency": 0.0, SOURCE: TRUTH}
        self._joint, self._start, self._last = "", 0, -1

    def hear(self, event: Event, ns: int) -> None:
        """Take an event of the axis and its time (ns), before the readings that came after it."""
        if event.name == START:
            # Joint states of 1.x were the truth, and there was no such parameter.
            self._said[SOURCE] = TRUTH
            self._joint = f"{event.details.get('axis_name', 'axis')}{SLIDER}"
            self._start, self._last = ns, -1
        elif event.name != "parameters" or event.outcome != "applied":
            return
        self._said |= {key: one for key, one in event.details.items() if key in self._said}
        self._sensor = None
        if self._said[SOURCE] != TRUTH:
            known = {key: self._said[key] for key in ("sensor_rate", "sensor_latency")}
            self._sensor = Sensor(replace(Parameters().sensor, **known))

    def taken_ns(self, joint: str, stamp_ns: int) -> int | None:
        """Return when the reading in a joint state was taken, ns; None if it was the one before."""
        if self._sensor is None or joint != self._joint or stamp_ns < self._start:
            return stamp_ns
        taken = self._sensor.taken_by(1e-9 * (stamp_ns - self._start))
        number = max(taken - self._sensor.delay, 0)
        before = self._last
        self._last = number
        if number == before:
            return None
        return self._start + round(1e9 * self._sensor.time_of(number))
