# SPDX-License-Identifier: Apache-2.0
"""The executables of the nodes where there is no ROS."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


@pytest.mark.parametrize("node", ["axis_node", "recorder_node", "replay_node"])
def test_a_node_without_ros_says_so_in_one_line(node: str) -> None:
    """As after ``pip install .`` without the extra ``ros``; it was a traceback."""
    program = (
        "import sys\n"
        "for name in ('rclpy', 'rcl_interfaces', 'std_msgs'): sys.modules[name] = None\n"
        f"from stickslip_ros.executables import {node}\n"
        f"sys.exit({node}())\n"
    )
    paths = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    child = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True, text=True, timeout=60, check=False,
        env={**os.environ, "PYTHONPATH": paths},
    )  # fmt: skip
    assert child.returncode == 2
    (line,) = child.stderr.splitlines()
    assert line.startswith(f"{node}: needs ROS 2")
    assert "pip install 'stickslip_ros[ros]'" in line
