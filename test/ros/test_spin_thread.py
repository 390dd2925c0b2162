# SPDX-License-Identifier: Apache-2.0
"""The thread that spins the nodes of a program: nothing ends it but its own close."""

import time
from statistics import median

import pytest
from live import Ros
from rclpy.event_handler import EventHandler
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import Int32
from std_srvs.srv import Trigger

from stickslip_ros.ros.spin_thread import SpinThread


def test_what_another_thread_destroys_does_not_end_it(
    ros: Ros, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It may do so when the executor has begun to wait for it: a client that is closed, too."""
    genuine = EventHandler.add_to_wait_set
    node = ros.node()
    doomed: list[Publisher] = []

    def add_late(handler: EventHandler, wait_set: object) -> None:
        if doomed:
            node.destroy_publisher(doomed.pop())
        genuine(handler, wait_set)

    monkeypatch.setattr(EventHandler, "add_to_wait_set", add_late)
    for _ in range(10):
        doomed.append(node.create_publisher(Int32, "~/numbers", 10))
        node.create_timer(1e-3, lambda: None)  # wakes the executor
        ros.wait_until(lambda: not doomed, "the destruction")
    ticks: list[int] = []
    node.create_timer(1e-3, lambda: ticks.append(1))
    ros.wait_until(lambda: ticks, "a tick")


def test_a_callback_that_raises_does_not_end_it(
    ros: Ros, capfd: pytest.CaptureFixture[str]
) -> None:
    """It is told, with where it happened."""
    node = ros.node()

    def fail(_: Int32) -> None:
        raise ZeroDivisionError("of the user")

    node.create_subscription(Int32, "~/numbers", fail, 10)
    node.create_service(Trigger, "~/call", lambda _, answer: answer)
    publisher = ros.publisher(node, Int32, "~/numbers")
    ros.send(publisher, Int32(data=1))
    for _ in range(3):
        ros.call(node, Trigger, "/test_node/call", Trigger.Request())
    said = capfd.readouterr().err
    assert "ZeroDivisionError: of the user" in said
    assert "in fail" in said


def test_it_ends_as_soon_as_it_is_asked(ros_domain: int) -> None:
    """It waited for the end of the executor's round, a second."""
    took = []
    for _ in range(5):
        spin = SpinThread("spin", ros_domain)
        spin.add(Node("node", context=spin.context))
        time.sleep(0.1)
        begin = time.monotonic()
        spin.close()
        took.append(time.monotonic() - begin)
    assert median(took) < 0.3, took
