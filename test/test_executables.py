# SPDX-License-Identifier: Apache-2.0
"""The executables of the nodes where there is no ROS."""

from pathlib import Path

from child import python

ROOT = Path(__file__).parent.parent


def test_a_node_without_ros_says_so_in_one_line() -> None:
    """As after ``pip install .`` without the extra ``ros``; it was a traceback."""
    nodes = ["axis_node", "recorder_node", "replay_node", "twin_node"]
    program = (
        "import sys\n"
        "for name in ('rclpy', 'rcl_interfaces', 'std_msgs'): sys.modules[name] = None\n"
        "from stickslip_ros import executables\n"
        f"print([getattr(executables, node)() for node in {nodes}])\n"
    )
    child = python("-c", program)
    assert child.stdout.split() == ["[2,", "2,", "2,", "2]"]
    for node, line in zip(nodes, child.stderr.splitlines(), strict=True):
        assert line.startswith(f"{node}: needs ROS 2")
        assert "pip install 'stickslip_ros[ros]'" in line
