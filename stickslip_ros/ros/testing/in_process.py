# SPDX-License-Identifier: Apache-2.0
"""Axes that run in this process, with a client for each, for tests.

They work as in a process of `axis_node`, except for their own context.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from stickslip_ros.physics.parameters.groups import AXIS_NODE
from stickslip_ros.ros.client import AxisClient
from stickslip_ros.ros.nodes.axis_host import axis_or_host
from stickslip_ros.ros.nodes.axis_node import AxisNode
from stickslip_ros.ros.nodes.emulation import Emulation
from stickslip_ros.ros.nodes.guarded_node import CLOCK_TOPIC, follows
from stickslip_ros.ros.nodes.process import SpinThread

_INSTANT = 0.5e-9  # s
_LOOK = 0.005  # s between looks at a condition
_ARRIVES = 1.0  # s that a message may be on its way
_AT_ONCE = 1.0  # s of the machine's time until the caller may interrupt
_BUSY = 1000  # rounds of messages that a moment of simulated time may cause


class InProcess:
    """A world for tests: axes, their clients, and the executor that spins them and your nodes.

    Its time is that of the machine; with own_time it is simulated: it stands still but for
    `run`, `wait_until` and the waits of the clients, which let it pass as fast as it can. Then
    /clock tells it to nodes with ``use_sim_time``, and whatever a node does about a message is done
    before time goes on, so a test comes out alike each time.
    """

    def __init__(
        self,
        folder: Path,
        parameters: Mapping[str, Any],
        of_axes: Mapping[str, Mapping[str, Any]],
        own_time: bool = False,
    ) -> None:
        """Start the axes.

        parameters are those of the node, or of the host and all its axes; of_axes are those of
        each axis by its name, none for a single axis; folder is where a parameter file is put.
        Raises ParameterError.
        """
        self.own_time = own_time
        self._ended = False
        if own_time:
            parameters = {**parameters, "start_paused": True, "publish_clock": True}
        single = not of_axes
        common = dict(parameters) if single else {**parameters, "axes": list(of_axes)}
        file = folder / "axes.yaml"
        sections = {AXIS_NODE: common, **of_axes}
        content = {name: {"ros__parameters": dict(p)} for name, p in sections.items() if p}
        # JSON is YAML with every text in quotes: ROS reads a bare y, n, on and off as yes and no.
        file.write_text(json.dumps(content), encoding="utf-8")
        arguments = ["--ros-args", "--params-file", str(file)] if common else ["--ros-args"]
        self._spin = SpinThread("stickslip_in_process")
        self.context = self._spin.context  #: of all nodes here
        try:
            self._axes = axis_or_host(
                arguments=arguments,
                context=self.context,
                cli_args=arguments,
                use_global_arguments=False,
            )
            for node in self._axes.nodes:
                self._spin.add(node)
            client = self.node("stickslip_test_client")
            self.nodes = [node for node in self._axes.nodes if isinstance(node, AxisNode)]
            names = [AXIS_NODE] if single else list(of_axes)
            self.clients = {name: AxisClient(name, node=client) for name in names}
            self.axis = self.clients[names[0]]  #: of the only axis, or of the first one
            if own_time:
                self._spin.run(self._hold)
        except BaseException:
            self._spin.close()
            raise

    @property
    def port(self) -> int:
        """The TCP port of the emulated controller; ValueError if there is none."""
        if not isinstance(self._axes, Emulation):
            raise ValueError("no controller is emulated; set the parameter emulate")
        return self._axes.port

    @contextmanager
    def fault(self, faults: str, axis: str | AxisClient | None = None) -> Iterator[AxisClient]:
        """Inject faults into an axis, by its name or client, for a block; None: the first axis.

        The others go on as they are. Raises ValueError for an axis that is not there.
        """
        if isinstance(axis, str) and axis not in self.clients:
            raise ValueError(f"there is no axis {axis!r}; there are {', '.join(self.clients)}")
        client = self.clients[axis] if isinstance(axis, str) else axis or self.axis
        with client.fault(faults):
            yield client

    # -- time

    @property
    def now(self) -> float:
        """The simulated time since the start, s."""
        return self.nodes[0].sim_loop.pace.seconds

    def run(self, seconds: float) -> None:
        """Let simulated time pass, s; with own_time at once, otherwise as it goes."""
        end = self.now + seconds
        if not self.own_time:
            self.wait_until(lambda: self.now >= end, 2.0 * seconds + 1.0)
            return
        while end - self.now > _INSTANT:
            self._pass_block(end)

    def wait_until(
        self, condition: Callable[[], object], timeout: float = 10.0, what: str = "the condition"
    ) -> None:
        """Let time pass until a condition holds; TimeoutError after timeout (s, simulated)."""
        deadline = self.now + timeout
        while not condition():
            if self.now > deadline:
                raise TimeoutError(f"not within {timeout:g} s of simulated time: {what}")
            if self.own_time:
                self._pass_block()
            else:
                time.sleep(_LOOK)

    def _hold(self) -> None:
        """Let time stand still but for the blocks that are asked for."""
        self.nodes[0].sim_loop.hold()
        published = [one for node in self._axes.nodes for one in node.publishers]
        self._clock = next(one for one in published if one.topic_name == CLOCK_TOPIC)
        for client in self.clients.values():
            client.clock, client.pass_time = lambda: self.now, self._pass_block
        # What rclpy says of QoS that does not match is two thirds of what an executor looks at in
        # each round; nodes under test keep theirs, which say the same.
        for node in self._spin.nodes:
            ends: list[Any] = [*node.publishers, *node.subscriptions]
            for one in ends:
                for handler in one.event_handlers:
                    node.remove_waitable(handler)
                    handler.destroy()
                one.event_handlers.clear()

    def _pass_block(self, end: float | None = None) -> None:
        """Let time go on to the next state, and all nodes react to it; or to an end (s) or near it.

        For a block alone, the thread that spins waits once more than it has to.
        """
        loop = self.nodes[0].sim_loop
        to = self.now + loop.pacer.period if end is None else end

        def work() -> None:
            until = time.monotonic() + _AT_ONCE
            while (left := to - self.now) > _INSTANT and time.monotonic() < until:
                loop.go_on(round(1e9 * min(loop.pacer.period, left)))
                self._settle()

        self._spin.run(work)

    def _settle(self) -> None:
        """Have all nodes react to what was published, until nobody has anything more to do."""
        for _ in range(_BUSY):
            for node in self._spin.nodes:
                for publisher in node.publishers:
                    publisher.wait_for_all_acked(Duration(seconds=_ARRIVES))
            if not self._spin.take_what_waits():
                return

    def node(self, name: str, **options: Any) -> Node:
        """Make a node that the executor spins."""
        return self.add(Node(name, context=self.context, **options))

    def add(self, node: Node) -> Node:
        """Let the executor spin a node that was made with :attr:`context`; return it.

        With own_time, a node with ``use_sim_time`` has the time of the world then.
        """
        if not (self.own_time and follows(node)):
            return self._spin.add(node)
        here = (*self._spin.nodes, node)
        hearers = sum(one.topic_name == CLOCK_TOPIC for n in here for one in n.subscriptions)
        loop, deadline = self.nodes[0].sim_loop, time.monotonic() + _ARRIVES

        def tell() -> None:
            while self._clock.get_subscription_count() < hearers and time.monotonic() < deadline:
                time.sleep(_LOOK)
            self._clock.publish(Clock(clock=loop.stamp()))
            self._clock.wait_for_all_acked(Duration(seconds=_ARRIVES))
            self._spin.add(node)  # whose subscription to /clock is its first
            self._settle()

        self._spin.run(tell)
        return node

    def close(self) -> None:
        """End all of it; twice does no harm."""
        if self._ended:
            return
        self._ended = True
        for client in self.clients.values():
            client.close()
        self._axes.close()  # which publish what they have not said yet
        self._spin.close()
