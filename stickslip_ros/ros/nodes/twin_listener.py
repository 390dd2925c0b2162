# SPDX-License-Identifier: Apache-2.0
"""Hears what a twin publishes, for its live page."""

from __future__ import annotations

from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node
from sensor_msgs.msg import JointState

from stickslip_ros.base.reporting import CONFIDENCE
from stickslip_ros.measurement.twin import TrackedParameter
from stickslip_ros.measurement.twin.story import TwinStory
from stickslip_ros.recordings.schemas import nanoseconds
from stickslip_ros.ros.nodes.process import SpinThread

_DEPTH = 1000  # messages that may wait


class TwinListener:
    """Follows a twin by its full name until it is closed; `story` is what it said so far."""

    def __init__(self, twin: str) -> None:
        """Subscribe; there need not be such a twin yet."""
        self.story = TwinStory(twin)
        self._name, self._origin = twin.lstrip("/"), 0
        self._own = SpinThread("stickslip_twin_page")
        node = Node("stickslip_twin_page", context=self._own.context, enable_rosout=False)
        for kind, topic, take in (
            (JointState, f"{twin}/joint_states", self._on_reading),
            (DiagnosticArray, f"{twin}/estimates", self._on_estimates),
            (DiagnosticArray, "/diagnostics", self._on_diagnostics),
        ):
            node.create_subscription(kind, topic, take, _DEPTH)
        self._own.add(node)

    def close(self) -> None:
        """Listen no more."""
        self._own.close()

    def _seconds(self, stamped: Any) -> float:
        """Return a stamp in s since the first one."""
        self._origin = self._origin or nanoseconds(stamped)
        return 1e-9 * (nanoseconds(stamped) - self._origin)

    def _on_reading(self, message: JointState) -> None:
        t, (expected, measured) = self._seconds(message.header.stamp), message.position
        self.story.readings.append((t, measured, expected, message.effort[0] / CONFIDENCE))

    def _on_estimates(self, message: DiagnosticArray) -> None:
        found, told = [], []
        for status in message.status:
            values = [float(pair.value) for pair in status.values]
            if status.level == DiagnosticStatus.OK:
                unit = status.values[0].key.partition(" (")[2].rstrip(")")
                name = status.name.partition(": ")[2]
                value, low, high = values
                seen = status.message == "seen"
                found.append(TrackedParameter(name, unit, value, low, high, seen))
            else:
                onset, when = (one - 1e-9 * self._origin for one in values)
                told.append((onset, when, status.message))
        if found:
            self.story.history.append((self._seconds(message.header.stamp), found))
        self.story.changes = told

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name != f"{self._name}: twin":
                continue
            values = {pair.key: pair.value for pair in status.values}
            self.story.level, _, self.story.reason = status.message.partition(": ")
            self.story.stepping = float(values["stepping (s)"])
            told = {key.partition("trouble: ")[2]: value for key, value in values.items()}
            self.story.troubles = {key: int(value) for key, value in told.items() if key}
