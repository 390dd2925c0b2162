# SPDX-License-Identifier: Apache-2.0
"""The twin as a process beside an axis, over DDS."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from conftest import Process, Ros

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Int32
from trajectory_msgs.msg import JointTrajectory

from stickslip_ros.ros.axis_node import AxisNode

pytestmark = pytest.mark.usefixtures("compiled_solver")
Start = Callable[..., "Process"]


def test_a_twin_beside_an_axis(
    ros: Ros, make_axis: Callable[..., AxisNode], start_node: Start
) -> None:
    """It knows the step and where a move ends, and tells steps that it was not told of."""
    make_axis(frequency=100.0)
    heard: dict[str, list[Any]] = {}
    user = ros.node("user")
    for name, kind in (
        ("/stickslip_twin/joint_states", JointState), ("/stickslip_twin/residual", Float64),
        ("/stickslip_twin/prediction", JointTrajectory), ("/diagnostics", DiagnosticArray),
        ("/stickslip_twin/estimates", DiagnosticArray), ("/joint_states", JointState),
    ):  # fmt: skip
        user.create_subscription(kind, name, heard.setdefault(name, []).append, 1000)
    twin = start_node("twin_node", "-r", "measured:=/joint_states", timing=1e-4)
    steps = ros.publisher(user, Int32, "/stickslip_axis/command/steps")
    ask = ros.publisher(user, Int32, "/stickslip_twin/predict/steps")
    residual = heard["/stickslip_twin/residual"]
    ros.wait_until(lambda: residual, "readings heard by the twin")
    ros.send(steps, Int32(data=150))
    sizes: list[Any] = []
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    user.create_subscription(Float64, "/stickslip_twin/step_size", sizes.append, latched)
    ros.wait_until(lambda: sizes and abs(sizes[-1].data - 133.8e-9) < 1e-9, "the step size")
    positions = heard["/joint_states"]

    def rests_beyond(x: float) -> bool:
        last = [one.position[0] for one in positions[-20:]]
        return last[0] > x and max(last) - min(last) < 1e-12

    ros.wait_until(lambda: rests_beyond(19e-6), "the end of the steps")
    count = len(residual)
    ros.wait_until(lambda: len(residual) > count + 50, "readings at rest")
    ros.send(ask, Int32(data=50))
    ros.wait_until(lambda: heard["/stickslip_twin/prediction"], "a prediction")
    (found,) = heard["/stickslip_twin/prediction"]
    assert found.joint_names == ["axis_slider"]
    ros.send(steps, Int32(data=50))
    end = found.points[-1].positions[0]
    ros.wait_until(lambda: rests_beyond(end - 1e-6), "the next end")
    assert abs(positions[-1].position[0] - end) < 60e-9
    expected = heard["/stickslip_twin/joint_states"][-1]
    assert expected.name == ["axis_slider"] and expected.effort[0] > 0.0
    names = {one.name for message in heard["/diagnostics"] for one in message.status}
    assert {"stickslip_twin: twin", "stickslip_twin: prediction"} <= names
    estimates = {one.name for m in heard["/stickslip_twin/estimates"] for one in m.status}
    assert "stickslip_twin: preload" in estimates
    assert twin.interrupt() == 0
