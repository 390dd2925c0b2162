# SPDX-License-Identifier: Apache-2.0
"""What the axis does with time: every factor, a stopped process, priority, overload."""

import re
import time
from collections import Counter
from itertools import pairwise
from statistics import median
from typing import Any

import pytest
from heard import Heard, stamp
from live import MakeAxis, Ros, Start
from rclpy.parameter import Parameter

from stickslip_ros.axis import Axis
from stickslip_ros.axis.pace import Pace
from stickslip_ros.ros.client import AxisClient


@pytest.mark.parametrize("factor", [0.1, 100.0])
def test_at_every_factor_the_states_are_those_of_the_commands(
    ros: Ros, make_axis: MakeAxis, factor: float
) -> None:
    """To the last bit: the same commands at the same simulated times, without ROS."""
    make_axis(real_time_factor=factor, frequency=1000.0)
    heard = Heard(ros)
    client = AxisClient(node=ros.node("user"))
    client.send("steps", 100).wait()
    client.send("amplitude", 200.0).send("jog", 500.0)
    client.send("stop").wait()
    client.send("load", 0.01)
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
        client.send("load", force)
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
    assert client.send("steps", 3).wait().steps_done == 3
    assert float(client.report()["timing"]["time dropped (s)"]) == 0.0


@pytest.mark.long
def test_a_stopped_process_skips_what_it_missed_and_moves_on(ros: Ros, start_node: Start) -> None:
    """Three seconds of SIGSTOP: no states for them, counted, and made up for or dropped."""
    process = start_node("axis_node", frequency=1000.0)
    process.wait_for("ready")
    client = AxisClient(node=ros.node("user"))
    heard = Heard(ros)
    client.send("steps", 100_000)
    seen = len(heard.joints)
    ros.wait_until(lambda: len(heard.joints) > seen + 5, "states before")
    early = client.report()["timing"]
    with process.stopped():
        silent = client.stamp
        # What was on its way has arrived when this long nothing came.
        ros.wait_until(lambda: _silent(client, silent), "silence", 60.0)
    client.send("stop").wait()
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


CRASH = ("Traceback", "Error", "terminate called", "Exception", "core dumped", "Segmentation")
HEARD = 0.2  # s, within which an axis answers, whatever it costs
CONTACTS = {"contacts": 16, "contact_spread": 0.2, "sensor_bandwidth": 3000.0}
FAST = {"slewrate": 50.0, "amplitude": 100.0, "max_frequency": 25000.0, "frequency": 1000.0}


def answers(client: AxisClient, count: int) -> list[float]:
    """Return how long a stop takes to be answered, s, each time."""
    took = []
    for _ in range(count):
        begin = time.monotonic()
        client.send("stop")
        took.append(time.monotonic() - begin)
    return took


@pytest.mark.parametrize(
    ("given", "changes", "jog"),
    [
        ({**CONTACTS, **FAST}, {}, 20000.0),
        pytest.param(
            {"sensor_rate": 100000.0}, {"sensor_bandwidth": 3000.0}, 1000.0, marks=pytest.mark.long
        ),
        pytest.param(
            {"publish_rate": 1000.0, "sensor_bandwidth": 3000.0, "creep": 0.02},
            {},
            1000.0,
            marks=pytest.mark.long,
        ),
    ],
    ids=["contacts", "sensor", "publish_rate"],
)
def test_stop_and_signals_are_heard_whatever_it_costs(
    ros: Ros, start_node: Start, given: dict[str, Any], changes: dict[str, Any], jog: float
) -> None:
    """Each was deaf for seconds to minutes when a block simulated the whole lag in one piece."""
    process = start_node("axis_node", **given)
    process.wait_for("ready", 300.0)  # several contacts are compiled when they are first used
    client = AxisClient(node=ros.node("user"))
    if changes:
        client.set_parameters(**changes)
    client.send("jog", jog)
    before = client.stamp
    ros.wait_until(lambda: client.stamp > before + 0.02, "motion")
    took = answers(client, 9)
    assert median(took) < HEARD, took
    client.send("jog", jog)
    begin = time.monotonic()
    assert process.terminate() == 0
    assert time.monotonic() - begin < 5.0  # most of it to close what DDS has open
    assert not [word for word in CRASH if word in process.output]


@pytest.mark.long
def test_it_says_how_slow_it_is_and_why_and_faults_after_the_limit(
    ros: Ros, start_node: Start
) -> None:
    """The log says it once for all axes of the process."""
    process = start_node("axis_node", axes="[a, b]", **CONTACTS, **FAST, real_time_factor=50.0)
    process.wait_for("axis b ready", 300.0)  # several contacts are compiled at first
    client = AxisClient("/a", node=ros.node("user"))
    client.send("jog", 20000.0)
    said = ros.wait_until(lambda: client.status["overload"], "overload in the status")
    assert "of 50: a second of motion takes " in said
    assert "contacts 16" in said
    assert "sensor_bandwidth 3000 Hz" in said
    timing = client.report()["timing"]
    assert float(timing["real-time factor"]) < 40.0
    assert float(timing["time dropped (s)"]) > 0.0
    client.set_parameters(overload_limit=0.5)
    ros.wait_until(lambda: client.state == "fault", "the fault")
    assert "overload_limit is 0.5 s" in client.status["last error"]
    process.wait_for("[stickslip_axis]: real-time factor ")
    assert not re.search(r"\[[ab]\]: real-time factor", process.output)
    assert process.interrupt() == 0
