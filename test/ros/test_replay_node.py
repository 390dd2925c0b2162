# SPDX-License-Identifier: Apache-2.0
"""Bags are played by a real process over DDS: all messages, in order, as they were offered.

What is due when is held against a clock of ours.
"""

import itertools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from live import Ros, Start
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Int32

from stickslip_ros.recordings import BagWriter, OfferedQos, TopicDescription
from stickslip_ros.recordings.schemas import schema_text
from stickslip_ros.ros.nodes.messages import message_definition
from stickslip_ros.ros.nodes.replay_node import main, offered_qos

START_NS = 1_700_000_000_000_000_000
STEP_NS = 5_000_000
COUNT = 200


@pytest.fixture
def bag(tmp_path: Path) -> Iterator[Path]:
    """A second of two topics, 200 messages each, one of them offered as well as it can."""
    qos = {"/joint_states": OfferedQos(), "/numbers": OfferedQos(reliability="best_effort")}
    kinds = {"/joint_states": "sensor_msgs/msg/JointState", "/numbers": "std_msgs/msg/Int32"}
    with BagWriter(tmp_path / "bag") as writer:
        for name, kind in kinds.items():
            schema = schema_text(kind, message_definition)
            writer.add_topic(TopicDescription(name, kind, schema, offered_qos=(qos[name],)))
        for i in range(COUNT):
            state = JointState(name=["slider"], position=[1e-9 * i], velocity=[0.0], effort=[0.0])
            for topic, message in (("/joint_states", state), ("/numbers", Int32(data=i))):
                ns = START_NS + i * STEP_NS
                data = serialize_message(message)
                writer.write(topic, data, log_ns=ns, publish_ns=ns, sequence=i + 1)
    yield tmp_path / "bag"


class Heard:
    """Everything that comes on some topics, in order."""

    def __init__(self, ros: Ros, **topics: type[Any]) -> None:
        self.all: list[tuple[str, Any]] = []
        node = ros.node("listener")
        for name, kind in topics.items():
            reliable = name == "joint_states"  # the others are offered as best they can
            how = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
            qos = QoSProfile(depth=1000, reliability=how)
            node.create_subscription(kind, f"/{name}", self._note(name), qos)

    def _note(self, name: str) -> Callable[[Any], None]:
        return lambda message: self.all.append((name, message))

    def of(self, name: str) -> list[Any]:
        return [message for topic, message in self.all if topic == name]


def test_a_part_under_another_name_with_a_clock(ros: Ros, start_module: Start, bag: Path) -> None:
    """From the command line, whose options are the node's parameters."""
    heard = Heard(ros, renamed=JointState, clock=Clock, numbers=Int32)
    player = start_module(
        "stickslip_ros.cli.main",
        *("bag", "play", "bag", "--start", "0.5", "--duration", "0.25", "--clock", "100"),
        *("--topics", "/joint_states", "--remap", "/joint_states:=/renamed"),
    )
    assert player.wait() == 0
    ros.wait_until(lambda: len(heard.of("renamed")) == 50, "a quarter of a second")
    assert heard.of("renamed")[0].position[0] == 1e-9 * 100
    assert not heard.of("numbers")
    stamps = [1_000_000_000 * m.clock.sec + m.clock.nanosec for m in heard.of("clock")]
    assert stamps[0] == START_NS + 500_000_000
    assert stamps == sorted(stamps)
    assert {b - a for a, b in itertools.pairwise(stamps)} == {10_000_000}


def test_a_loop_goes_on_until_told_to_end(ros: Ros, start_node: Start, bag: Path) -> None:
    heard = Heard(ros, joint_states=JointState, numbers=Int32)
    player = start_node("replay_node", bag="bag", rate=5.0, loop=True)
    ros.wait_until(lambda: len(heard.of("joint_states")) > 2 * COUNT + 10, "the third round")
    ros.wait_until(lambda: heard.of("numbers"), "what is offered as best it can")
    assert player.interrupt() == 0
    positions = [m.position[0] for m in heard.of("joint_states")]
    once = [1e-9 * i for i in range(COUNT)]
    assert positions[: 2 * COUNT] == [*once, *once]


