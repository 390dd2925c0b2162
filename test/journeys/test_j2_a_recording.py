# SPDX-License-Identifier: Apache-2.0
"""J2: two axes recorded, the recorder killed, and all that is done with what is left.

What is in the bag is said by `rosbags`, and by a node that heard the same topics meanwhile.
"""

import csv
import json
import re
from pathlib import Path
from typing import Any

import pytest
from child import stickslip
from live import Ros, Start
from rosbags.highlevel import AnyReader

pytest.importorskip("rclpy")

from sensor_msgs.msg import JointState

from stickslip_ros.client import AxisClient

pytestmark = pytest.mark.flaky(reruns=1)

DRIVE = ["-p", "axes:=[x, 'y']", "-p", "frequency:=100.0"]
#: N, of the last load: a word of the recording that nothing else in it says
LAST = "0.0123456"
STEPS = 10
#: m, of the sample that another integrator made
NOISE = 2e-9


def stamp(message: Any) -> int:
    """Return the stamp of a message of rclpy or rosbags, ns."""
    at = message.header.stamp
    return int(at.sec) * 10**9 + int(getattr(at, "nanosec", 0))


def states(bag: Path, topic: str) -> list[tuple[int, float]]:
    """Return stamp (ns) and position (m) of each state of a topic, as `rosbags` reads them."""
    with AnyReader([bag]) as reader:
        found = [one for one in reader.connections if one.topic == topic]
        messages: list[Any] = [
            reader.deserialize(data, one.msgtype) for one, _, data in reader.messages(found)
        ]
        return [(stamp(one), float(one.position[0])) for one in messages]


def test_a_recording(ros: Ros, start_node: Start, start_module: Start, tmp_path: Path) -> None:
    # Recorded: a recorder that comes late, motion of both axes, a force, and kill -9.
    host = start_node("axis_node", *DRIVE)
    host.wait_for("axis y ready")
    heard = ros.hear(JointState, "/x/truth")
    recorder = start_module("stickslip_ros", "bag", "record", "--out", "run")
    for axis in "xy":
        recorder.wait_for(f"first message of /{axis}/truth")
    with AxisClient("/x", timeout=60.0) as x, AxisClient("/y", timeout=60.0) as y:
        y.send("frequency", 1000.0).send("load", 1e-3)
        x.send("steps", STEPS)
        assert y.send("position", 2e-6).wait().position == pytest.approx(2e-6, abs=5e-9)
        x.wait()
        y.send("load", float(LAST))
    file = tmp_path / "run" / "run_0.mcap"
    ros.wait_until(lambda: LAST.encode() in file.read_bytes(), "the last load on the disk")
    recorder.kill()
    assert host.interrupt() == 0

    # Recovered: nobody reads it in silence, and what was flushed is whole.
    assert "stickslip bag recover" in stickslip("bag", "info", "run", cwd=tmp_path, code=2)
    assert "has no end" in stickslip("bag", "recover", "run", cwd=tmp_path, code=3)
    bag = tmp_path / "run_recovered"
    truth = states(bag, "/x/truth")
    live = [(stamp(one), one.position[0]) for one in list(heard)]
    between = [one for one in live if truth[0][0] <= one[0] <= truth[-1][0]]
    assert len(between) > STEPS and set(between) <= set(truth), "without a gap"

    # Looked at.
    told = json.loads(stickslip("bag", "info", str(bag), "--json", cwd=tmp_path))
    with AnyReader([bag]) as reader:
        counts = {one.topic: one.msgcount for one in reader.connections}
    assert {one["name"]: one["messages"] for one in told["topics"]} == counts
    assert {parameters["frequency"] for parameters in told["axes"].values()} == {100.0}

    # Run again: both axes, every state, bit for bit; and what if the runner were heavier.
    said = stickslip("bag", "resimulate", str(bag), cwd=tmp_path)
    assert said.count("bit for bit") == 2, said
    what_if = stickslip(
        "bag", "resimulate", str(bag), "--set", "mass=6e-3", "--out", "heavier", cwd=tmp_path
    )
    assert "bit for bit" not in what_if
    assert states(tmp_path / "heavier", "/x/truth")[-1][1] != truth[-1][1]

    # Exported: a table has what the bag has, to the last digit.
    stickslip("bag", "export", str(bag), "--out", "tables", cwd=tmp_path)
    with (tmp_path / "tables" / "x.truth.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["x_slider/position"]) for row in rows] == [x for _, x in truth]

    # Compared with what an interferometer saw of such a drive: what is left is its noise.
    words = ("compare", str(bag), "steps_100hz.csv", "--joint", "x_slider", "--json")
    found = json.loads(stickslip(*words, cwd=tmp_path))
    assert found["rmse"] == pytest.approx(NOISE, rel=0.2), found
    assert found["differing"] == [] and found["metrics"]["steps"]["measured"] == STEPS

    # Played into a live graph: the same states once more, in their order.
    again = ros.hear(JointState, "/x/truth", 10_000)
    player = start_module("stickslip_ros", "bag", "play", str(bag), "--rate", "2")
    ros.wait_until(lambda: again and stamp(again[-1]) == truth[-1][0], "the last of it")
    assert player.wait() == 0
    played = [(stamp(one), one.position[0]) for one in again]
    assert played == sorted(played) and set(played) <= set(truth)
    assert re.search(rf"\b{sum(counts.values())} messages", player.output), player.output
