# SPDX-License-Identifier: Apache-2.0
"""What the axis does with time: every factor, a process that was stopped, its clock, priority."""

import time
from collections import Counter
from itertools import pairwise

import pytest
from heard import Heard, stamp
from live import MakeAxis, Ros, Start
from rclpy.parameter import Parameter

from stickslip_ros.axis import Axis
from stickslip_ros.axis.pace import Pace
from stickslip_ros.ros.client import AxisClient
from stickslip_ros.ros.sim_loop import request_priority


@pytest.mark.parametrize("factor", [0.1, 100.0])
def test_at_every_factor_the_states_are_those_of_the_commands(
    ros: Ros, make_axis: MakeAxis, factor: float
) -> None:
    """To the last bit: the same commands at the same simulated times, without ROS."""
    make_axis(real_time_factor=factor, frequency=1000.0)
    heard = Heard(ros)
    client = AxisClient(node=ros.node("user"))
    client.step(100).wait()
    client.set_amplitude(200.0).jog(500.0)
    client.stop().wait()
    client.set_load(0.01)
    heard.event("load", "applied")
    ros.wait_until(lambda: stamp(heard.joints[-1]) > heard.events[-1][0], "a later state")
    assert heard.compare_with_rerun() > 3


def test_states_are_later_than_the_commands_before_them(ros: Ros, make_axis: MakeAxis) -> None:
    """However slow it is: else nobody knew on which side of a command a state of its time lies."""
    node = make_axis(real_time_factor=1e-6)
    heard = Heard(ros)
    assert node.count_publishers("/clock") == 0
    client = AxisClient(node=ros.node("user"))
    for force in (0.01, 0.02, 0.0):
        client.set_load(force)
        acted = heard.events[-1][0]
        heard.joints.clear()
        ros.wait_until(lambda: len(heard.joints) > 1, "states")
        stamps = [stamp(state) for state in list(heard.joints)]
        assert stamps[-1] > acted
        assert stamps == sorted(stamps)


def test_peers_follow_its_clock_where_it_publishes_one(ros: Ros, make_axis: MakeAxis) -> None:
    make_axis(publish_clock=True, real_time_factor=10.0)
    peer = ros.node("peer", parameter_overrides=[Parameter("use_sim_time", value=True)])
    heard = Heard(ros)
    ros.wait_until(lambda: peer.get_clock().now().nanoseconds > stamp(heard.joints[0]))
    seen = peer.get_clock().now().nanoseconds
    ros.wait_until(lambda: stamp(heard.joints[-1]) >= seen, "the state of that time")


def test_an_axis_at_rest_whose_states_nobody_reads_computes_seldom(
    ros: Ros, make_axis: MakeAxis, monkeypatch: pytest.MonkeyPatch
) -> None:
    """But as often as it should for whoever reads, and at once for a command."""
    blocks, catch_up = Counter[str](), Pace.catch_up

    def counted(pace: Pace, steady: int, only: Axis | None = None) -> bool:
        blocks["now"] += 1
        return catch_up(pace, steady, only)

    def blocks_a_second() -> float:
        before, began = blocks["now"], time.monotonic()
        time.sleep(1.0)
        return (blocks["now"] - before) / (time.monotonic() - began)

    monkeypatch.setattr(Pace, "catch_up", counted)
    make_axis()
    ros.wait_until(lambda: 0.0 < blocks_a_second() < 15.0, "rest, after its first report")
    heard = Heard(ros)
    client = AxisClient(node=ros.node("user"))
    seen, before = len(heard.joints), blocks["now"]
    ros.wait_until(lambda: len(heard.joints) > seen + 50, "states")
    assert blocks["now"] - before >= 50
    assert client.step(3).wait().steps_done == 3
    assert float(client.report()["timing"]["time dropped (s)"]) == 0.0


@pytest.mark.long
def test_a_stopped_process_skips_what_it_missed_and_moves_on(ros: Ros, start_node: Start) -> None:
    """Three seconds of SIGSTOP: no states for them, counted, and made up for or dropped."""
    process = start_node("axis_node", frequency=1000.0)
    process.wait_for("ready")
    client = AxisClient(node=ros.node("user"))
    heard = Heard(ros)
    client.step(100_000)
    seen = len(heard.joints)
    ros.wait_until(lambda: len(heard.joints) > seen + 5, "states before")
    early = client.report()["timing"]
    with process.stopped():
        silent = client.stamp
        # What was on its way has arrived when this long nothing came.
        ros.wait_until(lambda: _silent(client, silent), "silence", 60.0)
    client.stop().wait()
    stamps = [stamp(state) for state in list(heard.joints)]
    late = client.report()["timing"]
    made_up = 1e-9 * max(b - a for a, b in pairwise(stamps))
    dropped = float(late["time dropped (s)"]) - float(early["time dropped (s)"])
    assert made_up > 0.1
    assert made_up + dropped >= 3.0
    assert int(late["missed deadlines"]) - int(early["missed deadlines"]) >= 300 - 1
    assert "deadlines of 10 ms missed so far" in process.output
    assert heard.compare_with_rerun() > 10
    assert process.interrupt() == 0


def _silent(client: AxisClient, since: float) -> bool:
    """Whether three seconds have passed by the clock of the machine since the last state."""
    now = client.node.get_clock().now().nanoseconds * 1e-9
    return now - max(since, client.stamp) > 3.05


def test_priority_in_a_process_of_its_own(ros: Ros, start_node: Start) -> None:
    """Whatever this machine allows: the log and the diagnostics say the same."""
    assert request_priority(0) == "off"
    process = start_node("axis_node", real_time_priority=5)
    process.wait_for("real-time priority ")
    said = AxisClient(node=ros.node("user")).report()["timing"]["real-time priority"]
    assert said.startswith(("granted: SCHED_FIFO 5", "refused: "))
    assert f"real-time priority {said}" in process.output
    assert process.interrupt() == 0
