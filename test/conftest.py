# SPDX-License-Identifier: Apache-2.0
"""Shared fixtures: real ROS, each test in a DDS domain and a context of its own, on loopback only.

Nothing here imports ROS before a fixture that needs it is used, so the other tests run without it.
"""

from __future__ import annotations

import contextlib
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from table_1 import TABLE_1

if TYPE_CHECKING:
    from rclpy.context import Context
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.node import Node
    from rclpy.publisher import Publisher
    from rclpy.qos import QoSProfile

REPOSITORY = Path(__file__).resolve().parent.parent
TIMEOUT = 20.0  # s, far more than anything takes, for a machine that is busy with other things

# Fast DDS announces a new participant five times, 100 ms apart, and one that was missed costs
# seconds; more and quicker announcements make the first contact short and even. A writer asks for
# acknowledgement every 3 s, which is what waiting for it would take.
FAST_DISCOVERY = """<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"><profiles>
  <participant profile_name="quick" is_default_profile="true"><rtps><builtin><discovery_config>
    <initialAnnouncements><count>20</count><period><nanosec>50000000</nanosec></period>
    </initialAnnouncements>
  </discovery_config></builtin></rtps></participant>
  <data_writer profile_name="asking" is_default_profile="true"><times>
    <heartbeatPeriod><nanosec>20000000</nanosec></heartbeatPeriod>
  </times></data_writer>
</profiles></dds>
"""


def _wait_until(condition: Callable[[], Any], what: str = "", timeout: float = TIMEOUT) -> Any:
    """Return the first true value of the condition; fail when there is none in time.

    :param what: names the condition in the failure.
    :param timeout: s.
    """
    deadline = time.monotonic() + timeout
    while not (value := condition()):
        if time.monotonic() > deadline:
            pytest.fail(f"not within {timeout:g} s: {what or condition}")
        time.sleep(0.005)
    return value


@pytest.fixture(scope="session")
def compiled_solver() -> None:
    """Have everything compiled that an axis needs, for tests that start programs.

    On a fresh machine that takes half a minute, longer than they wait, and the programs say so.
    """
    from stickslip_ros.axis import Axis
    from stickslip_ros.studies.zero_amplitude import zero_amplitude
    from stickslip_ros.traces import regime_now

    axis = Axis(TABLE_1)
    axis.command_steps(1)
    axis.advance(0.005)
    axis.set_load(0.0)  # another plant in the middle of a cycle
    axis.advance(1.0)
    assert axis.state.t == 1.0
    assert regime_now(axis.simulation) == "elastic"
    assert zero_amplitude(axis.parameters)


@pytest.fixture
def wait_until() -> Callable[..., Any]:
    """Give the function that waits for a condition: ``wait_until(condition, what, timeout)``."""
    return _wait_until


