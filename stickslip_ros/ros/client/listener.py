# SPDX-License-Identifier: Apache-2.0
"""Receives the state, the events and the reports of an axis."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState

from stickslip_ros.base.reporting import format_si
from stickslip_ros.physics.parameters.groups import SLIDER
from stickslip_ros.recordings.schemas import nanoseconds
from stickslip_ros.ros.nodes import topics
from stickslip_ros.ros.nodes.messages import message_class

_POLL = 0.02  # s, between checks of conditions without a notification
_QUEUE = 100  # messages that may wait while the program computes
_MOST_ANSWERS = 1000  # that are kept: as many as an axis keeps for those who join late
_OF_STATUS = ("state", "moving", "target reached", "steps done", "steps left", "last error")


@dataclass(frozen=True)
class Answer:
    """An event of the axis, with the stamp (ns) of its message."""

    stamp: int
    values: dict[str, str]


class AxisListener:
    """Hears one axis. Its node has to be spun by another thread."""

    def __init__(self, axis: str, node: Node) -> None:
        """Listen to the axis node of that full name with the subscriptions of a node."""
        self.axis = axis
        self.node = node
        self._changed = threading.Condition()
        self._answers: deque[Answer] = deque(maxlen=_MOST_ANSWERS)
        self._status: dict[str, str] = {}
        self._message = ""  # of the status: the reason of a fault
        self._status_stamp = self._state_stamp = self._report_stamp = -1
        self._state_since = -1  # stamp of the first status with the present state
        self._position = self._velocity = self._friction_force = float("nan")
        self._report: dict[str, dict[str, str]] = {}
        self._description: dict[str, DiagnosticStatus] = {}
        self._joint = ""
        self._reading_age = 0  # ns, at most, of a reading when a joint state shows it
        #: For waits on motion: the clock of their time-outs (s), and what lets time pass; None: it
        #: passes by itself
        self.clock: Callable[[], float] = time.monotonic
        self.pass_time: Callable[[], None] | None = None
        self._subscriptions = self._listen()

    # -- state, as heard last

    @property
    def position(self) -> float:
        """Position of the runner, m, as its sensor reads it; nan while there is no reading."""
        return self._position if self._is_read else math.nan

    @property
    def velocity(self) -> float:
        """Velocity of the runner, m/s: the mean between the last two readings published."""
        return self._velocity if self._is_read else math.nan

    @property
    def friction_force(self) -> float:
        """Friction force on the runner, N, from joint_states."""
        return self._friction_force

    @property
    def stamp(self) -> float:
        """Time of position, velocity and force: the stamp of their message, s."""
        return self._state_stamp * 1e-9

    @property
    def state(self) -> str:
        """State of the axis: stopped, stepping, jogging, scanning, targeting, holding, ..."""
        return self._status["state"]

    @property
    def moving(self) -> bool:
        """True while cycles or a slow move of the actuator run."""
        return self._status["moving"] == "True"

    @property
    def target_reached(self) -> bool:
        """True while the closed loop holds its target."""
        return self._status["target reached"] == "True"

    @property
    def steps_done(self) -> int:
        """Steps of the present or last move, with sign, when the axis last said something."""
        return int(self._status["steps done"])

    @property
    def last_error(self) -> str:
        """Reason of the last refusal or fault, from any client."""
        return self._status["last error"]

    @property
    def status(self) -> Mapping[str, str]:
        """All that the axis said last, with an event or while it moves: see ``~/status``."""
        return dict(self._status)

    @property
    def summary(self) -> str:
        """The state in words: why a fault, what is left of a move, what is not as usual.

        In closed loop that is the distance: its steps are in trains, as many as it takes.
        """
        said = self._status
        away = float(said.get("following error (m)", "nan"))
        words = [self._message if said["state"] == "fault" else said["state"]]
        if math.isfinite(away):
            words.append(f"{format_si(abs(away), 'm', 3)} from the target")
        else:
            steps = "step" if said["steps done"] in ("1", "-1") else "steps"
            words += [f"{said['steps done']} {steps} done", f"{said['steps left']} left"]
        words += ["paused"] if said.get("paused") == "True" else []
        words += [f"injected: {said['injected faults']}"] if said.get("injected faults") else []
        return ", ".join(words)

    @property
    def parameters(self) -> Mapping[str, str]:
        """Parameters in force, as text."""
        prefix = f"{self.axis[1:]}: parameter "
        return {
            name.removeprefix(prefix): _values(status)["value"]
            for name, status in self._description.items()
            if name.startswith(prefix)
        }

    # -- inside

    @property
    def _is_read(self) -> bool:
        """Whether the sensor gives readings, without which joint_states stay away."""
        return self._status.get("measured position (m)") != "nan"

    @property
    def _shows_rest(self) -> bool:
        """Whether the joint state was read after the status was made, if it can be."""
        if not self._is_read:
            return True
        paused = self._status.get("paused") == "True" and self.pass_time is None
        return self._state_stamp >= self._status_stamp + (0 if paused else self._reading_age)

    def _listen(self) -> list[Any]:
        # The queue is shared by all who publish: of one message, a stranger's could be left.
        latched = QoSProfile(depth=_MOST_ANSWERS, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        found = []
        for topic, take in (
            # Events from before the connection arrive too: no answer gets lost.
            (topics.STATUS, self._on_status),
            (topics.EVENTS, self._on_events),
            (topics.SET_POINTS, self._on_events),
            (topics.DESCRIPTION, self._on_description),
            (topics.DIAGNOSTICS, self._on_report),
            (topics.JOINTS, self._on_state),
        ):
            kind, name = message_class(topic.type), topic.full_name(self.axis)
            qos = latched if topic.kept else QoSProfile(depth=_QUEUE)
            callback = partial(self._take, take, name)
            found.append(self.node.create_subscription(kind, name, callback, qos))
        return found

    def _take(self, take: Callable[[Any, int], None], topic: str, message: Any) -> None:
        try:
            with self._changed:
                take(message, nanoseconds(message.header.stamp))
                self._changed.notify_all()
        except (LookupError, ValueError) as error:
            # Anybody may publish here, and an exception would end the thread that spins.
            self.node.get_logger().warning(
                f"ignored a message on {topic} that does not come from an axis "
                f"({type(error).__name__}): who else publishes there?",
                throttle_duration_sec=1.0,
            )

    def _on_status(self, message: DiagnosticArray, stamp: int) -> None:
        if stamp >= self._status_stamp:
            before, self._status = self._status, _values(message.status[0], _OF_STATUS)
            if any(before.get(key) != self._status[key] for key in ("state", "moving")):
                self._state_since = stamp
            self._message, self._status_stamp = message.status[0].message, stamp

    def _on_events(self, message: DiagnosticArray, stamp: int) -> None:
        for status in message.status:
            self._answers.append(Answer(stamp, _values(status, ("event", "outcome"))))

    def _on_description(self, message: DiagnosticArray, _: int) -> None:
        found = {status.name: status for status in message.status}
        about = _values(found[f"{self.axis[1:]}: description"], ("axis_name",))
        for name, status in found.items():
            _values(status, ("value",) if ": parameter " in name else ())
        self._description = found
        self._joint = f"{about['axis_name']}{SLIDER}"
        p = self.parameters
        age = float(p.get("sensor_latency", 0.0)) + 2.0 / float(p.get("sensor_rate", math.inf))
        self._reading_age = round(1e9 * age)  # the latency is rounded up to readings

    def _on_report(self, message: DiagnosticArray, stamp: int) -> None:
        mine = [status for status in message.status if status.hardware_id == self.axis[1:]]
        if mine:
            self._report = {s.name.rpartition(": ")[2]: _values(s) for s in mine}
            self._report_stamp = stamp

    def _on_state(self, message: JointState, stamp: int) -> None:
        if self._joint in message.name:
            k = message.name.index(self._joint)
            found = message.position[k], message.velocity[k], message.effort[k]
            self._position, self._velocity, self._friction_force = found
            self._state_stamp = stamp

    def _wait(
        self,
        condition: Callable[[], bool],
        timeout: float,
        failure: Callable[[], str],
        motion: bool = False,
    ) -> None:
        """Wait for a condition; for one of motion, time has to pass.

        Raises TimeoutError after timeout (s), of motion by :attr:`clock`.
        """
        clock, pass_time = (self.clock, self.pass_time) if motion else (time.monotonic, None)
        deadline = clock() + timeout
        while True:
            with self._changed:
                if condition():
                    return
                if clock() > deadline:
                    raise TimeoutError(f"{failure()} (waited {timeout:g} s){self._others()}")
                if not pass_time:
                    self._changed.wait(_POLL)
            if pass_time:
                pass_time()

    def _others(self) -> str:
        """Return a warning if several nodes publish as this axis, else an empty text."""
        count = self.node.count_publishers(topics.STATUS.full_name(self.axis))
        if count < 2:
            return ""
        return f"; {count} nodes publish as {self.axis} and obey: end all but one, or rename them"


def _values(status: DiagnosticStatus, needed: Collection[str] = ()) -> dict[str, str]:
    """Return the values of a status by key; KeyError if one that is needed is missing."""
    found = {pair.key: pair.value for pair in status.values}
    for key in needed:
        found[key]
    return found
