# SPDX-License-Identifier: Apache-2.0
"""Identified parameters drawn at random, and the bands that they make."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from stickslip_ros.cli.main import main
from stickslip_ros.library.ensemble import Band, Ensemble, EnsembleError, read_ensemble
from stickslip_ros.parameters import Parameters, yaml_text
from stickslip_ros.traces import run_steps

FITTED = Ensemble(
    ("z_ba", "sigma_0ss"), (18e-9, 1e7), (17e-9, 9e6), (19e-9, 1.2e7), ((1.0, -0.8), (-0.8, 1.0))
)
BASE = Parameters.of({"preload": 0.4, "mass": 4e-3, "z_ba": 18e-9, "sigma_0ss": 1e7})


@pytest.fixture
def file(tmp_path: Path) -> str:
    path = tmp_path / "fitted.yaml"
    path.write_text(f"# fitted\n# {FITTED.comment()}\n{yaml_text(BASE)}", encoding="utf-8")
    return str(path)


def test_a_file_gives_back_what_was_written(file: str) -> None:
    assert read_ensemble(Path(file)) == FITTED


def test_draws_have_the_intervals_and_the_correlation() -> None:
    drawn = FITTED.draw(40_000)
    for k, name in enumerate(FITTED.names):
        low, high = np.percentile(drawn[name], [2.5, 97.5])
        assert low == pytest.approx(FITTED.low[k], rel=0.01)
        assert high == pytest.approx(FITTED.high[k], rel=0.01)
        assert np.median(drawn[name]) == pytest.approx(FITTED.values[k], rel=0.01)
    logs = np.log([drawn["z_ba"], drawn["sigma_0ss"]])
    assert np.corrcoef(logs)[0, 1] == pytest.approx(-0.8, abs=0.02)


def test_the_band_is_that_of_single_runs() -> None:
    band = Band.of(BASE, FITTED, 5, 40)
    drawn = FITTED.draw(40)
    positions = []
    for k in range(40):
        p = BASE.replace(**{name: float(values[k]) for name, values in drawn.items()})
        positions.append(run_steps(p, 5).position)
    assert band.draws == 40 and band.impossible == 0
    assert band.low == pytest.approx(np.percentile(positions, 2.5, axis=0), rel=1e-12)
    assert band.high == pytest.approx(np.percentile(positions, 97.5, axis=0), rel=1e-12)


def test_simulate_tells_the_band(file: str, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["simulate", "--ensemble", file, "--steps", "8", "--draws", "50"]
    assert main([*arguments, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    band = told["ensemble"]
    assert band["draws"] == 50
    assert band["step_size"]["low"] < told["step_size"] < band["step_size"]["high"]
    assert len(band["position"]["low"]) == 8
    assert main(arguments) == 0
    assert "50 draws of the ensemble lie within" in capsys.readouterr().out


@pytest.mark.slow
def test_sweep_has_a_band_for_each_metric(
    file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, picture = tmp_path / "sweep.csv", tmp_path / "sweep.png"
    arguments = ["sweep", "--ensemble", file, "--draws", "30", "--vary", "amplitude=100:300:3"]
    arguments += ["--steps", "8", "--metric", "step_size", "--metric", "backstep"]
    assert main([*arguments, "--out", str(out), "--plot", str(picture), "--json"]) == 0
    metrics = json.loads(capsys.readouterr().out)["metrics"]
    assert list(metrics) == [
        "step_size", "step_size_low", "step_size_high",
        "backstep", "backstep_low", "backstep_high",
    ]  # fmt: skip
    one = Band.of(BASE.replace(amplitude=200.0), FITTED, 8, 30)
    found = metrics["step_size_low"][1], metrics["step_size_high"][1]
    assert found == pytest.approx(one.step_size, rel=1e-9)
    lines = [line for line in out.read_text().splitlines() if not line.startswith("#")]
    rows = list(csv.DictReader(lines))
    assert float(rows[1]["step_size_low (m)"]) == metrics["step_size_low"][1]
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["simulate", "--config", "table1_typical.yaml"], "leave --config out"),
        (["simulate", "--draws", "2"], "--draws is 2; it has to be from 10 to 100000"),
        (["simulate", "--set", "z_ba=2e-8"], "--set z_ba: the ensemble draws it"),
        (["sweep", "--vary", "z_ba=1e-8:2e-8:3"], "z_ba is varied, and the ensemble draws it"),
    ],
)
def test_bad_use_is_refused(
    arguments: list[str], words: str, file: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*arguments, "--ensemble", file]) == 2
    assert words in capsys.readouterr().err


def test_a_file_without_a_whole_ensemble_is_refused(tmp_path: Path) -> None:
    for text, words in [
        ("# nothing\n", "holds no ensemble; write it with stickslip identify --out"),
        ('# ensemble: {"names": ["z_ba"]}\n', "is damaged"),
        (
            '# ensemble: {"names": ["z_ba"], "values": [1e-8], "low": [0.0], "high": [2e-8], '
            '"correlations": [[1.0]]}\n',
            "is damaged",
        ),
        (
            '# ensemble: {"names": ["z_ba"], "values": [1e-8], "low": [1e-8], "high": [2e-8], '
            '"correlations": [[1.0, 0.0]]}\n',
            "is damaged",
        ),
    ]:
        path = tmp_path / "bad.yaml"
        path.write_text(text, encoding="utf-8")
        with pytest.raises(EnsembleError, match=words):
            read_ensemble(path)
