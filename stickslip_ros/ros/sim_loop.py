# SPDX-License-Identifier: Apache-2.0
"""Leads the axes of a process through time: blocks, deadlines, the clock they share.

The simulation follows the steady clock in blocks: each block advances every axis to the present
time, and so does each command its own axis, which therefore acts when it arrives. After a command
that moves it, an axis publishes its state out of turn: the motion has begun by then. Deadlines are
absolute; those that were missed are skipped and counted.

How far a block gets in its share of the processor is the business of the `Pace`: the rest is taken
off the pace, so that a command, a service or a signal is heard soon whatever the parameters cost.

With a real-time factor of 0 nothing is waited for: block follows block, and commands act at the
time of the last one. Whatever the factor, the state at the time of a command is that before it, and
what is published next is later: so a recorded run can be repeated.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from time import perf_counter, thread_time
from typing import Protocol

from builtin_interfaces.msg import Time
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.task import Future
from rosgraph_msgs.msg import Clock as ClockMessage

from stickslip_ros.axis import Axis, Pacer
from stickslip_ros.axis.pace import Pace, PaceReport
from stickslip_ros.parameters import NodeParameters
from stickslip_ros.ros.messages import stamp
from stickslip_ros.ros.process import StopRequested
from stickslip_ros.ros.topics import CLOCK

_SIGNAL_PERIOD = 0.1  # s, between looks at whether a signal asks to end
_DIAGNOSTICS_PERIOD = 1.0  # s
_WARN_PERIOD = 1.0  # s, between warnings of the same kind
_APART = 5e-3  # s at least between states out of turn, however many commands come
_SLICE = 5e-3  # s of blocks without a pause, between looks for commands
_LONGEST_BLOCK = 0.025  # s between blocks, also where states are published more seldom: see `Pace`


class AxisOfLoop(Protocol):
    """What the loop asks of a node with an axis."""

    axis: Axis

    def begin(self) -> None:
        """Publish what the axis is; the time is 0."""

    def publish_state(self) -> None:
        """Publish the present state and what led to it."""

    def report(self) -> None:
        """Publish the diagnostics."""


class BlockTimes:
    """How long the blocks of a window took."""

    def __init__(self) -> None:
        """Begin a window."""
        self._count = 0
        self._sum = 0.0
        self.worst = 0.0  #: s

    @property
    def mean(self) -> float:
        """Mean time of a block, s; 0 if there was none."""
        return self._sum / self._count if self._count else 0.0

    def note(self, seconds: float) -> None:
        """Take the time (s) of a block."""
        self._count += 1
        self._sum += seconds
        self.worst = max(self.worst, seconds)


class SimLoop:
    """Calls the axes of a process when it is time; all of them from one timer.

    One timer, because the executor pays for each wake-up with a look at everything it holds.
    """

    def __init__(
        self, node: Node, values: NodeParameters, stop_requested: StopRequested = lambda: False
    ) -> None:
        """Take the timers from a node.

        stop_requested is looked at ten times a second, true ends the process.
        """
        self.finished: Future = Future()
        self.priority = "off"  #: what came of the wish for real-time priority
        self.pace = Pace((), 0.0, 0, 0, thread_time)
        self.pacer = Pacer(1.0 / values.publish_rate, 0.0)
        self.blocks = BlockTimes()  #: of all axes together, since the last report
        self.last_report = PaceReport(0.0, 0.0, 0.0)
        self._node = node
        self._values = values
        self._stop_requested = stop_requested
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._start = 0
        self._axes: Sequence[AxisOfLoop] = ()
        self._followed_up = 0.0  # s, when a state was published out of turn
        self._asked = False
        self._is_due = False  # the state, since a deadline at which not all axes were there
        self._block_ns = round(1e9 / values.publish_rate)
        self._clock = (
            node.create_publisher(ClockMessage, CLOCK.name, CLOCK.depth)
            if values.publish_clock
            else None
        )

    def start(self, axes: Sequence[AxisOfLoop]) -> None:
        """Let the time of these axes begin, at 0."""
        self._axes = axes
        self._start = self._steady.now().nanoseconds
        factor, now = self._values.real_time_factor, Clock().now().nanoseconds
        self.pace = Pace([one.axis for one in axes], factor, self._start, now, thread_time)
        for axis in axes:
            axis.begin()
        timer, steady = self._node.create_timer, self._steady
        if factor > 0.0:
            period = self.pacer.period
            self.pacer = Pacer(period, self.elapsed())
            timer(period / math.ceil(period / _LONGEST_BLOCK), self._paced, clock=steady)
        else:
            # A timer is looked at in every round of the executor, so its period is no pause.
            timer(1e-3, self._as_fast_as_it_can, clock=steady)
        timer(_DIAGNOSTICS_PERIOD, self._report, clock=steady)
        timer(_SIGNAL_PERIOD, self._end_on_signal, clock=steady)

    def act(self, node: AxisOfLoop) -> None:
        """Bring an axis to the present, at which a command acts."""
        began = perf_counter()
        self.pace.act(self._steady.now().nanoseconds, node.axis)
        self.blocks.note(perf_counter() - began)

    def follow_up(self, node: AxisOfLoop) -> None:
        """Have an axis publish its state at once, because a command moves it."""
        self.pace.expect_change()
        now = self.elapsed()
        if self._values.real_time_factor > 0.0 and now - self._followed_up > _APART:
            self._followed_up = now
            if self._catch_up(node.axis):
                node.publish_state()

    def stamp(self) -> Time:
        """Return the stamp of the present time of the simulation."""
        return stamp(self.pace.stamp)

    def elapsed(self) -> float:
        """Return the real time since the start, s."""
        return (self._steady.now().nanoseconds - self._start) * 1e-9

    def _paced(self) -> None:
        if not self._asked:
            self._ask_for_priority()
        missed = self.pacer.missed
        self._is_due |= self.pacer.tick(self.elapsed())
        if self.pacer.missed > missed:
            self._node.get_logger().warning(
                f"{self.pacer.missed} deadlines of {1e3 * self.pacer.period:g} ms missed so far; "
                "lower publish_rate or the load of the machine",
                throttle_duration_sec=_WARN_PERIOD,
            )
        if self._catch_up() and self._is_due:
            self._is_due = False
            self._publish()

    def _catch_up(self, only: Axis | None = None) -> bool:
        """Advance to the present; return whether there is a new state to publish."""
        began = perf_counter()
        there = self.pace.catch_up(self._steady.now().nanoseconds, only)
        self.blocks.note(perf_counter() - began)
        return there

    def _ask_for_priority(self) -> None:
        """Ask for the thread that runs the timers, which is known only when it does."""
        self._asked = True
        self.priority = request_priority(self._values.real_time_priority)
        if self.priority != "off":
            self._node.get_logger().info(f"real-time priority {self.priority}")

    def _as_fast_as_it_can(self) -> None:
        until = perf_counter() + _SLICE
        while (left := until - perf_counter()) > 0.0:
            began = perf_counter()
            done = self.pace.leap(self._block_ns, left)
            self.blocks.note(perf_counter() - began)
            if done:
                self._publish()

    def _publish(self) -> None:
        for axis in self._axes:
            axis.publish_state()
        if self._clock:
            self._clock.publish(ClockMessage(clock=self.stamp()))

    def _report(self) -> None:
        self.last_report = self.pace.report(self._steady.now().nanoseconds)
        for axis in self._axes:
            axis.report()
        self.pacer.forget_worst()
        self.blocks = BlockTimes()

    def _end_on_signal(self) -> None:
        if self._stop_requested() and not self.finished.done():
            self.finished.set_result(None)


def request_priority(priority: int | None) -> str:
    """Ask for a priority of SCHED_FIFO for the calling thread; return what came of it.

    None and 0 ask for nothing. The answer starts with "off", "granted" or "refused".
    """
    if not priority:
        return "off"
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (OSError, AttributeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "this system knows no SCHED_FIFO"
        return f"refused: {reason} (on Linux allow it with `ulimit -r {priority}` or CAP_SYS_NICE)"
    return f"granted: SCHED_FIFO {priority}"
