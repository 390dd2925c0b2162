# SPDX-License-Identifier: Apache-2.0
"""How a node runs as a process: its usage, what a long run leaves behind, a test that is killed."""

from collections.abc import Callable
from typing import Any

import pytest
from child import python
from rclpy.node import Node
from rclpy.task import Future

from stickslip_ros.ros.process import DONE, run


class CountingFuture(Future):
    """Knows how many callbacks wait for it."""

    waiting = 0

    def add_done_callback(self, callback: Callable[..., None]) -> None:
        self.waiting += 1
        super().add_done_callback(callback)


class Ticking(Node):
    """Ends after 200 rounds of the executor."""

    def __init__(self) -> None:
        super().__init__("ticking")
        self.finished = CountingFuture()
        self.ticks = 0
        self.create_timer(1e-3, self._tick)

    @property
    def nodes(self) -> list[Node]:
        return [self]

    def close(self) -> None:
        pass

    def _tick(self) -> None:
        self.ticks += 1
        if self.ticks == 200:
            self.finished.set_result(None)


def test_rounds_of_the_executor_leave_nothing_behind(ros_domain: int) -> None:
    made: list[Any] = []

    def make(_: Callable[[], bool]) -> Ticking:
        made.append(Ticking())
        return made[0]

    assert run("ticking", ["ticking"], make) == DONE
    assert made[0].ticks == 200
    assert made[0].finished.waiting <= 2


@pytest.mark.slow
def test_every_node_prints_its_usage() -> None:
    """In processes of their own, which they end."""
    for name, parameter in (
        ("axis_node", "publish_rate"),
        ("recorder_node", "compression"),
        ("replay_node", "rate"),
    ):
        code = f"import sys; from stickslip_ros.executables import {name}; sys.exit({name}())"
        said = python("-c", code, "--help")
        assert (said.returncode, said.stderr) == (0, "")
        assert said.stdout.startswith(f"usage: {name} --ros-args [-p NAME:=VALUE ...]")
        assert f"\n  {parameter} " in said.stdout
