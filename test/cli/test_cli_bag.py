# SPDX-License-Identifier: Apache-2.0
"""``stickslip bag``: what it says of bags, good and bad, and what it makes of them."""

import json
from pathlib import Path

import pytest
from bags import EVENTS, STEPS, event, int32

from stickslip_ros.cli.main import main
from stickslip_ros.recordings import BagWriter, OfferedQos, open_bag
from stickslip_ros.version import __version__

START = 1_700_000_000_123_456_789


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """A bag with the events of an axis, in two files."""
    folder = tmp_path / "run"
    with BagWriter(folder, custom_data={"lost_messages": "0"}, compression="zstd") as writer:
        for topic in (STEPS, EVENTS):
            writer.add_topic(topic)
        start = {"time (s)": "0.0", "event": "start", "outcome": "applied"}
        details = {"model": "ceim", "preload": "0.30000000000000004", "version": "0.1.0"}
        writer.write(EVENTS.name, event(START, **start, **details), log_ns=START, publish_ns=START)
        writer.split()
        for i in range(9):
            ns = START + (i + 1) * 500_000_000
            writer.write(STEPS.name, int32(0), log_ns=ns, publish_ns=ns)
    return folder


def test_info_says_what_is_in_a_bag(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bag", "info", str(bag)]) == 0
    said = capsys.readouterr().out
    for words in (
        f"bag          {bag}",
        "in 2 files",
        "compression  zstd",
        "start        2023-11-14 22:13:20.123456789 UTC",
        "duration     4.500 s",
        "messages     10",
        f"recorded by  stickslip_ros {__version__}, ROS jazzy",
        "lost_messages 0",
        "/axis/command/steps         9  std_msgs/msg/Int32  reliable, volatile",
        "/axis/events                1  diagnostic_msgs/msg/DiagnosticArray  best_effort, volatile",
        "axis of /axis/events; 1 more parameters at their defaults, see --json\n  preload",
        "preload                  0.30000000000000004",
    ):
        assert words in said
    assert "ceim" not in said


def test_info_is_one_object_with_json(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bag", "info", str(bag), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["start_ns"], found["messages"], found["duration"]) == (START, 10, 4.5)
    assert found["size"] == sum(file.stat().st_size for file in bag.glob("*.mcap"))
    assert [(file["name"], file["messages"]) for file in found["files"]] == [
        ("run_0.mcap", 1),
        ("run_1.mcap", 9),
    ]
    steps = next(topic for topic in found["topics"] if topic["name"] == STEPS.name)
    assert (steps["type"], steps["messages"], steps["type_hash"]) == (
        STEPS.type,
        9,
        STEPS.type_hash,
    )
    assert steps["offered_qos"] == [OfferedQos().as_json()]
    assert (found["compression"], found["ros_distro"], found["metadata_version"]) == (
        ["zstd"],
        "jazzy",
        9,
    )
    assert found["custom_data"] == {"lost_messages": "0"}
    assert found["axes"] == {
        EVENTS.name: {"model": "ceim", "preload": 0.30000000000000004, "version": "0.1.0"}
    }


def test_a_bag_without_an_axis_or_anything_is_told_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    BagWriter(tmp_path / "empty").close()
    assert main(["bag", "info", str(tmp_path / "empty")]) == 0
    assert "messages     0" in capsys.readouterr().out


def test_recover_makes_a_bag_and_says_what_it_kept(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (bag / "metadata.yaml").unlink()
    file = bag / "run_1.mcap"
    file.write_bytes(file.read_bytes()[:-20])
    assert main(["bag", "info", str(bag)]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.startswith(f"stickslip bag info: {file} is damaged: it has no end")
    assert "`stickslip bag recover`" in output.err and output.err.count("\n") == 1

    new = tmp_path / "new"
    assert main(["bag", "recover", str(bag), "--out", str(new)]) == 3
    output = capsys.readouterr()
    assert output.out.startswith(f"{new}: 10 messages kept, ")
    assert output.err.splitlines() == [
        "stickslip bag recover: metadata.yaml is missing",
        "stickslip bag recover: run_1.mcap has no end: what its writer had not written yet is "
        "missing",
        "stickslip bag recover: run_1.mcap is damaged: 17 bytes were left out",
    ]
    with open_bag(new) as recovered:
        assert recovered.message_count == 10
    assert main(["bag", "recover", str(bag), "--json"]) == 3
    found = json.loads(capsys.readouterr().out)
    assert (found["bag"], found["messages"]) == (f"{bag}_recovered", 10)
    assert (found["dropped_bytes"], found["unprotected"], len(found["findings"])) == (17, 0, 3)
    assert main(["bag", "recover", str(bag)]) == 2
    assert "run_recovered: File exists; choose another name" in capsys.readouterr().err
    assert main(["bag", "recover", str(new), "--out", str(tmp_path / "whole")]) == 0
    assert capsys.readouterr().err == ""
