# SPDX-License-Identifier: Apache-2.0
"""Recorders and axes that end at random moments: what is kept, what is said, what goes on.

A recorder takes a topic of 500 messages a second, an axis jogs; after up to three seconds it is
killed, gets a signal or two, loses its folder, or its disk is full (of 4 MB, where one may be
mounted). Exit codes have to be those of docs/node.md, one line says what went wrong, no process is
left, and the bag (recovered where it has no end) holds all that had been published half a second
before. The time for which the recorder waited for nothing but a processor is taken off.
"""

from __future__ import annotations

import os
import random
import resource
import shutil
import signal
import subprocess
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import pairwise
from pathlib import Path

from rclpy.node import Node
from std_msgs.msg import Float64

from stickslip_ros.base.child_process import ChildError, choose_domain
from stickslip_ros.recordings import BagError, decoder_for, open_bag, recover
from stickslip_ros.ros.client import AxisClient
from stickslip_ros.ros.nodes.axis_host import compile_axis
from stickslip_ros.ros.nodes.process import SpinThread
from validation.campaigns.processes import PATIENCE, Program, ended, waited

LOST = 0.5  #: s of messages at most that an end without a warning costs
#: s between a message and the recorder: the middleware, and the round of an executor
LATENCY = 0.1
PERIOD = 2e-3  # s between messages
BAG = Path("disk", "bag")  # in the folder of a recorder
SIGNALS = {"INT": signal.SIGINT, "TERM": signal.SIGTERM, "HUP": signal.SIGHUP}
#: What ends a recorder, and its exit code then
RECORDER = {
    **dict.fromkeys([*SIGNALS, "INT twice"], 0),
    "KILL": -signal.SIGKILL,
    "full": 1,  # the size of its files has a limit
    "disk full": 1,
    "gone": 1,
}
AXIS = {**dict.fromkeys([*SIGNALS, "INT twice"], 0), "KILL": -signal.SIGKILL}


