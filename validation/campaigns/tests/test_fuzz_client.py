# SPDX-License-Identifier: Apache-2.0
"""Hostile messages on the topics that a client hears: it goes on and commands its axis."""

import contextlib
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from hypothesis import strategies as some
from live import Ros

from .fuzzing import TIME, search

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState

from stickslip_ros.ros.axis_node import AxisNode
from stickslip_ros.ros.client import AxisClient

from .hostile import messages

pytestmark = TIME
PATIENCE = Duration(seconds=20)
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
HEARD = {
    "/stickslip_axis/status": (DiagnosticArray, LATCHED),
    "/stickslip_axis/events": (DiagnosticArray, LATCHED),
    "/stickslip_axis/description": (DiagnosticArray, LATCHED),
    "/diagnostics": (DiagnosticArray, QoSProfile(depth=10)),
    "/joint_states": (JointState, QoSProfile(depth=10)),
}


Check = Callable[[tuple[str, Any]], None]


@pytest.fixture
def check(ros: Ros) -> Iterator[Check]:
    """Give a function that publishes as a peer and fails if a client does not outlive it."""
    ros.add(AxisNode(context=ros.context))
    client = AxisClient()
    peer = ros.node("peer")
    outlets = {topic: ros.publisher(peer, kind, topic, qos) for topic, (kind, qos) in HEARD.items()}

    def outlives(example: tuple[str, Any]) -> None:
        topic, message = example
        # What is longer than its type can be does not leave the sender.
        with contextlib.suppress(RuntimeError):
            outlets[topic].publish(message)
        assert outlets[topic].wait_for_all_acked(PATIENCE)
        assert "stickslip_client" in [thread.name for thread in threading.enumerate()]
        assert client.state and client.moving in (True, False)

    yield outlives
    stamp = client.stamp
    ros.wait_until(lambda: client.stamp != stamp, "another state")
    client.close()
    # One who comes when they are gone commands as ever.
    for publisher in outlets.values():
        peer.destroy_publisher(publisher)
    with AxisClient(node=ros.node("user")) as later:
        assert later.step(1).wait().steps_done == 1


@pytest.mark.long
def test_messages(check: Check) -> None:
    found = [some.tuples(some.just(topic), messages(kind)) for topic, (kind, _) in HEARD.items()]
    print(search(some.one_of(found), check))
