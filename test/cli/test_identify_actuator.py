# SPDX-License-Identifier: Apache-2.0
"""``stickslip identify-actuator``: from a CSV to parameters that repeat the loop."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from actuator_bench import STROKE, bench, maxwell_slip
from table_1 import table_1

from stickslip_ros.cli.main import main
from stickslip_ros.physics.model.actuator import Actuator
from stickslip_ros.physics.parameters import Parameters

TRUE = Actuator.of(table_1(actuator="hysteresis", hysteresis=0.2).actuator)


@pytest.fixture
def loop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give a measured full loop in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    volts = np.concatenate([np.linspace(0, 300, 200), np.linspace(300, 0, 200)])
    memory = TRUE.rest().moved(300.0, TRUE.thresholds).moved(0.0, TRUE.thresholds)
    lines = ["# bench 3", "voltage (V); deflection (m)"]
    for volt in volts.tolist():
        memory = memory.moved(volt, TRUE.thresholds)
        lines.append(f"{volt!r}; {TRUE.deflection(memory)!r}")
    (tmp_path / "loop.csv").write_text("\n".join([*lines, ""]))
    return tmp_path / "loop.csv"


@pytest.mark.parametrize("full", [300.0, 150.0])
def test_the_parameters_repeat_the_loop(
    loop: Path, full: float, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whatever the largest voltage of the drive: the weights in force are those measured."""
    arguments = ["identify-actuator", str(loop), "--out", "own.yaml", "--operators", "8"]
    arguments += ["--set", f"max_voltage={full}"]
    assert main([*arguments, "--json"]) == 0
    output = capsys.readouterr()
    assert output.err == ""
    found = json.loads(output.out, parse_constant=pytest.fail)
    assert found["width"] == pytest.approx(0.2, rel=1e-3)
    assert found["error"] < 1e-6
    actuator = Actuator.of(Parameters.of(found["parameters"]).actuator)
    assert actuator.elastic == pytest.approx(TRUE.elastic)
    np.testing.assert_allclose(actuator.weights, TRUE.weights, rtol=1e-6)
    assert main(arguments) == 0
    table, _, lines = capsys.readouterr().out.partition("\n\n")
    assert "loop width   20.00 % of the stroke" in table
    assert yaml.safe_load(lines) == found["parameters"]
    assert sorted(path.name for path in loop.parent.iterdir()) == ["loop.csv", "own.yaml"]
    assert "identified from loop.csv" in (loop.parent / "own.yaml").read_text()


def test_a_recording_with_times_rests_and_creep(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Loops, drift and creep are told, and creep stands among the parameters to use."""
    monkeypatch.chdir(tmp_path)
    made = bench(maxwell_slip, 3, creep=0.02, drift=0.04)
    rows = np.column_stack([1e3 * made.times, made.volts, 1e6 * made.deflection])
    head = "time (ms),voltage (V),position (um)"
    np.savetxt("rec.csv", rows, delimiter=",", header=head, comments="")
    assert main(["identify-actuator", "rec.csv", "--out", "own.yaml", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["loops"] >= 2
    assert found["drift"] * made.times[-1] == pytest.approx(0.04 * STROKE, rel=0.2)
    assert found["creep"] == found["parameters"]["creep"] == pytest.approx(0.02, abs=0.003)
    assert Parameters.of(found["parameters"]).actuator.creep == found["creep"]
    assert main(["identify-actuator", "rec.csv", "--out", "own.yaml"]) == 0
    table = capsys.readouterr().out
    assert "% in a decade of time" in table
    assert "nm/s, taken out" in table
