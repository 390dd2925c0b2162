# SPDX-License-Identifier: Apache-2.0
"""The pytest plugin, in another project."""

import os
import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest
from child import python

pytestmark = pytest.mark.slow

PLUGIN = "stickslip_ros.testing.plugin"
PROJECT = """
import socket

import pytest


@pytest.mark.stickslip(preload=0.4, mass=4e-3, max_voltage=300.0, amplitude=300.0)
def test_200_steps_are_24_micrometres_and_a_half(stickslip_axis):
    stickslip_axis.set_frequency(1000.0).step(200).wait()
    assert stickslip_axis.position == pytest.approx(24.5e-6, abs=0.1e-6)


@pytest.mark.stickslip(preload=1.0, frequency=1000.0)
class TestHeavy:
    def test_of_a_class(self, stickslip_axis):
        assert stickslip_axis.parameters["preload"] == "1.0"

    @pytest.mark.stickslip(preload=0.7)
    def test_the_nearest_marker_wins(self, offline_axis):
        offline_axis.command_steps(10)
        offline_axis.advance(0.1)
        assert offline_axis.parameters.flat()["preload"] == 0.7
        assert offline_axis.parameters.flat()["frequency"] == 1000.0
        assert 1e-6 < offline_axis.state.x < 1.6e-6


@pytest.mark.stickslip(axes=["x", "y"], emulate="mcs", preload=0.4, x={"preload": 0.7})
def test_two_axes_and_an_emulated_controller(stickslip_world):
    x, y = stickslip_world.clients.values()
    with socket.create_connection(("127.0.0.1", stickslip_world.port)) as client:
        client.sendall(b":GNC\\n")
        assert client.recv(100) == b":N2\\n"
    assert (x.parameters["preload"], y.parameters["preload"]) == ("0.7", "0.4")
    assert x.step(10).wait().steps_done == y.step(-5).wait().steps_done + 15


def test_a_node_of_the_user(stickslip_world):
    node = stickslip_world.node("mine")
    assert ("stickslip_axis", "/") in node.get_node_names_and_namespaces()
"""


def run_pytest(folder: Path, arguments: Sequence[str]) -> subprocess.CompletedProcess[str]:
    """Run pytest on a folder, with the plugin whether or not the package is installed."""
    own = {name: "" for name in os.environ if name.startswith("PYTEST_")}
    options = ("-p", PLUGIN, "-p", "no:cacheprovider")
    return python("-m", "pytest", *options, *arguments, cwd=folder, **own)


def test_five_tests_of_a_user_run_side_by_side(tmp_path: Path) -> None:
    pytest.importorskip("rclpy")
    (tmp_path / "test_stage.py").write_text(PROJECT)
    found = run_pytest(tmp_path, ["-n", "2", "--strict-markers"])
    assert found.returncode == 0, found.stdout + found.stderr
    assert "5 passed" in found.stdout


def test_a_mistake_in_the_marker_is_told(tmp_path: Path) -> None:
    (tmp_path / "test_stage.py").write_text(
        "import pytest\n"
        "@pytest.mark.stickslip(prelaod=1.0)\ndef test_one(offline_axis): ...\n"
        "@pytest.mark.stickslip(1.0)\ndef test_two(offline_axis): ...\n"
    )
    found = run_pytest(tmp_path, [])
    assert found.returncode == 1
    assert "@pytest.mark.stickslip: there is no parameter 'prelaod'; did you mean" in found.stdout
    assert "takes names only" in found.stdout
    assert "plugin.py" not in found.stdout  # a line each, and no traceback


def test_loading_the_plugin_loads_nothing_else() -> None:
    program = (
        f"import sys, pytest; before = set(sys.modules); import {PLUGIN}; "
        "print(*sorted(name for name in set(sys.modules) - before))"
    )
    found = python("-c", program)
    assert {name.partition(".")[0] for name in found.stdout.split()} <= {"stickslip_ros"}
