# SPDX-License-Identifier: Apache-2.0
"""A twin beside an axis that is flooded, starved and started anew: it lives, and tells each gap.

Between steps back and forth the axis is stopped for seconds, or ended and started again; others
publish readings that are late, doubled or no numbers, and more commands than an axis takes; or the
twin itself gets no processor. The twin has to live, to report once a second, to count each gap,
restart and reading of no use, and may not grow. The axis never changes, so a change that is
reported is a false alarm.
"""

from __future__ import annotations

import math
import os
import shutil
import signal
import tempfile
import time
from collections import Counter, deque
from pathlib import Path

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.utilities import try_shutdown
from sensor_msgs.msg import JointState
from std_msgs.msg import Int32

from stickslip_ros.base.child_process import choose_domain
from validation.campaigns.processes import Program, memory_of

AXIS = ("axis_node", "--ros-args", "-p", "frequency:=100.0", "-p", "publish_rate:=100.0")
TWIN = ("twin_node", "--ros-args", "-r", "measured:=/joint_states", "-p", "timing:=0.0001")
AWAY = 2.5  #: s without processor
WITHIN = 60.0  #: s to tell of it, and to start an axis
GROWTH = 20.0  #: MB that the twin may grow by in the second half


class Peer(Node):
    """Commands the axis, disturbs both, and hears the twin."""

    def __init__(self) -> None:
        """Publish and subscribe; nobody need be there yet."""
        super().__init__("rough_peer")
        self.steps = self.create_publisher(Int32, "/stickslip_axis/command/steps", 10)
        self.readings = self.create_publisher(JointState, "/joint_states", 100)
        self.heard: deque[JointState] = deque(maxlen=30)
        self.values: dict[str, str] = {}  # of the last report
        self.reports: list[float] = []
        self.create_subscription(JointState, "/joint_states", self._on_reading, 10)
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_report, 100)

    def _on_reading(self, message: JointState) -> None:
        if message.name and message.name[0] == "axis_slider" and math.isfinite(message.position[0]):
            self.heard.append(message)

    def _on_report(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == "stickslip_twin: twin":
                self.values = {pair.key: pair.value for pair in status.values}
                self.values["reason"] = status.message
                self.reports.append(time.monotonic())

    def told(self, what: str) -> int:
        """Return how often the twin told a trouble."""
        return int(self.values.get(f"trouble: {what}", "0"))

    def spin(self, seconds: float) -> None:
        """Hear for so long."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            rclpy.spin_once(self, timeout_sec=left)

    def flood(self, lot: np.random.Generator) -> None:
        """Send commands and bad readings for two seconds, as fast as they go."""
        end = time.monotonic() + 2.0
        while time.monotonic() < end:
            self.steps.publish(Int32(data=int(lot.integers(-3, 4))))
            message = self.heard[int(lot.integers(len(self.heard)))]
            if lot.random() < 0.5:
                message = JointState(
                    header=message.header, name=["axis_slider"], position=[math.nan]
                )
            self.readings.publish(message)
            rclpy.spin_once(self, timeout_sec=0.0)


def rough(minutes: float, seed: int) -> int:
    """Treat a twin so long; return how much was not as it has to be."""
    choose_domain()
    lot, faults, done = np.random.default_rng(seed), list[str](), Counter[str]()
    rclpy.init()
    folders = [Path(tempfile.mkdtemp()) for _ in range(2)]
    peer, axis, twin = Peer(), Program(folders[0], *AXIS), Program(folders[1], *TWIN)
    memory, silent = [], 0.0
    try:
        while not (peer.heard and peer.reports):  # the first start compiles
            peer.spin(1.0)
        end = time.monotonic() + 60.0 * minutes
        while time.monotonic() < end:
            twin.check_running()
            changes = peer.values["changes"]
            for direction in (1, -1):
                peer.steps.publish(Int32(data=300 * direction))
                peer.spin(4.0)
            what = str(lot.choice(["starved", "restarted", "flooded", "twin starved"]))
            trouble = {
                "starved": "gaps", "restarted": "restarts of the axis",
                "flooded": "readings that are no numbers", "twin starved": "",
            }[what]  # fmt: skip
            before, begun, heard = peer.told(trouble), time.monotonic(), len(peer.reports)
            if what == "flooded":
                peer.flood(lot)
            elif what == "restarted":
                axis.end()
                axis = Program(folders[0], *AXIS)
            else:
                process = axis if what == "starved" else twin
                os.kill(process.pid, signal.SIGSTOP)
                peer.spin(AWAY)
                os.kill(process.pid, signal.SIGCONT)
            while trouble and peer.told(trouble) == before:
                if time.monotonic() - begun > WITHIN:
                    faults.append(f"{what}, but not told: {peer.values}")
                    break
                peer.spin(0.2)
            done[what] += 1
            peer.spin(5.0)
            if peer.values["changes"] != changes:
                print(f"{what}: {peer.values['reason']}", flush=True)
            times = [begun, *peer.reports[heard:], time.monotonic()]
            away = AWAY if what == "twin starved" else 0.0
            silent = max(silent, float(np.max(np.diff(times))) - away)
            memory.append(memory_of(twin.pid))
    finally:
        for process in (axis, twin):
            process.signalled(signal.SIGINT)
            faults += process.faults(0)
        try_shutdown()
        for folder in folders:
            shutil.rmtree(folder)
    grown = memory[-1] - memory[len(memory) // 2]
    faults += [f"grew by {grown:.0f} MB"] * (grown > GROWTH)
    faults += [f"{peer.values['changes']} changes"] * (peer.values["changes"] != "0")
    print(
        f"{dict(done)}; memory {memory[0]:.0f}, {memory[-1]:.0f} MB; silent {silent:.1f} s at most"
    )
    print(f"last: {peer.values}")
    print("\n".join(faults) or "all told")
    return len(faults)
