# SPDX-License-Identifier: Apache-2.0
"""J7: a law and a waveform of my own, from a package of mine, wherever a drive is simulated.

The law is the CEIM whose normal force is twice the preload, which a parameter makes of ours as
well: all that is said of mine has to be said of ours with that, to the last bit.
"""

import json
import sys
from pathlib import Path
from typing import Any

import pytest
from child import run, stickslip

PACKAGE = """
from stickslip_ros.physics.laws import LAWS, Law
from stickslip_ros.physics.waveforms import Shape

ceim = LAWS["ceim"]
TWICE = Law(
    constants=lambda c, f: ceim.constants(c, 2.0 * f),
    contact=lambda c, f: ceim.contact(c, 2.0 * f),
    free=("sigma_1",),
)


def ramp(drive):
    period, fall = 1.0 / drive.frequency, drive.amplitude / (drive.slewrate * 1e6)
    return Shape((period - fall, fall), (1.0, -1.0), slip=(1, 2), time_for_slip=period)
"""
ENTRY_POINTS = """
[stickslip_ros.laws]
twice = my_physics:TWICE

[stickslip_ros.waveforms]
ramp = my_physics:ramp
"""
MINE = ("--set", "model=twice", "--set", "waveform=ramp")
OURS = ("--set", "preload_ratio=2.0")
NOTEBOOK = """
import numpy as np
import stickslip_ros as ss
from my_physics import TWICE, ramp

ss.register_law("mine", TWICE)
ss.register_waveform("my_ramp", ramp)
ss.register_law("mine", TWICE)  # a cell that is run again
mine, ours = {"model": "mine", "waveform": "my_ramp"}, {"preload_ratio": 2.0}
for drive in (mine, ours):
    axis = ss.Axis(drive)
    axis.command("steps", 20)
    axis.advance(0.5)
    swept = ss.sweep(**drive, preload=[0.3, 0.4], steps=8)["step_size"]
    print(ss.simulate(**drive, steps=8).position.tolist(), swept.tolist(), axis.state.x)
"""


@pytest.fixture
def package(tmp_path: Path) -> dict[str, str]:
    """Install the package; return the environment of a program that finds it."""
    folder = tmp_path / "site"
    told = folder / "my_physics-1.0.dist-info"
    told.mkdir(parents=True)
    (folder / "my_physics.py").write_text(PACKAGE)
    (told / "METADATA").write_text("Metadata-Version: 2.1\nName: my-physics\nVersion: 1.0\n")
    (told / "entry_points.txt").write_text(ENTRY_POINTS)
    return {"PYTHONPATH": f"{folder}:{Path(__file__).parents[2]}"}


def test_mine_is_simulated_like_ours(package: dict[str, str], tmp_path: Path) -> None:
    def told(*words: str) -> dict[str, Any]:
        out = stickslip(
            "simulate", "--steps", "12", "--json", *words, cwd=tmp_path, changes=package
        )
        found: dict[str, Any] = json.loads(out)
        return {name: found[name] for name in ("position", "step_size", "backstep")}

    assert told(*MINE) == told(*OURS)
    vary = ("sweep", "--vary", "preload=0.3:0.6:3")
    mine, ours = (stickslip(*vary, *words, cwd=tmp_path, changes=package) for words in (MINE, OURS))
    assert mine == ours


def test_mine_drives_a_node_whose_bag_comes_out_again(
    package: dict[str, str], ros_domain: int, tmp_path: Path
) -> None:
    (tmp_path / "mine.yaml").write_text("model: twice\nwaveform: ramp\n")
    stickslip("demo", "--config", "mine.yaml", "--out", "demo", cwd=tmp_path, changes=package)
    (bag,) = (path.parent for path in (tmp_path / "demo").rglob("metadata.yaml"))
    said = stickslip("bag", "resimulate", str(bag), cwd=tmp_path, changes=package)
    assert "bit for bit" in said
    alone = stickslip("bag", "resimulate", str(bag), cwd=tmp_path, code=2)
    assert "model is 'twice'" in alone
    assert "stickslip_ros.laws" in alone  # what is missing here


def test_mine_is_identified(package: dict[str, str], tmp_path: Path) -> None:
    """A damping that was changed is found again, in my law as in ours."""
    sampled = (
        "--trace",
        "run.csv",
        "--sensor",
        "--set",
        "sensor_rate=1e5",
        "--set",
        "sensor_latency=0",
    )
    changed = ("--set", "sigma_1=6.5", "--set", "frequency=1000", "--steps", "30")
    stickslip("simulate", *changed, *MINE, *sampled, cwd=tmp_path, changes=package)
    (tmp_path / "mine.yaml").write_text(
        "model: twice\nwaveform: ramp\nfrequency: 1000.0\nsensor_rate: 100000.0\n"
    )
    words = ("identify", "--config", "mine.yaml", "run.csv", "--fit", "sigma_1", "--json")
    out = json.loads(stickslip(*words, cwd=tmp_path, changes=package))
    found = out["parameters"]["sigma_1"]
    assert found["low"] < 6.5 < found["high"]


def test_a_notebook_registers_them_for_its_process(package: dict[str, str], tmp_path: Path) -> None:
    script = tmp_path / "notebook.py"
    script.write_text(NOTEBOOK)
    done = run(sys.executable, str(script), cwd=tmp_path, **package)
    assert done.returncode == 0, done.stderr
    mine, ours = done.stdout.splitlines()
    assert mine == ours
