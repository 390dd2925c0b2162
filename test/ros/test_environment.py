# SPDX-License-Identifier: Apache-2.0
"""What the machine may do to the nodes: no home, few descriptors, a clock that is set."""

import sys
from pathlib import Path

import pytest
from child import run
from live import Ros, Start
from std_msgs.msg import Int32

from stickslip_ros.recordings import open_bag
from stickslip_ros.ros.recording import UnsetClock

DAY = 86_400 * 10**9


def test_without_a_home_it_says_where_the_log_can_go(
    start_node: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", "/proc/nowhere")
    monkeypatch.delenv("ROS_LOG_DIR")
    recorder = start_node("recorder_node", output="run")
    assert recorder.wait() == 2
    assert "; set ROS_LOG_DIR to a folder that you may write to" in recorder.output


@pytest.mark.usefixtures("ros_domain")
def test_descriptors_that_run_out_are_told(tmp_path: Path) -> None:
    recorder = [sys.executable, "-m", "stickslip_ros.ros.recorder_node"]
    done = run("sh", "-c", 'ulimit -n "$0"; exec "$@"', "8", *recorder, cwd=tmp_path)
    assert done.returncode == 2
    assert "Too many open files; close other files or raise the limit" in done.stderr
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.glob("stickslip_*"))


def test_of_two_recorders_on_one_output_one_is_refused(
    ros: Ros, start_node: Start, tmp_path: Path
) -> None:
    recorders = [start_node("recorder_node", output="run", topics="[/n]") for _ in range(2)]
    ros.wait_until(lambda: not all(one.running for one in recorders), "the end of one")
    kept, refused = sorted(recorders, key=lambda one: not one.running)
    assert refused.wait() == 2
    assert "run exists already; name another one" in refused.output
    kept.wait_for("recording /n")
    ros.send(ros.node().create_publisher(Int32, "/n", 10), Int32(data=7))
    assert kept.interrupt() == 0
    with open_bag(tmp_path / "run") as bag:
        assert bag.message_count == 1


def test_a_clock_that_is_set_leaves_the_order_of_times() -> None:
    now = {"wall": 10 * DAY, "steady": DAY}
    clock = UnsetClock(lambda: now["wall"], lambda: now["steady"])

    def later(ns: int, set_by: int = 0) -> None:
        now["steady"] += ns
        now["wall"] += ns + set_by

    later(1000)
    assert clock.time_of(now["wall"] - 10) == 10 * DAY + 990
    later(1000, set_by=-2 * DAY)
    before_it_was_set = 10 * DAY + 1500  # of a message that waited meanwhile
    assert clock.time_of(before_it_was_set) == before_it_was_set
    assert clock.time_of(now["wall"]) == 10 * DAY + 2000
    assert clock.time_of(before_it_was_set) == before_it_was_set
    assert clock.set_by == -2 * DAY
    later(1000, set_by=500_000_000)  # trimmed
    assert clock.time_of(now["wall"]) == 10 * DAY + 500_003_000
    later(1000, set_by=2 * DAY - 500_000_000)
    assert clock.time_of(now["wall"]) == 10 * DAY + 4000
    assert clock.set_by == 0
