# SPDX-License-Identifier: Apache-2.0
"""Shared fixtures: real ROS, each test in a DDS domain and a context of its own, on loopback only.

Nothing here imports ROS before a fixture that needs it is used, so the other tests run without it.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import hypothesis
import pytest
from child import environment
from table_1 import TABLE_1

if TYPE_CHECKING:
    from playwright.sync_api import Browser
    from rclpy.node import Node
    from rclpy.publisher import Publisher
    from rclpy.qos import QoSProfile

    from stickslip_ros.ros.axis_node import AxisNode
    from stickslip_ros.ros.spin_thread import SpinThread

#: Also where the package is used as it is, without having been installed.
pytest_plugins = ("stickslip_ros.testing.plugin",)
# Tests are about the compiled solver, and leave no process behind that compiles it.
os.environ.setdefault("STICKSLIP_COMPILE", "wait")
# Programs that tests start find the bytecode that the first of them leaves.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# The threads of linear algebra on small matrices wait for each other, busily.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# A shell that runs the tests in the background has them ignore Ctrl-C, and so would the programs
# that are sent one here.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
# An example that takes long shows a busy machine, not a defect.
hypothesis.settings.register_profile("any machine", deadline=None)
hypothesis.settings.load_profile("any machine")
TIMEOUT = 60.0  # s, far more than anything takes, for a machine that is busy with other things
#: Folders whose tests start processes, serve sockets or wait for DDS.
REAL_TIME = frozenset({"cli", "emulator", "examples", "fuzz", "ros", "testing", "validation"})
#: Fixtures for tests with DDS, programs or sockets, none of which is quick.
SLOW = frozenset({"stickslip_domain", "start_module", "emulate", "browser"})


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what is slow, and give a test that depends on the machine's clock a second chance.

    The summary tells who needed it.
    """
    for item in items:
        starts = SLOW.intersection(getattr(item, "fixturenames", ()))
        if starts or item.get_closest_marker("long"):
            item.add_marker(pytest.mark.slow)
        if item.nodeid.removeprefix("test/").partition("/")[0] in REAL_TIME:
            item.add_marker(pytest.mark.flaky(reruns=1))


def pytest_xdist_auto_num_workers() -> int:
    """Return the workers of ``-n auto``: half as many again as processors, as many tests wait."""
    return math.ceil(1.5 * len(os.sched_getaffinity(0)))


class CompileOnce:
    """Compiles in one process while the workers collect; each would compile all for itself."""

    def __init__(self) -> None:
        """Begin; that process holds a lock until it ends, however it does."""
        held, self._lock = tempfile.mkstemp()
        fcntl.flock(held, fcntl.LOCK_EX)
        command = [sys.executable, str(Path(__file__).with_name("compile_tests.py"))]
        self._child = subprocess.Popen(command, stdout=held, env=environment())
        os.close(held)

    @pytest.hookimpl(optionalhook=True)
    def pytest_configure_node(self, node: Any) -> None:
        """Tell a worker what to wait for."""
        node.workerinput["compiling"] = self._lock

    def pytest_unconfigure(self) -> None:
        """End it with the tests."""
        self._child.kill()
        self._child.wait()
        os.unlink(self._lock)


def pytest_configure(config: pytest.Config) -> None:
    """Compile before workers need it; a run in one process compiles what it uses."""
    if config.getoption("numprocesses", None) and not hasattr(config, "workerinput"):
        config.pluginmanager.register(CompileOnce())


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop(session: pytest.Session) -> None:
    """Wait in a worker until all is compiled."""
    compiling = getattr(session.config, "workerinput", {}).get("compiling")
    if compiling:
        with open(compiling) as lock:
            fcntl.flock(lock, fcntl.LOCK_SH)


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
    from stickslip_ros.library.zero_amplitude import zero_amplitude
    from stickslip_ros.traces import regime_now, trace_steps

    axis = Axis(TABLE_1)
    axis.compile_ahead()
    assert regime_now(axis.simulation) == "elastic"
    assert zero_amplitude(axis.parameters)
    assert len(trace_steps(TABLE_1, 2).t)


