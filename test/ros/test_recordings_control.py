# SPDX-License-Identifier: Apache-2.0
"""Recordings that are started, split and stopped by services, and disks that fail under them."""

import os
import resource
import shutil
import signal
import time
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from heard import values
from live import Ros, Start
from rclpy.node import Node
from rclpy.publisher import Publisher
from rosbags.rosbag2 import Reader
from std_msgs.msg import Int32, String
from std_srvs.srv import Trigger

from stickslip_ros.cli.main import main
from stickslip_ros.recordings import open_bag

RECORDER = "/stickslip_recorder"


def counts(folder: Path) -> dict[str, int]:
    with Reader(folder) as bag:
        return {c.topic: c.msgcount for c in bag.connections if c.topic != "/diagnostics"}


def call(ros: Ros, node: Node, service: str) -> Any:
    return ros.call(node, Trigger, f"{RECORDER}/{service}", Trigger.Request())


def send(publisher: Publisher, ros: Ros, *numbers: int) -> None:
    ros.send(publisher, *(Int32(data=number) for number in numbers))


def test_one_recorder_makes_several_bags(ros: Ros, start_node: Start, tmp_path: Path) -> None:
    recorder = start_node("recorder_node", output="run", topics="[/numbers]", wait=True)
    recorder.wait_for("waiting for a call of ~/start")
    node = ros.node()
    numbers = node.create_publisher(Int32, "/numbers", 10)
    assert not call(ros, node, "stop").success
    assert not call(ros, node, "split").success
    for name, count in (("run", 3), ("run_2", 2)):
        answer = call(ros, node, "start")
        assert answer.success
        assert answer.message == f"recording to {tmp_path / name}"
        assert "stop first" in call(ros, node, "start").message
        send(numbers, ros, *range(count))
        assert call(ros, node, "stop").message == f"{tmp_path / name}: {count} messages"
        ros.wait_until(lambda: not numbers.get_subscription_count(), "the end")
    assert recorder.terminate() == 0
    assert counts(tmp_path / "run") == {"/numbers": 3}
    assert counts(tmp_path / "run_2") == {"/numbers": 2}


def test_a_bag_is_split_on_demand_and_the_recorder_says_how_it_goes(
    ros: Ros, start_node: Start, tmp_path: Path
) -> None:
    recorder = start_node(
        "recorder_node", output="run", topics="[/numbers]", compression="zstd", status_period=0.2
    )
    node = ros.node()
    numbers = node.create_publisher(Int32, "/numbers", 10)
    reports = ros.hear(DiagnosticArray, "/diagnostics")

    def said() -> dict[str, str]:
        return values(reports[-1].status[0]) if reports else {}

    send(numbers, ros, 1, 2)
    recorder.wait_for("2 messages, ")  # the line of every so often
    ros.wait_until(lambda: said().get("messages") == "2", "the report")
    assert reports[-1].status[0].name == "stickslip_recorder: recording"
    assert (said()["state"], said()["bag"]) == ("recording", str(tmp_path / "run"))
    assert said()["messages lost"] == "0"
    assert int(said()["size (B)"]) > 0
    assert float(said()["messages per second (1/s)"]) >= 0.0
    assert call(ros, node, "split").message == f"{tmp_path / 'run'}: file 2 begins"
    send(numbers, ros, 3)
    assert call(ros, node, "stop").success
    assert recorder.wait() == 0
    assert counts(tmp_path / "run") == {"/numbers": 3}
    with open_bag(tmp_path / "run") as bag:
        assert [file.messages for file in bag.files] == [2, 1]
        assert bag.compressions == ["zstd"]


def test_the_command_line_records_topics_by_name_and_by_pattern(
    ros: Ros, start_module: Start, tmp_path: Path
) -> None:
    recorder = start_module(
        "stickslip_ros.cli.main",
        *("bag", "record", "/other", "--regex", "/arm/.*", "--out", "run", "--compression", "lz4"),
    )
    recorder.wait_for("recording /other, topics that match /arm/.* to")
    node = ros.node()
    names = ("/arm/a", "/arm/b/c", "/other", "/army")
    publishers = {name: node.create_publisher(Int32, name, 10) for name in names}
    for name in names[:-1]:
        send(publishers[name], ros, 1)
        recorder.wait_for(f"first message of {name}")
    assert not publishers["/army"].get_subscription_count()
    assert recorder.interrupt() == 0
    assert counts(tmp_path / "run") == {"/arm/a": 1, "/arm/b/c": 1, "/other": 1}


def test_a_full_disk_is_said_and_loses_nothing_before(
    ros: Ros, start_node: Start, tmp_path: Path
) -> None:
    """A limit on the size of files fails a write in the middle, as a full disk does."""
    recorder = start_node("recorder_node", output="run", topics="[/texts]")
    recorder.wait_for("recording /texts to")
    node = ros.node()
    texts = ros.publisher(node, String, "/texts", 100)
    resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE, (300_000, 300_000))
    sent = 0
    while recorder.running:
        texts.publish(String(data=f"{sent:06d}" + "x" * 2000))
        sent += 1
        time.sleep(1e-3)
    assert recorder.wait() == 1
    last = recorder.output.splitlines()[-1]
    assert last.startswith("recorder_node: cannot write the bag")
    assert "make room on the disk" in last
    assert main(["bag", "recover", str(tmp_path / "run"), "--out", str(tmp_path / "mended")]) == 3
    kept = counts(tmp_path / "mended")["/texts"]
    assert kept * 2006 > 150_000


@pytest.mark.long
def test_a_recorder_that_gets_no_processor_for_a_while_loses_nothing(
    start_node: Start, tmp_path: Path
) -> None:
    """Ten messages of each topic waited for it, which is 10 ms: half of a run was lost."""
    recorder = start_node("recorder_node", output="bag")
    recorder.wait_for("recording")
    axis = start_node("axis_node", publish_rate=1000.0)
    recorder.wait_for("first message of /joint_states")
    for _ in range(3):
        time.sleep(0.2)
        os.kill(recorder.pid, signal.SIGSTOP)
        time.sleep(0.3)
        os.kill(recorder.pid, signal.SIGCONT)
    assert (axis.interrupt(), recorder.terminate()) == (0, 0)
    with open_bag(tmp_path / "bag") as bag:
        assert bag.message_count > 1000
        assert bag.custom_data["lost_messages"] == "0"


def test_a_bag_that_vanishes_is_noticed(ros: Ros, start_node: Start, tmp_path: Path) -> None:
    recorder = start_node("recorder_node", output="run", topics="[/numbers]")
    recorder.wait_for("recording /numbers to")
    shutil.rmtree(tmp_path / "run")
    assert recorder.wait() == 1
    assert "was removed during the recording" in recorder.output.splitlines()[-1]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_cannot_be_written(start_node: Start, tmp_path: Path) -> None:
    (tmp_path / "closed").mkdir(mode=0o500)
    recorder = start_node("recorder_node", output="closed/run")
    assert recorder.wait() == 2
    assert "closed/run: Permission denied; choose a place that you may write to" in recorder.output
