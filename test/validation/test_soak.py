# SPDX-License-Identifier: Apache-2.0
"""``make soak``: a short one, one that is interrupted, and its judgement of what it finds."""

import json
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from live import wait_until

pytest.importorskip("rclpy")

from rosbags.highlevel import AnyReader

from stickslip_ros.axis.commands import COMMANDS
from validation.soak.__main__ import main
from validation.soak.run import MOST_GROWTH, RandomCommands, Sample, Soaked

COMMAND = (sys.executable, "-m", "validation.soak")


def children_of(pid: int) -> list[int]:
    return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


@pytest.mark.long
@pytest.mark.usefixtures("ros_domain")
def test_twenty_seconds(tmp_path: Path) -> None:
    out = tmp_path / "soak"
    done = subprocess.run(
        [*COMMAND, "--hours", str(20 / 3600), "--out", str(out), "--seed", "5", "--json"],
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stderr) == (0, "")
    found = json.loads(done.stdout)
    assert found == json.loads((out / "soak.json").read_text())
    assert found["findings"] == []
    assert found["seconds"] >= 20.0
    assert found["bit_for_bit"] is True
    assert (found["lost"], found["gaps"]) == (0, 0)
    assert sum(found["commands"].values()) > 20
    assert set(found["memory_mb"]) == {"axis", "recorder"}
    page = (out / "index.html").read_text()
    assert "nothing found" in page
    with AnyReader([out / "bag"]) as reader:  # as an independent reader counts them
        assert reader.message_count == found["messages"] > found["states"] > 500


@pytest.mark.long
@pytest.mark.usefixtures("ros_domain")
def test_interrupted_it_tells_what_it_has(tmp_path: Path) -> None:
    """And leaves no process behind."""
    out = tmp_path / "soak"
    process = subprocess.Popen(
        [*COMMAND, "--hours", "2", "--out", str(out)], stdout=subprocess.PIPE, text=True
    )
    log = out / "recorder_node.log"
    heard = "first message of /stickslip_axis/command/"
    wait_until(lambda: log.exists() and heard in log.read_text(), "a command in the bag")
    children = children_of(process.pid)
    assert len(children) >= 2
    process.send_signal(signal.SIGINT)
    text, _ = process.communicate(timeout=100.0)
    assert process.returncode == 0, text
    assert re.search(r"time +\d+\.\d s, interrupted", text)
    assert json.loads((out / "soak.json").read_text())["bit_for_bit"] is True
    assert not [pid for pid in children if Path(f"/proc/{pid}").exists()]


@pytest.mark.parametrize("hours", ["0", "-1", "nan", "inf"])
def test_a_time_that_cannot_be_is_refused(
    hours: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--hours", hours, "--out", str(tmp_path / "soak")]) == 2
    assert "--hours is" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_there_is_not_touched(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--hours", "1", "--out", str(tmp_path)]) == 2
    assert "File exists; choose another name" in capsys.readouterr().err


def _soaked(sizes: list[float]) -> Soaked:
    samples = [Sample(float(k), {"axis": size}, {"axis": 9}, 0) for k, size in enumerate(sizes)]
    return Soaked(0, samples=samples)


def test_growth_is_that_of_the_second_half() -> None:
    filling = [100.0 + k for k in range(50)] + [150.0] * 50
    assert _soaked(filling).growth("axis") == 0.0
    leaking = [100.0 + 0.1 * k for k in range(100)]
    assert _soaked(leaking).growth("axis") == pytest.approx(4.0)  # 40 samples apart
    assert MOST_GROWTH < 4.0
    assert _soaked(filling[:10]).growth("axis") is None


def test_the_commands_repeat_and_are_of_every_kind() -> None:
    one, two = RandomCommands(3), RandomCommands(3)
    first = [one.next() for _ in range(300)]
    assert repr(first) == repr([two.next() for _ in range(300)])
    assert {name for name, _ in first} == set(one.names)
    for name, arguments in first:  # the names of the joints are the client's to add
        assert len(arguments) == len(COMMANDS[name].example) - (name == "trajectory"), name
