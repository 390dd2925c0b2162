# SPDX-License-Identifier: Apache-2.0
"""``stickslip identify``: files in, parameters out."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from bench_traces import Axis, Drive, Sensor, bench_trace

from stickslip_ros.cli.main import main
from stickslip_ros.parameters import Parameters, read_yaml, yaml_text

pytestmark = pytest.mark.slow

AXIS = Axis(preload=0.5, mass=5e-3, sigma_1=7.0, sigma_0ss=1.2e7)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    folder = tmp_path_factory.mktemp("identify")
    drive = Drive(6, frequency=1000.0, amplitude=250.0, pause=3e-3)
    bench = bench_trace(AXIS, (drive,), Sensor(rate=5e5, noise=1e-9), 3e-3, 2)
    table = np.column_stack([1e3 * bench.t, 1e9 * bench.x])
    measured = folder / "trace.csv"
    np.savetxt(measured, table, delimiter=",", header="t (ms),x (nm)", comments="", fmt="%.9g")
    known = Parameters.of(
        {"preload": 0.5, "mass": 5e-3, "frequency": 1000.0, "amplitude": 250.0, "sigma_1": 7.0}
    )
    described = folder / "drive.yaml"
    usual = "    max_voltage: 300.0\n"  # as by default, and a part of the record all the same
    described.write_text(yaml_text(known) + usual, encoding="utf-8")
    return str(described), str(measured)


def test_the_fitted_file_loads_and_says_how_sure_it_is(
    files: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, page = tmp_path / "fitted.yaml", tmp_path / "fit.html"
    arguments = ["identify", "--run", *files, "--fit", "sigma_0,sigma_0ss", "--json"]
    assert main([*arguments, "--out", str(out), "--report", str(page), "--laws", "ceim"]) == 0
    check_page(page)
    assert "Friction laws, the best first" in page.read_text(encoding="utf-8")
    taken = page.read_text(encoding="utf-8").partition("What was taken as known")[2]
    assert "slewrate" in taken
    assert "max_frequency" not in taken  # what has its default does not matter: there were seventy
    told = json.loads(capsys.readouterr().out)
    sigma_0 = told["parameters"]["sigma_0"]
    assert sigma_0["value"] == pytest.approx(9.5e6, rel=0.01)
    assert sigma_0["low"] < sigma_0["value"] < sigma_0["high"]
    assert told["misfit"] is None
    (law,) = told["laws"]
    assert law["law"] == "ceim" and law["score"] == 0.0
    assert set(law["parameters"]) == {"sigma_0", "sigma_0ss"}
    assert law["residual"] < 1.1e-9
    assert read_yaml(out).friction.sigma_0 == pytest.approx(sigma_0["value"])
    assert "# sigma_0: " in out.read_text(encoding="utf-8")
    assert "max_voltage: 300.0" in out.read_text(encoding="utf-8")
    assert main(["identify", "--run", *files[::-1]]) == 2
    assert "is a parameter file; give it first" in capsys.readouterr().err
    assert main(["simulate", "--config", str(out), "--steps", "2", "--json"]) == 0


def check_page(page: Path) -> None:
    """The page has the numbers, a place for every plot, and data for every place."""
    text = page.read_text(encoding="utf-8")
    places = re.findall(r'<div class="plot" id="([^"]+)"', text)
    assert places == ["run-0", "folded-0", "profiles"]
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S)
    assert found
    drawn = json.loads(found[1])
    assert list(drawn) == places
    measured, fitted, left = drawn["run-0"]["data"]
    assert np.ptp(measured["y"]) == pytest.approx(np.ptp(fitted["y"]), rel=0.02)
    in_a_bin = 5e5 * np.median(np.diff(left["x"])) * 1e-3  # samples at 0.5 MHz; x is in ms
    assert np.std(left["y"]) == pytest.approx(1.0 / np.sqrt(in_a_bin), rel=0.1)  # nm of noise
    assert "sigma_0ss" in text and "trace.csv" in text
    assert not re.findall(r"(?:src|href)=\"(?!data:)", text)


def test_the_table_names_values_and_intervals(
    files: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["identify", "--run", *files, "--bounds", "sigma_0=5e6:2e7"]
    assert main([*arguments, "--fit", "sigma_0,sigma_0ss"]) == 0
    printed = capsys.readouterr().out
    assert "sigma_0" in printed and "low (95 %)" in printed
    assert "trace.csv: 6 steps, noise" in printed


def test_a_wrong_constant_that_is_kept_is_a_misfit(
    files: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    """The file has another sigma_0ss than the axis."""
    assert main(["identify", "--run", *files, "--fit", "sigma_0", "--json"]) == 1
    captured = capsys.readouterr()
    assert "misfit: trace.csv: " in captured.err
    assert json.loads(captured.out)["misfit"].startswith("trace.csv: ")
