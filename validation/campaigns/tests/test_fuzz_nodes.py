# SPDX-License-Identifier: Apache-2.0
"""Hostile messages and calls on every topic and service of real nodes, over real DDS.

Nodes and services are those that the graph shows, so new ones are in it by themselves. After each
example the node has to answer, and must not have computed for long; at the end its memory must not
have grown, the bag of the recorder is whole, and the run in it repeats bit for bit.
"""

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from cpu_time import cpu_seconds
from hypothesis import strategies as some
from live import Process, Ros, Start

from .fuzzing import MOST_GROWTH, SECONDS, TIME, megabytes, search

pytest.importorskip("rclpy")

from rcl_interfaces.srv import ListParameters
from rclpy.node import Node
from rclpy.serialization import serialize_message
from std_srvs.srv import Trigger

from stickslip_ros.recordings import open_bag, resimulate
from stickslip_ros.ros.messages import message_class

from .hostile import damaged, messages

pytestmark = [pytest.mark.long, TIME]
AXIS, RECORDER = "stickslip_axis", "stickslip_recorder"
PATIENCE = 600.0  # s for an answer, on a machine that is busy with other things
LONGEST = 2.0  # s that the node may compute for one example
HANGING = 20.0  # s of computing without an answer


class Prey:
    """A node of ours in a process, and how it is held against what is asked of it."""

    def __init__(self, process: Process, user: Node, name: str) -> None:
        self.process, self.name = process, name
        self._user = user
        self._clients: dict[str, Any] = {}
        self.call(ListParameters, "list_parameters", ListParameters.Request())
        self._computed = cpu_seconds(process.pid)
        self._memory = megabytes(process.pid)
        self.worst = 0.0

    def call(self, kind: type[Any], service: str, request: Any) -> Any:
        """Call a service of the node and return the answer."""
        name = f"/{self.name}/{service}"
        if name not in self._clients:
            self._clients[name] = self._user.create_client(kind, name)
        client = self._clients[name]
        assert client.wait_for_service(PATIENCE), f"{name} is gone: {self.process.output[-2000:]}"
        answered = threading.Event()
        future = client.call_async(request)
        future.add_done_callback(lambda _: answered.set())
        end = time.monotonic() + PATIENCE
        computed = cpu_seconds(self.process.pid)
        while not answered.wait(0.5):
            said = self.process.output[-2000:]
            assert self.process.running, f"{self.name} has ended: {said}"
            assert time.monotonic() < end, f"{name} does not answer: {said}"
            took = cpu_seconds(self.process.pid) - computed
            assert took < HANGING, f"computed for {took:.1f} s without an answer: {said}"
        return future.result()

    def check(self) -> None:
        """Fail if the node is gone, hangs or has computed for long since the last call."""
        for _ in range(2):  # with the second answer, what came before the first is done
            self.call(ListParameters, "list_parameters", ListParameters.Request())
        now = cpu_seconds(self.process.pid)
        self.worst, self._computed = max(self.worst, now - self._computed), now
        assert self.worst < LONGEST, f"computed for {self.worst:.1f} s"

    def grown(self) -> float:
        """Return by how much the memory has grown since the beginning, MB."""
        return megabytes(self.process.pid) - self._memory


@pytest.fixture
def user(ros: Ros) -> Node:
    return ros.node("peer")


@pytest.fixture
def recorder(start_node: Start, user: Node) -> Prey:
    process = start_node("recorder_node", output="bag")
    process.wait_for("recording")
    return Prey(process, user, RECORDER)


@pytest.fixture
def axis(recorder: Prey, start_node: Start, user: Node) -> Prey:
    process = start_node("axis_node", frequency=1000.0)
    process.wait_for("ready")
    recorder.process.wait_for("first message of /joint_states")
    return Prey(process, user, AXIS)


@pytest.fixture
def hunt(
    ros: Ros, user: Node, axis: Prey, recorder: Prey, tmp_path: Path
) -> Iterator[Callable[[int], None]]:
    """Give a function that ends a test: the axis works, nothing has grown, the bag is whole."""

    def end(examples: int) -> None:
        print(
            f"{examples} examples in {SECONDS:g} s: axis {axis.grown():+.1f} MB, recorder "
            f"{recorder.grown():+.1f} MB; the longest took the axis {axis.worst:.2f} s"
        )
        assert examples > 20
        assert axis.grown() < MOST_GROWTH
        assert recorder.grown() < MOST_GROWTH
        assert axis.process.interrupt() == 0
        answer = recorder.call(Trigger, "stop", Trigger.Request())
        assert answer.success, answer
        assert recorder.process.wait() == 0
        for output in (axis.process.output, recorder.process.output):
            assert "Traceback" not in output
        with open_bag(tmp_path / "bag") as bag:
            (again,) = resimulate(bag)
        assert again.bit_for_bit, again.as_json()

    yield end


def _topics(user: Node, name: str) -> dict[str, str]:
    """Return the topics that a node hears, and their types."""
    found = user.get_subscriber_names_and_types_by_node(name, "/")
    return {topic: kinds[0] for topic, kinds in found}


def _services(user: Node, name: str) -> dict[str, str]:
    found = user.get_service_names_and_types_by_node(name, "/")
    return {service.rpartition("/")[2]: kinds[0] for service, kinds in found}


def test_messages(
    ros: Ros, user: Node, axis: Prey, recorder: Prey, hunt: Callable[[int], None]
) -> None:
    """Whole ones with hostile values, and bytes that are none; on all that the axis hears."""
    topics = _topics(user, AXIS)
    assert len(topics) >= 9
    publishers = {
        topic: ros.publisher(user, message_class(kind), topic) for topic, kind in topics.items()
    }

    def check(example: tuple[str, Any]) -> None:
        topic, message = example
        # What is longer than its type can be does not leave the sender.
        with contextlib.suppress(RuntimeError):
            publishers[topic].publish(message)
        axis.check()

    whole = [
        some.tuples(some.just(topic), messages(message_class(kind)).map(serialize_message))
        for topic, kind in topics.items()
    ]
    pieces = some.one_of(whole).flatmap(lambda one: some.tuples(some.just(one[0]), damaged(one[1])))
    hunt(search(some.one_of(*whole, pieces), check))


def test_calls(user: Node, axis: Prey, recorder: Prey, hunt: Callable[[int], None]) -> None:
    """Every service of both nodes; parameters of every type number and with hostile values."""
    requests = []
    for prey in (axis, recorder):
        services = _services(user, prey.name)
        assert len(services) >= 7
        for service, type_name in services.items():
            if prey is recorder and service == "stop":
                continue  # it would obey
            kind = message_class(type_name)
            one = messages(kind.Request)
            requests.append(some.tuples(some.just(prey), some.just(kind), some.just(service), one))

    def check(example: tuple[Prey, type[Any], str, Any]) -> None:
        prey, kind, service, request = example
        prey.call(kind, service, request)
        prey.check()

    hunt(search(some.one_of(requests), check))
