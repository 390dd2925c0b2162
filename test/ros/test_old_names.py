# SPDX-License-Identifier: Apache-2.0
"""The names that the pages of earlier versions promised."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytest.importorskip("rclpy")


def test_the_client_has_a_public_name() -> None:
    from stickslip_ros import client
    from stickslip_ros.ros.client import AxisClient

    assert client.AxisClient is AxisClient


def test_the_old_place_of_the_nodes_still_leads_there() -> None:
    code = (
        "import warnings; warnings.simplefilter('error', DeprecationWarning)\n"
        "try:\n    import stickslip_ros.nodes\nexcept DeprecationWarning as word: print(word)\n"
        "warnings.simplefilter('ignore')\n"
        "from stickslip_ros.nodes.axis_node import AxisNode; print(AxisNode.__module__)\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert run.stdout.splitlines() == [
        "stickslip_ros.nodes is stickslip_ros.ros now",
        "stickslip_ros.ros.axis_node",
    ], run.stderr
