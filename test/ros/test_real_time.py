# SPDX-License-Identifier: Apache-2.0
"""What the axis does with time: every factor, a process that was stopped, its clock, priority."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from conftest import Process, Ros

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState

from stickslip_ros.axis import Axis
from stickslip_ros.parameters import PARAMETERS
from stickslip_ros.ros.axis_node import AxisNode
from stickslip_ros.ros.client import AxisClient
from stickslip_ros.ros.sim_loop import request_priority

pytestmark = pytest.mark.usefixtures("compiled_solver")


def _stamp(message: Any) -> int:
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


class Listener:
    """Hears the states and the events of an axis, and runs it again from them."""

    def __init__(self, ros: Ros, axis: str = "/stickslip_axis") -> None:
        """Join; late, like a recorder, as the events wait for it."""
        self.states: list[tuple[int, tuple[float, float]]] = []  # stamp; position, velocity
        self.events: list[tuple[int, dict[str, str]]] = []  # stamp of the message; values
        latched = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node = ros.node("listener")
        node.create_subscription(DiagnosticArray, f"{axis}/events", self._on_events, latched)
        node.create_subscription(JointState, "/joint_states", self._on_state, 1000)
        ros.wait_until(lambda: self.events and self.states, "events and states")

    def _on_events(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            self.events.append((_stamp(message), values))

    def _on_state(self, message: JointState) -> None:
        self.states.append((_stamp(message), (message.position[0], message.velocity[0])))

    def compare_with_a_second_run(self) -> int:
        """Repeat the events on an axis without ROS; assert the same states, return how many.

        The last states may be later than the events heard, so those after the last event stay out.
        """
        events, states = list(self.events), list(self.states)
        start, first = events[0]
        assert (first["event"], first["time (s)"]) == ("start", "0.0")
        given = {n: row.parse(first[n]) for n, row in PARAMETERS.items()}
        axis = Axis(given)
        compared = 0
        applied = [e for _, e in events[1:] if e["outcome"] == "applied"]
        for stamp, seen in sorted(states):
            t = (stamp - start) * 1e-9
            if stamp > events[-1][0]:
                break
            # What is commanded at t comes after the state at t.
            while applied and float(applied[0]["time (s)"]) < t:
                event = applied.pop(0)
                axis.advance(float(event["time (s)"]))
                axis.repeat(event["event"], {"value": json.loads(event.get("value", "0"))})
            axis.advance(t)
            assert (axis.state.x, axis.state.v) == seen, t
            compared += 1
        return compared


@pytest.fixture
def make_axis(ros: Ros) -> Callable[..., AxisNode]:
    def make(**parameters: Any) -> AxisNode:
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        node = AxisNode(context=ros.context, parameter_overrides=overrides)
        ros.add(node)
        return node

    return make


MakeAxis = Callable[..., AxisNode]


@pytest.mark.parametrize("factor", [0.0, 0.1, 1.0, 100.0])
def test_at_every_factor_the_states_are_those_of_the_commands(
    ros: Ros, make_axis: MakeAxis, factor: float
) -> None:
    """To the last bit: the same commands at the same simulated times, without ROS."""
    make_axis(real_time_factor=factor, frequency=1000.0)
    listener = Listener(ros)
    client = AxisClient(node=ros.node("user"))
    client.step(100).wait()
    client.set_amplitude(200.0).jog(500.0)
    client.stop().wait()
    client.set_load(0.01)
    ros.wait_until(lambda: listener.events[-1][1]["event"] == "load", "the last event")
    ros.wait_until(lambda: listener.states[-1][0] > listener.events[-1][0], "a later state")
    assert listener.compare_with_a_second_run() > 3


def test_states_are_later_than_the_commands_before_them(ros: Ros, make_axis: MakeAxis) -> None:
    """However slow it is: else nobody knew on which side of a command a state of its time lies."""
    make_axis(real_time_factor=1e-6)
    listener = Listener(ros)
    client = AxisClient(node=ros.node("user"))
    for force in (0.01, 0.02, 0.0):
        client.set_load(force)
        acted = listener.events[-1][0]
        listener.states.clear()
        ros.wait_until(lambda: len(listener.states) > 1, "states")
        assert listener.states[-1][0] > acted
        assert [stamp for stamp, _ in listener.states] == sorted(s for s, _ in listener.states)


def test_peers_follow_its_clock_where_it_publishes_one(ros: Ros, make_axis: MakeAxis) -> None:
    make_axis(publish_clock=True, real_time_factor=10.0)
    peer = ros.node("peer", parameter_overrides=[Parameter("use_sim_time", value=True)])
    listener = Listener(ros)
    ros.wait_until(lambda: peer.get_clock().now().nanoseconds > listener.states[0][0])
    seen = peer.get_clock().now().nanoseconds
    ros.wait_until(lambda: listener.states[-1][0] >= seen, "the state of that time")


def test_it_publishes_no_clock_unasked(ros: Ros, make_axis: MakeAxis) -> None:
    node = make_axis()
    Listener(ros)
    assert node.count_publishers("/clock") == 0


@pytest.mark.slow
def test_a_stopped_process_skips_what_it_missed_and_moves_on(
    ros: Ros, start_node: Callable[..., Process]
) -> None:
    """A second of SIGSTOP: no states for it, counted, and the physics went on meanwhile."""
    process = start_node("axis_node", frequency=1000.0)
    process.wait_for("ready")
    client = AxisClient(node=ros.node("user"))
    listener = Listener(ros)
    client.step(100_000)
    seen = len(listener.states)
    ros.wait_until(lambda: len(listener.states) > seen + 5, "states before")
    early = int(client.report()["timing"]["missed deadlines"])
    with process.stopped():
        silent = client.stamp
        # What was on its way has arrived when this long nothing came.
        ros.wait_until(lambda: _silent(client, silent), "silence", 60.0)
    client.stop().wait()
    gaps = [b[0] - a[0] for a, b in zip(listener.states, listener.states[1:], strict=False)]
    assert max(gaps) >= 3e9
    missed = int(client.report()["timing"]["missed deadlines"]) - early
    assert missed >= 300 - 1
    assert "deadlines of 10 ms missed so far" in process.output
    assert listener.compare_with_a_second_run() > 10
    assert process.interrupt() == 0


def _silent(client: AxisClient, since: float) -> bool:
    """Whether three seconds have passed by the clock of the machine since the last state."""
    now = client.node.get_clock().now().nanoseconds * 1e-9
    return now - max(since, client.stamp) > 3.05


def test_priority_is_attempted_and_reported(ros: Ros, make_axis: MakeAxis) -> None:
    assert request_priority(0) == "off"
    make_axis(real_time_priority=0)
    client = AxisClient(node=ros.node("user"))
    assert client.report()["timing"]["real-time priority"] == "off"


def test_priority_in_a_process_of_its_own(ros: Ros, start_node: Callable[..., Process]) -> None:
    """Whatever this machine allows: the log and the diagnostics say the same."""
    process = start_node("axis_node", real_time_priority=5)
    process.wait_for("real-time priority ")
    said = AxisClient(node=ros.node("user")).report()["timing"]["real-time priority"]
    assert said.startswith(("granted: SCHED_FIFO 5", "refused: "))
    assert f"real-time priority {said}" in process.output
    assert process.interrupt() == 0
