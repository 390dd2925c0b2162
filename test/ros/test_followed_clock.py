# SPDX-License-Identifier: Apache-2.0
"""Every node with ``use_sim_time``: without a clock, with a good one, with one that is set."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from heard import stamp
from live import Ros
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64, Int32
from table_1 import TABLE_1

from stickslip_ros.base.errors import StickslipError, UsageError
from stickslip_ros.client import AxisClient
from stickslip_ros.recordings import BagWriter, TopicDescription
from stickslip_ros.recordings.schemas import schema_text
from stickslip_ros.ros.nodes.axis_host import axis_or_host
from stickslip_ros.ros.nodes.axis_node import AxisNode
from stickslip_ros.ros.nodes.guarded_node import follows
from stickslip_ros.ros.nodes.messages import message_definition
from stickslip_ros.ros.nodes.process import Runnable
from stickslip_ros.ros.nodes.recorder_node import RecorderNode
from stickslip_ros.ros.nodes.replay_node import ReplayNode
from stickslip_ros.ros.nodes.replay_node import main as replay
from stickslip_ros.ros.nodes.twin_node import TwinNode

NONE_YET = "waits for the first message on /clock"
#: s and ns: below 0, the start, on, far too many ns, back, far ahead, back to 0, ahead once more
READINGS = (
    (-5, 0), (-(2**31), 7), (0, 0), (10, 0), (10, 2**32 - 1), (11, 0), (5, 0), (2**31 - 1, 0),
    (0, 0), (2**31 - 1, 2**32 - 1), (7, 0), (-7, 0), (8, 0),
)  # fmt: skip


class Leader:
    """Whoever publishes the clock."""

    def __init__(self, ros: Ros) -> None:
        self.publisher = ros.node("leader").create_publisher(Clock, "/clock", 10)

    def show(self, seconds: int, ns: int, nodes: list[Node]) -> None:
        """Publish a time until all have it, where they can take it at all."""
        reading = Time(sec=seconds, nanosec=ns)
        for _ in range(1000):
            self.publisher.publish(Clock(clock=reading))
            time.sleep(0.01)
            wanted = seconds * 10**9 + ns
            if wanted < 0 or all(one.get_clock().now().nanoseconds == wanted for one in nodes):
                return
        pytest.fail(f"nobody took {seconds} s")


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """A bag of ten numbers, a second apart."""
    with BagWriter(tmp_path / "bag") as writer:
        kind = "std_msgs/msg/Int32"
        writer.add_topic(TopicDescription("/numbers", kind, schema_text(kind, message_definition)))
        for i in range(10):
            data, ns = serialize_message(Int32(data=i)), (1_700_000_000 + i) * 10**9
            writer.write("/numbers", data, log_ns=ns, publish_ns=ns, sequence=i + 1)
    return tmp_path / "bag"


@pytest.fixture
def make(ros: Ros, bag: Path) -> Callable[..., Runnable]:
    """Give a function that makes a node of a kind with use_sim_time and spins it."""
    kinds: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
        "axis": (lambda **o: axis_or_host([], **o), TABLE_1),
        "axes": (lambda **o: axis_or_host([], **o), {**TABLE_1, "axes": ["x", "y"]}),
        "recorder": (RecorderNode, {"output": str(bag.parent / "new")}),
        "replay": (ReplayNode, {"bag": str(bag)}),
        "twin": (TwinNode, {}),
    }

    def made(kind: str, **more: Any) -> Runnable:
        cls, given = kinds[kind]
        values = {"use_sim_time": True, **given, **more}
        overrides = [Parameter(name, value=value) for name, value in values.items()]
        node: Runnable = cls(context=ros.context, parameter_overrides=overrides)
        for one in node.nodes:
            ros.add(one)
        return node

    return made


@pytest.mark.parametrize("kind", ["axis", "axes", "recorder", "replay", "twin"])
def test_no_clock_and_any_clock_do_no_harm(
    kind: str, ros: Ros, make: Callable[..., Runnable], capfd: pytest.CaptureFixture[str]
) -> None:
    user = ros.node("user")
    user.create_subscription(Int32, "/numbers", lambda _: None, 10)  # a player waits for some
    node = make(kind)
    said = ""

    def hears(text: str) -> bool:
        nonlocal said
        said += capfd.readouterr().err
        return text in said

    ros.wait_until(lambda: hears(NONE_YET), "that there is no clock yet")
    leader = Leader(ros)
    sent = [
        (user.create_publisher(Int32, f"{name}/command/steps", 10), Int32(data=3))
        for name in ("", "/stickslip_axis", "/x")
    ]
    sent.append((user.create_publisher(Float64, "/measured_position", 10), Float64(data=1e-6)))
    nodes = list(node.nodes)
    ros.wait_until(lambda: leader.publisher.get_subscription_count() == len(nodes), "listeners")
    for reading in READINGS:
        leader.show(*reading, nodes)
        for publisher, message in sent:
            publisher.publish(message)
        time.sleep(0.03)
    assert [one.failures for one in nodes] == [0] * len(nodes)  # type: ignore[attr-defined]
    node.close()
    hears("")
    assert "/clock says -5 s, which is passed over" in said
    assert "report it" not in said
    assert said.count(NONE_YET) == 1


def test_a_bag_is_played_by_the_clock(ros: Ros, make: Callable[..., Runnable]) -> None:
    heard = ros.hear(Int32, "/numbers")
    player = make("replay")
    leader = Leader(ros)
    nodes = list(player.nodes)
    leader.show(100, 0, nodes)
    ros.wait_until(lambda: heard, "the first message")
    leader.show(103, 500_000_000, nodes)
    ros.wait_until(lambda: len(heard) >= 4, "three seconds later")
    time.sleep(0.1)
    assert [one.data for one in heard] == [0, 1, 2, 3], "it stands with the clock"
    leader.show(110, 0, nodes)
    ros.wait_until(player.finished.done, "the end")
    ros.wait_until(lambda: [one.data for one in heard] == list(range(10)), "all")


def test_what_a_twin_hears_without_a_stamp_is_of_the_time_of_the_clock(
    ros: Ros, make: Callable[..., Runnable]
) -> None:
    twin = make("twin")
    assert isinstance(twin, TwinNode)
    leader, user = Leader(ros), ros.node("user")
    position = ros.publisher(user, Float64, "/measured_position")
    heard = ros.hear(DiagnosticArray, "/stickslip_twin/estimates")
    ros.send(position, Float64(data=1e-6))
    nodes = list(twin.nodes)
    for seconds in (50, 51):
        leader.show(seconds, 0, nodes)
        ros.send(position, Float64(data=1e-6))
        ros.wait_until(lambda: twin._waiting, "the reading, before the clock goes on")
    ros.wait_until(
        lambda: 50 * 10**9 in map(stamp, heard), "the time of the reading, not that before any time"
    )
    assert not twin.twin.troubles["gaps"]


def test_two_clocks_at_once_are_refused(make: Callable[..., Runnable], bag: Path) -> None:
    with pytest.raises(UsageError, match="lets /clock lead the time, and this would publish it"):
        make("replay", clock=100.0)
    for more in ({"publish_clock": True}, {"real_time_factor": 2.0}, {"start_paused": True}):
        for kind in ("axis", "axes"):
            with pytest.raises(StickslipError, match="leave out publish_clock, real_time_factor"):
                make(kind, **more)
    with pytest.raises(UsageError, match="use_sim_time is 1; it has to be true or false"):
        make("recorder", use_sim_time=1)


def test_an_axis_does_not_pass_over_its_own_wish(ros: Ros, tmp_path: Path) -> None:
    file = tmp_path / "one.yaml"
    file.write_text("x:\n  ros__parameters:\n    use_sim_time: true\n")
    overrides = [Parameter("axes", value=["x", "y"])]
    line = ["--ros-args", "--params-file", str(file)]
    with pytest.raises(StickslipError, match="use_sim_time is true for x alone"):
        axis_or_host(line, context=ros.context, cli_args=line, parameter_overrides=overrides)


def test_the_clock_is_chosen_at_the_start(ros: Ros, make: Callable[..., Runnable]) -> None:
    for kind in ("axis", "twin"):
        (result,) = make(kind).nodes[0].set_parameters([Parameter("use_sim_time", value=False)])
        assert result.reason == "use_sim_time can be set at the start only"


@pytest.mark.parametrize("form", ["-p", "--params-file"])
def test_one_axis_takes_it_from_its_command_line(form: str, ros: Ros, tmp_path: Path) -> None:
    file = tmp_path / "sim.yaml"
    (tmp_path / "wave.csv").write_text("0\n1\n0\n")
    file.write_text(
        "/**:\n  ros__parameters:\n    use_sim_time: true\n    waveform_table: wave.csv\n"
    )
    value = "use_sim_time:=true" if form == "-p" else str(file)
    line = ["--ros-args", form, value]
    (axis,) = axis_or_host(line, context=ros.context, cli_args=line).nodes
    assert follows(axis)
    assert isinstance(axis, AxisNode)
    # A file that a file names lies beside it, wherever the node is started.
    table = str(tmp_path / "wave.csv") if form == "--params-file" else None
    assert axis.axis.parameters.drive.waveform_table == table


def test_a_player_says_in_one_line_that_clocks_contradict(
    bag: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    line = ["replay_node", "--ros-args", "-p", f"bag:={bag}", "-p", "clock:=10.0"]
    assert replay([*line, "-p", "use_sim_time:=true"]) == 2
    assert len(capfd.readouterr().err.splitlines()) == 1


def test_a_client_of_an_axis_without_a_clock_is_told_of_it(
    ros: Ros, make: Callable[..., Runnable]
) -> None:
    make("axis")
    with pytest.raises(TimeoutError, match="says nothing before the first /clock"):
        AxisClient(node=ros.node("user"), timeout=3.0)
