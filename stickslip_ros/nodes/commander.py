# SPDX-License-Identifier: Apache-2.0
"""Sends moves to an axis over topics, waits for each to end and for the report on it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.time import Time
from std_msgs.msg import Float64, Int32


@dataclass(frozen=True)
class Move:
    """Steps (sign: direction) at an amplitude (V) and a frequency (Hz)."""

    amplitude: float
    frequency: float
    steps: int


class Commander(Node):
    """Commands one axis."""

    def __init__(self, axis: str = "/stickslip_axis", **options: Any) -> None:
        """Connect to the axis node of that full name; options are those of `rclpy.node.Node`."""
        super().__init__("stickslip_commander", **options)
        self._name = axis.removeprefix("/")
        self._heard: list[DiagnosticStatus] = []
        # Stamps of the end of the last move and of the last report, ns; -1 before the first.
        self._ended = self._reported = -1
        self._amplitude = self.create_publisher(Float64, f"{axis}/command/amplitude", 10)
        self._frequency = self.create_publisher(Float64, f"{axis}/command/frequency", 10)
        self._steps = self.create_publisher(Int32, f"{axis}/command/steps", 10)
        self._events = self.create_subscription(
            DiagnosticArray, f"{axis}/events", self._on_events, 100
        )
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_report, 10)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self)

    def wait_for_axis(self, listeners: int = 1, timeout: float = 30.0) -> None:
        """Wait until that many nodes hear the commands and the axis' events reach us.

        Raises TimeoutError after timeout (s).
        """
        commands = (self._amplitude, self._frequency, self._steps)

        def connected() -> bool:
            heard = all(p.get_subscription_count() >= listeners for p in commands)
            return heard and self.count_publishers(self._events.topic_name) > 0

        self._wait(connected, timeout, "no axis answers: is axis_node running in this domain?")

    def carry_out(self, move: Move, timeout: float = 60.0) -> None:
        """Send a move and wait for its end.

        Raises ValueError with the axis' reason if it refuses, TimeoutError after timeout (s).
        """
        for publisher, message, answer in (
            (self._amplitude, Float64(data=move.amplitude), "amplitude applied"),
            (self._frequency, Float64(data=move.frequency), "frequency applied"),
            (self._steps, Int32(data=move.steps), "move finished"),
        ):
            # Topics keep no order among each other, so each command waits for its answer.
            self._heard.clear()
            publisher.publish(message)
            self._wait(partial(self._has, answer), timeout, f"no {answer!r}: {move}")

    def wait_for_report(self, timeout: float = 30.0) -> None:
        """Wait until the axis has reported on the last move on /diagnostics, once a second.

        Raises TimeoutError after timeout (s).
        """

        # What was reported before the end may arrive after it, so the stamps decide.
        def reported() -> bool:
            return self._reported > self._ended

        self._wait(reported, timeout, "the axis does not report on /diagnostics")

    def _on_events(self, message: DiagnosticArray) -> None:
        self._heard.extend(message.status)
        if any(status.message == "move finished" for status in message.status):
            self._ended = Time.from_msg(message.header.stamp).nanoseconds

    def _on_report(self, message: DiagnosticArray) -> None:
        if any(status.hardware_id == self._name for status in message.status):
            self._reported = Time.from_msg(message.header.stamp).nanoseconds

    def _has(self, answer: str) -> bool:
        for status in self._heard:
            if status.message.endswith("refused"):
                values = {pair.key: pair.value for pair in status.values}
                raise ValueError(f"{status.message}: {values.get('reason')}")
        return any(status.message == answer for status in self._heard)

    def _wait(self, condition: Callable[[], bool], timeout: float, failure: str) -> None:
        deadline = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > deadline:
                raise TimeoutError(f"{failure} (waited {timeout:g} s)")
            self._executor.spin_once(timeout_sec=0.05)
