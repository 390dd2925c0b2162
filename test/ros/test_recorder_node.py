# SPDX-License-Identifier: Apache-2.0
"""The recorder as a real process over DDS; its bags are read with ``rosbags``."""

from __future__ import annotations

import signal
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from heard import values
from live import MakeAxis, Ros, Start
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.interfaces import ConnectionExtRosbag2, QosDurability, QosReliability
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

if TYPE_CHECKING:
    pass


from diagnostic_msgs.msg import DiagnosticArray
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Int32
from std_srvs.srv import Trigger

from stickslip_ros.recordings import open_bag, recorded_runs
from stickslip_ros.ros.nodes.recorder_node import SERVICE_QOS, main
from stickslip_ros.ros.nodes.recording import LossCount, RecordedTopic, axis_topics, request_qos


def _values(folder: Path, topic: str) -> list[Any]:
    with AnyReader([folder]) as reader:
        messages: list[Any] = [
            reader.deserialize(data, connection.msgtype)
            for connection, _, data in reader.messages()
            if connection.topic == topic
        ]
    return [message.data for message in messages]


def _counts(folder: Path) -> dict[str, int]:
    with Reader(folder) as bag:
        return {connection.topic: connection.msgcount for connection in bag.connections}


def _joint_state(number: int) -> JointState:
    message = JointState(name=["slider"], position=[1.0], velocity=[2.0], effort=[3.0])
    message.header.stamp.sec = number
    return message


@pytest.mark.parametrize(
    "number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long)]
)
def test_every_message_is_in_the_bag_after_a_signal(
    ros: Ros, start_node: Start, tmp_path: Path, number: signal.Signals
) -> None:
    """Both signals come at once after the last message, which is on its way then."""
    recorder = start_node("recorder_node", output="run", axis="/stage/stickslip_axis")
    axis = ros.node("stickslip_axis", namespace="/stage")
    states = ros.publisher(axis, JointState, "joint_states", 100)
    steps = ros.publisher(axis, Int32, "~/command/steps")
    recorder.wait_for("recording all topics of /stage/stickslip_axis to")
    extra = axis.create_publisher(Float64, "~/command/later", 10)
    recorder.wait_for("recording /stage/stickslip_axis/command/later")
    ros.wait_until(extra.get_subscription_count)
    for i in range(500):
        states.publish(_joint_state(i))
    steps.publish(Int32(data=-200))
    extra.publish(Float64(data=0.5))
    for publisher in (states, steps, extra):
        assert publisher.wait_for_all_acked(Duration(seconds=10))
    assert (recorder.interrupt if number == signal.SIGINT else recorder.terminate)() == 0

    folder = tmp_path / "run"
    expected = dict.fromkeys(axis_topics("/stage/stickslip_axis"), 0) | {
        "/stage/joint_states": 500,
        "/stage/stickslip_axis/command/steps": 1,
        "/stage/stickslip_axis/command/later": 1,
    }
    counts = _counts(folder)
    for topics in (counts, expected):
        del topics["/diagnostics"]  # its own, once a second
    assert counts == expected
    assert _values(folder, "/stage/stickslip_axis/command/steps") == [-200]
    with (folder / "run_0.mcap").open("rb") as stream:
        messages = list(make_reader(stream, validate_crcs=True).iter_messages())
        found = Counter(channel.topic for _, channel, _ in messages)
    found.pop("/diagnostics", None)
    assert found == {topic: n for topic, n in expected.items() if n}
    numbers = [m.sequence for _, c, m in messages if c.topic == "/stage/joint_states"]
    assert numbers == list(range(1, 501))
    assert all(0 < m.publish_time <= m.log_time for _, _, m in messages)
    store = get_typestore(Stores.ROS2_JAZZY)
    with Reader(folder) as bag:
        for connection in bag.connections:
            assert connection.digest == store.hash_rihs01(connection.msgtype)
        assert bag.ros_distro == "jazzy"
    said = recorder.output
    assert said.count("recording all topics of /stage/stickslip_axis to") == 1
    assert "/stage/joint_states 500" in said
    assert "lost 0, sent before joining 0" in said


