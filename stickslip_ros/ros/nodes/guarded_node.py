# SPDX-License-Identifier: Apache-2.0
"""A node that guards all its callbacks, so that none of them can end the process.

If a callback raises an exception, the node logs and counts it; a service answers that it failed.
rclpy itself would pass the exception to the code that spins the executor. The topic /clock, which
leads the time of a node with ``use_sim_time``, is read so that time never runs back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial, wraps
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, qos_profile_parameters
from rclpy.task import Future

from stickslip_ros.base.errors import UsageError

CLOCK_TOPIC, USE_SIM_TIME = "/clock", "use_sim_time"
_AGAIN = 10.0  # s between warnings that there is no clock, or none that counts
_WARN_PERIOD = 1.0  # s, between errors in the log
_SERVICES = QoSProfile(depth=250)  # so many requests may wait
#: Parameters that one request may set, more are refused together; or ask for: it is answered by
#: nothing then, as by a node that does not know one of them. 3000 names made a node grow by 70 MB.
MOST_PARAMETERS = 200
_ASKING = (DescribeParameters, GetParameters, GetParameterTypes, ListParameters)


def follows(node: Node) -> bool:
    """Return whether a node has ``use_sim_time``. Raises UsageError where it is no bool."""
    value = node.get_parameter(USE_SIM_TIME).value
    if not isinstance(value, bool):
        raise UsageError(f"parameter {USE_SIM_TIME} is {value!r}; it has to be true or false")
    return value


class FollowedClock:
    """Readings of /clock that never run back, for what cannot be undone."""

    def __init__(self, node: Node) -> None:
        """Take the clock of a node that has ``use_sim_time``."""
        self._node = node
        self._back = self._last = 0  # ns by which it was set back, and its last reading
        self._begun = False

    def missing(self) -> bool:
        """Return whether there is no time yet, and say so now and then."""
        # Later on, 0 is a time as any other: a simulator that starts anew.
        self._begun = self._begun or self._node.get_clock().now().nanoseconds > 0
        if self._begun:
            return False
        self._node.get_logger().warning(
            "waits for the first message on /clock, which leads the time; publish it, or leave "
            "out use_sim_time",
            throttle_duration_sec=_AGAIN,
        )
        return True

    def reading(self) -> int:
        """Return the time, ns, from where it was set back; 0: there is none yet."""
        now = self._node.get_clock().now().nanoseconds + self._back
        if now < self._last:
            self._node.get_logger().warning(
                f"/clock was set back by {1e-9 * (self._last - now):g} s; time goes on from where "
                "it was, ahead of it: start the node anew for the new time"
            )
            self._back, now = self._back + self._last - now, self._last
        now = min(now, (2**31 - 1) * 10**9)  # the last time that a stamp can hold
        if self._last and now - self._last > 60_000_000_000:  # the clock may have been set
            self._node.get_logger().warning(
                f"/clock went on by {1e-9 * (now - self._last):g} s at once, and all of it counts: "
                "start the node anew if that was a change of the clock"
            )
        self._last = now
        return self._last


class NoAnswer(Exception):
    """Raised by the callback of a service that is not to be answered at all."""


class GuardedNode(Node):
    """A node that no message, service call, timer or parameter can bring down."""

    def __init__(self, name: str, **options: Any) -> None:
        """Set up the node; name and options are those of `rclpy.node.Node`.

        Given parameters are declared, so that a misspelt name is found.
        """
        self.failures = 0  #: callbacks that raised, since the start
        self.finished = Future()  #: done when there is nothing left to do
        self.nodes: Sequence[Node] = [self]  #: to spin
        options.setdefault("automatically_declare_parameters_from_overrides", True)
        super().__init__(name, **options)
        #: /clock, with ``use_sim_time``, of which rclpy only logs a wrong type, and goes on without
        self.followed = FollowedClock(self) if follows(self) else None
        self.add_on_set_parameters_callback(_keep_clock)

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Any, *a: Any, **k: Any
    ) -> Any:
        """As rclpy does; an exception in the callback is counted as a refusal."""
        if topic == CLOCK_TOPIC:  # asked for by rclpy itself, with use_sim_time
            callback = partial(self._take_clock, callback)
        return super().create_subscription(msg_type, topic, self._guarded(callback, topic), *a, **k)

    def create_service(  # type: ignore[override]
        self, kind: Any, name: str, callback: Any, *a: Any, **k: Any
    ) -> Any:
        """As rclpy does; an exception in it is counted, and the answer reports the failure.

        Requests of a hundred clients at once may wait, and of parameters no more: of those that
        rclpy has no room for, nobody hears again.
        """
        setters = {SetParameters: self._set_each, SetParametersAtomically: self._set_all}
        guarded = self._guarded(setters.get(kind, callback), name)
        listed = "prefixes" if kind is ListParameters else "names"

        def answer(request: Any, response: Any) -> Any:
            if kind in _ASKING and len(getattr(request, listed)) > MOST_PARAMETERS:
                return response
            done = guarded(request, response)
            if done is None and hasattr(response, "message"):
                response.message = f"{name} failed; the log of the node says why"
            return done or response

        if not a and k.get("qos_profile") in (None, qos_profile_parameters):
            k["qos_profile"] = _SERVICES
        return super().create_service(kind, name, answer, *a, **k)

    def create_timer(  # type: ignore[override]
        self, period: float, callback: Any, *a: Any, **k: Any
    ) -> Any:
        """As rclpy does, by the steady clock; an exception in the callback is counted."""
        k.setdefault("clock", Clock(clock_type=ClockType.STEADY_TIME))
        return super().create_timer(period, self._guarded(callback, "a timer"), *a, **k)

    def note_failure(self, source: str, error: Exception) -> None:
        """Count and log an exception of a callback; source: topic, service or "a timer"."""
        self.failures += 1
        self.get_logger().error(
            f"{source} failed, {_short(error)}; {self.failures} failures so far. It is passed "
            "over and the node goes on: please report it with what was sent",
            throttle_duration_sec=_WARN_PERIOD,
        )

    def _set_each(self, request: Any, response: Any) -> Any:
        wanted = request.parameters
        if len(wanted) > MOST_PARAMETERS:  # one refusal for all: to make thousands takes 50 ms
            response.results = [self._set(wanted)] * len(wanted)
        else:
            response.results = [self._set([message]) for message in wanted]
        return response

    def _set_all(self, request: Any, response: Any) -> Any:
        response.result = self._set(request.parameters)
        return response

    def _set(self, messages: Sequence[Any]) -> SetParametersResult:
        """Set parameters, all or none; a type that ROS does not know is refused as well."""
        if (count := len(messages)) > MOST_PARAMETERS:
            limit = f"{MOST_PARAMETERS} is the limit: send several"
            return refused(f"{count} parameters in one request; {limit}")
        try:
            wanted = [Parameter.from_parameter_msg(message) for message in messages]
            # A dump that is loaded again names those of the start too, as they are.
            news = [one for one in wanted if not _stays(self, one)]
            if wanted and not news:
                return SetParametersResult(successful=True)
            return self.set_parameters_atomically(news)
        except Exception as error:
            return refused(_short(error))

    def _take_clock(self, take: Callable[[Any], None], message: Any) -> None:
        """Hand a message of /clock to rclpy, which raises for times below 0."""
        if message.clock.sec >= 0:
            take(message)
            return
        self.get_logger().warning(
            f"/clock says {message.clock.sec + 1e-9 * message.clock.nanosec:g} s, which is passed "
            "over: ROS knows no times before 0; have whoever publishes it begin at 0 or later",
            throttle_duration_sec=_AGAIN,
        )

    def _guarded(self, callback: Callable[..., Any], source: str) -> Callable[..., Any]:
        # rclpy looks at the signature, which wraps keeps.
        @wraps(callback)
        def guarded(*arguments: Any) -> Any:
            try:
                return callback(*arguments)
            except NoAnswer:
                raise  # whoever spins passes it over, and rclpy then sends nothing
            except Exception as error:
                self.note_failure(source, error)
                return None

        return guarded


def _keep_clock(changes: Sequence[Parameter]) -> SetParametersResult:
    """Refuse another clock while the node runs: what is under way counts by the present one."""
    if any(one.name == USE_SIM_TIME for one in changes):
        return refused(f"{USE_SIM_TIME} can be set at the start only")
    return SetParametersResult(successful=True)


def refused(reason: str) -> SetParametersResult:
    """Return that parameters are not set, and why."""
    return SetParametersResult(successful=False, reason=reason)


def _stays(node: Node, wanted: Parameter) -> bool:
    """Return whether a parameter that only the start sets has the wanted value already."""
    if not node.has_parameter(wanted.name):
        return False
    now, fixed = node.get_parameter(wanted.name), node.describe_parameter(wanted.name).read_only
    same = now.type_ == wanted.type_ and now.value == wanted.value
    if now.type_ == Parameter.Type.DOUBLE:  # 1, and the text that YAML takes "1e-06" for
        with suppress(TypeError, ValueError):
            same = now.value == float(wanted.value)
    return same and (fixed or wanted.name == USE_SIM_TIME)


def _short(error: Exception) -> str:
    text = " ".join(f"{type(error).__name__}: {error}".split())
    return text if len(text) <= 300 else f"{text[:300]} ..."