class Numbers:
    """A topic on which a thread says the time, s."""

    def __init__(self) -> None:
        self._spin = SpinThread("endings", int(os.environ["ROS_DOMAIN_ID"]))
        node = self._spin.add(Node("endings", context=self._spin.context))
        self._publisher = node.create_publisher(Float64, "/numbers", 1000)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._talk, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Say no more."""
        self._over.set()
        self._thread.join()
        self._spin.close()

    def _talk(self) -> None:
        while not self._over.wait(PERIOD):
            self._publisher.publish(Float64(data=time.monotonic()))


def _end(process: Program, how: str, lot: random.Random, folder: Path) -> None:
    """Do to a process what ends it."""
    if how == "disk full":
        with (folder / "disk" / "other").open("wb", buffering=0) as other, suppress(OSError):
            while True:
                other.write(bytes(1000))
    elif how == "full":
        size = sum(file.stat().st_size for file in (folder / BAG).iterdir()) + 1000
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (size, size))
    elif how == "gone":
        shutil.rmtree(folder / BAG)
    elif how == "KILL":
        os.kill(process.pid, signal.SIGKILL)
    else:
        name, _, twice = how.partition(" ")
        os.kill(process.pid, SIGNALS[name])
        if twice and not ended(process.pid, lot.uniform(0.0, 0.2)):
            os.kill(process.pid, SIGNALS[name])  # Popen would reap one that has just ended


def a_recorder(how: str, lot: random.Random, folder: Path, numbers: Numbers) -> list[str]:
    """Let a recorder end; return what was wrong."""
    process = Program(
        folder, "recorder_node", "--ros-args", "-p", f"output:={BAG}", "-p", "topics:=[/numbers]"
    )
    try:
        process.wait_for("first message of /numbers")
    except ChildError as error:
        process.end()
        return [str(error)]
    time.sleep(lot.uniform(0.0, 2.0))
    before = waited(process.pid)
    time.sleep(1.0)
    last, idle = time.monotonic(), waited(process.pid) - before
    _end(process, how, lot, folder)
    found = process.faults(RECORDER[how])
    if RECORDER[how] == 1 and "recorder_node: " not in process.said:
        found.append(f"it said {process.said[-500:]}")
    if how == "gone":
        return found
    (folder / "disk" / "other").unlink(missing_ok=True)  # room to recover it
    allowed = LATENCY + idle + (LOST if RECORDER[how] else 0.0)
    kept = _last_kept(folder)
    if last - kept > allowed:
        found.append(f"{last - kept:.3f} s are lost, {allowed:.3f} s are allowed")
    return found


def _last_kept(folder: Path) -> float:
    """Return when the last message in the bag was published, s; the bag may lack its end."""
    try:
        bag = open_bag(folder / BAG)
    except BagError:
        bag = open_bag(recover(folder / BAG).folder)
    with bag:
        decode = decoder_for(bag.topics["/numbers"])
        found = list(bag.messages())
        gaps = sum(b.sequence != a.sequence + 1 for a, b in pairwise(found))
        assert not gaps, f"{gaps} gaps between {len(found)} messages"
        return max((float(decode(one.data).data) for one in found), default=0.0)


def an_axis(how: str, lot: random.Random, folder: Path) -> list[str]:
    """Let an axis end that jogs; return what was wrong."""
    process = Program(folder, "axis_node")
    try:
        with AxisClient(timeout=PATIENCE) as client:
            client.send("jog", 1000.0)
            time.sleep(lot.uniform(0.0, 2.0))
            _end(process, how, lot, folder)
            return process.faults(AXIS[how])
    finally:
        process.end()


@contextmanager
def _disk(folder: Path, how: str) -> Iterator[Path]:
    """Make the disk of a recorder in a folder: where it gets full, one of 4 MB."""
    disk = folder / BAG.parent
    disk.mkdir()
    if how == "disk full":
        subprocess.run(
            ["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", disk],
            check=True,
            stderr=subprocess.DEVNULL,
        )
    try:
        yield folder
    finally:
        if how == "disk full":
            subprocess.run(["umount", disk], check=True)


def _may_mount() -> bool:
    try:
        with tempfile.TemporaryDirectory() as made, _disk(Path(made), "disk full"):
            return True
    except (OSError, subprocess.CalledProcessError):
        return False


@contextmanager
def _signals_for_children() -> Iterator[None]:
    """Have programs hear the signals that a shell's background or nohup has us ignore.

    They would inherit that. What is handled here, by doing nothing, is at its default for them.
    """
    ignored = [one for one in SIGNALS.values() if signal.getsignal(one) == signal.SIG_IGN]
    for number in ignored:
        signal.signal(number, lambda *_: None)
    try:
        yield
    finally:
        for number in ignored:
            signal.signal(number, signal.SIG_IGN)


@_signals_for_children()
def endings(moments: int, seed: int, only: str = "") -> int:
    """Try so many ends, all or only those of a name; print the bad ones, return their number."""
    choose_domain()
    compile_axis()
    lot, bad, tried = random.Random(seed), 0, Counter[str]()
    recorder_kinds = sorted(RECORDER)
    if not _may_mount():
        print("no disk can be mounted here, so none gets full")
        recorder_kinds.remove("disk full")
    numbers = Numbers()
    try:
        for number in range(moments):
            of_axis = number % 3 == 2
            kinds = sorted(AXIS) if of_axis else recorder_kinds
            how = kinds[(number // 3 if of_axis else number - number // 3) % len(kinds)]
            name = only or f"{'axis' if of_axis else 'recorder'}, {how}"
            who, _, how = name.partition(", ")
            of_axis = who == "axis"
            with tempfile.TemporaryDirectory() as made, _disk(Path(made), how) as folder:
                found = (
                    an_axis(how, lot, folder) if of_axis else a_recorder(how, lot, folder, numbers)
                )
            tried[name] += 1
            bad += bool(found)
            for fault in found:
                print(f"  {number} {name}: {fault}", flush=True)
    finally:
        numbers.close()
    print(", ".join(f"{name}: {count}" for name, count in sorted(tried.items())))
    print(f"{moments} ends, {bad} bad, load {os.getloadavg()[0]:.1f}")
    return bad