#: What a search for steps found and said, by the samples that it searched.
_FOUND: dict[bytes, tuple[Any, list[str]]] = {}


@pytest.fixture(scope="module", autouse=True)
def search_once(request: pytest.FixtureRequest) -> Iterator[None]:
    """Search the same samples for steps once, but in the tests of the search.

    A search takes seconds, and most tests look at what follows it.
    """
    if request.path.parent.name == "traces":
        yield
        return
    from stickslip_ros.traces import analysis

    search = analysis.find_steps

    def remember(t: Any, x: Any, period: float | None = None, report: Any = None) -> Any:
        key = hashlib.blake2b(t.tobytes() + x.tobytes() + repr(period).encode()).digest()
        if key not in _FOUND:
            said: list[str] = []
            _FOUND[key] = search(t, x, period, said.append), said
        found, said = _FOUND[key]
        for stage in said if report else ():
            report(stage)
        return found

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(analysis, "find_steps", remember)
        yield


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Give a real Chromium; without one, or without Playwright, the test is skipped."""
    api = pytest.importorskip("playwright.sync_api", reason="no Playwright: pip install playwright")
    names = ("chromium", "chromium-browser", "google-chrome")
    program = next(filter(None, map(shutil.which, names)), None)
    if not program:
        pytest.skip("no Chromium on this machine: apt install chromium")
    with api.sync_playwright() as playwright:
        found = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield found
        found.close()


@pytest.fixture
def wait_until() -> Callable[..., Any]:
    """Give the function that waits for a condition: ``wait_until(condition, what, timeout)``."""
    return _wait_until


@pytest.fixture
def ros_domain(stickslip_domain: int) -> int:
    """Reserve a DDS domain for this test and set the environment, that of child processes too."""
    return stickslip_domain


class Ros:
    """A context with an executor that spins in a thread, and helpers to wait for what happens."""

    def __init__(self, spin: SpinThread) -> None:
        """Keep what spins; the fixture ``ros`` makes and ends it."""
        self.context, self.executor = spin.context, spin.executor
        self.add = spin.add

    wait_until = staticmethod(_wait_until)

    def node(self, name: str = "test_node", **options: Any) -> Node:
        """Make a node that the executor spins."""
        from rclpy.node import Node

        return self.add(Node(name, context=self.context, **options))

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


@pytest.fixture
def ros(ros_domain: int) -> Iterator[Ros]:
    """Give a :class:`Ros` in a domain of its own."""
    from stickslip_ros.ros.spin_thread import SpinThread

    spin = SpinThread("ros", ros_domain)
    try:
        yield Ros(spin)
    finally:
        spin.close()


@pytest.fixture
def make_axis(ros: Ros) -> Callable[..., AxisNode]:
    """Give a function that makes an axis node here: ``make_axis("/left", frequency=500.0)``.

    The operating point is that of Table 1 where nothing else is said.
    """
    from rclpy.parameter import Parameter

    from stickslip_ros.ros.axis_node import AxisNode

    def make(namespace: str | None = None, **parameters: Any) -> AxisNode:
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        node = AxisNode(
            given={**TABLE_1, "publish_rate": 100.0},
            context=ros.context,
            namespace=namespace,
            parameter_overrides=overrides,
        )
        return ros.add(node)

    return make


class Process:
    """A program of ours, running on its own; its output is collected in a file."""

    def __init__(self, command: Sequence[str], folder: Path, output: Path) -> None:
        """Start it in a folder."""
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

    ``start_node("recorder_node", output="bag")`` runs that executable.
    """

    def start(name: str, *ros_arguments: str, **parameters: object) -> Process:
        arguments = list(ros_arguments)
        for key, value in parameters.items():
            arguments += ["-p", f"{key}:={value}"]
        return start_module("stickslip_ros.executables", name, "--ros-args", *arguments)

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
