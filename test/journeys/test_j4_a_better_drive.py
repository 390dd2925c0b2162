# SPDX-License-Identifier: Apache-2.0
"""J4: a drive simulated, explored, swept, predicted, and given a waveform without ringing.

Every step that is said of it, or promised, is made once more by a general integrator.
"""

import http.client
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from child import stickslip
from live import Start

from stickslip_ros.physics.parameters import Parameters
from validation.whole_system import positions

#: Mine: a heavier runner with a payload, at 1 kHz.
DRIVE = {"preload": 0.6, "mass": 5e-3, "payload": 1e-3, "frequency": 1000.0}
CYCLES = 30


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump({"/**": {"ros__parameters": DRIVE}}))
    return tmp_path


def told(folder: Path, command: str, *words: str) -> dict[str, Any]:
    """Run a command with my drive; return what it says as JSON."""
    given = ("--config", "mine.yaml", *words, "--json")
    found: dict[str, Any] = json.loads(stickslip(command, *given, cwd=folder))
    return found


def integrated(**changes: Any) -> float:
    """Return the settled step (m) of a drive by the general integrator."""
    steps = np.diff(positions(Parameters.of({**DRIVE, **changes}), CYCLES))
    return float(steps[-5:].mean())


def test_a_better_drive(folder: Path) -> None:
    # What does it do? Where it is after each cycle, another integrator agrees to 0.01 nm a cycle.
    now = told(folder, "simulate", "--steps", str(CYCLES))
    off = np.array(now["position"]) - positions(Parameters.of(DRIVE), CYCLES)
    assert np.abs(off).max() < 0.01e-9 * CYCLES
    assert now["step_size"] == pytest.approx(integrated(), abs=0.02e-9)

    # What would more preload do? Each point of a sweep is a simulation.
    vary = ("--vary", "preload=0.4:1.2:3", "--metric", "step_size", "--metric", "backstep")
    swept = told(folder, "sweep", *vary)
    (preloads,), sizes = swept["vary"].values(), swept["metrics"]["step_size"]
    for preload, size in zip(preloads, sizes, strict=True):
        assert size == pytest.approx(integrated(preload=preload), abs=0.05e-9)

    # Which amplitude makes steps of 80 nm? In closed form, as near as it says itself.
    asked = told(folder, "predict", "--step", "80nm", "--frequency", "100")
    made = integrated(amplitude=asked["amplitude"], frequency=100.0)
    assert abs(made - 80e-9) < asked["error"]

    # A slip in two parts leaves no ringing; its voltages go to a generator.
    files = ("--out", "shaped.yaml", "--waveform", "wave.csv")
    shaped = told(folder, "shape", *files)
    assert shaped["ringing_after"] < 0.05 * shaped["ringing_before"]
    table = {"waveform": "table", "waveform_table": str(folder / "wave.csv")}
    assert integrated(**table) == pytest.approx(shaped["step_after"], abs=0.05e-9)

    # And what the generator plays is simulated as it was promised.
    played = told(
        folder, "simulate", "--steps", str(CYCLES), *(f"--set={n}={v}" for n, v in table.items())
    )
    assert played["step_size"] == pytest.approx(shaped["step_after"], abs=0.02e-9)


def test_the_same_drive_on_a_page(folder: Path, start_module: Start) -> None:
    """The curves of `explore` are those of `simulate`."""
    words = ("--no-browser", "--config", "mine.yaml", "--measurement", "steps_100hz.csv")
    page = start_module("stickslip_ros", "explore", *words)
    page.wait_for("explore at http://127.0.0.1:")
    port = int(page.output.split("127.0.0.1:")[1].split("/")[0])
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    connection.request("GET", "/")
    assert "steps_100hz.csv" in connection.getresponse().read().decode()
    connection.request("GET", "/curves?preload=0.8")
    found = json.loads(connection.getresponse().read())
    connection.close()
    _, step = found["over"]["amplitude"]["now"]
    assert 1e-9 * step == pytest.approx(integrated(preload=0.8), abs=0.05e-9)
    assert page.interrupt() == 0
