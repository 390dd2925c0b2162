# SPDX-License-Identifier: Apache-2.0
"""The commander: sends a move, waits for its end, says why there is none."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from conftest import Ros

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from std_msgs.msg import Float64

from stickslip_ros.analysis import run_steps
from stickslip_ros.nodes.axis_node import AxisNode
from stickslip_ros.nodes.commander import Commander, Move
from stickslip_ros.parameters import check

pytestmark = pytest.mark.usefixtures("compiled_solver")


@pytest.fixture
def commander(ros: Ros) -> Iterator[Commander]:
    node = Commander(context=ros.context)
    yield node
    node.destroy_node()


@pytest.fixture
def axis(ros: Ros) -> AxisNode:
    node = AxisNode(context=ros.context)
    ros.add(node)
    return node


def test_moves_are_carried_out_one_after_the_other(axis: AxisNode, commander: Commander) -> None:
    """Each has ended when the next is sent, and each ends where it does without ROS."""
    commander.wait_for_axis()
    commander.carry_out(Move(300.0, 2000.0, 100))
    assert axis.axis.status.steps_done == 100
    commander.carry_out(Move(150.0, 1000.0, -20))
    assert axis.axis.status.steps_done == -20
    status = axis.axis.status
    assert (status.amplitude, status.frequency, status.refused) == (150.0, 1000.0, 0)
    run = run_steps(check({"amplitude": 150.0, "frequency": 1000.0}), -20)
    assert status.mean_step == pytest.approx(run.position[-1] / 20, rel=0.02)


def test_the_report_on_a_move_comes_after_its_end(
    ros: Ros, axis: AxisNode, commander: Commander
) -> None:
    """What was reported before is not taken for it, nor what another axis reports."""
    heard: list[DiagnosticArray] = []
    listener = ros.node()
    listener.create_subscription(DiagnosticArray, "/diagnostics", heard.append, 10)
    commander.wait_for_axis()
    commander.wait_for_report()
    commander.carry_out(Move(300.0, 2000.0, 100))
    commander.wait_for_report()
    ros.wait_until(lambda: any(_steps_done(message) == 100 for message in heard), "the report")
    ros.executor.remove_node(axis)  # it is silent from now on
    other = ros.publisher(listener, DiagnosticArray, "/diagnostics")
    late = DiagnosticArray(status=[DiagnosticStatus(hardware_id="other")])
    late.header.stamp.sec = 2**31 - 1
    other.publish(late)
    commander._ended = commander._reported
    with pytest.raises(TimeoutError, match="does not report on /diagnostics"):
        commander.wait_for_report(timeout=0.3)


def _steps_done(message: DiagnosticArray) -> int:
    (status,) = (s for s in message.status if s.name == "stickslip_axis: axis")
    return int({pair.key: pair.value for pair in status.values}["steps done"])


def test_a_refusal_is_raised_with_its_reason(axis: AxisNode, commander: Commander) -> None:
    commander.wait_for_axis()
    with pytest.raises(ValueError, match=r"amplitude refused: amplitude is 301 V; .* 300 V"):
        commander.carry_out(Move(301.0, 1000.0, 10))
    assert not axis.axis.moving
    commander.carry_out(Move(300.0, 1000.0, 10))
    assert axis.axis.status.steps_done == 10


def test_without_an_axis_it_says_so(commander: Commander) -> None:
    with pytest.raises(TimeoutError, match="no axis answers: is axis_node running"):
        commander.wait_for_axis(timeout=0.1)


def test_no_answer_is_a_timeout_that_names_the_move(ros: Ros, commander: Commander) -> None:
    """Somebody listens to the commands but is no axis."""
    node = ros.node()
    node.create_subscription(Float64, "/stickslip_axis/command/amplitude", lambda _: None, 10)
    with pytest.raises(TimeoutError, match=r"no 'amplitude applied': Move\(amplitude=42"):
        commander.carry_out(Move(42.0, 1.0, 1), timeout=0.1)