@pytest.fixture
def ros_domain(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Reserve a DDS domain for this test and set the environment, that of child processes too."""
    pytest.importorskip("rclpy")
    coordinator = pytest.importorskip("domain_coordinator")
    start = random.randrange(100)
    attempts = iter(range(100))
    profile = tmp_path / "fast_discovery.xml"
    profile.write_text(FAST_DISCOVERY)
    with coordinator.domain_id(lambda: (start + next(attempts)) % 100 + 1) as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "ros_log"))
        monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", str(profile))
        yield domain


class Ros:
    """A context with an executor that spins in a thread, and helpers to wait for what happens."""

    def __init__(self, context: Context, executor: SingleThreadedExecutor) -> None:
        """Keep the two; the fixture ``ros`` makes and ends them."""
        self.context = context
        self.executor = executor
        self._nodes: list[Node] = []

    wait_until = staticmethod(_wait_until)

    def node(self, name: str = "test_node", **options: Any) -> Node:
        """Make a node that the executor spins."""
        from rclpy.node import Node

        node = Node(name, context=self.context, **options)
        return self.add(node)

    def add(self, node: Node) -> Node:
        """Let the executor spin a node made with :attr:`context`; it is destroyed at the end."""
        self._nodes.append(node)
        self.executor.add_node(node)
        return node

    def publisher(
        self, node: Node, kind: type[Any], topic: str, qos: QoSProfile | int = 10
    ) -> Publisher:
        """Make a publisher and wait until somebody listens."""
        publisher = node.create_publisher(kind, topic, qos)
        self.wait_until(lambda: publisher.get_subscription_count(), f"a listener of {topic}")
        return publisher

    def call(self, node: Node, kind: type[Any], service: str, request: Any) -> Any:
        """Call a service, wait for it and for the answer, return the answer."""
        client = node.create_client(kind, service)
        self.wait_until(client.service_is_ready, f"the service {service}")
        answer = client.call_async(request)
        self.wait_until(answer.done, f"an answer of {service}")
        return answer.result()

    def close(self) -> None:
        """Destroy the nodes; the executor must have ended."""
        for node in self._nodes:
            node.destroy_node()


@pytest.fixture
def ros(ros_domain: int) -> Iterator[Ros]:
    """Give a :class:`Ros` in a domain of its own."""
    import rclpy
    from rclpy.context import Context
    from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

    context = Context()
    rclpy.init(context=context, domain_id=ros_domain)
    executor = SingleThreadedExecutor(context=context)

    ending = threading.Event()

    def spin() -> None:
        with contextlib.suppress(ExternalShutdownException):
            # Shut down in the middle of `spin`, the executor falls over what it waits for.
            while not ending.is_set():
                executor.spin_once(timeout_sec=1.0)

    thread = threading.Thread(target=spin)
    thread.start()
    world = Ros(context, executor)
    try:
        yield world
    finally:
        ending.set()
        executor.wake()
        thread.join()
        executor.shutdown()
        world.close()
        context.try_shutdown()


class Process:
    """A program of ours, running on its own; its output is collected in a file."""

    def __init__(self, command: Sequence[str], folder: Path, output: Path) -> None:
        """Start it in a folder."""
        path = os.pathsep.join(filter(None, (str(REPOSITORY), os.environ.get("PYTHONPATH"))))
        self._output = output
        with output.open("wb") as stream:
            self._child = subprocess.Popen(
                command,
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
                env={**os.environ, "PYTHONPATH": path, "PYTHONUNBUFFERED": "1"},
            )

    @property
    def pid(self) -> int:
        """Its number."""
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
            _wait_until(said, f"'{text}' in the output", timeout)
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


@pytest.fixture
def start_module(ros_domain: int, tmp_path: Path) -> Iterator[Callable[..., Process]]:
    """Give a function that starts ``python -m <module> <arguments>`` in the test's DDS domain.

    What still runs at the end of the test is killed.
    """
    started: list[Process] = []

    def start(module: str, *arguments: str) -> Process:
        output = tmp_path / f"process_{len(started)}.log"
        process = Process([sys.executable, "-m", module, *arguments], tmp_path, output)
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()


@pytest.fixture
def start_node(start_module: Callable[..., Process]) -> Callable[..., Process]:
    """Give a function that starts a node of ours with parameters.

    ``start_node("recorder_node", output="bag")`` runs ``stickslip_ros.ros.recorder_node``.
    """

    def start(name: str, *ros_arguments: str, **parameters: object) -> Process:
        arguments = list(ros_arguments)
        for key, value in parameters.items():
            arguments += ["-p", f"{key}:={value}"]
        return start_module(f"stickslip_ros.ros.{name}", "--ros-args", *arguments)

    return start


@pytest.fixture
def emulate() -> Iterator[Callable[..., Any]]:
    """Give a function that serves a controller with one axis per set of parameters."""
    from emulated import Emulated

    from stickslip_ros.axis import Axis

    started: list[Emulated] = []

    def start(name: str, *parameters: dict[str, Any]) -> Emulated:
        emulated = Emulated(name, [Axis({**TABLE_1, **values}) for values in parameters or ({},)])
        started.append(emulated)
        return emulated

    yield start
    for emulated in started:
        emulated.server.close()
