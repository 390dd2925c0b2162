# SPDX-License-Identifier: Apache-2.0
"""Hostile bytes on every topic and service of two axes of one name.

    python -m validation.campaigns.floods [--minutes 10] [--rate 5000] [--seed 1] [--clock]

A peer sends so many messages a second: whole ones with hostile values and bytes that are none, on
all that the axes and a recorder hear, and requests to all their services (whole ones: SECURITY.md
says why). What orders silence is left out: ``stop`` of the recorder; ``pause``, ``enable`` and
``real_time_factor`` of the axes. Nobody may die, raise or grow, and no axis may be silent for
longer than 0.2 s, less the time for which it and the one who hears it waited for nothing but a
processor. With --clock, libfaketime sets the clock of the nodes by a day, on and back, every five
seconds; the steady clock goes on.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import random
import subprocess
import sys
import tempfile
import threading
import time
import unittest.mock
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis.strategies import SearchStrategy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from stickslip_ros.recordings import open_bag
from stickslip_ros.ros.child_process import ChildError, ChildProcess, child_node, choose_domain
from stickslip_ros.ros.messages import message_class
from stickslip_ros.ros.process import SpinThread
from stickslip_ros.simulation import warm_up
from validation.campaigns.arguments import arguments
from validation.campaigns.processes import FAKETIME, ended, memory_of, waited, with_clock_of
from validation.campaigns.tests.hostile import damaged, messages

AXIS, RECORDER = "stickslip_axis", "stickslip_recorder"
HEARD = f"/{AXIS}/contact"  #: by this an axis is heard, with a name of its own
SILENCE = 0.2  #: s at most between two states of an axis
GROWTH = 30.0  #: MB that a process may grow by in the second half
REQUESTS, LONG = 25, 100  #: of so many messages, one is a request, and one is longer than SHORT
SHORT = 2000  # bytes
EXAMPLES = 60  # of each topic and service, whole ones and damaged ones
LOOK_EVERY, PATIENCE = 5.0, 60.0  # s
JUMPS = ("+1d", "-1d", "+0d")  #: of the clock, in turn
ORDERS_SILENCE = {f"/{RECORDER}/stop", f"/{AXIS}/pause", f"/{AXIS}/enable"}


def examples(strategy: SearchStrategy[Any], number: int) -> list[Any]:
    """Return examples that Hypothesis draws, from a seed."""
    found: list[Any] = []
    how: dict[str, Any] = {"max_examples": EXAMPLES, "deadline": None, "database": None}
    checks = settings(phases=[Phase.generate], suppress_health_check=list(HealthCheck), **how)
    seed(number)(checks(given(strategy)(lambda example: found.append(example))))()
    return found


def flood(rate: float, number: int, seconds: float) -> None:
    """Send so many messages a second for so long, at all that nodes hear; say how many."""
    os.nice(10)  # to send is more work than to hear
    spin, lot = SpinThread("flood"), random.Random(number)
    node = spin.add(Node("flood", context=spin.context))
    time.sleep(5.0)  # until the graph is known
    topics, services = dict[str, list[str]](), dict[str, list[str]]()
    for name in (AXIS, RECORDER):
        topics |= dict(node.get_subscriber_names_and_types_by_node(name, "/"))
        services |= dict(node.get_service_names_and_types_by_node(name, "/"))
    out, ask = [], []
    latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)  # all hear that
    for topic in sorted(topics.keys() - {HEARD}):
        kind = message_class(topics[topic][0])
        whole = messages(kind).map(serialize_message)
        pool = examples(whole, number) + examples(whole.flatmap(damaged), number)
        pool.sort(key=len)
        short = sum(len(one) <= SHORT for one in pool)
        out.append((node.create_publisher(kind, topic, latched), pool, short))
    for service in sorted(services.keys() - ORDERS_SILENCE):
        kind = message_class(services[service][0])
        pool = examples(messages(kind.Request), number)
        pool = [one for one in pool if "real_time_factor" not in str(one)]
        ask.append((node.create_client(kind, service), pool))
    print(f"{len(out)} topics, {len(ask)} services", flush=True)
    sent, begin, unsent = 0, time.monotonic(), 0
    while (now := time.monotonic() - begin) < seconds:
        if sent >= now * rate:
            time.sleep(1e-3)
            continue
        sent += 1
        if sent % REQUESTS:
            publisher, pool, short = lot.choice(out)
            try:
                publisher.publish(pool[lot.randrange(short if sent % LONG else len(pool))])
            except RuntimeError:  # longer than its type can be
                unsent += 1
        else:
            client, pool = lot.choice(ask)
            client.remove_pending_request(client.call_async(lot.choice(pool)))
    print(f"{sent - unsent} messages, {sent / now:.0f} a second", flush=True)
    spin.close()


class Listener:
    """Hears the states of axes: how many there were, and how long there was none."""

    def __init__(self, node: Node, pids: dict[str, int]) -> None:
        """Take the processes by the name that begins the joints of each."""
        self.pids, self.count = pids, dict.fromkeys(pids, 0)
        self.silent, self.gross = dict.fromkeys(pids, 0.0), dict.fromkeys(pids, 0.0)
        self._last = dict[str, tuple[float, float]]()
        node.create_subscription(JointState, HEARD, self._on_state, 1000)

    def _now(self, name: str) -> tuple[float, float]:
        here = waited(threading.get_native_id())
        return time.monotonic(), waited(self.pids[name]) + here

    def _on_state(self, message: JointState) -> None:
        name = message.name[0].partition("_")[0]
        if name in self.pids:
            now, waits = self._now(name)
            then, waited_then = self._last.get(name, (now, waits))
            self._last[name] = now, waits
            self.gross[name] = max(self.gross[name], now - then)
            self.silent[name] = max(self.silent[name], now - then - waits + waited_then)
            self.count[name] += 1


def study(minutes: float, rate: float, number: int, jumps: bool) -> list[str]:
    """Flood for so long; print what was seen and return what was wrong."""
    choose_domain()
    warm_up()
    words = [sys.executable, "-m", "validation.campaigns.floods", "--only-send"]
    words += ["--minutes", str(minutes), "--rate", str(rate), "--seed", str(number)]
    with tempfile.TemporaryDirectory() as made, contextlib.ExitStack() as nodes:
        folder, faults = Path(made), list[str]()

        def start(name: str, parameter: str, says: str) -> ChildProcess:
            (place := folder / f"{name} {parameter[-1]}").mkdir()
            child = nodes.enter_context(child_node(name, place, "-p", parameter))
            child.wait_for(says)  # one after the other, since a clock that is faked takes time
            return child

        clock = folder / "clock"
        clock.write_text("+0d\n")
        with unittest.mock.patch.dict(os.environ, with_clock_of(clock) if jumps else {}):
            axes = {name: start("axis_node", f"axis_name:={name}", "ready") for name in "ab"}
            heard_first = "first message of /joint_states"
            recorder = start("recorder_node", f"output:={folder / 'bag'}", heard_first)
        spin = SpinThread("listener")
        node = spin.add(Node("listener", context=spin.context))
        heard = Listener(node, {name: child.pid for name, child in axes.items()})
        memory: dict[str, list[float]] = {}
        everybody = {**axes, "recorder": recorder}
        sender = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        assert sender.stdout
        print(sender.stdout.readline(), end="", flush=True)  # from now on it floods
        until = time.monotonic() + 60.0 * minutes  # the nodes end while the flood goes on
        turns = itertools.cycle(JUMPS)
        while time.monotonic() < until and sender.poll() is None and not faults:
            time.sleep(LOOK_EVERY)
            clock.write_text(f"{next(turns)}\n")
            for name, child in everybody.items():
                try:
                    child.check_running()
                    memory.setdefault(name, []).append(memory_of(child.pid))
                except ChildError as error:
                    faults.append(str(error))
        ends = dict[str, float]()
        for name, child in everybody.items():
            begin, before = time.monotonic(), waited(child.pid)
            try:
                child.interrupt()
                ended(child.pid, PATIENCE)
                ends[name] = time.monotonic() - begin - waited(child.pid) + before
                child.ended()
            except ChildError as error:
                faults.append(f"{name}: {error}")
        spin.close()
        print(sender.communicate()[0], end="")
        said = [one.read_text(errors="replace") for one in folder.glob("*/*.log")]
        faults += [one[one.index("Traceback") :][:800] for one in said if "Traceback" in one]
        grown = {name: sizes[-1] - sizes[len(sizes) // 2] for name, sizes in memory.items()}
        faults += [f"{name} grew by {size:.0f} MB" for name, size in grown.items() if size > GROWTH]
        for name in axes:
            if heard.silent[name] > SILENCE:
                faults.append(f"axis {name} was silent for {heard.silent[name]:.3f} s")
        with open_bag(folder / "bag") as bag:
            print(f"{bag.message_count} messages in the bag")
    print(f"silent at most {heard.silent} s (with waiting {heard.gross} s), {heard.count} states")
    print(f"ended {ends} s after SIGINT, growth {grown} MB, load {os.getloadavg()[0]:.1f}")
    return faults


def main(argv: Sequence[str] | None = None) -> int:
    """Print what was seen; return 1 for a fault."""
    args = arguments(__doc__, argv, minutes=10.0, rate=5000.0, seed=1, clock=False, only_send=False)
    if args.only_send:
        flood(args.rate, args.seed, 60.0 * args.minutes)
        return 0
    if args.clock and FAKETIME is None:
        sys.exit("--clock needs libfaketime: apt install faketime")
    faults = study(args.minutes, args.rate, args.seed, args.clock)
    print(*faults or ["nothing was wrong"], sep="\n")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main())
