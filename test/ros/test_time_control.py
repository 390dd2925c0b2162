# SPDX-License-Identifier: Apache-2.0
"""Time under control: pauses, steps, paces while the axis runs, and somebody else's clock."""

import time

import pytest
from heard import Heard, stamp
from live import MakeAxis, Ros, Start
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool

from stickslip_ros.base.priority import request_priority
from stickslip_ros.recordings.schemas import nanoseconds
from stickslip_ros.ros.client import AxisClient, CommandRefused
from stickslip_ros.ros.nodes.axis_host import axis_or_host
from stickslip_ros.ros.nodes.messages import stamp as time_message


def test_a_paused_axis_takes_commands_and_moves_with_the_steps_of_time(
    ros: Ros, make_axis: MakeAxis
) -> None:
    make_axis(frequency=1000.0, start_paused=True)
    client = AxisClient(node=ros.node("user"))
    assert client.status["paused"] == "True"
    begin = client.send("steps", 10).stamp
    time.sleep(0.1)
    assert (client.stamp - begin) < 1e-6
    client.go_on(cycles=5)
    assert client.stamp - begin == pytest.approx(5e-3, abs=1e-6)
    assert client.go_on(0.0025).stamp - begin == pytest.approx(7.5e-3, abs=1e-6)
    assert client.state == "stepping"
    client.send("pause", False).wait()
    assert (client.steps_done, client.status["paused"]) == (10, "False")
    with pytest.raises(CommandRefused, match=r"step_time is 0.1 while time runs: pause first"):
        client.go_on(0.1)


def test_its_clock_stands_and_steps_with_it(ros: Ros, make_axis: MakeAxis) -> None:
    make_axis(publish_clock=True)
    heard = ros.hear(Clock, "/clock")
    client = AxisClient(node=ros.node("user")).send("pause")
    ros.wait_until(lambda: len(heard) > 2, "a clock")
    client.go_on(2.0)
    end = client.stamp - 1e-6
    ros.wait_until(lambda: 1e-9 * nanoseconds(heard[-1].clock) >= end, "the clock of the end")
    clock = [nanoseconds(one.clock) for one in heard]
    assert clock == sorted(clock)


def test_one_axis_of_several_leads_the_time_of_all_and_the_host_too(ros: Ros) -> None:
    overrides = [Parameter("axes", value=["x", "y"]), Parameter("frequency", value=1000.0)]
    host = axis_or_host(context=ros.context, parameter_overrides=overrides)
    for node in host.nodes:
        ros.add(node)
    user = ros.node("user")
    x, y = AxisClient("/x", node=user), AxisClient("/y", node=user)
    x.send("pause")
    ros.wait_until(lambda: y.status["paused"] == "True", "y stands, too")
    y.send("steps", 5)
    x.go_on(0.1)
    y.wait()
    assert y.steps_done == 5
    answer = ros.call(user, SetBool, "/stickslip_axis/pause", SetBool.Request(data=False))
    assert answer.success
    assert host.nodes[2].axis.paused is False  # type: ignore[attr-defined]

    def set_at_host(name: str, value: float) -> str:
        change = Parameter(name, value=value).to_parameter_msg()
        request = SetParameters.Request(parameters=[change])
        answer = ros.call(user, SetParameters, "/stickslip_axis/set_parameters", request)
        return str(answer.results[0].reason)

    assert set_at_host("real_time_factor", 3.0) == ""
    factors = [node.get_parameter("real_time_factor").value for node in host.nodes]
    assert factors == [3.0, 3.0, 3.0]
    y.set_parameters(real_time_factor=2.0)
    assert host.nodes[0].get_parameter("real_time_factor").value == 2.0
    assert "set it at the axes, as /x" in set_at_host("preload", 1.0)
    assert "while time runs: pause first" in set_at_host("step_time", 1.0)


class Leader:
    """Somebody else who leads the time."""

    def __init__(self, ros: Ros) -> None:
        self.ros, self.publisher = ros, ros.publisher(ros.node("leader"), Clock, "/clock")

    def set(self, seconds: float) -> None:
        self.ros.send(self.publisher, Clock(clock=time_message(round(seconds * 1e9))))


def test_it_follows_the_clock_of_somebody_else_with_stops_and_jumps(
    ros: Ros, make_axis: MakeAxis
) -> None:
    node = make_axis(use_sim_time=True, frequency=1000.0)
    leader = Leader(ros)
    leader.set(100.0)
    heard = Heard(ros)
    client = AxisClient(node=ros.node("user"))
    assert client.stamp == 100.0
    client.send("steps", 500)
    time.sleep(0.1)
    assert client.stamp - 100.0 < 1e-6  # it stands with the clock
    leader.set(100.1)
    ros.wait_until(lambda: client.stamp >= 100.1, "a tenth of a second later")
    assert client.stamp - 100.1 < 1e-6
    assert client.moving
    leader.set(160.0)
    ros.wait_until(lambda: client.stamp >= 160.0, "a jump of a minute")
    assert client.wait().steps_done == 500
    leader.set(20.0)
    ros.wait_until(lambda: node.get_clock().now().nanoseconds == 20 * 10**9, "it has heard")
    time.sleep(0.1)  # and looked
    leader.set(21.0)
    ros.wait_until(lambda: client.stamp >= 161.0 - 1e-6, "a second after the clock was set back")
    with pytest.raises(CommandRefused, match="steer whoever publishes the clock"):
        client.send("pause")
    with pytest.raises(CommandRefused, match="steer whoever publishes the clock"):
        client.set_parameters(real_time_factor=2.0)
    assert not node.axis.paused
    assert heard.compare_with_rerun() > 3
    assert stamp(heard.joints[0]) == 100 * 10**9


@pytest.mark.long
def test_the_process_paces_and_pauses(ros: Ros, start_node: Start) -> None:
    """With the executor of events, whose timers are others, and a priority if it may have one."""
    assert request_priority(0) == "off"
    process = start_node("axis_node", frequency=1000.0, start_paused="true", real_time_priority=5)
    process.wait_for("ready")
    client = AxisClient(node=ros.node("user"))
    begin = client.stamp
    assert client.go_on(0.5).stamp - begin == pytest.approx(0.5, abs=1e-6)
    client.set_parameters(real_time_factor=0.0).send("pause", False)
    ros.wait_until(lambda: client.stamp > begin + 5.0, "as fast as it can")
    client.set_parameters(real_time_factor=1.0).send("pause")
    assert client.go_on(cycles=100).stamp > begin + 5.1
    client.send("pause", False).send("steps", 3).wait()
    said = client.report()["timing"]["real-time priority"]
    assert said.startswith(("granted: SCHED_FIFO 5", "refused: "))
    assert f"real-time priority {said}" in process.output
    assert process.interrupt() == 0
