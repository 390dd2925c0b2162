# SPDX-License-Identifier: Apache-2.0
"""Node of a twin: hears the commands and the position of an axis, and says what the model knows.

Readings wait a moment for commands that were given before them and come later.
"""

from __future__ import annotations

import heapq
import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PointStamped
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Int32
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from stickslip_ros.axis import Event
from stickslip_ros.axis.command import FLOAT64, INT32
from stickslip_ros.axis.commands import COMMANDS
from stickslip_ros.axis.events import START
from stickslip_ros.base.errors import UsageError
from stickslip_ros.base.reporting import CONFIDENCE
from stickslip_ros.measurement.identification.posterior import find_posterior
from stickslip_ros.measurement.twin import Forecast, Twin, TwinCommand, TwinSettings
from stickslip_ros.measurement.twin.own_sensor import OwnSensor
from stickslip_ros.measurement.twin.recording import KNOWN, UNKNOWN, commands_of, event_ns
from stickslip_ros.measurement.twin.settings import ASKED, TwinError
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.physics.parameters.groups import AXIS_NODE, SLIDER
from stickslip_ros.recordings.schemas import nanoseconds
from stickslip_ros.ros.nodes.guarded_node import GuardedNode
from stickslip_ros.ros.nodes.messages import (
    diagnostic_array,
    diagnostic_status,
    message_class,
    publisher_of,
    stamp,
)
from stickslip_ros.ros.nodes.node_parameters import OwnParameter, full_name, read_own, run_node
from stickslip_ros.ros.nodes.topics import EVENTS, TWIN_OUTPUTS

NODE_NAME = "stickslip_twin"
_POLL, _REPORT = 0.05, 1.0  # s
_READING_TIME = 0.1  # s that readings are taken without a look at messages and reports
_AGAIN = 10.0  # s between warnings that no position is heard
_MOST = 20_000  # messages that wait: a flood beyond them is counted and left out
_QUEUE = 10_000  # messages of a topic that may come while the twin has no processor
_CHANGES = 20  # the last ones, which estimates tell
_LEVELS = {"ok": DiagnosticStatus.OK, "unlike the model": DiagnosticStatus.ERROR}

PARAMETERS = (
    OwnParameter("config", "", "parameter file of the axis, as of identify"),
    OwnParameter("axis", f"/{AXIS_NODE}", "full name of the axis node"),
    OwnParameter("joint", "", "joint in measured; empty: the first slider"),
    OwnParameter("direction", [1.0, 0.0, 0.0], "of the axis in measured_point"),
    OwnParameter("unit", 1.0, "m, unit of the positions that are measured"),
    OwnParameter("patience", 0.1, "s that readings wait for commands"),
    *(
        OwnParameter(name, getattr(TwinSettings, name), f"{unit}, {about}")
        for name, (unit, about) in ASKED.items()
    ),
)


