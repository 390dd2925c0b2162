# SPDX-License-Identifier: Apache-2.0
"""``stickslip demo`` as users run it: two processes over DDS, a bag, a table, a picture."""

import re
import signal
import subprocess
from pathlib import Path

import pytest
from child import PATIENCE, environment
from live import wait_until
from test_main import COMMAND, stickslip

pytest.importorskip("rclpy")

from rosbags.highlevel import AnyReader

from stickslip_ros.base.shared_files import example
from stickslip_ros.cli.main import main

pytestmark = pytest.mark.long


def _results(folder: Path) -> dict[str, bytes]:
    """Return every file below a folder, hidden ones included."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def test_the_demo_leaves_whole_results_or_none(ros_domain: int, tmp_path: Path) -> None:
    """First one that cannot work, then a good one, then the bad one over the good results."""
    bad = tmp_path / "slow.yaml"  # its slip takes longer than a cycle at 1 kHz
    bad.write_text("/**:\n  ros__parameters:\n    slewrate: 0.2\n")
    out = tmp_path / "new" / "demo"

    broken = stickslip("demo", "--out", str(out), "--config", str(bad))
    assert broken.returncode == 2
    (line,) = broken.stderr.splitlines()
    assert "did not end well: frequency refused: frequency 1000 Hz leaves 1000 us" in line
    assert not out.exists()

    good = stickslip("demo", "--out", str(out))
    assert (good.returncode, good.stderr) == (0, "")
    results = _results(out)
    assert {"bag/metadata.yaml", "bag/bag_0.mcap", "response.png", "summary.txt"} <= set(results)
    assert not [name for name in results if name.startswith(".")]
    assert results["response.png"].startswith(b"\x89PNG")
    _check_table(good.stdout, out)
    assert results["summary.txt"].decode() in good.stdout

    again = stickslip("demo", "--out", str(out), "--config", str(bad))
    assert again.returncode == 2
    assert _results(out) == results


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_demo_in_order(
    ros_domain: int, tmp_path: Path, number: signal.Signals
) -> None:
    """In the middle of it: exit code 130, one line, and no folder is left."""
    out = tmp_path / "demo"
    child = subprocess.Popen(
        [*COMMAND, "demo", "--out", str(out)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment(),
    )
    try:
        wait_until(lambda: _started(out), "both processes", PATIENCE)
        child.send_signal(number)
        _, errors = child.communicate(timeout=PATIENCE)
    finally:
        child.kill()
    assert errors == "stickslip demo: interrupted\n"
    assert child.returncode == 130
    assert not out.exists()


def _started(out: Path) -> bool:
    """Whether the axis of a demo says that it is ready, and the recorder that it records."""
    logs = "".join(log.read_text() for log in out.glob(".new-*/*.log"))
    return "ready" in logs and "recording all" in logs


def _check_table(text: str, out: Path) -> None:
    """Hold the printed table against the known numbers and the bag."""
    rows = {line[:22].strip(): line[22:].split() for line in text.splitlines()}
    assert [float(cell) for cell in rows["step size (nm)"]] == pytest.approx(
        [122.49, -122.49, 133.83, 130.0], abs=0.02
    )
    # The second move ends where the first one began, but for the backstep of the first.
    assert [float(cell) for cell in rows["end of last step (nm)"]] == pytest.approx(
        [24536.59, -25.67, 2702.46], abs=0.02
    )
    assert float(rows["mean speed (um/s)"][0]) == pytest.approx(122.49, abs=0.02)
    assert float(rows["real-time factor"][0]) == pytest.approx(1.0, abs=0.05)
    assert re.fullmatch(r"\d+", rows["deadlines missed"][0])
    with AnyReader([out / "bag"]) as reader:
        assert int(rows["messages recorded"][0]) == reader.message_count
        steps = [
            int(reader.deserialize(data, connection.msgtype).data)  # type: ignore[attr-defined]
            for connection, _, data in reader.messages()
            if connection.topic == "/stickslip_axis/command/steps"
        ]
    assert steps == [200, -200, 20]


def test_results_take_the_place_of_earlier_ones(tmp_path: Path) -> None:
    """A second demo in a row: folders and files of the first give way, others stay."""
    work, out = tmp_path / "work", tmp_path / "out"
    for folder, text in ((out, "old"), (work, "new")):
        (folder / "bag").mkdir(parents=True)
        (folder / "bag" / text).write_text(text)
        (folder / "summary.txt").write_text(text)
    (out / "notes").write_text("mine")
    example("demo").put_in_place(work, out)
    assert _results(out) == {"bag/new": b"new", "notes": b"mine", "summary.txt": b"new"}


def test_a_folder_that_cannot_be_made_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    assert main(["demo", "--out", str(tmp_path / "file" / "demo")]) == 2
    error = capsys.readouterr().err
    assert error.startswith("stickslip demo: cannot write ")
    assert "Not a directory" in error
    assert len(error.splitlines()) == 1


def test_the_bag_of_somebody_else_stays(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Only what looks like an earlier demo may give way."""
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "mine").write_text("mine")
    assert main(["demo", "--out", str(tmp_path)]) == 2
    assert "not of an earlier demo; choose another --out" in capsys.readouterr().err
    assert (tmp_path / "bag" / "mine").read_text() == "mine"
