# SPDX-License-Identifier: Apache-2.0
"""The ROS side of the demo: what goes wrong is said by an error of its own."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

if TYPE_CHECKING:
    from conftest import Ros

pytest.importorskip("rclpy")

from stickslip_ros.ros import demonstration
from stickslip_ros.ros.axis_node import AxisNode
from stickslip_ros.ros.client import AxisClient
from stickslip_ros.ros.demonstration import DemonstrationError, Move, Recorded


@pytest.mark.parametrize(
    ("program", "complaint"),
    [
        ("import time; time.sleep(60)", "node did not end: last words"),
        ("raise SystemExit(1)", "node failed: last words"),
    ],
)
def test_a_process_that_does_not_end_well(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, program: str, complaint: str
) -> None:
    monkeypatch.setattr(demonstration, "_TIMEOUT", 1.0)
    log = tmp_path / "log"
    log.write_text("last words\n")
    child = subprocess.Popen([sys.executable, "-c", program])
    try:
        with pytest.raises(DemonstrationError, match=complaint):
            demonstration._Process("node", log, child).ended()
    finally:
        child.kill()
        child.wait()


def test_a_recorder_that_is_gone(ros: Ros, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demonstration, "_TIMEOUT", 0.1)
    ros.add(AxisNode(context=ros.context))
    with (
        AxisClient() as client,
        pytest.raises(DemonstrationError, match="nobody offers /stickslip_recorder/stop"),
    ):
        demonstration._stop(client)


class _Willing:
    """Stands for a process or a client that does all it is asked to."""

    def __enter__(self) -> _Willing:
        return self

    def __exit__(self, *_: object) -> None: ...

    def __getattr__(self, name: str) -> Any:
        return lambda *_, **__: self


@pytest.mark.usefixtures("ros_domain")
def test_a_move_that_the_bag_says_nothing_about(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    @contextmanager
    def process(*_: object) -> Iterator[_Willing]:
        yield _Willing()

    monkeypatch.setattr(demonstration, "_process", process)
    monkeypatch.setattr(demonstration, "AxisClient", lambda *_, **__: _Willing())
    monkeypatch.setattr(demonstration, "_stop", lambda _: None)
    recorded = Recorded(np.zeros(1), np.zeros(1), [], [{}], [], 1)
    monkeypatch.setattr(demonstration, "_read", lambda _: recorded)
    moves = [Move(300.0, 1000.0, 1)] * 2
    with pytest.raises(DemonstrationError, match="holds 1 reports on 2 moves"):
        demonstration.demonstrate(tmp_path / "bag", tmp_path / "axis.yaml", moves)
