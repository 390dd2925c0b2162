# SPDX-License-Identifier: Apache-2.0
"""Fixtures of pytest: an axis over ROS, several of them, one without ROS; see docs/testing.md.

Every test gets axes of its own, in a DDS domain of its own, on loopback only, so tests run side by
side. Loading this costs nothing: everything is imported when a fixture is used.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from stickslip_ros.axis import Axis
    from stickslip_ros.ros.client import AxisClient
    from stickslip_ros.ros.in_process import InProcess

_MARKER = "stickslip"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option that names the driver to hold against the contract."""
    group = parser.getgroup("stickslip_ros")
    group.addoption(
        "--stickslip-driver",
        default="offline",
        metavar="NAME|MODULE:FACTORY",
        help="driver that stickslip_ros.testing.contract tests (default: %(default)s)",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Describe the marker."""
    config.addinivalue_line(
        "markers",
        f"{_MARKER}(axes=[...], emulate='anc300', x={{...}}, **parameters): parameters of the "
        "simulated axes of a test; those of one axis under its name",
    )


@pytest.fixture
def stickslip_domain(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Reserve a DDS domain for the test and set the environment, that of child processes too."""
    from stickslip_ros.testing.domain import own_domain

    with own_domain(tmp_path, monkeypatch.setenv) as domain:
        yield domain


@pytest.fixture
def stickslip_world(
    request: pytest.FixtureRequest, stickslip_domain: int, tmp_path: Path
) -> Iterator[InProcess]:
    """Give axes in this process: ``clients["x"]``, ``port`` of the emulator, ``node("mine")``."""
    yield from _world(request, tmp_path)


@pytest.fixture
def stickslip_axis(
    request: pytest.FixtureRequest, stickslip_domain: int, tmp_path: Path
) -> Iterator[AxisClient]:
    """Give the client of one axis, which runs in this process as `/stickslip_axis`."""
    for world in _world(request, tmp_path):
        yield world.clients["stickslip_axis"]


@pytest.fixture
def offline_axis(request: pytest.FixtureRequest) -> Axis:
    """Give an axis without ROS, whose time is an argument: ``advance(t)``."""
    from stickslip_ros.axis import Axis

    return Axis(_parameters(request))


def _parameters(request: pytest.FixtureRequest) -> dict[str, Any]:
    """Return what the markers say, the nearest last."""
    markers = list(request.node.iter_markers(_MARKER))
    for marker in markers:
        if marker.args:
            raise pytest.UsageError(
                f"{request.node.nodeid}: @pytest.mark.{_MARKER} takes names only, as preload=1.0"
            )
    return {name: value for marker in reversed(markers) for name, value in marker.kwargs.items()}


def _world(request: pytest.FixtureRequest, folder: Path) -> Iterator[InProcess]:
    from stickslip_ros.ros.in_process import InProcess

    given = _parameters(request)
    names = list(given.pop("axes", []))
    of_axes: dict[str, Mapping[str, Any]] = {name: given.pop(name, {}) for name in names}
    given.setdefault("emulate_port", 0)
    world = InProcess(folder, given, of_axes)
    yield world
    world.close()
