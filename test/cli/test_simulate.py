# SPDX-License-Identifier: Apache-2.0
"""``stickslip simulate``: its numbers against the reference table, its outputs."""

import csv
import json
import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from table_1 import OVER_PRELOAD, OVER_STROKE, table_1

from stickslip_ros.cli.main import main
from stickslip_ros.physics.laws import LEFT_TO_LAW
from stickslip_ros.physics.model.friction import constants_in_force
from stickslip_ros.physics.parameters import PARAMETERS, Parameters
from stickslip_ros.simulation.sampling import PlannedRun, trace_runs
from stickslip_ros.simulation.steps import run_steps

CONFIG = Path(__file__).resolve().parent.parent.parent / "config"
#: The operating point of Table 1, spelt out.
TYPICAL = ("--config", str(CONFIG / "table1_typical.yaml"))

Simulate = Callable[..., dict[str, Any]]


@pytest.fixture
def as_json(capsys: pytest.CaptureFixture[str]) -> Simulate:
    """Give a function that runs the subcommand and returns the object that it prints."""

    def run(*arguments: str) -> dict[str, Any]:
        assert main(["simulate", "--json", *arguments]) == 0
        output = capsys.readouterr()
        assert output.err == ""
        result: dict[str, Any] = json.loads(output.out, parse_constant=pytest.fail)
        return result

    return run


def test_the_steps_are_those_of_the_reference(as_json: Simulate) -> None:
    """Within 0.05 nm, at every preload and stroke."""
    cases = [(preload, 160, step) for preload, step in OVER_PRELOAD.items()]
    for stroke, (weak, firm) in OVER_STROKE.items():
        cases += [(0.4, stroke, weak), (1.0, stroke, firm)]
    for preload, stroke, step in cases:
        drive = ["--amplitude", f"{stroke * 300 / 160}", "--set", f"preload={preload}"]
        result = as_json(*TYPICAL, "--steps", "12", *drive)
        position = result["position"]
        assert 1e9 * (position[11] - position[6]) / 5 == pytest.approx(step, abs=0.05)
        assert 1e9 * result["step_size"] == pytest.approx(step, abs=0.05)


def test_the_json_object_is_the_contract(as_json: Simulate) -> None:
    """Every key, SI units, and parameters that repeat the run."""
    result = as_json("--steps", "-9", "--set", "preload=0.5", "--frequency", "250")
    assert list(result) == [
        "steps",
        "position",
        "step_size",
        "backstep",
        "mean_speed",
        "zero_amplitude",
        "growth",
        "parameters",
    ]
    assert result["steps"] == -9
    assert result["parameters"] == Parameters.of({"preload": 0.5, "frequency": 250.0}).flat()
    assert result["mean_speed"] == pytest.approx(250.0 * result["step_size"])
    run = run_steps(Parameters.of(result["parameters"]), -9)
    assert result["position"] == run.position.tolist()
    assert (result["step_size"], result["backstep"]) == (run.step_size, run.backstep)
    assert 1e-8 < result["zero_amplitude"] < 1e-7