def test_stop_service_closes_the_bag_before_it_answers(
    ros: Ros, start_node: Start, tmp_path: Path
) -> None:
    recorder = start_node("recorder_node", output="deep/run", topics="[/numbers]")
    node = ros.node()
    numbers = ros.publisher(node, Int32, "/numbers")
    ros.send(numbers, *(Int32(data=i) for i in range(10)))
    answer = ros.call(node, Trigger, "/stickslip_recorder/stop", Trigger.Request())
    folder = tmp_path / "deep" / "run"
    assert _values(folder, "/numbers") == list(range(10))
    assert answer.success
    assert answer.message == f"{folder}: 10 messages"
    assert recorder.wait() == 0
    assert _counts(folder) == {"/numbers": 10}


@pytest.mark.parametrize(
    ("wait", "calls"),
    [
        (True, 200),
        pytest.param(False, 200, marks=pytest.mark.long),
        pytest.param(False, 2000, marks=pytest.mark.long),
    ],
)
def test_many_calls_at_once_are_all_answered(
    ros: Ros, start_node: Start, tmp_path: Path, wait: bool, calls: int
) -> None:
    recorder = start_node("recorder_node", output="run", topics="[/numbers]", wait=wait)
    node = ros.node()
    client = node.create_client(Trigger, "/stickslip_recorder/stop", qos_profile=SERVICE_QOS)
    ros.wait_until(client.service_is_ready, "the service")
    if wait:
        ros.call(node, Trigger, "/stickslip_recorder/start", Trigger.Request())
    answers = [client.call_async(Trigger.Request()) for _ in range(calls)]
    ros.wait_until(lambda: all(answer.done() for answer in answers), "all answers")
    said = {answer.result().message for answer in answers}
    assert said == {f"{tmp_path / 'run'}: 0 messages"}
    assert (recorder.terminate() if wait else recorder.wait()) == 0


def test_the_subscription_follows_the_publishers(
    ros: Ros, start_node: Start, tmp_path: Path
) -> None:
    """A latched message from before the start, then a publisher that only does its best."""
    node = ros.node()
    early = node.create_publisher(Int32, "/latched", ros.latched(5))
    early.publish(Int32(data=1))
    recorder = start_node("recorder_node", output="run", topics="[/latched, /joint_states]")
    ros.wait_until(early.get_subscription_count)
    best_effort = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
    states = ros.publisher(node, JointState, "/joint_states", best_effort)
    reports = ros.hear(DiagnosticArray, "/diagnostics")

    def reported() -> int:
        return int(values(reports[-1].status[0])["messages"]) if reports else 0

    def both_are_recorded() -> bool:
        # What nobody confirms may be lost as long as the recorder does not know the publisher.
        states.publish(_joint_state(1))
        return reported() > 1

    ros.wait_until(reported, "the latched message")
    ros.wait_until(both_are_recorded, "a message of both topics")
    ros.call(node, Trigger, "/stickslip_recorder/stop", Trigger.Request())
    assert recorder.wait() == 0
    counts = _counts(tmp_path / "run")
    assert counts["/latched"] == 1
    assert counts["/joint_states"] > 0
    with Reader(tmp_path / "run") as bag:
        qos = {
            connection.topic: connection.ext.offered_qos_profiles
            for connection in bag.connections
            if isinstance(connection.ext, ConnectionExtRosbag2)
        }
    assert [q.durability for q in qos["/latched"]] == [QosDurability.TRANSIENT_LOCAL]
    assert [q.reliability for q in qos["/joint_states"]] == [QosReliability.BEST_EFFORT]