class TwinNode(GuardedNode):
    """Runs beside an axis until :attr:`finished` is done."""

    def __init__(self, **options: Any) -> None:
        """Read the parameters, subscribe. Raises UsageError, ParameterError and TwinError."""
        super().__init__(NODE_NAME, **options)
        given = read_own(self, PARAMETERS)
        self._patience, self._joint = given["patience"], given["joint"]
        direction, self._unit = list(given["direction"]), given["unit"]
        length = math.hypot(*direction)
        if len(direction) != 3 or not (math.isfinite(length) and length):
            raise UsageError(f"direction is {direction}; give x, y and z, such as [0, 1, 0]")
        self._direction = [one / length for one in direction]
        if not (math.isfinite(self._unit) and self._unit):
            raise UsageError(f"unit is {self._unit:g} m; it has to be a number other than 0")
        axis, config = full_name(self, "axis", given["axis"]), given["config"] or None
        settings = {name: given[name] for name in ASKED}
        posterior = find_posterior(Path(config)) if config else None
        self.twin = Twin(Parameters.of(config), TwinSettings(**settings), posterior)
        self._origin: int | None = None  # ns that the twin's times count from: the oldest heard
        self._start: int | None = None  # ns, when the simulated time of the axis was 0
        self._sensor = OwnSensor()
        # What waits for its turn: time (ns), whether it is a reading, number of arrival, itself,
        # and the joint whose state it is
        self._waiting: list[tuple[int, bool, int, Event | TwinCommand | float, str]] = []
        self._arrived = 0
        self._told = 0
        latched = QoSProfile(depth=_QUEUE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        kind = message_class(EVENTS.type)
        self.create_subscription(kind, EVENTS.full_name(axis), self._on_events, latched)
        for command in COMMANDS.values():
            if command.type in (INT32, FLOAT64) and command.name in (*KNOWN, *UNKNOWN):
                kind, take = message_class(command.type), partial(self._on_command, command.name)
                self.create_subscription(kind, command.interface, take, 10)
        positions = [
            self.create_subscription(kind, name, take, _QUEUE)
            for kind, name, take in (
                (JointState, "measured", self._on_joints),
                (PointStamped, "measured_point", self._on_point),
                (Float64, "measured_position", self._on_number),
            )
        ]
        self._heard_on = [one.topic_name for one in positions]
        for kind, name, ask in (
            (Int32, "~/predict/steps", self.twin.predict_steps),
            (Float64, "~/predict/position", self.twin.predict_position),
        ):
            self.create_subscription(kind, name, partial(self._predict, ask), 10)
        self._out = {one.name: publisher_of(self, one) for one in TWIN_OUTPUTS}
        self.create_timer(_POLL, self._poll)
        self.create_timer(_REPORT, self._report)

    def close(self) -> None:
        """Take what waits; twice does no harm."""
        self._take(math.inf)

    # -- hearing

    def _wait(self, ns: int, what: Event | TwinCommand | float, joint: str = "") -> None:
        if len(self._waiting) >= _MOST:
            self.twin.troubles["messages of a flood"] += 1
            return
        self._arrived += 1
        is_reading = isinstance(what, float)  # of one time, commands go first
        heapq.heappush(self._waiting, (ns, is_reading, self._arrived, what, joint))

    def _on_events(self, message: Any) -> None:
        published = nanoseconds(message.header.stamp)
        for status in message.status:
            event = Event.of({pair.key: pair.value for pair in status.values})
            if event is None:
                continue
            if event.name == START:
                self._start = published
            # The message comes when the axis may have gone on already.
            ns = published if self._start is None else event_ns(self._start, event)
            self._wait(ns, event)

    def _on_command(self, name: str, message: Any) -> None:
        """Take a command that says no time: it is given when it arrives."""
        self._wait_unstamped(TwinCommand(math.nan, name, float(message.data)))

    def _on_joints(self, message: JointState) -> None:
        names = list(message.name)
        if not self._joint:
            self._joint = next((name for name in names if name.endswith(SLIDER)), "")
        if self._joint in names and len(message.position) == len(names):
            position = self._unit * message.position[names.index(self._joint)]
            self._wait(nanoseconds(message.header.stamp), position, self._joint)

    def _on_point(self, message: PointStamped) -> None:
        place = message.point.x, message.point.y, message.point.z
        way = sum(one * along for one, along in zip(place, self._direction, strict=True))
        self._wait(nanoseconds(message.header.stamp), self._unit * way)

    def _on_number(self, message: Float64) -> None:
        self._wait_unstamped(self._unit * message.data)

    def _wait_unstamped(self, what: TwinCommand | float) -> None:
        """Take what says no time as of now; nothing while there is no time."""
        if not self.followed:
            self._wait(self.get_clock().now().nanoseconds, what)
        elif not self.followed.missing():
            self._wait(self.followed.reading(), what)

    def _poll(self) -> None:
        newest = max((ns for ns, *_ in self._waiting), default=0)
        self._take(newest - round(1e9 * self._patience), time.monotonic() + _READING_TIME)

    def _take(self, until: float, deadline: float = math.inf) -> None:
        """Give the twin all that is older than a time (ns), and publish what it says.

        What is not done at a deadline (s, of the monotonic clock) waits.
        """
        while self._waiting and self._waiting[0][0] <= until and time.monotonic() < deadline:
            ns, _, _, what, joint = heapq.heappop(self._waiting)
            if self._origin is None:
                self._origin = ns
            t = 1e-9 * (ns - self._origin)
            if isinstance(what, TwinCommand):
                self.twin.command(replace(what, t=t))
                continue
            if isinstance(what, Event):
                self._sensor.hear(what, ns)
                for command in commands_of(what, t):
                    self.twin.command(command)
                continue
            taken = self._sensor.taken_ns(joint, ns)
            if taken is None:
                continue
            update = self.twin.measure(1e-9 * (taken - self._origin), what)
            if update is None:
                continue
            names = [self._joint, f"{self._joint}_measured"]
            expected = JointState(name=names, position=[update.expected, update.measured])
            expected.header.stamp = self._stamp(update.t)
            expected.effort = [CONFIDENCE * update.deviation, 0.0]
            self._out["~/joint_states"].publish(expected)
            self._out["~/residual"].publish(Float64(data=update.measured - update.expected))

    # -- saying

    def _stamp(self, t: float) -> Any:
        return stamp((self._origin or 0) + round(1e9 * t))

    def _report(self) -> None:
        if self.followed:
            self.followed.missing()
        twin, name = self.twin, self.get_fully_qualified_name().lstrip("/")
        level, reason = twin.level
        if math.isnan(twin.t) and not any(self.count_publishers(n) for n in self._heard_on):
            reason = f"nobody publishes a position on {', '.join(self._heard_on)}; see --help"
            self.get_logger().warning(reason, throttle_duration_sec=_AGAIN)
        estimates = twin.estimates()
        now = self.get_clock().now().to_msg()
        statuses = [
            diagnostic_status(
                name, one.name, DiagnosticStatus.OK, "seen" if one.seen else "held",
                {f"value ({one.unit})": one.value, f"low ({one.unit})": one.low,
                 f"high ({one.unit})": one.high},
            )
            for one in estimates
        ]  # fmt: skip
        for number, change in enumerate(twin.changes[-_CHANGES:], 1):
            origin = 1e-9 * (self._origin or 0)  # s since 1970
            times = {"since (s)": origin + change.onset, "told (s)": origin + change.told}
            what, warn = f"change {number}", DiagnosticStatus.WARN
            statuses.append(diagnostic_status(name, what, warn, change.text, times))
        heard = now if math.isnan(twin.t) else self._stamp(twin.t)
        self._out["~/estimates"].publish(diagnostic_array(heard, statuses))
        rate, deviation = twin.drift
        values = {
            "level": level, "stepping (s)": twin.driven, "drift (1/s)": rate,
            "drift, standard error (1/s)": deviation, "changes": len(twin.changes),
            "waiting messages": len(self._waiting),
            **{f"trouble: {what}": count for what, count in twin.troubles.items()},
        }  # fmt: skip
        self._say("twin", _LEVELS.get(level, DiagnosticStatus.WARN), f"{level}: {reason}", values)
        step = next((one.value for one in estimates if one.name == "step size"), None)
        if step is not None:
            self._out["~/step_size"].publish(Float64(data=step))
        for change in twin.changes[self._told :]:
            self.get_logger().warning(change.text)
        self._told = len(twin.changes)

    def _say(self, what: str, level: bytes, message: str, values: dict[str, Any]) -> None:
        name = self.get_fully_qualified_name().lstrip("/")
        status = diagnostic_status(name, what, level, message, values)
        self._out["/diagnostics"].publish(
            diagnostic_array(self.get_clock().now().to_msg(), [status])
        )

    def _predict(self, ask: Callable[[Any], Forecast], asked: Int32 | Float64) -> None:
        """Publish where a move ends: its begin, then its end with the ends of the 95 % band."""
        if not math.isfinite(asked.data):
            return
        try:
            found = ask(asked.data)
        except TwinError as error:
            self.get_logger().warning(str(error))
            return
        lasts = Duration(nanoseconds=round(1e9 * (found.end - found.begin))).to_msg()
        message = JointTrajectory(joint_names=[self._joint])
        message.header.stamp = self._stamp(found.begin)
        message.points = [
            JointTrajectoryPoint(positions=[self.twin.tracker.x]),
            JointTrajectoryPoint(positions=[found.position], time_from_start=lasts),
        ]
        self._out["~/prediction"].publish(message)
        values = {"steps": found.steps, "low (m)": found.low, "high (m)": found.high}
        self._say("prediction", DiagnosticStatus.OK, f"{found.steps} steps", values)


#: Runs the twin; returns 0 at its end, 2 on bad use
main = partial(
    run_node, "twin_node", TwinNode, "The model beside an axis: what has changed.", PARAMETERS
)
