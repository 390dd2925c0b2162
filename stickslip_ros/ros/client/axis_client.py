# SPDX-License-Identifier: Apache-2.0
"""The client of an axis: commands that return when the axis has accepted them, and its state.

    with AxisClient("/stickslip_axis") as axis:
        axis.send("frequency", 1000.0)
        axis.send("steps", 200).wait()
        print(axis.position)

Every command waits for the answer of the axis, and raises `CommandRefused` with the reason if the
axis refuses; `wait` waits for the end of the command. Nothing waits longer than its timeout.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, closing, contextmanager, suppress
from functools import partial
from typing import TYPE_CHECKING, Any

from rcl_interfaces.srv import SetParametersAtomically
from rclpy.client import Client
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.task import Future

from stickslip_ros.axis import CommandRefused
from stickslip_ros.axis.command import JOINT_STATE, SET_PARAMETERS, TRAJECTORY, Command
from stickslip_ros.axis.commands import COMMANDS, command_of
from stickslip_ros.axis.events import STEP_OF_TIME, value_text
from stickslip_ros.axis.faults import VANISH
from stickslip_ros.base.errors import StickslipError
from stickslip_ros.base.reporting.terminal import announce_if_slow
from stickslip_ros.physics.parameters import PARAMETERS
from stickslip_ros.physics.parameters.groups import AXIS_NODE
from stickslip_ros.ros.client.listener import Answer, AxisListener
from stickslip_ros.ros.nodes.messages import (
    MalformedCommand,
    message_class,
    read_command,
    write_command,
)
from stickslip_ros.ros.nodes.process import SpinThread
from stickslip_ros.ros.nodes.topics import axes_in

_LAST_WORDS = 1.0  # s
_LOOK = 0.01  # s between looks for axes and answers
_QUIET = 1.0  # s without another axis, after which all are known
#: Methods of before 3.0.0 and their commands; others had the names of theirs
_FORMER = {"step": "steps", "move_to": "position", "follow": "trajectory"}


class AxisFault(StickslipError, RuntimeError):
    """The axis is in fault and takes no motion until a reset."""


class AxisClient(AxisListener, AbstractContextManager["AxisClient"]):
    """Commands one axis. Use it from one thread at a time."""

    def __init__(
        self,
        axis: str = f"/{AXIS_NODE}",
        *,
        node: Node | None = None,
        timeout: float = 20.0,
        listeners: int = 1,
    ) -> None:
        """Connect to the axis node of that full name.

        Without a node, the client makes its own, with a context and a thread that spins it; a given
        node has to be spun by another thread. timeout (s) applies to each answer of the axis.
        listeners is the number of nodes that have to subscribe before the first command is sent,
        such as 2 if a recorder runs beside the axis. Raises TimeoutError if the axis does not
        answer, ValueError for a name that no node can have.
        """
        name = f"/{axis.lstrip('/')}"
        if not re.fullmatch(r"(/[A-Za-z_][A-Za-z0-9_]*)+", name):
            raise ValueError(f"axis is {axis!r}; give the full name of a node, as /{AXIS_NODE}")
        self.timeout = timeout  #: s, for each answer of the axis
        self._own: SpinThread | None = None
        if node is None:
            self._own = SpinThread("stickslip_client")
            # It logs nothing, and a second one of that name would be warned of.
            own = Node("stickslip_client", context=self._own.context, enable_rosout=False)
            node = self._own.add(own)
        super().__init__(name, node)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._spun = node.create_timer(0.0, lambda: self._spun.cancel(), clock=steady)
        self._answered = -1  # stamp (ns) of the answer to the last command
        self._commands = False  # something was sent: until then, what others send counts
        self._jogs = False  # the last command of this client that moves or ends a move
        self._moves = False  # that command moves, and its end has not been waited for
        self._publishers: dict[str, Publisher] = {}
        self._clients: dict[str, Client] = {}
        for one in COMMANDS.values():
            kind, topic = message_class(one.type), f"{self.axis}/{one.interface}"
            if one.is_service:
                self._clients[one.name] = node.create_client(kind, topic)
            else:
                self._publishers[one.name] = node.create_publisher(kind, topic, one.depth)
        try:
            with announce_if_slow(f"waiting for {self.axis}, {timeout:g} s at most"):
                self._wait(
                    lambda: self.connected(listeners),
                    timeout,
                    lambda: self._why_absent(listeners),
                )
        except BaseException:
            self.close()
            raise

    def __exit__(self, *error: object) -> None:
        """Close the client; the axis continues."""
        self.close()

    def close(self) -> None:
        """Disconnect from the axis, which continues; closing twice does no harm.

        Subscribers get a second to confirm commands that are still on their way.
        """
        deadline = time.monotonic() + _LAST_WORDS
        for publisher in self._publishers.values():
            left = max(deadline - time.monotonic(), 0.0)
            publisher.wait_for_all_acked(Duration(seconds=left))
        if self._own:
            self._own.close()
        else:
            self.node.destroy_timer(self._spun)
            for subscription in self._subscriptions:
                self.node.destroy_subscription(subscription)
            for publisher in self._publishers.values():
                self.node.destroy_publisher(publisher)
            for client in self._clients.values():
                self.node.destroy_client(client)
        self._subscriptions, self._publishers, self._clients = [], {}, {}

    def connected(self, listeners: int = 1) -> bool:
        """Return whether the axis, and as many nodes as needed, are connected both ways."""
        return not self._missing(listeners)

    def _why_absent(self, listeners: int) -> str:
        if not self._spun.is_canceled():
            return (
                f"nobody spins {self.node.get_fully_qualified_name()}, the node that the client "
                "was given: have another thread spin it, such as SpinThread, and make the client "
                "in none of its callbacks; or leave out node"
            )
        axes = axes_in(self.node)
        if not axes:
            return (
                f"no axis answers at {self.axis}: is axis_node running in this domain, "
                "or is it still compiling? see its log"
            )
        if self.axis not in axes:
            return f"no axis {self.axis}; here are {', '.join(axes)}"
        missing = f"{self.axis} is not complete; missing: {', '.join(self._missing(listeners))}"
        if self._status:
            return missing
        return (
            f"{missing}; with use_sim_time an axis says nothing before the first /clock, publish it"
        )

    def _missing(self, listeners: int) -> list[str]:
        """Name the interfaces of the axis that are still missing."""
        missing = [] if self._status else ["its status"]
        if self._state_stamp < 0 and self._is_read:
            missing.append("its joint state")
        for publisher in self._publishers.values():
            if publisher.get_subscription_count() < listeners:
                missing.append(f"a listener on {publisher.topic_name}")
        for client in self._clients.values():
            if not client.service_is_ready():
                missing.append(f"the service {client.srv_name}")
        return missing

    # -- commands; each returns when the axis has taken it

    def send(self, name: str, *arguments: Any) -> AxisClient:
        """Send a command by its name in docs/states.md, with its value in SI units if it has one.

        So ``send("steps", 200)``, ``send("jog", -500.0)`` (Hz), ``send("position", 5e-6)`` (m),
        ``send("stop")``, ``send("enable", False)``, ``send("parameters", {"preload": 0.7})``, and
        ``send("trajectory", [(0.5, 1e-6)])``, with points of time from now (s) and position (m).
        Raises CommandRefused with the reason of the axis, ParameterError for what is no command.
        """
        command = command_of(name)
        if command.type == TRAJECTORY:
            arguments = ([self._joint], *arguments)
        arguments = command.completed(arguments)
        if command.type == SET_PARAMETERS:
            return self.set_parameters(*arguments)
        if command.type == JOINT_STATE and arguments[0] != self._joint:
            raise CommandRefused(f"{name} refused: no joint {arguments[0]!r}; give {self._joint}")
        message = _message(name, *arguments)
        if command.is_service:
            return self._call(name, message)
        value = ""
        if command.arguments == ("value",):
            value = value_text(*(read_command(command, message, 0, self._joint) or ()))
        since = self._forget_answers()
        self._publishers[name].publish(message)
        self._await_answer(name, value, since)
        if command.moves:
            self._moves = command.task is not None and not command.turns_off(arguments)
            self._jogs = name == "jog" and self._moves
        return self

    if not TYPE_CHECKING:  # for programs of before 3.0.0

        def __getattr__(self, name: str) -> Callable[..., AxisClient]:
            """Return the command that had a method: ``step``, ``move_to``, ``set_load``, ..."""
            known = _FORMER.get(name, name.removeprefix("set_"))
            if known not in COMMANDS:
                raise AttributeError(f"an AxisClient has no {name!r}")
            return partial(self.send, known)

    def follow_with(
        self,
        others: Sequence[AxisClient],
        points: Sequence[tuple[float, Sequence[float]]],
        host: str = "",
    ) -> AxisClient:
        """Follow points together with other axes of the process; all take them, or none does.

        points: times from now (s), each with a position (m) of this axis and of the others. They
        end together. host is the full name of the node that hosts the axes, in place of
        `stickslip_axis` in their namespace.
        """
        axes, command = [self, *others], COMMANDS["trajectory"]
        message = _message(command.name, [axis._joint for axis in axes], points)
        host = host or f"{self.axis.rpartition('/')[0]}/{AXIS_NODE}"
        topic = f"{host}/{command.interface}"
        publisher = self.node.create_publisher(type(message), topic, command.depth)
        failure = f"no host of axes listens on {topic}"
        try:
            heard = publisher.get_subscription_count
            self._wait(lambda: heard() > 0, self.timeout, lambda: failure)
            since = [axis._forget_answers() for axis in axes]
            publisher.publish(message)
            for axis, stamp in zip(axes, since, strict=True):
                axis._await_answer(command.name, "", stamp)
                axis._moves = True
        finally:
            self.node.destroy_publisher(publisher)
        return self

    def set_parameters(
        self, parameters: Mapping[str, Any] | None = None, /, **values: Any
    ) -> AxisClient:
        """Set parameters of the axis, all or none: of a mapping, by name, or both."""
        values = {**(parameters or {}), **values}
        wanted = [Parameter(name, value=v).to_parameter_msg() for name, v in values.items()]
        request = SetParametersAtomically.Request(parameters=wanted)
        # Those that every node has are no event of the axis, and one that vanishes says none.
        noted = bool(PARAMETERS.keys() & values.keys())
        noted = noted and VANISH not in str(values.get("fault"))
        return self._call("parameters", request, noted)

    # -- faults on demand, of an axis that runs with allow_faults

    @contextmanager
    def fault(self, faults: str) -> Iterator[AxisClient]:
        """Inject faults of docs/faults.md, as "axis_stall 50", for a block.

        Those that were injected before act again after it.
        """
        before = self.parameters["fault"]
        self.inject(faults)
        try:
            yield self
        finally:
            self.inject(before)

    def inject(self, faults: str) -> AxisClient:
        """Let these faults act from now on, and no others; empty: none."""
        return self.set_parameters(fault=faults)

    # -- the time of the axis, and of all others in its process

    def go_on(self, seconds: float = 0.0, *, cycles: int = 0, timeout: float = 60.0) -> AxisClient:
        """Let a paused time go on by simulated seconds, or drive cycles, and stand still again.

        Returns when the state at the end has arrived; TimeoutError after timeout (s) of real time.
        """
        steps = {"step_time": float(seconds), "step_cycles": cycles}
        self.set_parameters(**{name: value for name, value in steps.items() if value})

        def there() -> bool:
            ends = [a.stamp for a in self._answers if a.values["event"] == STEP_OF_TIME]
            return bool(ends) and (self._state_stamp >= ends[-1] or not self._is_read)

        self._wait(there, timeout, lambda: f"{self.axis} has not come to the end of the step")
        return self

    # -- waiting

    def wait(self, timeout: float = 60.0) -> AxisClient:
        """Wait until steps, a scan or a trajectory have ended, a target or home is reached.

        Raises AxisFault with the reason of a fault, CommandRefused where a command of somebody
        else ended it, TimeoutError after timeout (s), ValueError after a jog, which has no end.
        Of what a soft limit ended, `ended_by` tells.
        """

        def ended() -> bool:
            if self.state == "fault":
                raise AxisFault(self._status["last error"] + self._others())
            if self._jogs and self.state == "jogging":
                raise ValueError("a jog does not end: send stop or jog 0 before waiting")
            at_rest = not self.moving and self.state not in ("targeting", "homing")
            return at_rest and self._shows_rest

        self._wait(
            ended, timeout, lambda: f"{self.axis} is still {self.summary}; it goes on", motion=True
        )
        if self._moves:
            # The event of the end has a topic of its own; a closed loop that comes back to its
            # target has none.
            with suppress(TimeoutError):
                self._wait(self._heard_of_end, _LAST_WORDS, str, motion=True)
            self._moves = False
            if (by := self.ended_by) in COMMANDS:
                raise CommandRefused(
                    f"{self.axis}: the motion was ended by another command: {by}, of somebody else"
                )
        return self

    @property
    def ended_by(self) -> str:
        """What has ended the motion of the last command; "" if nothing did.

        The name of a command, of anybody, or of a soft limit, ``soft_low`` or ``soft_high``.
        """
        for values in (one.values for one in self._since_answer()):
            event = values["event"]
            if _begins_or_ends_a_move(values):
                return event
            if event == "limit" and values["limit"].startswith("soft"):
                return values["limit"]
        return ""

    @property
    def limits_hit(self) -> list[str]:
        """What the motion of the last command has hit, each once, the first first.

        They are the ends of the travel, "travel_low" and "travel_high", and the soft limits,
        "soft_low" and "soft_high". Of a client that has sent nothing: of the last motion.
        """
        events = [one.values for one in self._since_answer()]
        return list(dict.fromkeys(one["limit"] for one in events if one["event"] == "limit"))

    def wait_for_state(self, state: str, timeout: float = 60.0) -> AxisClient:
        """Wait until the axis is in that state; TimeoutError after timeout (s)."""
        self._wait(
            lambda: self.state == state,
            timeout,
            lambda: f"{self.axis} is {self.state}, not {state}",
            motion=True,
        )
        return self

    def report(self, timeout: float = 30.0) -> dict[str, dict[str, str]]:
        """Wait for the next report of the axis, once a second: axis, friction and timing.

        The report is later than the last answer or end of a move received here.
        """
        since = self._status_stamp
        failure = f"{self.axis} does not report on /diagnostics"
        self._wait(lambda: self._report_stamp > since, timeout, lambda: failure, motion=True)
        return self._report

    # -- inside

    def _since_answer(self) -> list[Answer]:
        """Return the events since the answer to the last command."""
        with self._changed:  # those of another topic, from before the connection, may come later
            events = [one for one in self._answers if one.stamp >= self._answered]
        if self._commands:
            return events
        begun = [k for k, one in enumerate(events) if _begins_or_ends_a_move(one.values)]
        return events[begun[-1] + 1 :] if begun else events

    def _heard_of_end(self) -> bool:
        events = self._since_answer()
        ends = [one.stamp for one in events if one.values["outcome"] == "finished"]
        return bool(self.ended_by) or (bool(ends) and ends[-1] >= self._state_since)

    def _call(self, name: str, request: Any, noted: bool = True) -> AxisClient:
        since = self._forget_answers()
        future = self._clients[name].call_async(request)
        failure = f"{self.axis} does not answer the call of {name}"
        self._wait(future.done, self.timeout, lambda: failure)
        response: Any = future.result()
        result = getattr(response, "result", response)
        if getattr(result, "success", getattr(result, "successful", False)):
            if noted:
                self._await_answer(name, "", since)
            return self
        reason = getattr(result, "message", "") or getattr(result, "reason", "")
        raise CommandRefused(f"{name} refused: {reason}")

    def _forget_answers(self) -> int:
        """Forget earlier answers; return the stamp that any answer to this command has to reach."""
        if not self._publishers:
            raise RuntimeError(f"this client of {self.axis} is closed; make a new one")
        with self._changed:
            self._answers.clear()
            self._commands = True
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
        self._wait(answered, self.timeout, lambda: f"{self.axis} does not answer {text}")
        with self._changed:  # what came before it belongs to the last command
            while self._answers.popleft() is not found[0]:
                pass
            self._answered = found[0].stamp
        if found[0].values["outcome"] == "refused":
            raise CommandRefused(f"{name} refused: {found[0].values.get('reason')}")
        if COMMANDS[name].moves:
            self._jogs = self._moves = False


def _begins_or_ends_a_move(event: Mapping[str, str]) -> bool:
    command = COMMANDS.get(event["event"])
    return command is not None and command.moves and event["outcome"] == "applied"


def _message(name: str, *arguments: Any) -> Any:
    """Return the message of a command; CommandRefused if it cannot hold the arguments."""
    try:
        return write_command(COMMANDS[name], *arguments)
    except MalformedCommand as error:
        raise CommandRefused(f"{name} refused: {error}") from None


def command_all(command: Command, timeout: float) -> dict[str, str]:
    """Call a service without values of every axis in the graph, each as soon as it is found.

    Returns why it did not do so for each full name of an axis, which is empty where it did; nothing
    where no axis is found within the timeout (s), which applies to the answers as well.
    """
    with closing(SpinThread("stickslip_everywhere")) as spin:
        node = spin.add(Node("stickslip_everywhere", context=spin.context, enable_rosout=False))
        clients: dict[str, Client] = {}
        calls: dict[str, Future] = {}
        began = found = time.monotonic()
        while (now := time.monotonic()) < began + timeout:
            for axis in axes_in(node):
                if axis not in clients:
                    kind, name = message_class(command.type), f"{axis}/{command.interface}"
                    clients[axis], found = node.create_client(kind, name), now
            for axis, client in clients.items():
                if axis not in calls and client.service_is_ready():
                    calls[axis] = client.call_async(write_command(command))
            done = [axis for axis, call in calls.items() if call.done()]
            if clients and len(done) == len(clients) and now > found + _QUIET:
                break
            time.sleep(_LOOK)
        silent = f"it does not answer (waited {timeout:g} s)"
        answers = {axis: call.result() for axis, call in calls.items() if call.done()}
        reasons = {axis: "" if one.success else one.message for axis, one in answers.items()}
        return {axis: reasons.get(axis, silent) for axis in clients}
