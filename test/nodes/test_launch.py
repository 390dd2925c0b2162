# SPDX-License-Identifier: Apache-2.0
"""The launch file: its recorder finds its axis in every namespace."""

from __future__ import annotations

import runpy
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING
from unittest.mock import MagicMock

import pytest

if TYPE_CHECKING:
    from conftest import Process

pytest.importorskip("rclpy")

FILE = Path(__file__).resolve().parent.parent.parent / "launch" / "axis.launch.py"
# The launch system is not among the ROS wheels.
LAUNCH = ("", ".actions", ".conditions", ".substitutions")
MODULES = [f"{root}{part}" for root in ("launch", "launch_ros") for part in LAUNCH]


@pytest.mark.parametrize("namespace", ["/", "/left"])
def test_the_recorder_is_told_the_axis_beside_it(
    namespace: str, start_node: Callable[..., Process], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in MODULES:
        monkeypatch.setitem(sys.modules, name, MagicMock())
    node = sys.modules["launch_ros.actions"].Node
    runpy.run_path(str(FILE))["generate_launch_description"]()
    (recorder,) = (
        call.kwargs for call in node.call_args_list if call.kwargs["executable"] == "recorder_node"
    )
    (parameters,) = recorder["parameters"]
    process = start_node("recorder_node", "-r", f"__ns:={namespace}", output="bag", **parameters)
    process.wait_for(f"recording all topics of {namespace.rstrip('/')}/stickslip_axis to ")
