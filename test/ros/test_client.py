# SPDX-License-Identifier: Apache-2.0
"""The client: every command and its refusal, waiting for the end, what the axis says."""

import io
import math
import re
import sys
import threading
import time
from typing import Any

import pytest
from child import python
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from heard import values
from live import MakeAxis, Ros, Start
from rclpy.node import Node

from stickslip_ros.physics.parameters import PARAMETERS, ParameterError
from stickslip_ros.ros.client import AxisClient, AxisFault, CommandRefused
from stickslip_ros.ros.nodes.axis_node import AxisNode


@pytest.fixture
def node(make_axis: MakeAxis) -> AxisNode:
    return make_axis(frequency=1000.0, max_velocity=1e-3)


@pytest.fixture
def client(ros: Ros, node: AxisNode) -> AxisClient:
    return AxisClient(node=ros.node("user"))


def test_each_command_leads_to_its_state(node: AxisNode, client: AxisClient) -> None:
    assert client.state == "stopped"
    assert client.send("steps", 100_000).state == "stepping"
    assert client.send("jog", -2000.0).wait_for_state("jogging").velocity < 1.0
    with pytest.raises(ValueError, match="a jog does not end"):
        client.wait()
    assert client.send("jog", 0.0).wait_for_state("stopped").wait().state == "stopped"
    client.send("scan", 100.0).wait()
    assert node.axis.state.u == pytest.approx(100.0 * node.axis.parameters.actuator.gain)
    client.send("scan", 0.0).wait()
    client.send("stop").send("zero")
    assert client.send("position", 1e-6).wait().target_reached
    assert client.state == "holding"
    assert client.position == pytest.approx(1e-6, abs=5e-9)
    client.send("trajectory", [(0.2, 2e-6), (0.4, 1.5e-6)]).wait()
    assert client.position == pytest.approx(1.5e-6, abs=5e-9)
    assert client.send("home").wait().position == pytest.approx(0.0, abs=5e-9)
    client.send("enable", False).wait_for_state("disabled")
    with pytest.raises(CommandRefused, match="home refused: the axis is disabled: enable it first"):
        client.send("home")
    with pytest.raises(CommandRefused, match="steps refused: the axis is disabled"):
        client.send("steps", 1)
    assert client.send("enable").state == "stopped"
    old: Any = client  # programs of before run on
    assert old.set_amplitude(200.0).step(3).wait().steps_done == 3
    with pytest.raises(AttributeError, match="an AxisClient has no 'stepp'"):
        old.stepp(3)


def test_a_fault_is_raised_and_left_by_a_reset(
    client: AxisClient, capfd: pytest.CaptureFixture[str]
) -> None:
    """The log of the node has it, too."""
    client.send("frequency", 18_500.0)
    with pytest.raises(AxisFault, match="velocity is"):
        client.send("steps", 100_000).wait()
    assert client.state == "fault"
    assert client.summary.startswith("fault: velocity is ")
    assert re.search(
        r"\[ERROR\].* fault: velocity is .* or raise max_velocity", capfd.readouterr().err
    )
    with pytest.raises(CommandRefused, match="the axis is in fault"):
        client.send("steps", 1)
    assert client.send("reset").state == "stopped"


def test_refusals_are_raised_with_their_reason(node: AxisNode, client: AxisClient) -> None:
    for command, reason in (
        (
            lambda: client.send("amplitude", 301.0),
            "amplitude refused: amplitude is 301 V; .* 300 V",
        ),
        (lambda: client.send("position", math.inf), "position refused"),
        (lambda: client.send("trajectory", []), "trajectory refused: trajectory without points"),
        (
            lambda: client.set_parameters(preload=-1.0),
            "parameters refused: preload is -1 N; .* 0.001 ",
        ),
        (lambda: client.set_parameters(frequency=1.0), "start only: later send frequency, on ~"),
    ):
        before = node.axis.status.refused
        with pytest.raises(CommandRefused, match=reason):
            command()
        assert node.axis.status.refused == before + 1
    assert client.state == "stopped"


def test_what_no_message_can_hold_is_not_sent(node: AxisNode, client: AxisClient) -> None:
    """A count that wraps around would be carried out as another one."""
    for value in (2**31, -(2**31) - 1, 1.5, "3", None):  # 1.5 and "3" were sent as 1 and 3
        with pytest.raises(ParameterError, match=f"steps takes a whole number .*, not {value!r}"):
            client.send("steps", value)
    for seconds in (math.nan, math.inf, 1e12):
        with pytest.raises(CommandRefused, match=r"point 2 is at .* s; a message holds"):
            client.send("trajectory", [(0.1, 0.0), (seconds, 0.0)])
    assert node.axis.status.step_count == 0
    assert client.send("steps", 1).wait().steps_done == 1


