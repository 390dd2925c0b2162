# SPDX-License-Identifier: Apache-2.0
"""J3: what an instrument wrote, analysed, compared with my drive, and fitted.

The motion is by an integrator of its own, in `bench_traces`; another one runs what was fitted.
"""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest
from bench_traces import Axis, Bench, Drive, Sensor, bench_trace
from child import stickslip

from stickslip_ros.physics.parameters import Parameters, read_yaml
from validation.whole_system import positions

#: My axis, of which I know the preload and the mass, and not its stiffnesses.
AXIS = Axis(preload=0.5, mass=5e-3, sigma_1=7.0, sigma_0_offset=9e6, sigma_0ss=1.2e7)
SIGMA_0 = 11.5e6  # N/m, of its preload by Eq. 14
NOISE = 1e-9  # m
DRIVE = {"preload": 0.5, "mass": 5e-3, "frequency": 1000.0, "amplitude": 250.0, "sigma_1": 7.0}
HEAD = """Gerät;Vibrometer OFV-5000
Datum;12.03.2026 14:07:33
Messbereich;20 µm
Kommentar;Läufer 5 g, 0,5 N

Zeit;Weg
(ms);(µm)

"""


def write(file: Path, bench: Bench) -> None:
    """Write it as a German program does: semicolons, decimal commas, an old encoding."""
    rows = zip((1e3 * bench.t).tolist(), (1e6 * bench.x).tolist(), strict=True)
    lines = [f"{t:.5f};{x:.6f}".replace(".", ",") for t, x in rows]
    file.write_bytes((HEAD + "\r\n".join(lines) + "\r\n").encode("cp1252"))


@pytest.fixture
def forth() -> Bench:
    drive = Drive(8, frequency=1000.0, amplitude=250.0, pause=3e-3)
    return bench_trace(AXIS, (drive,), Sensor(rate=5e5, noise=NOISE), 3e-3, 2)


@pytest.fixture
def both_ways() -> Bench:
    drives = (Drive(12, 500.0, pause=0.005), Drive(9, 500.0, direction=-1, pause=0.006))
    return bench_trace(AXIS, drives, Sensor(rate=100e3, noise=NOISE, zero=3e-7), rest=0.006)


def test_a_measured_file(forth: Bench, both_ways: Bench, tmp_path: Path) -> None:
    write(tmp_path / "vor.csv", forth)
    write(tmp_path / "beide.csv", both_ways)
    (tmp_path / "drive.yaml").write_text(json.dumps(DRIVE))

    # What does it show? Steps, direction and drive are found; of a folder, in one table.
    stickslip("analyse", "vor.csv", "beide.csv", "--table", "all.csv", cwd=tmp_path)
    with (tmp_path / "all.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    true = [*forth.runs, *both_ways.runs]
    assert [row["file"] for row in rows] == ["vor.csv", "beide.csv", "beide.csv"]
    for row, one in zip(rows, true, strict=True):
        assert float(row["step size (m)"]) == pytest.approx(one.step_size, abs=0.3e-9)
        assert 0.0 < float(row["standard error of the step size (m)"]) < 0.3e-9
        assert (int(row["steps"]), int(row["direction"])) == (one.steps, one.direction)

    # Does my drive do the same? Not with the stiffnesses of the paper.
    words = ["compare", "drive.yaml", "vor.csv", "--max-rmse", "2e-9", "--report", "before.html"]
    said = stickslip(*words, code=1, cwd=tmp_path)
    assert "DIFFERS" in said

    # Which stiffnesses does it have, and how sure is that?
    words = ["identify", "--config", "drive.yaml", "vor.csv", "--fit", "sigma_0,sigma_0ss"]
    words += ["--out", "fitted.yaml", "--report", "fit.html", "--json"]
    found = json.loads(stickslip(*words, cwd=tmp_path))
    assert found["misfit"] is None
    for name, value in {"sigma_0": SIGMA_0, "sigma_0ss": AXIS.sigma_0ss}.items():
        one = found["parameters"][name]
        assert one["low"] < value < one["high"] and one["determined"], (name, one)
        assert one["value"] == pytest.approx(value, rel=0.02)

    # With these it does, to the noise of the instrument.
    words = ["compare", "fitted.yaml", "vor.csv", "--max-rmse", "1.3e-9", "--json"]
    told = json.loads(stickslip(*words, cwd=tmp_path))
    assert told["rmse"] == pytest.approx(NOISE, rel=0.2)
    assert told["differing"] == []
    page = (tmp_path / "fit.html").read_text(encoding="utf-8")
    assert "sigma_0ss" in page and "vor.csv" in page
    assert re.findall(r'<div class="plot" id="([^"]+)"', page) == ["run-0", "folded-0", "profiles"]
    known = page.partition("What was taken as known")[2]
    assert "slewrate" in known and "max_frequency" not in known  # which does not matter
    assert "# sigma_0: " in (tmp_path / "fitted.yaml").read_text(encoding="utf-8")

    # And another integrator makes the measured steps of the fitted file.
    fitted = read_yaml(tmp_path / "fitted.yaml")
    assert isinstance(fitted, Parameters)
    ends = positions(fitted, 8)
    assert np.diff(ends)[-4:].mean() == pytest.approx(forth.runs[0].step_size, abs=0.3e-9)
