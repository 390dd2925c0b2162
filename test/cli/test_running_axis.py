# SPDX-License-Identifier: Apache-2.0
"""``stickslip send`` and ``watch`` with a node over DDS."""

import csv
import os
import pty
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from live import MakeAxis, Start
from rosbags.highlevel import AnyReader

from stickslip_ros.axis.commands import COMMANDS
from stickslip_ros.cli.main import main
from stickslip_ros.cli.running_axis import sparkline
from stickslip_ros.physics.parameters.row import read_quantity

pytest.importorskip("rclpy")

from stickslip_ros.ros.client import AxisClient
from stickslip_ros.ros.nodes.axis_node import AxisNode

PATIENCE = 60.0  # s


@pytest.fixture
def axis(make_axis: MakeAxis) -> AxisNode:
    return make_axis(frequency=1000.0, allow_faults=True)


def test_every_command_of_the_registry_can_be_sent(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["send", "--list"])  # fails for one of a type that it cannot read
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(COMMANDS)


@pytest.mark.long
def test_a_recorder_that_is_waited_for_has_the_command(start_node: Start, tmp_path: Path) -> None:
    """The axis is a process, too: Fast DDS delivers in two ways at once else, and loses states."""
    start_node("axis_node", frequency=1000.0).wait_for("ready")
    recorder = start_node("recorder_node", output="run")
    recorder.wait_for("recording all topics of /stickslip_axis to")
    assert main(["send", "steps", "1", "--wait", "--listeners", "2", "--timeout", "60"]) == 0
    assert recorder.terminate() == 0
    with AnyReader([tmp_path / "run"]) as bag:
        topics = {one.topic: one.msgcount for one in bag.connections}
    assert topics["/stickslip_axis/command/steps"] == 1


