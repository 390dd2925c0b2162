# SPDX-License-Identifier: Apache-2.0
"""The demo's ROS side: an axis and a recorder as processes, driven over DDS, and their bag."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from std_srvs.srv import Trigger

from stickslip_ros.recordings import decoder_for, open_bag
from stickslip_ros.ros.client import AxisClient

_AXIS, _RECORDER = "/stickslip_axis", "/stickslip_recorder"
_TIMEOUT = 60.0


class DemonstrationError(RuntimeError):
    """A process of the demo did not do its part; the message holds its last words."""


@dataclass(frozen=True)
class Move:
    """Steps (sign: direction) at an amplitude (V) and a frequency (Hz)."""

    amplitude: float
    frequency: float
    steps: int


@dataclass(frozen=True)
class Recorded:
    """What the bag of a demo holds."""

    t: NDArray[np.float64]  #: times of the joint states since the first, s
    x: NDArray[np.float64]  #: runner position, m
    moves: list[dict[str, str]]  #: values of the events "move finished"
    friction: list[dict[str, str]]  #: values of the status friction, the first after each move
    timing: list[dict[str, str]]  #: values of the status timing
    messages: int  #: in the bag


def demonstrate(bag: Path, config: Path, moves: Sequence[Move]) -> Recorded:
    """Run moves on an axis process, recorded by a recorder process; return what the bag holds."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    with (
        _process("recorder_node", bag.parent, "-p", f"output:={bag}") as recorder,
        _process("axis_node", bag.parent, "--params-file", str(config)) as axis,
    ):
        recorder.wait_for("recording")
        axis.wait_for("ready")
        # First contact may take seconds, and what is published before it nobody records.
        recorder.wait_for("first message of /joint_states")
        # The recorder is to hear the commands too.
        with AxisClient(_AXIS, listeners=2) as client:
            for move in moves:
                client.set_amplitude(move.amplitude).set_frequency(move.frequency)
                client.step(move.steps).wait(_TIMEOUT).report()
            _stop(client)
        recorder.ended()
    recorded = _read(bag)
    if len(recorded.friction) != len(moves):
        raise DemonstrationError(
            f"the bag holds {len(recorded.friction)} reports on {len(moves)} moves"
        )
    return recorded


def _stop(client: AxisClient) -> None:
    """Have the recorder close its bag and end."""
    recorder = client.node.create_client(Trigger, f"{_RECORDER}/stop")
    if not recorder.wait_for_service(_TIMEOUT):
        raise DemonstrationError(f"nobody offers {_RECORDER}/stop: is the recorder gone?")
    answer: Any = recorder.call(Trigger.Request(), _TIMEOUT)
    if not (answer and answer.success):
        raise DemonstrationError(f"the recorder did not close its bag: {answer}")


class _Process:
    """A node in a process of its own; its log goes to a file."""

    def __init__(self, name: str, log: Path, child: subprocess.Popen[bytes]) -> None:
        self._name, self._log, self.child = name, log, child

    def wait_for(self, text: str) -> None:
        """Wait for a text in the log; DemonstrationError if it does not come."""
        deadline = time.monotonic() + _TIMEOUT
        while text not in self._said():
            if self.child.poll() is not None or time.monotonic() > deadline:
                raise DemonstrationError(f"{self._name} did not start: {self._said().strip()}")
            time.sleep(0.02)

    def ended(self) -> None:
        """Wait for the end; DemonstrationError if it was a bad one."""
        try:
            code = self.child.wait(_TIMEOUT)
        except subprocess.TimeoutExpired:
            raise DemonstrationError(f"{self._name} did not end: {self._said().strip()}") from None
        if code != 0:
            raise DemonstrationError(f"{self._name} failed: {self._said().strip()}")

    def _said(self) -> str:
        return self._log.read_text(encoding="utf-8", errors="replace")


@contextlib.contextmanager
def _process(name: str, folder: Path, *ros_args: str) -> Iterator[_Process]:
    log = folder / f"{name}.log"
    command = [sys.executable, "-m", f"stickslip_ros.ros.{name}", "--ros-args", *ros_args]
    with log.open("wb") as stream:
        child = subprocess.Popen(command, stdout=stream, stderr=subprocess.STDOUT)
    try:
        yield _Process(name, log, child)
    finally:
        if child.poll() is None:
            child.send_signal(signal.SIGINT)
            try:
                child.wait(10.0)
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()


def _read(bag: Path) -> Recorded:
    t, x = [], []
    moves: list[dict[str, str]] = []
    statuses: dict[str, list[dict[str, str]]] = {"friction": [], "timing": []}
    with open_bag(bag) as opened:
        decoders = {
            name: decoder_for(opened.topics[name]) for name, n in opened.counts.items() if n
        }
        messages = opened.message_count
        for found in opened.messages():
            message = decoders[found.topic](found.data)
            if found.topic == "/joint_states":
                t.append(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)
                x.append(message.position[0])
            for status in getattr(message, "status", ()):
                values = {pair.key: pair.value for pair in status.values}
                kind = status.name.rpartition(": ")[2]
                if status.message == "move finished":
                    moves.append(values)
                    statuses["friction"].append({})
                elif kind in statuses:
                    statuses[kind].append(values)
    friction = _first_after_each_move(statuses["friction"])
    return Recorded(np.array(t) - t[0], np.array(x), moves, friction, statuses["timing"], messages)


def _first_after_each_move(friction: list[dict[str, str]]) -> list[dict[str, str]]:
    """Return the first status after each end of a move, which an empty one marks."""
    return [after for before, after in pairwise(friction) if not before and after]
