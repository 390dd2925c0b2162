# SPDX-License-Identifier: Apache-2.0
"""The executables of the nodes where there is no ROS."""

from pathlib import Path

import pytest
from child import python

ROOT = Path(__file__).parent.parent


@pytest.mark.parametrize("node", ["axis_node", "recorder_node", "replay_node", "twin_node"])
def test_a_node_without_ros_says_so_in_one_line(node: str) -> None:
    """As after ``pip install .`` without the extra ``ros``; it was a traceback."""
    program = (
        "import sys\n"
        "for name in ('rclpy', 'rcl_interfaces', 'std_msgs'): sys.modules[name] = None\n"
        f"from stickslip_ros.executables import {node}\n"
        f"sys.exit({node}())\n"
    )
    child = python("-c", program)
    assert child.returncode == 2
    (line,) = child.stderr.splitlines()
    assert line.startswith(f"{node}: needs ROS 2")
    assert "pip install 'stickslip_ros[ros]'" in line
