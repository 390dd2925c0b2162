# SPDX-License-Identifier: Apache-2.0
"""What runs beside a test, ROS nodes and programs of ours, and waiting for them."""

from __future__ import annotations

import contextlib
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from child import environment

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.publisher import Publisher
    from rclpy.qos import QoSProfile

    from stickslip_ros.ros.nodes.axis_node import AxisNode
    from stickslip_ros.ros.nodes.process import SpinThread

TIMEOUT = 60.0  # s, far more than anything takes, for a machine that is busy with other things


def wait_until(condition: Callable[[], Any], what: str = "", timeout: float = TIMEOUT) -> Any:
    """Return the first true value of the condition; fail when there is none in time.

    what: names the condition in the failure; timeout: s.
    """
    deadline = time.monotonic() + timeout
    while not (value := condition()):
        if time.monotonic() > deadline:
            pytest.fail(f"not within {timeout:g} s: {what or condition}")
        time.sleep(0.005)
    return value


class Ros:
    """A context with an executor that spins in a thread, and helpers to wait for what happens."""

    def __init__(self, spin: SpinThread) -> None:
        """Keep what spins; the fixture ``ros`` makes and ends it."""
        self.context, self.executor = spin.context, spin.executor
        self.add = spin.add

    wait_until = staticmethod(wait_until)

    def node(self, name: str = "test_node", **options: Any) -> Node:
        """Make a node that the executor spins."""
        from rclpy.node import Node

        return self.add(Node(name, context=self.context, **options))

    def hear(self, kind: type[Any], topic: str, qos: QoSProfile | int = 1000) -> list[Any]:
        """Return a list that takes every message of a topic from now on."""
        heard: list[Any] = []
        self.node("ears").create_subscription(kind, topic, heard.append, qos)
        return heard

    @staticmethod
    def latched(depth: int = 100) -> QoSProfile:
        """Return the quality of service with which the last messages wait for who comes late."""
        from rclpy.qos import DurabilityPolicy, QoSProfile

        return QoSProfile(depth=depth, durability=DurabilityPolicy.TRANSIENT_LOCAL)

    def publisher(
        self, node: Node, kind: type[Any], topic: str, qos: QoSProfile | int = 10
    ) -> Publisher:
        """Make a publisher and wait until somebody listens."""
        publisher = node.create_publisher(kind, topic, qos)
        self.wait_until(lambda: publisher.get_subscription_count(), f"a listener of {topic}")
        return publisher

    def send(self, publisher: Publisher, *messages: Any) -> None:
        """Publish reliably: return when everybody who listens has got all of it."""
        from rclpy.duration import Duration

        self.wait_until(publisher.get_subscription_count, f"a listener of {publisher.topic_name}")
        for message in messages:
            publisher.publish(message)
        assert publisher.wait_for_all_acked(Duration(seconds=TIMEOUT)), publisher.topic_name

    def call(self, node: Node, kind: type[Any], service: str, request: Any) -> Any:
        """Call a service, wait for it and for the answer, return the answer."""
        client = node.create_client(kind, service)
        self.wait_until(client.service_is_ready, f"the service {service}")
        answer = client.call_async(request)
        self.wait_until(answer.done, f"an answer of {service}")
        return answer.result()


class Process:
    """A program of ours, running on its own; its output is collected in a file."""

    def __init__(self, command: Sequence[str], folder: Path, output: Path) -> None:
        self._output = output
        # Tests that are killed leave no node behind, which would answer in a later test's domain.
        if shutil.which("setpriv"):
            command = ["setpriv", "--pdeathsig", "KILL", *command]
        with output.open("wb") as stream:
            self._child = subprocess.Popen(
                command,
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
                env=environment(PYTHONUNBUFFERED="1"),
            )

    @property
    def pid(self) -> int:
        return self._child.pid

    @property
    def output(self) -> str:
        """Everything it has said so far, on stdout and stderr."""
        return self._output.read_text(encoding="utf-8", errors="replace")

    def wait_for(self, text: str, timeout: float = TIMEOUT) -> None:
        """Wait until the text stands in the output; fail if the process ends without it."""

        def said() -> bool:
            ended = self._child.poll() is not None
            return text in self.output or ended

        try:
            wait_until(said, f"'{text}' in the output", timeout)
        finally:
            print(self.output)  # pytest shows it if the test fails
        assert text in self.output, f"ended without '{text}'"

    @property
    def running(self) -> bool:
        """Whether it has not ended yet."""
        return self._child.poll() is None

    def wait(self, timeout: float = TIMEOUT) -> int:
        """Return the exit code when it has ended."""
        return self._child.wait(timeout)

    def interrupt(self) -> int:
        """Send SIGINT, as Ctrl-C does; return the exit code."""
        self._child.send_signal(signal.SIGINT)
        return self.wait()

    def terminate(self) -> int:
        """Send SIGTERM; return the exit code."""
        self._child.terminate()
        return self.wait()

    @contextlib.contextmanager
    def stopped(self) -> Iterator[None]:
        """Keep it from running meanwhile, by SIGSTOP and SIGCONT."""
        self._child.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            self._child.send_signal(signal.SIGCONT)

    def kill(self) -> None:
        """End it at once if it still runs."""
        if self._child.poll() is None:
            self._child.kill()
            self._child.wait()


#: What the fixtures ``start_module``, ``start_node`` and ``make_axis`` give.
Start = Callable[..., Process]
MakeAxis = Callable[..., "AxisNode"]
