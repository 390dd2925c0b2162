# SPDX-License-Identifier: Apache-2.0
"""The launch files: the recorder finds its axis in every namespace, the nanorobot its axes."""

from __future__ import annotations

import runpy
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest.mock import MagicMock

import pytest

if TYPE_CHECKING:
    from conftest import Process

pytest.importorskip("rclpy")

ROOT = Path(__file__).resolve().parent.parent.parent
# The launch system is not among the ROS wheels.
LAUNCH = ("", ".actions", ".conditions", ".substitutions", ".event_handlers", ".events.process")
MODULES = [f"{root}{part}" for root in ("launch", "launch_ros") for part in LAUNCH]
MODULES += ["launch.events", "launch_ros.parameter_descriptions"]


Start = Callable[..., "Process"]


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], dict[str, Any]]:
    """Give a function that reads a launch file: executable -> arguments of its node."""

    def read(name: str) -> dict[str, Any]:
        for module in MODULES:
            monkeypatch.setitem(sys.modules, module, MagicMock())
        node = sys.modules["launch_ros.actions"].Node
        runpy.run_path(str(ROOT / "launch" / name))["generate_launch_description"]()
        return {call.kwargs["executable"]: call.kwargs for call in node.call_args_list}

    return read


def test_ros2_launch_finds_each_launch_file_once() -> None:
    """By package and name: it looks through all of the share folder, and two are an error."""
    found = [
        path.name
        for folder in ("config", "examples", "launch", "urdf")
        for path in (ROOT / folder).rglob("*.launch.*")
    ]
    assert sorted(found) == ["axis.launch.py", "nanorobot.launch.py", "ros2_control.launch.py"]


def test_controllers_start_when_the_axis_is_ready_and_once(
    launched: Callable[[str], dict[str, Any]],
) -> None:
    nodes = launched("../examples/ros2_control/ros2_control.launch.py")
    assert "spawner" not in nodes
    made = sys.modules["launch_ros.actions"].Node
    (handler,) = sys.modules["launch.event_handlers"].OnProcessIO.call_args_list
    assert handler.kwargs["target_action"] is made.return_value
    after = handler.kwargs["on_stderr"]
    axis = MagicMock(text=b"[INFO] [1.2] [stickslip_axis]: axis axis ready: ceim, preload 0.4 N\n")
    assert after(MagicMock(text=b"[INFO] compiling\n")) == []
    assert len(after(axis)) == 1
    assert made.call_args.kwargs["executable"] == "spawner"
    assert after(axis) == []


@pytest.mark.parametrize("name", ["axis.launch.py", "nanorobot.launch.py"])
def test_peers_on_other_machines_are_not_met_unless_wanted(
    name: str, launched: Callable[[str], dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ament_index_python.packages.get_package_share_directory", lambda _: ROOT)
    launched(name)
    variable = "ROS_AUTOMATIC_DISCOVERY_RANGE"
    inherited = sys.modules["launch.substitutions"].EnvironmentVariable
    inherited.assert_called_once_with(variable, default_value="LOCALHOST")
    action = sys.modules["launch.actions"].SetEnvironmentVariable
    action.assert_called_once_with(variable, inherited.return_value)


@pytest.mark.parametrize("namespace", ["/", "/left"])
def test_the_recorder_is_told_the_axis_beside_it(
    namespace: str, start_node: Start, launched: Callable[[str], dict[str, Any]]
) -> None:
    (parameters,) = launched("axis.launch.py")["recorder_node"]["parameters"]
    process = start_node("recorder_node", "-r", f"__ns:={namespace}", output="bag", **parameters)
    process.wait_for(f"recording all topics of {namespace.rstrip('/')}/stickslip_axis to ")


@pytest.mark.usefixtures("compiled_solver")
def test_the_nanorobot_has_its_axes_and_its_model(
    start_node: Start,
    launched: Callable[[str], dict[str, Any]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("ament_index_python.packages.get_package_share_directory", lambda _: ROOT)
    nodes = launched("nanorobot.launch.py")
    (model,) = nodes["robot_state_publisher"]["parameters"]
    # It may not be installed, and what had started before would be left behind.
    assert next(iter(nodes)) == "robot_state_publisher"
    assert model["robot_description"] == (ROOT / "urdf" / "nanorobot.urdf").read_text()
    assert "square" in nodes
    (parameters,) = nodes["axis_node"]["parameters"]
    process = start_node("axis_node", *nodes["axis_node"]["ros_arguments"], **parameters)
    for name in "xyz":
        process.wait_for(f"[{name}]: axis {name} ready")


def test_a_file_of_parameters_that_is_not_there_ends_the_launch(
    launched: Callable[[str], dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """launch itself starts the axis with the defaults then."""
    monkeypatch.setattr("ament_index_python.packages.get_package_share_directory", lambda _: ROOT)
    launched("axis.launch.py")
    chosen = sys.modules["launch.substitutions"].LaunchConfiguration.return_value
    axis = runpy.run_path(str(ROOT / "launch" / "axis.launch.py"))["axis"]
    chosen.perform.return_value = "nope.yaml"
    with pytest.raises(FileNotFoundError, match=r"there is no file .*config/nope.yaml"):
        axis(None)
    chosen.perform.return_value = "table1_vibration.yaml"
    axis(None)
    (file,) = sys.modules["launch_ros.actions"].Node.call_args.kwargs["parameters"]
    assert file == str(ROOT / "config" / "table1_vibration.yaml")