def test_what_is_kept_for_late_subscribers_comes_first_and_no_time_is_no_wait(
    ros: Ros, start_node: Start, tmp_path: Path
) -> None:
    """The model of a robot stands at the begin of a bag, or has no stamp at all.

    Of the others, what has none is left out: a player waited 55 years for what came next.
    """
    kept = OfferedQos(durability="transient_local", depth=1)
    with BagWriter(tmp_path / "bag") as writer:
        for name, qos in (("/model", kept), ("/numbers", OfferedQos())):
            schema = schema_text("std_msgs/msg/Int32", message_definition)
            about = TopicDescription(name, "std_msgs/msg/Int32", schema, offered_qos=(qos,))
            writer.add_topic(about)
        for name, value, ns in (
            ("/model", 1, 0),
            ("/numbers", 2, 0),
            ("/model", 3, START_NS),
            ("/numbers", 4, START_NS),
            ("/numbers", 5, START_NS + 10**9),
        ):
            data = serialize_message(Int32(data=value))
            writer.write(name, data, log_ns=ns, publish_ns=ns)
    heard = Heard(ros, model=Int32, numbers=Int32)
    whole = start_node("replay_node", bag="bag")
    assert whole.wait() == 0
    ros.wait_until(lambda: len(heard.all) == 4, "all of it")
    assert [one.data for one in heard.of("model")] == [1, 3]
    assert [one.data for one in heard.of("numbers")] == [4, 5]
    assert "2 messages are up to 1 " in whole.output and "left out" in whole.output
    heard.all.clear()
    part = start_node("replay_node", bag="bag", start=0.5)
    assert part.wait() == 0
    ros.wait_until(lambda: len(heard.all) == 2, "the rest, and the model before it")
    assert [(topic, one.data) for topic, one in heard.all] == [("model", 3), ("numbers", 5)]


@pytest.mark.usefixtures("ros_domain")
def test_topics_without_a_valid_name_are_left_out_and_named(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """One of them ended the player with an exception, and its name reached the terminal."""
    schema = schema_text("std_msgs/msg/Int32", message_definition)
    with BagWriter(tmp_path / "bag") as writer:
        for name in ("/numbers", "/a\x1b[2J b"):
            writer.add_topic(TopicDescription(name, "std_msgs/msg/Int32", schema))
            data = serialize_message(Int32(data=1))
            writer.write(name, data, log_ns=START_NS, publish_ns=START_NS)
    assert main(["replay_node", "--ros-args", "-p", f"bag:={tmp_path / 'bag'}"]) == 0
    said = capfd.readouterr().err
    assert "not playing /a\\x1b[2J b: " in said and "\x1b[2J" not in said
    assert "played 1 messages" in said


@pytest.mark.usefixtures("ros_domain")
@pytest.mark.parametrize(
    ("parameters", "complaint"),
    [
        ("", "parameter bag is empty"),
        ("bag:=nowhere", "there is no bag"),
        ("bag:=bag rate:=0.0", "parameter rate is 0; it has to lie between 0.001 and 1e+06"),
        ("bag:=bag start:=3", "the bag is 0.995 s long; start earlier"),
        ("bag:=bag topics:=[/none]", "no topic /none in the bag; it has /joint_states"),
        ("bag:=bag sped:=1.0", "unknown parameter 'sped'"),
    ],
)
def test_bad_use_is_one_line(
    bag: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    parameters: str,
    complaint: str,
) -> None:
    monkeypatch.chdir(bag.parent)
    given = [word for one in parameters.split() for word in ("-p", one)]
    assert main(["replay_node", "--ros-args", *given]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith("replay_node: ")
    assert complaint in line


@pytest.mark.usefixtures("ros_domain")
def test_a_bag_that_breaks_off_ends_with_an_error(
    bag: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    file = bag / "bag_0.mcap"
    content = bytearray(file.read_bytes())
    content[2000:2100] = bytes(100)
    file.write_bytes(content)
    given = [word for one in (f"bag:={bag}", "rate:=100.0") for word in ("-p", one)]
    assert main(["replay_node", "--ros-args", *given]) in (1, 2)
    assert "bag_0.mcap" in capfd.readouterr().err.splitlines()[-1]


def test_a_stand_in_promises_what_all_offered() -> None:
    reliable, other = OfferedQos(), OfferedQos(reliability="best_effort")
    latched = OfferedQos(durability="transient_local")
    assert offered_qos([reliable, other]).reliability == ReliabilityPolicy.BEST_EFFORT
    assert offered_qos([latched]).durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert offered_qos([latched, reliable]).durability == DurabilityPolicy.VOLATILE
    assert offered_qos([]).durability == DurabilityPolicy.VOLATILE
