# SPDX-License-Identifier: Apache-2.0
"""``stickslip identify``: files in, parameters out."""

import json
import re

import numpy as np
import pytest
from bench_traces import Axis, Drive, Sensor, bench_trace

from stickslip_ros.cli.main import main
from stickslip_ros.physics.parameters import Parameters, yaml_text

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


def test_the_table_names_values_and_intervals(
    files: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["identify", "--run", *files, "--bounds", "sigma_0=5e6:2e7"]
    assert main([*arguments, "--fit", "sigma_0,sigma_0ss"]) == 0
    printed = capsys.readouterr().out
    assert "sigma_0" in printed and "low (95 %)" in printed
    assert "trace.csv: 6 steps, noise" in printed
    assert re.search(r"^deviance \d+\.\d$", printed, re.MULTILINE)


def test_a_wrong_constant_that_is_kept_is_a_misfit(
    files: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    """The file has another sigma_0ss than the axis."""
    assert main(["identify", "--run", *files, "--fit", "sigma_0", "--json"]) == 1
    captured = capsys.readouterr()
    assert "misfit: trace.csv: " in captured.err
    told = json.loads(captured.out)
    assert told["misfit"].startswith("trace.csv: ")
    assert told["deviance"] > 0.0
