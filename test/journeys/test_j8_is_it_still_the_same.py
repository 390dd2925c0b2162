# SPDX-License-Identifier: Apache-2.0
"""J8: recordings of an axis, and what its twin says of them.

A general integrator moves the axis of the tables and changes it; the twin is told the commands.
"""

import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from child import stickslip
from emulated import Client
from live import Start, wait_until

from stickslip_ros.measurement.twin import TwinCommand
from stickslip_ros.physics.parameters import Parameters
from validation.twin_axis import Hidden, RealAxis

DRIVE = {"preload": 0.4, "frequency": 300.0, "amplitude": 250.0}
#: s, when the axis changes: in the middle of the steps at its first drive
WHEN = 0.5
#: What changes, and the causes that may be named for it; none: it is the same axis.
CHANGES = {
    "nothing": (Hidden(), set()),
    "payload": (Hidden(payload=2e-3), {"payload"}),
    "preload": (Hidden(preload=0.85), {"preload", "place"}),
}


def write_tables(folder: Path, hidden: Hidden) -> RealAxis:
    """Write readings and commands of an axis at two frequencies, with rests, there and back."""
    (folder / "drive.yaml").write_text(yaml.safe_dump({"/**": {"ros__parameters": DRIVE}}))
    axis = RealAxis(Parameters.of(DRIVE), lambda t, _: hidden if t >= WHEN else Hidden())
    axis.rest(0.05)
    axis.step(300)
    for frequency, steps in ((100.0, 60), (300.0, -60)):
        axis.command("frequency", frequency)
        axis.rest(0.1)
        axis.step(steps)
    axis.rest(0.1)
    commands = [one for one in axis.log if isinstance(one, TwinCommand)]
    readings = [one for one in axis.log if not isinstance(one, TwinCommand)]
    rows = [f"{t!r},{1e9 * x!r}" for t, x in readings]
    (folder / "axis.csv").write_text("\n".join(["time (s),position (nm)", *rows]))
    said = [f"{one.t!r},{one.name},{one.value!r}" for one in commands]
    (folder / "commands.csv").write_text("\n".join(["time,command,value", *said]))
    return axis


@pytest.mark.parametrize(
    "name", ["nothing", "payload", pytest.param("preload", marks=pytest.mark.long)]
)
def test_a_table_of_an_axis(name: str, tmp_path: Path) -> None:
    hidden, right = CHANGES[name]
    axis = write_tables(tmp_path, hidden)
    words = ["twin", "axis.csv", "--drive", "commands.csv", "--config", "drive.yaml"]
    words += ["--predict-steps", "100", "--predict-position", "60um", "--json"]
    words += ["--report", "twin.html", "--plot", "twin.png", "--table", "twin.csv"]
    found: dict[str, Any] = json.loads(stickslip(*words, cwd=tmp_path, code=int(bool(right))))
    assert len(found["changes"]) == bool(right), found["changes"]
    for change in found["changes"]:
        assert abs(change["onset"] - WHEN) < 0.1 and change["told"] < WHEN + 0.5
        posterior = change["posterior"]
        named = {cause for cause, share in posterior.items() if share > 0.01}
        assert named & right, change["text"]
        if len(named) > 1 and max(posterior.values()) < 0.95:
            assert "cannot be distinguished" in change["text"]
    assert "Residual" in (tmp_path / "twin.html").read_text(encoding="utf-8")
    assert (tmp_path / "twin.png").stat().st_size > 5000
    seen = len((tmp_path / "twin.csv").read_text().splitlines())
    assert seen > 0.9 * len((tmp_path / "axis.csv").read_text().splitlines())

    # Where a hundred steps more of the same axis end, it says itself.
    told, there = found["predictions"]
    assert abs(there["position"] - 60e-6) < 70e-9  # within half a step
    axis.step(100)
    axis.rest(0.05)
    assert right or told["low"] <= axis.x <= told["high"]


def test_a_recording_of_a_lab_program(start_module: Start, tmp_path: Path) -> None:
    """A bag of an emulated controller is of the axis that it was, not of one pressed harder."""
    words = ["emulate", "mcs", "--port", "0", "--axes", "x", "--record", "bag"]
    words += ["--set", "amplitude=100", "--set", "sensor_latency=0"]
    device = start_module("stickslip_ros", *words)
    device.wait_for(" port ")
    port = int(device.output.partition(" port ")[2].partition(",")[0])
    with Client(port) as client:
        for steps in (400, -200):
            assert client.ask(f":MST0,{steps},4095,300") == ":E0,0"
            wait_until(lambda: client.ask(":GS0") == ":S0,0", "rest")
    assert device.terminate() == 0
    (tmp_path / "drive.yaml").write_text(json.dumps({"preload": 0.4}))
    words = ["twin", "bag", "--config", "drive.yaml"]
    assert "change:" not in stickslip(*words, cwd=tmp_path)
    said = stickslip(*words, "--set", "preload=0.6", code=1, cwd=tmp_path)
    assert "the file is not of this axis" in said