def test_parameters_are_described_and_change(ros: Ros, node: AxisNode, client: AxisClient) -> None:
    """Whoever comes late hears the description: each parameter with unit and range, commands."""
    client.set_parameters({"preload": 0.6}, mass=0.003)
    ros.wait_until(lambda: client.parameters["mass"] == "0.003", "the new description")
    assert client.parameters["preload"] == "0.6"
    assert set(client.parameters) == set(PARAMETERS)
    heard = ros.hear(DiagnosticArray, "/stickslip_axis/description", ros.latched(1))

    def described() -> dict[str, dict[str, str]]:
        return {status.name: values(status) for status in heard[-1].status}

    ros.wait_until(lambda: heard, "the description")
    statuses, row = described(), PARAMETERS["preload"]
    limits = {"low": repr(row.low), "high": repr(row.high)}
    expected = {"value": "0.6", "unit": "N", **limits, "mutable": "True"}
    assert statuses["stickslip_axis: parameter preload"] == expected
    assert statuses["stickslip_axis: command amplitude"]["high"] == "300.0"
    assert "axis_slider" in statuses["stickslip_axis: description"]["joints"]
    client.send("steps", 100).wait()
    client.send("zero")  # moves the range of targets, which is told anew
    ros.wait_until(
        lambda: (
            described()["stickslip_axis: command position"]["low"]
            == repr(node.axis.config.reach[0])
        ),
        "the range from the new zero",
    )
    with pytest.raises(CommandRefused, match="use_sim_time can be set at the start only"):
        client.set_parameters(use_sim_time=True)
    assert client.set_parameters().state == "stopped"


def test_the_report_is_one_made_after_the_last_answer(
    ros: Ros, node: AxisNode, client: AxisClient
) -> None:
    """What was reported before is not taken for it, nor what another axis reports."""
    assert client.send("steps", 100).wait().report()["axis"]["steps done"] == "100"
    client.send("steps", 1).wait()
    ros.executor.remove_node(node)  # it is silent from now on
    other = ros.publisher(ros.node("other"), DiagnosticArray, "/diagnostics")
    late = DiagnosticArray(status=[DiagnosticStatus(hardware_id="other")])
    late.header.stamp.sec = 2**31 - 1
    other.publish(late)
    with pytest.raises(TimeoutError, match="does not report on /diagnostics"):
        client.report(timeout=0.3)


@pytest.mark.usefixtures("ros_domain")
def test_without_an_axis_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = io.StringIO()
    monkeypatch.setattr(screen, "isatty", lambda: True)
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setattr("stickslip_ros.base.reporting.terminal._PATIENCE", 0.5)
    with pytest.raises(TimeoutError, match=r"no axis answers at /lab/x: is axis_node running "):
        AxisClient("lab/x", timeout=1.3)
    assert screen.getvalue() == "waiting for /lab/x, 1.3 s at most ...\n"
    for name in ("", "lab/no name", "/1x", "x/"):
        with pytest.raises(ValueError, match=f"axis is '{name}'; give the full name of a node"):
            AxisClient(name, timeout=0.1)


def test_what_a_stranger_latched_does_not_hide_the_axis(ros: Ros, node: AxisNode) -> None:
    """A new client is sent the last message of every publisher, the stranger's after the axis's."""
    stranger, latched = ros.node("stranger"), ros.latched(10)
    for topic in 10 * ["/stickslip_axis/status", "/stickslip_axis/description"]:
        publisher = stranger.create_publisher(DiagnosticArray, topic, latched)
        publisher.publish(DiagnosticArray(status=[DiagnosticStatus(name="none of an axis")]))
    for number in range(5):
        with AxisClient(node=ros.node(f"user_{number}")) as client:
            assert client.send("steps", 1).wait().steps_done == 1


