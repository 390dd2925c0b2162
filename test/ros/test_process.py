# SPDX-License-Identifier: Apache-2.0
"""How nodes run: as a process, in a thread that spins them."""

import os
import signal
import threading
import time
from collections.abc import Callable
from itertools import pairwise
from statistics import median
from typing import Any

import pytest
from live import Ros
from rclpy.event_handler import EventHandler
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.task import Future
from std_msgs.msg import Int32
from std_srvs.srv import Trigger

from stickslip_ros.ros.nodes import axis_host, process, recorder_node, replay_node, twin_node
from stickslip_ros.ros.nodes.guarded_node import GuardedNode
from stickslip_ros.ros.nodes.process import DONE, SpinThread, run


class CountingFuture(Future):
    """Knows how many callbacks wait for it."""

    waiting = 0

    def add_done_callback(self, callback: Callable[..., None]) -> None:
        self.waiting += 1
        super().add_done_callback(callback)


class Alone(GuardedNode):
    """What a process runs, of one node."""

    def __init__(self) -> None:
        super().__init__("alone")
        self.finished = CountingFuture()

    def close(self) -> None:
        pass


def ended(kind: type[Alone], many: bool = False) -> Any:
    """Run a node until it ends, well; return it."""
    made: list[Alone] = []

    def make() -> Alone:
        made.append(kind())
        return made[0]

    assert run("alone", ["alone"], make, many=many) == DONE
    return made[0]


class Ticking(Alone):
    """Ends after 200 rounds of the executor."""

    def __init__(self) -> None:
        super().__init__()
        self.ticks = 0
        self.create_timer(1e-3, self._tick)

    def _tick(self) -> None:
        self.ticks += 1
        if self.ticks == 200:
            self.finished.set_result(None)


def test_rounds_of_the_executor_leave_nothing_behind(ros_domain: int) -> None:
    node = ended(Ticking)
    assert node.ticks == 200
    assert isinstance(node.finished, CountingFuture) and node.finished.waiting <= 2


def test_a_signal_is_heard_behind_a_flood(ros_domain: int) -> None:
    """Where it was a timer that looked, its turn came after all that waited before it."""

    class Stopped(Ticking):
        def _tick(self) -> None:
            self.ticks += 1
            if self.ticks == 5:
                os.kill(os.getpid(), signal.SIGTERM)

    assert ended(Stopped).ticks <= 6


@pytest.mark.parametrize("many", [False, True])
def test_a_signal_ends_the_wait_for_something_to_do(
    ros_domain: int, monkeypatch: pytest.MonkeyPatch, many: bool
) -> None:
    """It was heard when the wait was over, a tenth of a second later."""
    monkeypatch.setattr(process, "_ROUND", 60.0)
    sent: list[float] = []

    class Idle(Ticking):
        def __init__(self) -> None:
            super().__init__()
            for timer in self.timers:
                timer.cancel()

    def interrupt() -> None:
        sent.append(time.monotonic())
        os.kill(os.getpid(), signal.SIGTERM)

    timer = threading.Timer(1.0, interrupt)
    timer.start()
    ended(Idle, many)
    assert time.monotonic() - sent[0] < 10.0


class Flooded(Alone):
    """Hears more than it has the time for, while a timer ticks, and then one message more."""

    FLOOD, LAST, TAKES = 2.0, -1, 3e-3  # s, number of the last message, s for each

    def __init__(self) -> None:
        super().__init__()
        self.ticks, self.executors = list[float](), set[Any]()
        self.create_subscription(Int32, "~/numbers", self._hear, 10)
        self._publisher = self.create_publisher(Int32, "~/numbers", 10)
        self.create_timer(0.01, lambda: self.ticks.append(time.monotonic()))
        threading.Thread(target=self._flood, daemon=True).start()

    def _flood(self) -> None:
        end = time.monotonic() + self.FLOOD
        while time.monotonic() < end:
            self._publisher.publish(Int32(data=1))
            time.sleep(2e-4)
        time.sleep(1.0)  # it has taken all that waited
        self._publisher.publish(Int32(data=self.LAST))

    def _hear(self, message: Int32) -> None:
        time.sleep(self.TAKES)
        self.executors.add(self.executor)
        if message.data == self.LAST:
            self.last_executor = self.executor
            self.finished.set_result(None)


def test_a_flood_keeps_no_timer_from_its_turn(ros_domain: int) -> None:
    """Its turn came behind all that had ever come: after 1.7 s of a flood of 2 s."""
    node = ended(Flooded, many=True)
    assert max(later - tick for tick, later in pairwise(node.ticks)) < 0.5
    # The usual executor has taken over, and has handed back.
    assert len(node.executors) == 2
    assert not isinstance(node.last_executor, SingleThreadedExecutor)


@pytest.mark.parametrize(
    ("main", "shown"),
    [
        (axis_host.main, "\n  publish_rate "),
        (recorder_node.main, "\n  compression "),
        (replay_node.main, "\n  rate "),
        (twin_node.main, "(default: [1.0, 0.0, 0.0])\n"),
    ],
)
def test_every_node_prints_its_usage(
    main: Callable[[list[str]], int], shown: str, capfd: pytest.CaptureFixture[str]
) -> None:
    """The zeros of a direction were left out."""
    assert main(["node", "--help"]) == 0
    said = capfd.readouterr()
    assert said.err == ""
    assert " --ros-args [-p NAME:=VALUE ...]" in said.out
    assert shown in said.out


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
