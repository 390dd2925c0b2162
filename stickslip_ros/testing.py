# SPDX-License-Identifier: Apache-2.0
"""Fixtures of pytest: an axis over ROS, several of them, one without ROS; see docs/testing.md.

Every test gets axes of its own, in a DDS domain of its own, on loopback only, so tests run side by
side. Loading this costs nothing: everything is imported when a fixture is used.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from stickslip_ros.base.errors import StickslipError

if TYPE_CHECKING:
    from stickslip_ros.ros.client import AxisClient
    from stickslip_ros.ros.testing.in_process import InProcess
    from stickslip_ros.ros.testing.offline import OfflineAxis

_MARKER = "stickslip"
_compiled = False  # by a test of this process
_DOMAINS = 100  # 1 to 100: those that Fast DDS has ports for on every system

# Fast DDS announces a new participant five times, 100 ms apart, and a known one every 3 s, which
# is what a missed announcement costs; more and quicker ones make the first contact short and even.
# A writer asks for acknowledgement every 3 s, which is what waiting for it would take.
_FAST_DISCOVERY = """<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"><profiles>
  <participant profile_name="quick" is_default_profile="true"><rtps><builtin><discovery_config>
    <initialAnnouncements><count>20</count><period><nanosec>50000000</nanosec></period>
    </initialAnnouncements>
    <leaseAnnouncement><sec>0</sec><nanosec>250000000</nanosec></leaseAnnouncement>
  </discovery_config></builtin></rtps></participant>
  <data_writer profile_name="asking" is_default_profile="true"><times>
    <heartbeatPeriod><nanosec>20000000</nanosec></heartbeatPeriod>
  </times></data_writer>
</profiles></dds>
"""
# Where a process is killed that shares memory with others, Fast DDS gives that memory up, and one
# of the others that closes its context in the same moment crashes. Tests kill processes, so they
# share no memory.
_TRANSPORTS = "UDPv4"


def pytest_configure(config: pytest.Config) -> None:
    """Describe the marker."""
    config.addinivalue_line(
        "markers",
        f"{_MARKER}(axes=[...], emulate='anc300', own_time=True, x={{...}}, **parameters): "
        "parameters of the simulated axes of a test; those of one axis under its name",
    )


@pytest.fixture
def stickslip_domain(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Reserve a DDS domain for the test and its child processes; set the environment."""
    with own_domain(tmp_path, monkeypatch.setenv) as domain:
        yield domain


@pytest.fixture
def stickslip_world(
    request: pytest.FixtureRequest, stickslip_domain: int, tmp_path: Path
) -> Iterator[InProcess]:
    """Give the world of the test: axes in this process, faults of theirs, time.

    ``clients["x"]``, ``axis``, ``fault("sensor_freeze", "x")``, ``run(1.0)``, ``wait_until``,
    ``add(MyNode(context=world.context))``, ``port`` of the emulator.
    """
    with _marker_of(request):
        world = _world_of(_parameters(request), tmp_path, request)
    yield world
    world.close()


@pytest.fixture
def stickslip_axis(stickslip_world: InProcess) -> AxisClient:
    """Give the client of the only axis of the world, or of its first one."""
    return stickslip_world.axis


@pytest.fixture
def stickslip_fault(stickslip_world: InProcess) -> Callable[..., AbstractContextManager[Any]]:
    """Give a function that injects faults: ``with stickslip_fault("sensor_freeze"): ...``.

    They act on the first axis of the world, with ``axis=`` on that of a name or a client.
    docs/faults.md lists the faults.
    """
    return stickslip_world.fault


@pytest.fixture
def offline_axis(request: pytest.FixtureRequest) -> OfflineAxis:
    """Give an axis without ROS: ``run(seconds)`` lets time pass, at once."""
    from stickslip_ros.ros.testing.offline import OfflineAxis

    with _marker_of(request):
        return OfflineAxis(_parameters(request))


def _parameters(request: pytest.FixtureRequest) -> dict[str, Any]:
    """Return the parameters of the markers, the innermost last."""
    markers = list(request.node.iter_markers(_MARKER))
    for marker in markers:
        if marker.args:
            raise StickslipError("it takes names only, as preload=1.0")
    return {name: value for marker in reversed(markers) for name, value in marker.kwargs.items()}


@contextmanager
def _marker_of(request: pytest.FixtureRequest) -> Iterator[None]:
    """Fail the test in one line, without a traceback, where its marker cannot be carried out."""
    try:
        yield
    except StickslipError as error:
        text = f"{request.node.nodeid}: @pytest.mark.{_MARKER}: {error}"
        pytest.fail(text, pytrace=False)


def _world_of(given: dict[str, Any], folder: Path, request: pytest.FixtureRequest) -> InProcess:
    from stickslip_ros.ros.nodes.axis_host import compile_axis
    from stickslip_ros.ros.testing.in_process import InProcess

    names, own_time = list(given.pop("axes", [])), bool(given.pop("own_time", False))
    of_axes: dict[str, Mapping[str, Any]] = {name: given.pop(name, {}) for name in names}
    given = {"allow_faults": True, "emulate_port": 0, **given}
    global _compiled
    if not _compiled:  # where nothing of it is in the cache, the user sees what takes so long
        capture = request.config.pluginmanager.getplugin("capturemanager")
        with capture.global_and_fixture_disabled() if capture else nullcontext():
            compile_axis()
        _compiled = True
    return InProcess(folder, given, of_axes, own_time)


@contextmanager
def own_domain(folder: Path, setenv: Callable[[str, str], None]) -> Iterator[int]:
    """Reserve a domain while the block lasts, set it in the environment, return its number.

    folder is where logs and the profile of Fast DDS go. The test is skipped where ROS is missing.
    """
    cure = "source a ROS 2 installation, or pip install stickslip_ros[ros]"
    pytest.importorskip("rclpy", reason=f"no rclpy: {cure}")
    coordinator = pytest.importorskip(
        "domain_coordinator", reason=f"no domain_coordinator (of ament_cmake_ros): {cure}"
    )
    start = random.randrange(_DOMAINS)
    attempts = iter(range(_DOMAINS))
    profile = folder / "fast_discovery.xml"
    profile.write_text(_FAST_DISCOVERY, encoding="utf-8")
    with coordinator.domain_id(lambda: (start + next(attempts)) % _DOMAINS + 1) as domain:
        setenv("ROS_DOMAIN_ID", str(domain))
        setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        setenv("ROS_LOG_DIR", str(folder / "ros_log"))
        setenv("FASTRTPS_DEFAULT_PROFILES_FILE", str(profile))
        setenv("FASTDDS_BUILTIN_TRANSPORTS", _TRANSPORTS)
        yield int(domain)
