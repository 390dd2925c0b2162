# SPDX-License-Identifier: Apache-2.0
"""The ROS side of the demo: what goes wrong is said by an error of its own."""

from __future__ import annotations

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


def test_a_recorder_that_is_gone(ros: Ros, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demonstration, "_TIMEOUT", 0.1)
    ros.add(AxisNode(context=ros.context))
    with (
        AxisClient() as client,
        pytest.raises(DemonstrationError, match="nobody offers /stickslip_recorder/stop"),
    ):
        demonstration._stop(client)
