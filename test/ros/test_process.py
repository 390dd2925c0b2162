# SPDX-License-Identifier: Apache-2.0
"""How a node runs as a process: its usage, what a long run leaves behind, a test that is killed."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from child import python
from live import wait_until
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


@pytest.mark.skipif(not shutil.which("setpriv"), reason="setpriv (of util-linux) is not installed")
def test_programs_of_a_test_that_is_killed_end_with_it(tmp_path: Path) -> None:
    """Or else an axis would answer in the domain of a later test."""
    test = (
        "import sys, time; from pathlib import Path; from live import Process;"
        "sleep = [sys.executable, '-c', 'import time; print(1, flush=True); time.sleep(600)'];"
        "print(Process(sleep, Path(), Path('out')).pid, flush=True); time.sleep(600)"
    )
    found = os.pathsep.join([str(Path(__file__).parents[1]), *filter(None, sys.path)])
    environment = {**os.environ, "PYTHONPATH": found}
    with subprocess.Popen(
        [sys.executable, "-c", test], stdout=subprocess.PIPE, cwd=tmp_path, env=environment
    ) as running:
        assert running.stdout
        child = Path("/proc") / running.stdout.readline().decode().strip() / "cmdline"
        out = tmp_path / "out"
        wait_until(lambda: out.exists() and out.read_text(), "a word of the program")
        running.kill()
    # Nothing, or empty until whoever adopted it takes notice.
    wait_until(lambda: not (child.exists() and child.read_bytes()), "the end of the program")


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