@pytest.mark.usefixtures("ros_domain")
@pytest.mark.parametrize(
    ("command", "first"),
    [("send stop --timeout 0.5", ""), ("watch --timeout 0.5", ""),
     ("send stop --timeout 0.5 --wait", "/stickslip_axis: stop ...\n")],
)  # fmt: skip
def test_an_axis_that_is_not_there_is_said_to_be_missing(
    command: str, first: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever waits hears soon what for."""
    monkeypatch.setattr("stickslip_ros.base.reporting.terminal._PATIENCE", 0.01)
    assert main(command.split()) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"{first}stickslip ")
    assert "no axis answers at /stickslip_axis" in said
    assert "or is it still compiling? see its log" in said


@pytest.mark.usefixtures("axis")
def test_for_a_wrong_name_the_axes_that_are_there_are_named(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """At the end of the timeout: the axis that is meant may be discovered after others."""
    assert main(["send", "stop", "--axis", "/elsewhere", "--timeout", "3"]) == 2
    said = capsys.readouterr().err
    assert "no axis /elsewhere; here are /stickslip_axis (waited 3 s)\n" in said


def test_commands_reach_a_live_axis(axis: AxisNode, capsys: pytest.CaptureFixture[str]) -> None:
    def send(*arguments: str) -> str:
        code = main(["send", *arguments, "--timeout", f"{PATIENCE}"])
        output = capsys.readouterr()
        assert (code, output.err) == (0, "")
        return output.out

    assert re.fullmatch(
        r"stopped, 200 steps done, 0 left, at 24\.5\d+ µm\n", send("steps", "200", "--wait")
    )
    back = send("steps", "-300", "--wait")  # with one minus sign throughout
    assert re.fullmatch(r"stopped, -300 steps done, 0 left, at -[\d.]+ µm\n", back)
    assert send("frequency", "2kHz").startswith("frequency 2000 Hz, stopped, ")
    assert "jogging" in send("jog", "500")
    assert send("stop").startswith("stopped, ")
    said = send("parameters", "preload=1.0", "mass=0.003")
    assert said.startswith("preload 1.000 N, mass 0.003000 kg, stopped, ")
    assert "stopped" in send("zero")
    reached = re.fullmatch(
        r"holding, [\d.]+ .?m from the target, at (.*)\n", send("position", "2um", "--wait")
    )
    assert reached
    assert read_quantity(reached[1], "m") == pytest.approx(2e-6, abs=1e-8)
    assert "holding" in send("trajectory", "0.1:500nm", "0.2s:0", "--wait")
    assert "holding" in send("joint_command", "axis_slider", "position", "0.4um", "--wait")
    assert main(["send", "joint_command", "x", "velocity", "1um/s"]) == 1
    assert "no joint 'x'; give axis_slider" in capsys.readouterr().err
    assert main(["send", "amplitude", "900"]) == 1
    assert "amplitude refused: amplitude is 900 V" in capsys.readouterr().err
    assert ", injected: sensor_drift, at " in send("parameters", "fault=sensor_drift")
    assert send("parameters", 'fault=""').startswith("fault none, ")
    send("jog", "500")
    assert ", paused, at " in send("pause", "on")
    assert re.search(r"^jogging, .* paused, at .*, it ends with its cycle$", send("stop"), re.M)


def test_a_command_goes_to_every_axis(
    make_axis: MakeAxis, capsys: pytest.CaptureFixture[str]
) -> None:
    nodes = [make_axis(name, axis_name=name[1:], allow_faults=True) for name in ("/x", "/y")]
    for node in nodes:
        node.axis.command("jog", 100.0)
    assert main(["send", "stop", "--all"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        f"/{name}/stickslip_axis: stop done" for name in "xy"
    ]
    assert {node.axis.mode for node in nodes} <= {"stopped", "jogging"}  # to the end of its cycle
    nodes[0].axis.command("parameters", {"fault": "refuse"})
    assert main(["send", "zero", "--all"]) == 1
    assert "stickslip send: /x/stickslip_axis: " in capsys.readouterr().err
    assert main(["send", "steps", "3", "--all"]) == 2
    assert "--all is for commands without a value" in capsys.readouterr().err


def test_a_jog_is_not_waited_for(axis: AxisNode, capsys: pytest.CaptureFixture[str]) -> None:
    """It was sent, then refused: the axis ran on without end."""
    assert main(["send", "jog", "500", "--wait"]) == 2
    assert "leave out --wait" in capsys.readouterr().err
    assert axis.axis.mode == "stopped"


def test_a_move_that_another_command_ends_is_no_success(
    axis: AxisNode, capsys: pytest.CaptureFixture[str]
) -> None:
    def stop() -> None:
        with AxisClient(timeout=PATIENCE) as other:
            other.wait_for_state("stepping", PATIENCE)
            other.send("stop")

    with ThreadPoolExecutor() as beside:
        stopped = beside.submit(stop)
        assert main(["send", "steps", "100000", "--wait", "--timeout", f"{PATIENCE}"]) == 1
        stopped.result()
    assert "ended by another command: stop" in capsys.readouterr().err


def test_a_move_that_a_soft_limit_ends_is_no_success(
    axis: AxisNode, capsys: pytest.CaptureFixture[str]
) -> None:
    client = ["--timeout", f"{PATIENCE}"]
    here = axis.axis.status.position
    assert main(["send", "parameters", f"soft_high={here + 1e-6}", *client]) == 0
    assert main(["send", "steps", "100", "--wait", *client]) == 1
    said = capsys.readouterr()
    assert said.out.endswith(", against soft_high\n")
    assert "steps was ended by a limit: soft_high" in said.err
    for against in ("soft_high", ""):
        assert main(["watch", "--for", "0.6", *client]) == 0
        *_, row = csv.DictReader(capsys.readouterr().out.splitlines())
        assert row["against"] == against
        main(["send", "steps", "-1", *client])
        capsys.readouterr()


def test_the_end_of_the_travel_is_said(
    make_axis: MakeAxis, capsys: pytest.CaptureFixture[str]
) -> None:
    make_axis(frequency=1000.0, travel_low=-1e-6)
    assert main(["send", "steps", "-30", "--wait", "--timeout", f"{PATIENCE}"]) == 0
    assert capsys.readouterr().out.endswith(" nm, against the low end of the travel\n")


def test_watch_prints_lines_in_a_pipe(axis: AxisNode, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["send", "jog", "1000", "--timeout", f"{PATIENCE}"]) == 0
    capsys.readouterr()
    assert main(["watch", "--period", "0.1", "--for", "1", "--timeout", f"{PATIENCE}"]) == 0
    rows = list(csv.DictReader(capsys.readouterr().out.splitlines()))
    assert len(rows) == 11
    assert {row["state"] for row in rows} == {"jogging"}
    for column in ("position", "steps_done"):
        assert float(rows[-1][column]) > float(rows[0][column]), column


@pytest.mark.long
@pytest.mark.parametrize(
    ("encoding", "bar"), [pytest.param("utf-8", "█", marks=pytest.mark.long), ("cp1252", "^")]
)
def test_watch_draws_a_table_on_a_terminal(axis: AxisNode, encoding: str, bar: str) -> None:
    assert main(["send", "jog", "1000", "--timeout", f"{PATIENCE}"]) == 0
    assert main(["send", "amplitude", "900"]) == 1
    master, slave = pty.openpty()
    child = subprocess.run(
        [sys.executable, "-m", "stickslip_ros", "watch", "--for", "1.5", "--timeout", "60"],
        stdin=slave, stdout=slave, stderr=subprocess.PIPE, timeout=2 * PATIENCE, check=False,
        env={**os.environ, "PYTHONIOENCODING": encoding, "TERM": "xterm", "COLUMNS": "100"},
    )  # fmt: skip
    os.close(slave)
    shown = b""
    try:
        while part := os.read(master, 65536):
            shown += part
    except OSError:  # the terminal is closed and empty
        pass
    os.close(master)
    text = shown.decode(encoding, errors="replace")
    assert (child.returncode, child.stderr) == (0, b"")
    for word in ("/stickslip_axis", "jogging", "refused", "300 V, 1000 Hz", bar):
        assert word in text, word


def test_a_sparkline_goes_from_the_least_to_the_greatest() -> None:
    assert sparkline([0.0, 3.5, 7.0]) == "▁▅█"
    assert sparkline([5.0, 5.0]) == "▁▁"
    assert sparkline([]) == ""
