# SPDX-License-Identifier: Apache-2.0
"""The ROS side of the demo: what goes wrong is said by an error of its own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from conftest import Ros

pytest.importorskip("rclpy")

from stickslip_ros.client import AxisClient
from stickslip_ros.executables import example
from stickslip_ros.ros.axis_node import AxisNode

demonstration = example("demo")
DemonstrationError = demonstration.DemonstrationError


@pytest.mark.parametrize(
    ("program", "complaint"),
    [
        ("import time; time.sleep(60)", "node did not end: last words"),
        ("raise SystemExit(1)", "node failed: last words"),
    ],
)
def test_a_process_that_does_not_end_well(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, program: str, complaint: str
) -> None:
    monkeypatch.setattr(demonstration, "_TIMEOUT", 1.0)
    log = tmp_path / "log"
    log.write_text("last words\n")
    child = subprocess.Popen([sys.executable, "-c", program])
    try:
        with pytest.raises(DemonstrationError, match=complaint):
            demonstration._Process("node", log, child).ended()
    finally:
        child.kill()
        child.wait()


def test_a_recorder_that_is_gone(ros: Ros, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demonstration, "_TIMEOUT", 0.1)
    ros.add(AxisNode(context=ros.context))
    with (
        AxisClient() as client,
        pytest.raises(DemonstrationError, match="nobody offers /stickslip_recorder/stop"),
    ):
        demonstration._stop(client)
