# SPDX-License-Identifier: Apache-2.0
"""A user's end of an axis: commands that return when they are taken, state as properties.

    with AxisClient("/stickslip_axis") as axis:
        axis.set_frequency(1000.0)
        axis.step(200).wait()
        print(axis.position)

Every command waits for the axis' answer and raises `CommandRefused` with its reason if it says no;
`wait` waits for the end of what was commanded. Nothing waits longer than its timeout.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Sequence
from types import TracebackType
from typing import Any

from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import Float64, Int32
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from stickslip_ros.axis import CommandRefused
from stickslip_ros.parameters import PARAMETERS
from stickslip_ros.ros.client.listener import Answer, AxisListener
from stickslip_ros.ros.client.own_node import OwnNode

#: Commands after which a jog does not go on.
_ENDS_A_JOG = ("steps", "scan", "position", "trajectory", "stop", "enable")
_INT32 = 2**31  # steps, and s of a duration, have to be less to go into a message
_TOPICS: dict[str, tuple[type[Any], str]] = {
    "amplitude": (Float64, "command/amplitude"),
    "frequency": (Float64, "command/frequency"),
    "steps": (Int32, "command/steps"),
    "jog": (Float64, "command/jog"),
    "scan": (Float64, "command/scan"),
    "position": (Float64, "command/position"),
    "trajectory": (JointTrajectory, "joint_trajectory"),
    "load": (WrenchStamped, "load"),
}
_SERVICES: dict[str, tuple[type[Any], str]] = {
    "stop": (Trigger, "stop"),
    "reset": (Trigger, "reset"),
    "zero": (Trigger, "zero"),
    "enable": (SetBool, "enable"),
    "parameters": (SetParametersAtomically, "set_parameters_atomically"),
}


class AxisFault(RuntimeError):
    """The axis is in fault and takes no motion until `AxisClient.reset`."""


class AxisClient(AxisListener):
    """Commands one axis. Use it from one thread at a time."""

    def __init__(
        self,
        axis: str = "/stickslip_axis",
        *,
        node: Node | None = None,
        timeout: float = 20.0,
        listeners: int = 1,
    ) -> None:
        """Connect to the axis node of that full name.

        Without a node, the client makes its own, with a context and a thread that spins it; a
        given one has to be spun by another thread. timeout (s) holds for each answer of the axis.
        listeners is how many nodes have to hear the commands before the first one is sent, such
        as 2 if a recorder runs beside the axis. Raises TimeoutError if the axis does not answer,
        ValueError for a name that no node can have.
        """
        name = f"/{axis.lstrip('/')}"
        if not re.fullmatch(r"(/[A-Za-z_][A-Za-z0-9_]*)+", name):
            raise ValueError(f"axis is {axis!r}; give the full name of a node, as /stickslip_axis")
        self._timeout = timeout
        self._own: OwnNode | None = None
        if node is None:
            self._own = OwnNode()
            node = self._own.node
        super().__init__(name, node)
        self._jogs = False  # the last command of ours that moves or ends a move
        self._publishers = {
            name: node.create_publisher(kind, f"{self.axis}/{topic}", 10)
            for name, (kind, topic) in _TOPICS.items()
        }
        self._clients = {
            name: node.create_client(kind, f"{self.axis}/{service}")
            for name, (kind, service) in _SERVICES.items()
        }
        try:
            self._wait(
                lambda: self.connected(listeners),
                timeout,
                lambda: f"no axis answers at {self.axis}: is axis_node running in this domain?",
            )
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> AxisClient:
        """Return the client."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close it; the axis goes on with what it does."""
        self.close()

    def close(self) -> None:
        """Let go of the axis, which goes on with what it does; twice does no harm."""
        if self._own:
            self._own.close()
        else:
            for subscription in self._subscriptions:
                self.node.destroy_subscription(subscription)
            for publisher in self._publishers.values():
                self.node.destroy_publisher(publisher)
            for client in self._clients.values():
                self.node.destroy_client(client)
        self._subscriptions, self._publishers, self._clients = [], {}, {}

    def connected(self, listeners: int = 1) -> bool:
        """Return whether the axis, so many nodes in all, hears the commands and has been heard."""
        return (
            bool(self._status)
            and self._state_stamp >= 0
            and all(p.get_subscription_count() >= listeners for p in self._publishers.values())
            and all(client.service_is_ready() for client in self._clients.values())
        )

    # -- commands; each returns when the axis has taken it

    def step(self, steps: int) -> AxisClient:
        """Run so many steps, the sign is the direction; 0 finishes the cycle and stops."""
        count = int(operator.index(steps))
        if not -_INT32 <= count < _INT32:
            raise CommandRefused(f"steps refused: {count} steps; a command takes {_INT32 - 1}")
        return self._publish("steps", Int32(data=count), str(count))

    def jog(self, hertz: float) -> AxisClient:
        """Step without end at a frequency (Hz), the sign is the direction; 0 stops."""
        self._publish_number("jog", hertz)
        self._jogs = hertz != 0.0
        return self

    def scan(self, volts: float) -> AxisClient:
        """Move the actuator slowly to a level (V), without a slip."""
        return self._publish_number("scan", volts)

    def move_to(self, position: float) -> AxisClient:
        """Go to a position (m) in closed loop and hold it."""
        return self._publish_number("position", position)

    def follow(self, points: Sequence[tuple[float, float]]) -> AxisClient:
        """Follow points (time from now in s, position in m) in closed loop, hold the last."""
        message = JointTrajectory(joint_names=[self._joint])
        for number, (seconds, position) in enumerate(points, 1):
            if not abs(seconds) < _INT32:
                raise CommandRefused(
                    f"trajectory refused: point {number} is at {seconds:g} s; "
                    f"a message holds up to {_INT32 - 1} s"
                )
            at = Duration(nanoseconds=round(seconds * 1e9)).to_msg()
            message.points.append(JointTrajectoryPoint(positions=[position], time_from_start=at))
        return self._publish("trajectory", message)

    def set_amplitude(self, volts: float) -> AxisClient:
        """Set the amplitude (V peak to peak) from the next cycle on."""
        return self._publish_number("amplitude", volts)

    def set_frequency(self, hertz: float) -> AxisClient:
        """Set the drive frequency (Hz) from the next cycle on."""
        return self._publish_number("frequency", hertz)

    def set_load(self, newtons: float) -> AxisClient:
        """Put an external force (N) along the axis in force."""
        message = WrenchStamped()
        message.wrench.force.x = float(newtons)
        return self._publish("load", message, repr(float(newtons)))

    def set_parameters(self, **values: Any) -> AxisClient:
        """Set parameters of the axis, all or none."""
        wanted = [Parameter(name, value=v).to_parameter_msg() for name, v in values.items()]
        request = SetParametersAtomically.Request(parameters=wanted)
        # Those that every node has are no event of the axis.
        return self._call("parameters", request, noted=bool(PARAMETERS.keys() & values.keys()))

    def stop(self) -> AxisClient:
        """End what runs, steps after their cycle."""
        return self._call("stop", Trigger.Request())

    def reset(self) -> AxisClient:
        """Leave a fault."""
        return self._call("reset", Trigger.Request())

    def zero(self) -> AxisClient:
        """Let the closed loop count positions from the present one on."""
        return self._call("zero", Trigger.Request())

    def enable(self, on: bool = True) -> AxisClient:
        """Let the axis take commands, or none."""
        return self._call("enable", SetBool.Request(data=on))

    # -- waiting

    def wait(self, timeout: float = 60.0) -> AxisClient:
        """Wait until steps, a scan or a trajectory have ended or a target is reached.

        Raises AxisFault with the reason of a fault, TimeoutError after timeout (s), ValueError
        after a jog, which has no end.
        """

        def ended() -> bool:
            if self.state == "fault":
                raise AxisFault(self._status["last error"])
            if self._jogs and self.state == "jogging":
                raise ValueError("a jog has no end: stop it, or jog(0), before waiting")
            at_rest = not self.moving and self.state != "targeting"
            return at_rest and self._state_stamp >= self._status_stamp

        def failure() -> str:
            left = self._status["steps left"]
            return f"{self.axis} is still {self.state}, {left} steps left"

        self._wait(ended, timeout, failure)
        return self

    def wait_for_state(self, state: str, timeout: float = 60.0) -> AxisClient:
        """Wait until the axis is in that state; TimeoutError after timeout (s)."""
        self._wait(
            lambda: self.state == state,
            timeout,
            lambda: f"{self.axis} is {self.state}, not {state}",
        )
        return self

    def report(self, timeout: float = 30.0) -> dict[str, dict[str, str]]:
        """Return what the axis reports next, once a second: axis, friction and timing.

        Waits for a report made after the last answer or end of a move that arrived here.
        """
        since = self._status_stamp
        self._wait(
            lambda: self._report_stamp > since,
            timeout,
            lambda: f"{self.axis} does not report on /diagnostics",
        )
        return self._report

    # -- inside

    def _publish_number(self, name: str, value: float) -> AxisClient:
        return self._publish(name, Float64(data=float(value)), repr(float(value)))

    def _publish(self, name: str, message: Any, value: str = "") -> AxisClient:
        """Publish a command and wait for its answer, the one with that value if there are more."""
        since = self._forget_answers()
        self._publishers[name].publish(message)
        self._await_answer(name, value, since)
        return self

    def _call(self, name: str, request: Any, noted: bool = True) -> AxisClient:
        since = self._forget_answers()
        future = self._clients[name].call_async(request)
        failure = f"{self.axis} does not answer the call of {name}"
        self._wait(future.done, self._timeout, lambda: failure)
        response: Any = future.result()
        result = getattr(response, "result", response)
        if getattr(result, "success", getattr(result, "successful", False)):
            if noted:
                self._await_answer(name, "", since)
            return self
        reason = getattr(result, "message", "") or getattr(result, "reason", "")
        raise CommandRefused(f"{name} refused: {reason}")

    def _forget_answers(self) -> int:
        """Forget earlier answers; return the stamp before which none is to ours."""
        if not self._publishers:
            raise RuntimeError(f"this client of {self.axis} is closed; make a new one")
        with self._changed:
            self._answers.clear()
            return self._state_stamp

    def _await_answer(self, name: str, value: str, since: int) -> None:
        found: list[Answer] = []

        def answered() -> bool:
            found[:] = [
                answer
                for answer in self._answers
                if answer.stamp >= since
                and answer.values["event"] == name
                and answer.values["outcome"] in ("applied", "refused")
                and (not value or answer.values["value"] == value)
            ]
            return bool(found) and self._status_stamp >= found[0].stamp

        text = f"{name} {value}".strip()
        self._wait(answered, self._timeout, lambda: f"{self.axis} does not answer {text}")
        if found[0].values["outcome"] == "refused":
            raise CommandRefused(f"{name} refused: {found[0].values.get('reason')}")
        if name in _ENDS_A_JOG:
            self._jogs = False
