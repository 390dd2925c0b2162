# SPDX-License-Identifier: Apache-2.0
"""Hostile messages and calls on every topic and service of real nodes, one by one and in floods.

Topics and services are those that the graph shows, so new ones are in it by themselves. Messages
are whole ones with hostile values and bytes that are none. What orders silence is left out.

`one_by_one`: after each example the node has to answer, and must not have computed for long; at the
end its memory must not have grown, the bag of the recorder is whole, and the run in it repeats bit
for bit. `flooded`: a peer sends 5000 a second to two axes of one name and a recorder (requests are
whole ones: SECURITY.md says why). No axis may be silent for longer than 0.2 s, less the time for
which it and the one who hears it waited for nothing but a processor. `client`: hostile messages on
the topics that a client hears; it goes on and commands its axis.
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
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from cpu_time import cpu_seconds
from diagnostic_msgs.msg import DiagnosticArray
from hypothesis import strategies as some
from hypothesis.strategies import SearchStrategy
from live import Ros, wait_until
from rcl_interfaces.srv import ListParameters
from rclpy.duration import Duration
from rclpy.node import Node, NodeNameNonExistentError
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from stickslip_ros.base.child_process import ChildError, choose_domain
from stickslip_ros.recordings import open_bag, resimulate
from stickslip_ros.ros.client import AxisClient
from stickslip_ros.ros.nodes.axis_node import AxisNode
from stickslip_ros.ros.nodes.messages import message_class
from stickslip_ros.ros.nodes.process import SpinThread
from stickslip_ros.simulation import warm_up
from validation.campaigns.hostile_messages import damaged, examples, messages, search
from validation.campaigns.processes import FAKETIME, Program, memory_of, waited, with_clock_of

AXIS, RECORDER = "stickslip_axis", "stickslip_recorder"
HEARD = f"/{AXIS}/contact"  #: by this an axis is heard, with a name of its own
SILENCE = 0.2  #: s at most between two states of an axis
GROWTH, GROWTH_ONE_BY_ONE = 30.0, 50.0  #: MB that a process may grow by
RATE = 5000.0  #: messages a second of a flood
REQUESTS, LONG = 25, 100  #: of so many messages, one is a request, and one is longer than SHORT
SHORT = 2000  # bytes
EXAMPLES = 60  # of each topic and service, whole ones and damaged ones
LOOK_EVERY = 5.0  # s
JUMPS = ("+1d", "-1d", "+0d")  #: of the clock, in turn
ORDERS_SILENCE = {f"/{RECORDER}/stop", f"/{AXIS}/pause", f"/{AXIS}/enable"}
ANSWERS = 600.0  # s for an answer, on a machine that is busy with other things
LONGEST = 2.0  # s that the node may compute for one example
HANGING = 20.0  # s of computing without an answer
LATCHED = Ros.latched(10)  # all hear that
#: What a client hears
OF_CLIENT = {
    f"/{AXIS}/status": (DiagnosticArray, LATCHED),
    f"/{AXIS}/events": (DiagnosticArray, LATCHED),
    f"/{AXIS}/description": (DiagnosticArray, LATCHED),
    "/diagnostics": (DiagnosticArray, QoSProfile(depth=10)),
    "/joint_states": (JointState, QoSProfile(depth=10)),
}


def _heard_by(node: Node, name: str) -> dict[str, type[Any]]:
    """Return the topics that a node hears, and their types."""
    found = node.get_subscriber_names_and_types_by_node(name, "/")
    return {topic: message_class(kinds[0]) for topic, kinds in found}


def _services_of(node: Node, name: str) -> dict[str, type[Any]]:
    """Return the services of a node, and their types, when the graph knows it."""

    def found() -> list[tuple[str, list[str]]]:
        with suppress(NodeNameNonExistentError):
            return node.get_service_names_and_types_by_node(name, "/")
        return []

    services = wait_until(lambda: len(one := found()) >= 7 and one, f"services of {name}")
    return {service: message_class(kinds[0]) for service, kinds in services}


@contextmanager
def _recorded(
    folder: Path, names: str, *parameters: str, **changes: str
) -> Iterator[dict[str, Program]]:
    """Start a recorder, and axes of these names with parameters; changes of the environment."""
    choose_domain()
    warm_up()
    with contextlib.ExitStack() as stack:

        def start(name: str, node: str, *parameters: str) -> Program:
            (place := folder / name).mkdir()
            words = (word for one in parameters for word in ("-p", one))
            program = Program(place, node, "--ros-args", *words, **changes)
            stack.callback(program.end)
            return program

        found = {"recorder": start("recorder", "recorder_node", f"output:={folder / 'bag'}")}
        found["recorder"].wait_for("recording")
        for name in names:
            found[name] = start(name, "axis_node", f"axis_name:={name}", *parameters)
            found[name].wait_for("ready")  # one after the other: a clock that is faked takes time
        found["recorder"].wait_for("first message of /joint_states")
        yield found


def _end(programs: dict[str, Program], folder: Path, again: bool) -> list[str]:
    """End axes, then the recorder; return what was bad, of the bag as well."""
    faults, took = [], {}
    for name in reversed(programs):
        took[name] = programs[name].signalled(2)
        faults += [f"{name}: {fault}" for fault in programs[name].faults(0)]
    with open_bag(folder / "bag") as bag:
        print(f"{bag.message_count} messages in the bag; ended {took} s after SIGINT")
        if again and not all(run.bit_for_bit for run in resimulate(bag)):
            faults.append("the run did not come out again bit for bit")
    return faults


def _told(faults: list[str]) -> int:
    print(*faults or ["nothing was wrong"], sep="\n")
    return len(faults)


# -- one by one


class Prey:
    """A node in a process, and how it is held against what is asked of it."""

    def __init__(self, program: Program, user: Node, name: str) -> None:
        """Take a node that is ready."""
        self.program, self.name, self._user = program, name, user
        self._clients: dict[str, Any] = {}
        self.call(ListParameters, f"/{name}/list_parameters", ListParameters.Request())
        self._computed, self._memory = cpu_seconds(program.pid), memory_of(program.pid)
        self.worst = 0.0

    def call(self, kind: type[Any], name: str, request: Any) -> None:
        """Call a service of the node and wait for the answer."""
        if name not in self._clients:
            self._clients[name] = self._user.create_client(kind, name)
        client = self._clients[name]
        assert client.wait_for_service(ANSWERS), f"{name} is gone: {self.program.said[-2000:]}"
        answered = threading.Event()
        client.call_async(request).add_done_callback(lambda _: answered.set())
        end, computed = time.monotonic() + ANSWERS, cpu_seconds(self.program.pid)
        while not answered.wait(0.5):
            self.program.check_running()
            took = cpu_seconds(self.program.pid) - computed
            late = took > HANGING or time.monotonic() > end
            assert not late, f"{name}: no answer in {took:.1f} s of computing"

    def check(self) -> None:
        """Fail if the node is gone, hangs or has computed for long since the last call."""
        for _ in range(2):  # with the second answer, what came before the first is done
            self.call(ListParameters, f"/{self.name}/list_parameters", ListParameters.Request())
        now = cpu_seconds(self.program.pid)
        self.worst, self._computed = max(self.worst, now - self._computed), now
        assert self.worst < LONGEST, f"computed for {self.worst:.1f} s"

    def grown(self) -> float:
        """Return by how much the memory has grown since the beginning, MB."""
        return memory_of(self.program.pid) - self._memory


def _messages_to(ros: Ros, user: Node, axis: Prey) -> tuple[SearchStrategy[Any], Any]:
    """Return whole and broken messages on all that the axis hears, and how one is checked."""
    topics = _heard_by(user, AXIS)
    assert len(topics) >= 9
    publishers = {topic: ros.publisher(user, kind, topic) for topic, kind in topics.items()}

    def check(example: tuple[str, Any]) -> None:
        with suppress(RuntimeError):  # what is longer than its type can be does not leave
            publishers[example[0]].publish(example[1])
        axis.check()

    whole = [
        some.tuples(some.just(topic), messages(kind).map(serialize_message))
        for topic, kind in topics.items()
    ]
    pieces = some.one_of(whole).flatmap(lambda one: some.tuples(some.just(one[0]), damaged(one[1])))
    return some.one_of(*whole, pieces), check


def _calls_of(user: Node, *preys: Prey) -> tuple[SearchStrategy[Any], Any]:
    """Return calls of every service, parameters with hostile values too, and how one is checked."""
    requests = []
    for prey in preys:
        services = _services_of(user, prey.name)
        assert len(services) >= 7
        for service, kind in services.items():
            if service != f"/{RECORDER}/stop":  # it would obey
                one = messages(kind.Request)
                requests.append(
                    some.tuples(some.just(prey), some.just(kind), some.just(service), one)
                )

    def check(example: tuple[Prey, type[Any], str, Any]) -> None:
        prey, *call = example
        prey.call(*call)
        prey.check()

    return some.one_of(requests), check


def one_by_one(seconds: float, seed: int) -> int:
    """Send messages, then calls, for half of the time each; return how much was bad."""
    faults: list[str] = []
    for what in ("messages", "calls"):
        with (
            tempfile.TemporaryDirectory() as made,
            _recorded(Path(made), "a", "frequency:=1000.0") as programs,
        ):
            spin = SpinThread("peer")
            ros = Ros(spin)
            user = ros.node("peer")
            axis = Prey(programs["a"], user, AXIS)
            recorder = Prey(programs["recorder"], user, RECORDER)
            found = _calls_of(user, axis, recorder)
            strategy, check = _messages_to(ros, user, axis) if what == "messages" else found
            try:
                done = search(strategy, check, 0.5 * seconds, seed)
                print(
                    f"{done} {what}: axis {axis.grown():+.1f} MB, recorder {recorder.grown():+.1f} "
                    f"MB; the longest took the axis {axis.worst:.2f} s"
                )
                most = max(axis.grown(), recorder.grown())
                faults += [f"grew by {most:.0f} MB"] * (most > GROWTH_ONE_BY_ONE)
            except (AssertionError, ChildError):
                faults.append(traceback.format_exc())
            spin.close()
            faults += _end(programs, Path(made), again=True)
    return _told(faults)


def client(seconds: float, seed: int) -> int:
    """Publish as a peer; return 1 if a client does not outlive it."""
    choose_domain()
    spin = SpinThread("peer")
    ros = Ros(spin)
    ros.add(AxisNode(context=ros.context))
    client, peer = AxisClient(), ros.node("peer")
    outlets = {
        topic: ros.publisher(peer, kind, topic, qos) for topic, (kind, qos) in OF_CLIENT.items()
    }

    def check(example: tuple[str, Any]) -> None:
        topic, message = example
        with suppress(RuntimeError):  # what is longer than its type can be does not leave
            outlets[topic].publish(message)
        assert outlets[topic].wait_for_all_acked(Duration(seconds=20))
        assert "stickslip_client" in [thread.name for thread in threading.enumerate()]
        assert client.state and client.moving in (True, False)

    found = [
        some.tuples(some.just(topic), messages(kind)) for topic, (kind, _) in OF_CLIENT.items()
    ]
    try:
        print(f"{search(some.one_of(found), check, seconds, seed)} messages")
        stamp = client.stamp
        ros.wait_until(lambda: client.stamp != stamp, "another state")
        # One who comes when they are gone commands as ever.
        for publisher in outlets.values():
            peer.destroy_publisher(publisher)
        with AxisClient(node=ros.node("user")) as later:
            assert later.send("steps", 1).wait().steps_done == 1
    except AssertionError:
        traceback.print_exc()
        return 1
    finally:
        client.close()
        spin.close()
    return 0


# -- floods


def flood(seconds: float, number: int) -> None:
    """Send messages for so long, at all that nodes hear; say how many."""
    os.nice(10)  # to send is more work than to hear
    spin, lot = SpinThread("flood"), random.Random(number)
    node = spin.add(Node("flood", context=spin.context))
    time.sleep(5.0)  # until the graph is known
    topics = _heard_by(node, AXIS) | _heard_by(node, RECORDER)
    services = _services_of(node, AXIS) | _services_of(node, RECORDER)
    out, ask = [], []
    for topic in sorted(topics.keys() - {HEARD}):
        whole = messages(topics[topic]).map(serialize_message)
        pool = examples(whole, number, EXAMPLES)
        pool += examples(whole.flatmap(damaged), number, EXAMPLES)
        pool.sort(key=len)
        short = sum(len(one) <= SHORT for one in pool)
        out.append((node.create_publisher(topics[topic], topic, LATCHED), pool, short))
    for service in sorted(services.keys() - ORDERS_SILENCE):
        pool = examples(messages(services[service].Request), number, EXAMPLES)
        pool = [one for one in pool if "real_time_factor" not in str(one)]
        ask.append((node.create_client(services[service], service), pool))
    print(f"{len(out)} topics, {len(ask)} services", flush=True)
    sent, begin, unsent = 0, time.monotonic(), 0
    while (now := time.monotonic() - begin) < seconds:
        if sent >= now * RATE:
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


def flooded(minutes: float, number: int, clock: str = "") -> int:
    """Flood for so long, with a clock that is set if it says so; return how much was bad."""
    if clock and FAKETIME is None:
        sys.exit("this needs libfaketime: apt install faketime")
    faults, memory = list[str](), dict[str, list[float]]()
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        (file := folder / "clock").write_text("+0d\n")
        with _recorded(folder, "ab", **(with_clock_of(file) if clock else {})) as programs:
            spin = SpinThread("listener")
            node = spin.add(Node("listener", context=spin.context))
            heard = Listener(node, {name: programs[name].pid for name in "ab"})
            words = [sys.executable, "-m", __name__, str(60.0 * minutes), str(number)]
            sender = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
            assert sender.stdout
            print(sender.stdout.readline(), end="", flush=True)  # from now on it floods
            until = time.monotonic() + 60.0 * minutes  # the nodes end while the flood goes on
            turns = itertools.cycle(JUMPS)
            while time.monotonic() < until and sender.poll() is None and not faults:
                time.sleep(LOOK_EVERY)
                file.write_text(f"{next(turns)}\n")
                for name, program in programs.items():
                    try:
                        program.check_running()
                        memory.setdefault(name, []).append(memory_of(program.pid))
                    except ChildError as error:
                        faults.append(str(error))
            faults += _end(programs, folder, again=False)
            spin.close()
        print(sender.communicate()[0], end="")
    grown = {name: sizes[-1] - sizes[len(sizes) // 2] for name, sizes in memory.items()}
    faults += [f"{name} grew by {size:.0f} MB" for name, size in grown.items() if size > GROWTH]
    for name, silent in heard.silent.items():
        if silent > SILENCE:
            faults.append(f"axis {name} was silent for {silent:.3f} s")
    print(f"silent at most {heard.silent} s (with waiting {heard.gross} s), {heard.count} states")
    print(f"growth {grown} MB, load {os.getloadavg()[0]:.1f}")
    return _told(faults)


if __name__ == "__main__":
    flood(float(sys.argv[1]), int(sys.argv[2]))