def test_no_answer_and_no_end_are_timeouts(ros: Ros, start_node: Start) -> None:
    process = start_node("axis_node")
    client = AxisClient(node=ros.node("user"), timeout=60.0)
    client.send("steps", 100_000)
    with pytest.raises(
        TimeoutError, match=r"axis is still stepping, \d+ steps done, \d+ left; it goes on \("
    ):
        client.wait(timeout=0.1)
    client.send("position", 1e-3)
    with pytest.raises(
        TimeoutError, match=r"is still targeting, [\d.]+ .m from the target; it goes on \("
    ):
        client.wait(timeout=0.1)
    client.timeout = 0.2
    with process.stopped():
        with pytest.raises(TimeoutError, match="/stickslip_axis does not answer steps 5"):
            client.send("steps", 5)
        with pytest.raises(TimeoutError, match="does not answer the call of stop"):
            client.send("stop")


class Late(AxisClient):
    """Hears events later than the status, as may happen: they are on topics of their own."""

    def _on_events(self, message: DiagnosticArray, stamp: int) -> None:
        def hear() -> None:
            with self._changed:
                AxisClient._on_events(self, message, stamp)

        threading.Timer(0.1, hear).start()


@pytest.mark.parametrize("kind", [AxisClient, Late])
def test_a_soft_limit_is_told_each_time(
    ros: Ros, make_axis: MakeAxis, kind: type[AxisClient], capfd: pytest.CaptureFixture[str]
) -> None:
    """One that ends a move at once has the stamp of the answer to the command."""
    make_axis(frequency=1000.0, soft_high=5e-6)
    client = kind(node=ros.node("user"))
    for steps in (400, 400, -16, 400):
        client.send("steps", steps).wait()
        hit = "soft_high" if steps > 0 else ""
        assert (client.ended_by, client.limits_hit) == (hit, [hit] if hit else [])
    assert re.search(r"\[WARN\].* soft_high was hit, at 49\d\d nm", capfd.readouterr().err)
    client.send("position", 2e-6).wait()
    began = time.monotonic()
    client.send("stop").wait()
    client.send("steps", 0).wait()
    assert time.monotonic() - began < 1.0, "no end is waited for where nothing moves"


def test_the_end_of_the_travel_is_told_each_time(ros: Ros, make_axis: MakeAxis) -> None:
    """Also by a move that ends before the supervisor looks."""
    make_axis(frequency=4000.0, travel_high=2e-6)
    client = AxisClient(node=ros.node("user"))
    for steps in (100, 8, 8, 8):
        assert client.send("steps", steps).wait().limits_hit == ["travel_high"]


def test_closing_leaves_the_axis_alone(ros: Ros, node: AxisNode) -> None:
    with AxisClient() as client:
        client.send("steps", 100_000)
        own = client.node
    client.close()
    for command in (lambda: client.send("stop"), lambda: client.send("steps", 1)):
        with pytest.raises(RuntimeError, match="is closed; make a new one"):
            command()
    assert not own.context.ok()
    assert node.axis.status.state == "stepping"
    user = ros.node("user")
    before = len(list(user.publishers))
    given = AxisClient(node=user)
    given.send("stop")
    given.close()
    assert len(list(user.publishers)) == before
    assert user.context.ok()


def test_a_program_may_end_without_closing(node: AxisNode) -> None:
    program = (
        "from stickslip_ros.ros.client import AxisClient\n"
        "print(AxisClient().send('steps', 5).steps_done)"
    )
    run = python("-c", program)
    assert (run.returncode, run.stderr) == (0, "")


def test_a_second_axis_of_the_same_name_is_told(
    ros: Ros, client: AxisClient, make_axis: MakeAxis
) -> None:
    """Its fault is taken for that of the first: their words cannot be told apart."""
    make_axis(max_velocity=1e-9)
    both = AxisClient(node=ros.node("second_user"), listeners=2)
    both.send("steps", 100_000).wait_for_state("fault")
    with pytest.raises(AxisFault, match="raise max_velocity; 2 nodes publish as /stickslip_ax"):
        both.wait()
    with pytest.raises(TimeoutError, match="2 nodes publish as /stickslip_axis and obey: end all"):
        both.wait_for_state("holding", timeout=0.1)
    client.send("stop")


def test_a_node_that_nobody_spins_is_told(ros: Ros, node: AxisNode) -> None:
    """It was told to publish /clock."""
    mine = Node("mine", context=ros.context)
    with pytest.raises(
        TimeoutError, match="nobody spins /mine, the node that the client was given"
    ):
        AxisClient(node=mine, timeout=0.5)
    assert AxisClient(node=ros.add(mine)).send("steps", 1).wait().steps_done == 1
