# SPDX-License-Identifier: Apache-2.0
"""A run recorded over DDS comes out of its bag again, bit for bit, and with other parameters."""

import contextlib
import json
import os
import random
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from live import Ros, Start
from rosbags.highlevel import AnyReader
from std_srvs.srv import Trigger

from stickslip_ros.cli.main import main
from stickslip_ros.ros.client import AxisClient, CommandRefused

pytestmark = pytest.mark.long
AXIS = "/stickslip_axis"
#: Seconds and commands; the long run is what a change of solver or device has to pass.
SECONDS = float(os.environ.get("STICKSLIP_RESIMULATE_S", "2"))
COMMANDS = max(10, round(50 * SECONDS / 60))


@pytest.fixture
def bag(ros: Ros, start_node: Start, tmp_path: Path) -> Path:
    """A few seconds of an axis under random commands, good and bad; the recorder joins late."""
    axis = start_node("axis_node", preload=0.5, sensor_noise=2e-9)
    node = ros.node()
    AxisClient(node=node).set_frequency(500.0).step(100)
    recorder = start_node("recorder_node", output="run")
    recorder.wait_for("first message of /joint_states")
    client = AxisClient(node=node, listeners=2)
    r = random.Random(7)
    choices: list[tuple[str, Callable[[], float]]] = [
        ("steps", lambda: r.randint(-300, 300)),
        ("amplitude", lambda: r.uniform(-20.0, 300.0)),
        ("frequency", lambda: r.uniform(100.0, 3000.0)),
        ("jog", lambda: r.uniform(-2000.0, 2000.0)),
        ("scan", lambda: r.uniform(0.0, 300.0)),
        ("position", lambda: r.uniform(-3e-6, 3e-6)),
        ("load", lambda: r.uniform(-0.02, 0.02)),
    ]
    for _ in range(COMMANDS):
        name, value = r.choice(choices)
        with contextlib.suppress(CommandRefused):
            client.send(name, value())
        time.sleep(r.uniform(0.5, 1.5) * SECONDS / COMMANDS)
    client.close()
    assert axis.interrupt() == 0
    assert ros.call(node, Trigger, "/stickslip_recorder/stop", Trigger.Request()).success
    assert recorder.wait() == 0
    return tmp_path / "run"


def test_a_recorded_run_comes_out_again(
    bag: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("stickslip_ros.reporting.terminal._PATIENCE", 0.0)
    assert main(["bag", "resimulate", str(bag), "--json"]) == 0
    output = capsys.readouterr()
    (run,) = json.loads(output.out)["runs"]
    assert f"computing {run['duration']:.0f} s of motion" in output.err
    assert run["bit_for_bit"]
    assert run["axis"] == AXIS
    assert run["commands"] >= COMMANDS / 2
    with AnyReader([bag]) as reader:
        states = sum(
            c.msgcount
            for c in reader.connections
            if c.topic in ("/joint_states", f"{AXIS}/contact")
        )
    assert run["states"] == states
    assert set(run["differences"]) == {
        f"axis_{body} {field}"
        for body in ("slider", "piezo", "contact")
        for field in ("position", "velocity", "effort")
    }
    assert all(d["unequal"] == 0 for d in run["differences"].values())

    # What if the runner were heavier: another run, as a bag that repeats itself in turn.
    heavier = bag.parent / "heavier"
    assert main(["bag", "resimulate", str(bag), "--set", "mass=0.006", "--out", str(heavier)]) == 0
    said = capsys.readouterr().out
    assert "largest difference to the run as recorded" in said
    assert main(["bag", "resimulate", str(heavier)]) == 0
    assert "bit for bit" in capsys.readouterr().out
    with AnyReader([heavier]) as reader:
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