@pytest.mark.usefixtures("ros_domain")
@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ("output:=there", "there exists already; name another one"),
        ("output:=file/run", "file/run: Not a directory; make its folder first"),
        ("outptu:=run", "unknown parameter 'outptu'; did you mean output?"),
        ("output:=run axis:=/a//b", "'/a//b' is not a valid name"),
        ("output:=run topics:=3", "parameter topics is 3; give a list of names"),
        ("output:=run regex:=(", "parameter regex: '(' is not a regular expression"),
        ("output:=run compression:=zip", "it has to be one of none, lz4, zstd"),
        (
            "output:=run max_size:=-1.0",
            "max_size is -1 MB; it has to lie between 0.05 and 1e+09 MB, or be 0 for never",
        ),
        ("bag_folder", "unknown argument 'bag_folder'"),
    ],
)
def test_bad_use_is_one_line_and_leaves_nothing(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    arguments: str,
    complaint: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there").mkdir()
    (tmp_path / "file").write_text("")
    before = {path.name for path in tmp_path.iterdir()} | {"ros_log"}
    given = [word for one in arguments.split() for word in ("-p", one)]
    line = ["--ros-args", *given] if ":=" in arguments else [arguments]
    assert main(["recorder_node", *line]) == 2
    (said,) = capfd.readouterr().err.splitlines()
    assert said.startswith("recorder_node: ")
    assert complaint in said
    assert {path.name for path in tmp_path.iterdir()} <= before
    assert list((tmp_path / "there").iterdir()) == []


def test_the_request_is_what_all_publishers_meet() -> None:
    reliable = QoSProfile(depth=1)
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    assert request_qos([]).reliability == ReliabilityPolicy.RELIABLE
    assert request_qos([]).durability == DurabilityPolicy.VOLATILE
    assert request_qos([reliable, best_effort]).reliability == ReliabilityPolicy.BEST_EFFORT
    assert request_qos([reliable, latched]).durability == DurabilityPolicy.VOLATILE
    assert request_qos([latched, latched]).durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert request_qos([reliable]).depth >= 10_000  # a machine that is busy for seconds at 1 kHz


def test_several_publishers_are_not_looked_for_with_each_message(
    ros: Ros, monkeypatch: pytest.MonkeyPatch
) -> None:
    """That took most of a recorder's time where two axes had one name, or a bag was played."""
    node = ros.node()
    publishers = [node.create_publisher(Int32, "/numbers", 10) for _ in range(2)]
    topic = RecordedTopic(node, "/numbers", "std_msgs/msg/Int32", lambda *_: None)
    ros.wait_until(lambda: node.count_publishers("/numbers") == 2)
    looks: list[str] = []
    genuine = node.get_publishers_info_by_topic

    def look(name: str) -> list[TopicEndpointInfo]:
        looks.append(name)
        return genuine(name)

    monkeypatch.setattr(node, "get_publishers_info_by_topic", look)
    topic.follow_publishers()
    for number in range(0, 200, 2):
        topic.losses.note(number, topic.publishers)
    assert (len(looks), topic.losses.lost) == (1, 0)
    node.destroy_publisher(publishers.pop())
    ros.wait_until(lambda: node.count_publishers("/numbers") == 1)
    for number in (200, 210):  # of the other one, from here on
        topic.follow_publishers()
        topic.losses.note(number, topic.publishers)
    assert topic.losses.lost == 9


def test_gaps_in_the_numbers_of_one_publisher_are_losses() -> None:
    count = LossCount()
    one, two = frozenset([b"one"]), frozenset([b"two"])
    for number in (3, 4, 7, 8):
        count.note(number, lambda: one)
    assert (count.lost, count.before_joining) == (2, 2)
    # Another publisher counts anew; two at a time cannot be told apart.
    for number in (1, 2):
        count.note(number, lambda: two)
    for number in (9, 40, 3):
        count.note(number, lambda: one | two)
    count.note(None, lambda: one)
    assert (count.lost, count.before_joining) == (2, 2)


def test_without_a_name_it_records_every_axis_that_it_finds(
    ros: Ros, start_node: Start, make_axis: MakeAxis, tmp_path: Path
) -> None:
    """Before it starts and later; it had recorded /stickslip_axis alone, in silence."""
    make_axis("/left")
    recorder = start_node("recorder_node", output="run")
    recorder.wait_for("/left/stickslip_axis")
    make_axis("/right")
    recorder.wait_for("found /right/stickslip_axis, and records all topics of it")
    recorder.wait_for("first message of /right/joint_states")
    recorder.wait_for("first message of /left/joint_states")
    assert recorder.interrupt() == 0
    with open_bag(tmp_path / "run") as bag:
        runs = {run.node: run for run in recorded_runs(bag)}
    assert set(runs) == {"/left/stickslip_axis", "/right/stickslip_axis"}
