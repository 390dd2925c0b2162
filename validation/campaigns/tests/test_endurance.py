# SPDX-License-Identifier: Apache-2.0
"""How the node holds out: six axes for long, one at 18.5 kHz, command to first motion.

Prints what it measures (`pytest -s`) and asserts nothing about speed: that is a matter of the
machine. ``STICKSLIP_ENDURANCE_S`` sets how long each run takes, 2 s by default.
"""

import math
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cpu_time import cpu_seconds
from diagnostic_msgs.msg import DiagnosticArray
from live import Ros, Start
from sensor_msgs.msg import JointState
from std_msgs.msg import Int32

from stickslip_ros.ros.client import AxisClient

pytestmark = pytest.mark.long
SECONDS = float(os.environ.get("STICKSLIP_ENDURANCE_S", "2"))
COMMANDS = int(10 * SECONDS)
NAMES = "abcdef"
PERIOD = 0.01  # s

#: Keeps to the same deadlines and does nothing: what it misses, the machine has caused.
CONTROL = f"""
import sys, threading, time
ended = threading.Event()
threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
begin, done, missed = time.monotonic(), 0, 0
while not ended.is_set():
    time.sleep(max(0.0, begin + (done + 1) * {PERIOD} - time.monotonic()))
    due = int((time.monotonic() - begin) / {PERIOD} + 0.1)
    missed += max(0, due - done - 1)
    done = max(due, done)
print(missed)
"""


@contextmanager
def _control() -> Iterator[list[int]]:
    """Run the control beside what is measured; at the end the list holds what it missed."""
    missed: list[int] = []
    child = subprocess.Popen(
        [sys.executable, "-c", CONTROL], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        yield missed
        missed.append(int(child.communicate(timeout=20.0)[0]))
    finally:
        child.kill()
        child.wait()


def _megabytes(pid: int) -> float:
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def _timing(client: AxisClient) -> dict[str, float]:
    timing = client.report()["timing"]
    return {key: float(value) for key, value in timing.items() if key != "real-time priority"}


def _jog_all(hertz: float) -> None:
    for name in NAMES:
        with AxisClient(f"/{name}") as client:
            client.jog(hertz)


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="reads /proc")
def test_six_axes_at_1_khz(ros: Ros, start_node: Start) -> None:
    """Every deadline of every axis either gave a state or is counted as missed."""
    axes = f"[{', '.join(NAMES)}]"
    process = start_node("axis_node", axes=axes, frequency=1000.0, travel_high=1.0)
    process.wait_for("axis f ready")
    _jog_all(1000.0)
    heard: dict[str, list[float]] = {name: [] for name in NAMES}
    missed: list[int] = []
    reported = [math.nan]  # s, when the last count was made

    def on_state(message: JointState) -> None:
        heard[message.name[0][0]].append(_seconds(message))

    def on_report(message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == "f: timing":
                values = {pair.key: pair.value for pair in status.values}
                missed.append(int(values["missed deadlines"]))
                reported[0] = _seconds(message)

    # Nobody else listens: this process, in Python, has more to do with it than the axes.
    ears = ros.node("ears")
    ears.create_subscription(JointState, "/joint_states", on_state, 10_000)
    ears.create_subscription(DiagnosticArray, "/diagnostics", on_report, 100)
    ros.wait_until(lambda: missed and heard["f"], "the first report")
    with _control() as control:
        cpu, memory, begin = cpu_seconds(process.pid), _megabytes(process.pid), time.monotonic()
        early = missed[-1]
        time.sleep(SECONDS / 2)
        halfway = _megabytes(process.pid) - memory
        time.sleep(SECONDS / 2)
        took = time.monotonic() - begin
        share = (cpu_seconds(process.pid) - cpu) / took
        growth = _megabytes(process.pid) - memory
        clock_error = time.time() - heard["f"][-1]
        reports = len(missed)
        ros.wait_until(lambda: len(missed) > reports, "one more report")
    print(
        f"six axes at 1 kHz, {took:.1f} s: {100 * share:.1f} % of a core, {missed[-1] - early} "
        f"deadlines missed, {control[0]} by a process that only sleeps, memory {halfway:+.2f} MB "
        f"in the first half, {growth - halfway:+.2f} MB in the second, "
        f"last state {1e3 * clock_error:.1f} ms old"
    )
    assert process.interrupt() == 0
    ros.wait_until(lambda: _still(heard), "all that was published")
    last = min(reported[0], *(stamps[-1] for stamps in heard.values()))
    for stamps in heard.values():
        assert np.all(np.diff(stamps) > 0.0)
        ticks = sum(stamp <= last for stamp in stamps)
        assert ticks + missed[-1] >= (last - stamps[0]) / PERIOD - 2


def _still(heard: dict[str, list[float]]) -> bool:
    before = sum(map(len, heard.values()))
    time.sleep(0.2)
    return sum(map(len, heard.values())) == before


def _seconds(message: Any) -> float:
    return float(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)


def test_one_axis_at_18500_hz(ros: Ros, start_node: Start) -> None:
    process = start_node("axis_node", frequency=18_500.0, travel_high=1.0)
    client = AxisClient(node=ros.node("user"))
    client.jog(18_500.0)
    before, begin, x = _timing(client), client.stamp, client.position
    with _control() as control:
        time.sleep(SECONDS)
        after = _timing(client)
    missed = after["missed deadlines"] - before["missed deadlines"]
    speed = (client.position - x) / (client.stamp - begin)
    print(
        f"18.5 kHz: {1e3 * speed:.3f} mm/s, real-time factor {after['real-time factor']:.4f}, "
        f"{missed:.0f} deadlines missed, {control[0]} by a process that only sleeps, block "
        f"{1e6 * after['block execution time, mean (s)']:.0f} us mean, "
        f"{1e6 * after['block execution time, worst (s)']:.0f} us worst"
    )
    assert speed > 0.0
    assert process.interrupt() == 0


def test_command_to_first_motion(ros: Ros, start_node: Start) -> None:
    """From publishing the command to the arrival of the first state in which the axis moves."""
    process = start_node("axis_node", frequency=1000.0)
    process.wait_for("ready")
    moved, still = threading.Event(), threading.Event()
    arrived, last, rest = [0.0], [math.nan], [math.nan]

    def look(message: JointState) -> None:
        x = message.position[0]
        if not moved.is_set() and abs(x - rest[0]) > 1e-9:
            arrived[0] = time.monotonic()
            moved.set()
        if x == last[0]:
            still.set()
        last[0] = x

    # As little as possible here: this side is in Python too, and each subscription costs it.
    node = ros.node("user")
    steps = ros.publisher(node, Int32, "/stickslip_axis/command/steps")
    node.create_subscription(JointState, "/joint_states", look, 100)
    latencies = []
    for number in range(COMMANDS):
        still.clear()
        assert still.wait(20.0)
        time.sleep(0.0137 * (number % 7) / 7)  # so that the phase to the blocks varies
        rest[0] = last[0]
        moved.clear()
        sent = time.monotonic()
        steps.publish(Int32(data=12))
        assert moved.wait(20.0)
        latencies.append(1e3 * (arrived[0] - sent))
    p50, p99 = np.percentile(latencies, [50, 99])
    print(f"command to first motion, {COMMANDS} commands: p50 {p50:.1f} ms, p99 {p99:.1f} ms")
    assert len(latencies) == COMMANDS
    assert process.interrupt() == 0
