# SPDX-License-Identifier: Apache-2.0
"""Shared fixtures: real ROS, each test in a DDS domain and a context of its own, on loopback only.

Nothing here imports ROS before a fixture that needs it is used, so the other tests run without it.
"""

from __future__ import annotations

import fcntl
import importlib.util
import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import hypothesis
import pytest
from child import environment
from live import MakeAxis, Process, Ros, Start
from table_1 import TABLE_1

if TYPE_CHECKING:
    from playwright.sync_api import Browser

# Programs that tests start find the bytecode that the first of them leaves, and so does the next
# run: to rewrite the assertions of all tests takes each worker twenty seconds.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
# The threads of linear algebra on small matrices wait for each other, busily.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# A shell that runs the tests in the background has them ignore Ctrl-C, and so would the programs
# that are sent one here.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
# An example that takes long shows a busy machine, not a defect.
hypothesis.settings.register_profile("any machine", deadline=None)
hypothesis.settings.load_profile("any machine")
#: Folders whose tests start processes, serve sockets or wait for DDS.
REAL_TIME = frozenset({"cli", "emulator", "examples", "ros"})
NO_BROWSER = "no browser for the tests of pages: apt-get install chromium"


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what `make test` leaves out, and give what depends on a clock a second chance.

    The summary tells who needed it. Their programs wait for no compiling: it is done before.
    """
    for item in items:
        if item.nodeid.startswith("validation"):
            item.add_marker(pytest.mark.long)
        if item.nodeid.removeprefix("test/").partition("/")[0] in REAL_TIME:
            item.add_marker(pytest.mark.flaky(reruns=1))
            item.fixturenames.insert(0, "compiled_solver")  # type: ignore[attr-defined]


def pytest_report_header() -> str:
    """Say what is left out as a whole."""
    return "" if importlib.util.find_spec("rclpy") else "no rclpy: test/ros is left out"


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Let the summary count what lacks a browser in one line, not in one for each place."""
    for report in terminalreporter.stats.get("skipped", ()):
        if NO_BROWSER in str(report.longrepr):
            report.longrepr = (__file__, None, NO_BROWSER)


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """Return the workers of ``-n auto``: half as many again as processors, as many tests wait."""
    return math.ceil(1.5 * len(os.sched_getaffinity(0)))


class CompileOnce:
    """Compiles in two processes while the workers collect; each would compile all for itself."""

    def __init__(self) -> None:
        """Begin; these processes hold a lock until both have ended, however they do."""
        held, self._lock = tempfile.mkstemp()
        fcntl.flock(held, fcntl.LOCK_EX)
        command = [sys.executable, str(Path(__file__).with_name("compile_tests.py"))]
        self._children = [
            subprocess.Popen([*command, *what], stdout=held, env=environment())
            for what in ([], ["integrators"])
        ]
        os.close(held)

    @pytest.hookimpl(optionalhook=True)
    def pytest_configure_node(self, node: Any) -> None:
        """Tell a worker what to wait for."""
        node.workerinput["compiling"] = self._lock

    def pytest_report_header(self) -> str:
        """Say what comes before the first test."""
        return "every worker loads the package and collects the tests: ten seconds or more"

    @pytest.hookimpl(optionalhook=True)
    def pytest_xdist_node_collection_finished(self, node: Any, ids: list[str]) -> None:
        """Tell who has collected, and what the tests still wait for."""
        said = f"{node.gateway.id} has collected {len(ids)} tests"
        if any(child.poll() is None for child in self._children):
            said += "; what they need is still being compiled, minutes the first time"
        terminal = node.config.pluginmanager.getplugin("terminalreporter")
        terminal.write_line(f"\n{said}" if terminal.isatty else said)

    def pytest_unconfigure(self) -> None:
        for child in self._children:
            child.kill()
            child.wait()
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


@pytest.fixture(scope="session")
def compiled_solver() -> None:
    """Have everything compiled that an axis needs, for tests that start programs.

    On a fresh machine that takes a while, longer than they wait, and the programs say so.
    """
    from stickslip_ros.axis import Axis
    from stickslip_ros.simulation.operating_points import zero_amplitude
    from stickslip_ros.simulation.phases import regime_now
    from stickslip_ros.simulation.sampling import trace_steps

    axis = Axis(TABLE_1)
    axis.compile_ahead()
    assert regime_now(axis.simulation) == "elastic"
    assert zero_amplitude(axis.parameters)
    assert len(trace_steps(TABLE_1, 2).t)


#: What a search for steps found and said, by the samples that it searched.


@pytest.fixture(scope="session", autouse=True)
def patience() -> Iterator[None]:
    """Let commands say nothing about how long they take on a busy machine."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("stickslip_ros.base.reporting.terminal._PATIENCE", 600.0)
        yield


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Give a real Chromium; without one, or without Playwright, the test is skipped."""
    api = pytest.importorskip("playwright.sync_api", reason="no Playwright: pip install playwright")
    names = ("chromium", "chromium-browser", "google-chrome")
    program = next(filter(None, map(shutil.which, names)), None)
    if not program:
        pytest.skip(NO_BROWSER)
    with api.sync_playwright() as playwright:
        found = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield found
        found.close()


@pytest.fixture
def ros_domain(stickslip_domain: int) -> int:
    """Reserve a DDS domain for this test and set the environment, that of child processes too."""
    return stickslip_domain


@pytest.fixture
def ros(ros_domain: int) -> Iterator[Ros]:
    """Give a :class:`Ros` in a domain of its own."""
    from stickslip_ros.ros.nodes.process import SpinThread

    spin = SpinThread("ros", ros_domain)
    try:
        yield Ros(spin)
    finally:
        spin.close()


@pytest.fixture
def make_axis(ros: Ros) -> MakeAxis:
    """Give a function that makes an axis node here: ``make_axis("/left", frequency=500.0)``.

    The operating point is that of Table 1 where nothing else is said.
    """
    from rclpy.parameter import Parameter

    from stickslip_ros.ros.nodes.axis_node import AxisNode

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


@pytest.fixture
def start_module(ros_domain: int, tmp_path: Path) -> Iterator[Start]:
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
def start_node(start_module: Start) -> Start:
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

    def start(name: str, *parameters: dict[str, Any], record: Path | None = None) -> Emulated:
        axes = [Axis({**TABLE_1, **values}) for values in parameters or ({},)]
        emulated = Emulated(name, axes, record)
        started.append(emulated)
        return emulated

    yield start
    for emulated in started:
        emulated.close()