def test_a_search_that_fails_leaves_the_zero_amplitude_out(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Behind a slow amplifier no cycle settles that the search could run; the run itself counts."""
    slow = ["--set", "amplifier_bandwidth=1", "--frequency", "5000", "--json"]
    assert main(["simulate", "--steps", "3", *slow]) == 0
    output = capsys.readouterr()
    assert json.loads(output.out)["zero_amplitude"] is None
    assert "no 0-amplitude: amplifier and actuator do not settle" in output.err


def test_no_zero_amplitude_is_null(as_json: Simulate) -> None:
    assert as_json("--steps", "2", "--set", "preload=20")["zero_amplitude"] is None
    assert as_json("--steps", "2", "--set", "force=1")["zero_amplitude"] is None


def test_the_table_says_the_same_to_people(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "--steps", "20", *TYPICAL]) == 0
    output = capsys.readouterr()
    rows = dict(line.split(maxsplit=1) for line in output.out.splitlines())
    assert output.err == ""
    assert rows["position"] == "2702.456 nm, as the last slip ends"
    run = run_steps(table_1(), 20)
    assert rows["step"] == f"size    {1e9 * run.step_size:.3f} nm"
    assert rows["backstep"] == f"{1e9 * run.backstep:.3f} nm"
    assert main(["simulate", "--steps", "2", "--set", "preload=20"]) == 0
    assert "0-amplitude  none: no amplitude makes steps, or the load" in capsys.readouterr().out


def test_options_beat_assignments_beat_the_file(as_json: Simulate, tmp_path: Path) -> None:
    file = tmp_path / "own.yaml"
    file.write_text("/**:\n  ros__parameters: {preload: 1.0, mass: 0.005, amplitude: 100.0}\n")
    p = as_json(
        *("--steps", "1", "--config", str(file)),
        *("--set", "preload=2", "--set", "preload=3", "--set", "amplitude=150"),
        *("--amplitude", "200"),
    )["parameters"]
    assert (p["mass"], p["preload"], p["amplitude"]) == (0.005, 3.0, 200.0)


def test_the_vibration_preset_rings_with_4_khz(as_json: Simulate) -> None:
    p = as_json("--steps", "1", "--config", str(CONFIG / "table1_vibration.yaml"))["parameters"]
    assert math.sqrt(p["sigma_0"] / p["mass"]) / (2 * math.pi) == pytest.approx(4000, rel=1e-4)


def test_every_parameter_is_listed(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["simulate", "--list-parameters"])
    assert end.value.code == 0
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines()}
    assert list(lines) == list(PARAMETERS)
    for name, row in PARAMETERS.items():
        if row.kind in (int, float):
            assert f"{row.low:g} to {row.high:g}" in lines[name]
    own = constants_in_force(Parameters().friction)  # what the law takes where nothing is set
    for name in LEFT_TO_LAW:
        assert f" {getattr(own, name):g} (" in lines[name]
    assert " not set " in lines["max_steps"]
    assert "friction law: ceim, " in lines["model"]
    assert ": sawtooth, " in lines["waveform"]


def test_the_help_follows_the_table(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["simulate", "--help"])
    text = " ".join(capsys.readouterr().out.split())
    for name in ("amplitude", "frequency"):
        row = PARAMETERS[name]
        assert f"(default: {row.default:g} {row.unit})" in text


# -- traces


def test_the_trace_is_a_table_that_agrees_with_the_run(as_json: Simulate, tmp_path: Path) -> None:
    file = tmp_path / "run.csv"
    result = as_json("--steps", "3", "--trace", str(file), *TYPICAL)
    with file.open(newline="") as stream:
        rows = [[float(cell) for cell in row] for row in list(csv.reader(stream))[1:]]
    assert rows[0][:2] == [0.0, 0.0]
    assert rows[-1][0] == pytest.approx(0.03, abs=1e-15)
    assert rows[-1][1] == pytest.approx(result["position"][-1], abs=1e-14)
    assert all(a[0] < b[0] for a, b in pairwise(rows))
    assert max(row[3] for row in rows) == pytest.approx(160e-9, abs=1e-18)
    assert list(tmp_path.iterdir()) == [file]


def test_the_sensor_writes_what_it_reads(as_json: Simulate, tmp_path: Path) -> None:
    """A table as a logger writes it, with a rest of a period before and after."""
    file = tmp_path / "readings.csv"
    values = ("sensor_rate=1e5", "sensor_bandwidth=5e3", "sensor_latency=1e-3", "sensor_seed=7")
    sets = [word for value in values for word in ("--set", value)]
    as_json("--steps", "3", "--trace", str(file), "--sensor", *sets, *TYPICAL)
    with file.open(newline="") as stream:
        header, *rows = list(csv.reader(stream))
    assert header == ["time (s)", "position (m)"]
    times, positions = zip(*(map(float, row) for row in rows), strict=True)
    assert (times[0], times[-1]) == pytest.approx((1e-3, 51e-3), abs=1e-12)
    before = [x for t, x in zip(times, positions, strict=True) if t < 11e-3]
    assert max(map(abs, before)) < 6e-9  # the noise of a nanometre
    after = positions[-500:]
    rest = trace_runs(table_1(), [PlannedRun(0.0, 3)], after=0.01)[1, -1]
    assert sum(after) / 500 == pytest.approx(rest, abs=0.2e-9)
