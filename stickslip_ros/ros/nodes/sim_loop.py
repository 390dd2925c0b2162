# SPDX-License-Identifier: Apache-2.0
"""Advances the axes of a process in time: blocks, deadlines, the common clock.

The simulation follows the steady clock in blocks: each block advances every axis to the present
time, and each command advances its own axis, so it takes effect when it arrives. After a command
that moves it, an axis publishes one more state, when the motion has begun. Deadlines are absolute;
missed ones are skipped and counted. While all axes rest and nobody reads their states, blocks come
seldom, for a wake-up costs more than they do.

`Pace` limits how far a block gets in its share of the processor. The rest is dropped, so that a
command, a service or a signal is handled soon, however much the parameters cost.

With a real-time factor of 0, blocks follow each other without a pause, and commands take effect at
the end of the last block; so does a step of a paused time. With any factor, the state published at
the time of a command is the state before it, and the next one is later: so a recorded run can be
repeated.

With ``use_sim_time`` the topic /clock leads. The time begins with its first message. All that this
clock advances is simulated; while it stands or has been set back, the axes stand still.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from time import monotonic_ns, perf_counter, thread_time

from builtin_interfaces.msg import Time
from lifecycle_msgs.msg import State, TransitionEvent
from rclpy.clock import Clock
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock as ClockMessage

from stickslip_ros.axis import Axis
from stickslip_ros.axis.events import STEP_OF_TIME
from stickslip_ros.axis.pace import Pace, PaceReport
from stickslip_ros.base.clocks import Pacer
from stickslip_ros.base.priority import request_priority
from stickslip_ros.physics.parameters import NodeParameters, ParameterError
from stickslip_ros.ros.nodes.guarded_node import GuardedNode
from stickslip_ros.ros.nodes.messages import publisher_of, stamp
from stickslip_ros.ros.nodes.neighbours import JointSpeakers
from stickslip_ros.ros.nodes.topics import CLOCK, READY

_DIAGNOSTICS_PERIOD = 1.0  # s
_STARTS = 1.0  # s in which other nodes are found, so that deadlines missed are no news
_APART = 5e-3  # s at least between states out of turn, however many commands come
_SLICE = 5e-3  # s of blocks without a pause, between checks for commands
_LONGEST_BLOCK = 0.025  # s between blocks, also where states are published more seldom: see `Pace`
_REST_BLOCK = 0.1  # s between blocks of axes at rest that nobody reads
_CHEAP = 0.05  # s of processor for a second of motion at most, so that such a block drops no time
_FOLLOWS = (
    "use_sim_time lets /clock lead the time: leave out publish_clock, real_time_factor and "
    "start_paused, and steer whoever publishes the clock"
)


class AxisOfLoop(GuardedNode):
    """A node with an axis, as the loop calls it."""

    axis: Axis
    is_read: bool  #: somebody subscribed to a state when one was published last
    joint_topic: str  #: full name of the topic of its joints

    def begin(self) -> None:
        """Publish the description of the axis; the time is 0."""

    def publish_state(self) -> None:
        """Publish the present state and the events before it."""

    def report(self) -> None:
        """Publish the diagnostics."""


class SimLoop:
    """Calls the axes of a process when it is time; all of them from one timer.

    One timer, because the executor checks all its entities at each wake-up.
    """

    def __init__(self, node: GuardedNode, values: NodeParameters) -> None:
        """Take the timers from a node. Raises ParameterError for two that lead the time."""
        self.begun = False  #: time goes by
        self.priority = "off"  #: result of the request for real-time priority
        self.pace = Pace((), 0.0, 0, 0, thread_time)
        self.pacer = Pacer(1.0 / values.publish_rate, 0.0)
        self.blocks: list[float] = []  #: s that each took since the last report, all axes
        self.last_report = PaceReport(0.0, 0.0, 0.0)
        self.speakers = JointSpeakers(node)
        self.node = node  #: what has the timers
        self._values = values
        self._start = 0
        self._axes: Sequence[AxisOfLoop] = ()
        self._to_report: list[AxisOfLoop] = []  # that have their turn in this period
        self._in_step: Callable[[], None] = lambda: None
        self._published: Callable[[], None] = lambda: None
        self._followed_up = 0.0  # s, when a state was published out of turn
        self._asked_for_priority = False
        self._is_due = False  # the state, since a deadline at which not all axes were there
        self._rests = False  # blocks come seldom
        self._block_ns = round(1e9 / values.publish_rate)
        self._factor = values.real_time_factor
        self.paused = values.start_paused  #: True while the time stands still, except for steps
        self._held, self._report_at = False, 0  # ns, when the next reports are due
        self._first = 0  # of the axes that publishes first
        self._until = 0  # ns that the present step of a paused time goes to
        self._stepping: AxisOfLoop | None = None  # who asked for it
        self._followed = node.followed
        if self._followed and (values.publish_clock or self._factor != 1.0 or self.paused):
            raise ParameterError(_FOLLOWS)
        self._clock = publisher_of(node, CLOCK) if values.publish_clock else None
        self._ready = publisher_of(node, READY)
        self._ready_readers = 0  # subscribers when "active" was sent last

    def start(
        self,
        axes: Sequence[AxisOfLoop],
        in_step: Callable[[], None] = lambda: None,
        published: Callable[[], None] = lambda: None,
    ) -> None:
        """Let the time of these axes begin, at 0.

        in_step is called when all have one time, published when all have published their state.
        """
        self._axes, self._in_step, self._published = axes, in_step, published
        self._start = monotonic_ns()
        timer = self.node.create_timer
        period = self.pacer.period
        self.pacer = Pacer(period, self.elapsed(), excused=_STARTS)
        self._tick = timer(period / math.ceil(period / _LONGEST_BLOCK), self._paced)
        self._tick_ns = self._tick.timer_period_ns
        # The executor checks a timer in every round, so its period is not a pause.
        self._hurry = timer(1e-3, self._as_fast_as_it_can)
        self._reporter = timer(_DIAGNOSTICS_PERIOD / len(axes), self._report)
        self._choose_timer()
        self._begin()

    def _begin(self) -> None:
        """Let the time begin, with ``use_sim_time`` only when there is one."""
        leader = self._followed
        if leader and leader.missing():
            return
        now = leader.reading() if leader else Clock().now().nanoseconds
        if self._clock and self.paused:  # stamps as floats of seconds are then apart as in any run
            now -= now % 1_000_000_000
        steady, factor = monotonic_ns(), 0.0 if self.paused else self._factor
        axes = [one.axis for one in self._axes]
        followed = leader.reading if leader else None
        self.pace = Pace(axes, factor, steady, now, thread_time, followed)
        self.begun = True
        self.pacer.restart(self.elapsed())  # nothing was due while there was no time
        for axis in self._axes:
            axis.begin()
        self._tell_ready()

    def _tell_ready(self) -> None:
        """Publish that commands are taken now; launch listens without asking for what is kept."""
        active = State(id=State.PRIMARY_STATE_ACTIVE, label="active")
        self._ready.publish(TransitionEvent(timestamp=self.pace.stamp, goal_state=active))

    # -- who leads the time

    def check(self, changes: Collection[str]) -> None:
        """Raise ParameterError if a command or parameters of these names cannot be taken now."""
        if not self.begun:
            raise ParameterError("no time goes by yet: publish /clock, or leave out use_sim_time")
        if self._followed and not {"pause", "real_time_factor"}.isdisjoint(changes):
            raise ParameterError(_FOLLOWS)

    def pause(self, on: bool) -> None:
        """Stop the time of all axes, or let it continue."""
        for one in self._axes:
            if one.axis.paused != on:
                one.axis.command("pause", on)
        self.paused, self._until = on, 0
        self._choose_timer()

    def take(self, node: AxisOfLoop, changes: Collection[str]) -> None:
        """Apply the changed parameters of an axis that affect the time of all axes."""
        p, frequency = node.axis.parameters.node, node.axis.status.frequency
        if p.real_time_factor != self._factor:
            self._factor = p.real_time_factor
            for one in dict.fromkeys((*self._axes, self.node)):
                if one.get_parameter("real_time_factor").value != self._factor:
                    one.set_parameters([Parameter("real_time_factor", value=self._factor)])
            self._choose_timer()
        ways = {"step_time": p.step_time, "step_cycles": p.step_cycles / frequency}
        ahead = sum(round(1e9 * seconds) for name, seconds in ways.items() if name in changes)
        if ahead:
            self._until, self._stepping = max(self._until, self.pace.ns) + ahead, node
            self._choose_timer()

    def _choose_timer(self) -> None:
        """Let the timer run that moves the time now; the other one costs nothing."""
        hurries = self._until > 0 if self.paused else self._factor == 0.0
        if self.begun:
            self.pace.change(monotonic_ns(), 0.0 if self.paused else self._factor)
        if self._held:
            return
        if hurries:
            self._tick.cancel()
            self._hurry.reset()
        else:
            self._hurry.cancel()
            if self._tick.is_canceled():
                self.pacer.restart(self.elapsed())
                self._tick.reset()

    def _rest(self, on: bool) -> None:
        """Let blocks come seldom, as long as nobody notices, or as usual."""
        if on != self._rests:
            self._rests = on
            self._tick.timer_period_ns = round(1e9 * _REST_BLOCK) if on else self._tick_ns
            self._tick.reset()
            self.pacer.restart(self.elapsed())

    def _may_rest(self) -> bool:
        """Return whether nothing moves, nobody reads, and seldom blocks keep the pace."""
        report = self.last_report
        if self._clock or self.pace.factor != 1.0 or not 0.0 < report.cost < _CHEAP * report.factor:
            return False
        return not any(one.is_read or one.axis.moving or one.axis.closed_loop for one in self._axes)

    def act(self, *nodes: AxisOfLoop) -> None:
        """Bring an axis, or several, to the present, at which a command acts."""
        self._rest(False)
        began, now = perf_counter(), monotonic_ns()
        for node in nodes:
            self.pace.act(now, node.axis)
        self.blocks.append(perf_counter() - began)

    def follow_up(self, node: AxisOfLoop) -> None:
        """Have an axis publish its state at once, because a command moves it."""
        self.pace.expect_change()
        now = self.elapsed()
        if self.pace.factor > 0.0 and now - self._followed_up > _APART:
            self._followed_up = now
            if self._catch_up(node.axis):
                node.publish_state()

    def stamp(self) -> Time:
        """Return the stamp of the present time of the simulation."""
        return stamp(self.pace.stamp)

    def elapsed(self) -> float:
        """Return the real time since the start, s."""
        return (monotonic_ns() - self._start) * 1e-9

    def _paced(self) -> None:
        if not self._asked_for_priority:  # here, because only now the thread of the timers is known
            self._asked_for_priority = True
            self.priority = request_priority(self._values.real_time_priority)
            if self.priority != "off":
                self.node.get_logger().info(f"real-time priority {self.priority}")
        if not self.begun:
            self._begin()
            return
        if self._rests:
            self.pacer.restart(self.elapsed())
        self._is_due |= self._rests or self.pacer.tick(self.elapsed())
        if self.pacer.misses_more():
            self.node.get_logger().warning(
                f"{self.pacer.missed} deadlines of {1e3 * self.pacer.period:g} ms missed so far; "
                "lower publish_rate or the load of the machine"
            )
        if self._catch_up() and self._is_due:
            self._is_due = False
            self._publish()
            self._rest(self._may_rest())

    def _catch_up(self, only: Axis | None = None) -> bool:
        """Advance to the present; return whether there is a new state to publish."""
        began = perf_counter()
        there = self.pace.catch_up(monotonic_ns(), only)
        self.blocks.append(perf_counter() - began)
        return there

    def _as_fast_as_it_can(self) -> None:
        until = perf_counter() + _SLICE
        while not self._hurry.is_canceled() and (left := until - perf_counter()) > 0.0:
            began = perf_counter()
            ahead = self._until - self.pace.ns if self.paused else self._block_ns
            done = self.pace.leap(min(ahead, self._block_ns), left)
            self.blocks.append(perf_counter() - began)
            if self._stepping and self._until and self.pace.ns >= self._until:
                self._stepping.axis.note(STEP_OF_TIME, "finished")
                self._until = 0
                self._choose_timer()
            if done:
                self._publish()

    def hold(self) -> None:
        """Leave a paused time to `go_on` alone, reports included."""
        self._held, self._report_at, self._first = True, self.pace.ns, 0
        for timer in (self._tick, self._reporter):
            timer.cancel()

    def go_on(self, ns: int) -> None:
        """Let a held time go on by a time (ns) at once; publish the state, and reports if due."""
        while not self.pace.leap(ns, _SLICE):
            pass
        self._publish()
        if self.pace.ns >= self._report_at:
            self._report_at += round(1e9 * _DIAGNOSTICS_PERIOD)
            for _ in self._axes:
                self._report()

    def _publish(self) -> None:
        self._in_step()
        # In turns: of a queue that is full, one reader would always take the same axis.
        self._first = (self._first + 1) % len(self._axes)
        for axis in (*self._axes[self._first :], *self._axes[: self._first]):
            axis.publish_state()
        self._published()
        if self._clock:
            self._clock.publish(ClockMessage(clock=self.stamp()))

    def _report(self) -> None:
        """Have one axis report, each in its turn: those of fifty at once would cost deadlines."""
        waiting = self._ready.get_subscription_count()
        if self.begun and waiting > self._ready_readers:
            self._tell_ready()
        self._ready_readers = waiting
        if not self._to_report:
            self._to_report = list(self._axes)
            self.last_report = self.pace.report(monotonic_ns())
            self.speakers.look([one.joint_topic for one in self._axes])
        self._to_report.pop(0).report()
        if not self._to_report:
            self.pacer.forget_worst()
            self.blocks = []
