# SPDX-License-Identifier: Apache-2.0
"""``stickslip sweep`` as a user meets it: output, exit codes, Ctrl-C."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from child import environment
from table_1 import table_1

from stickslip_ros.cli.main import main
from stickslip_ros.simulation.steps import run_steps

REPOSITORY = Path(__file__).parent.parent.parent
TYPICAL = ("--config", str(REPOSITORY / "config" / "table1_typical.yaml"))
SMALL = ("sweep", "--vary", "preload=500mN:3N:6", "--set", "frequency=1000", *TYPICAL)
#: Far longer than a test waits.
LONG = ("sweep", "--vary", "preload=0.1:6:200000", "--set", "frequency=1000", "--jobs", "2")


def rows_of(text: str) -> list[list[str]]:
    """The rows of a table without its comments and its line of names."""
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    return [line.split(",") for line in lines[1:]]


@pytest.fixture(scope="module", autouse=True)
def compiled() -> None:
    """Have everything compiled: on a fresh machine the first sweep says that it compiles."""
    assert main([*SMALL, "--json"]) == 0


def test_without_out_the_table_goes_to_stdout(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(SMALL) == 0
    output = capsys.readouterr()
    assert output.out.startswith("preload (N),step_size (m)\n")  # the settings go to files only
    rows = rows_of(output.out)
    assert [row[0] for row in rows] == ["0.5", "1.0", "1.5", "2.0", "2.5", "3.0"]
    wanted = run_steps(table_1(preload=1.0, frequency=1000.0), 12).step_size
    assert float(rows[1][1]) == wanted
    assert output.err == ""


def test_json_has_the_shape_of_the_grid(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*SMALL, "--vary", "amplitude=200:400:2", "--metric", "mean_speed", "--json"]) == 0
    output = capsys.readouterr()
    found = json.loads(output.out)
    assert list(found["vary"]) == ["preload", "amplitude"]
    assert np.shape(found["metrics"]["mean_speed"]) == (6, 2)
    assert all(row[0] > 0.0 and row[1] is None for row in found["metrics"]["mean_speed"])
    assert found["empty"] == 6
    assert "amplitude is 400 V" in found["why_empty"]
    assert found["parameters"]["frequency"] == 1000.0


def test_table_and_picture_are_written_and_summed_up(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    csv, png = tmp_path / "a.csv", tmp_path / "a.png"
    assert main([*SMALL, "--out", str(csv), "--plot", str(png), "--metric", "step_size"]) == 0
    assert len(rows_of(csv.read_text())) == 6
    assert png.read_bytes().startswith(b"\x89PNG")
    assert "step_size" in capsys.readouterr().out


def test_impossible_points_are_empty_counted_and_explained(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    csv = tmp_path / "a.csv"
    arguments = ["sweep", "--vary", "amplitude=200:400:3", "--out", str(csv)]
    assert main(arguments) == 0
    assert [row[1] == "" for row in rows_of(csv.read_text())] == [False, False, True]
    error = capsys.readouterr().err
    assert "1 of 3 points have an empty value" in error
    assert "amplitude 400 V: amplitude is 400 V; it has to lie between" in error
    assert len(error.splitlines()) == 1


@pytest.mark.long
@pytest.mark.parametrize("out", [True, pytest.param(False, marks=pytest.mark.long)])
def test_ctrl_c_keeps_what_is_done(tmp_path: Path, out: bool) -> None:
    csv = tmp_path / "a.csv"
    child = subprocess.Popen(
        [sys.executable, "-m", "stickslip_ros.cli.main", *LONG, *(["--out", str(csv)] * out)],
        cwd=REPOSITORY,
        stderr=subprocess.PIPE,
        text=True,
        env=environment(),
    )
    assert child.stderr
    try:
        assert "computing points" in child.stderr.readline()
        time.sleep(1.0)
        child.send_signal(signal.SIGINT)
        error = child.communicate(timeout=60.0)[1]
    finally:
        child.kill()
    assert child.returncode == 130
    if not out:
        assert "were done; --out FILE.csv keeps them" in error
        return
    rows = rows_of(csv.read_text())
    assert f"interrupted; {len(rows)} points are in {csv}" in error
    assert all(len(row) == 2 and row[1] for row in rows)


def test_effects_that_a_sweep_leaves_out_are_named(capsys: pytest.CaptureFixture[str]) -> None:
    known = ["--set", "creep=0.02", "--set", "slip_spread=0.1", "--set", "dwell_growth=0.05"]
    assert main(["sweep", "--vary", "preload=0.3:0.4:2", *known]) == 0
    assert capsys.readouterr().err.splitlines()[-1].endswith("leaves out creep, slip_spread")
    assert main(["sweep", "--vary", "preload=0.3:0.4:2", "--steps", "3", *known]) == 0
    assert "leaves out" not in capsys.readouterr().err  # runs from rest have all of them


def test_points_as_a_table(tmp_path: Path) -> None:
    """The rows of --out, without its comments; LaTeX by the ending."""
    files = [tmp_path / name for name in ("out.csv", "t.csv", "t.tex")]
    assert main([*SMALL, "--out", str(files[0]), "--table", str(files[1])]) == 0
    whole, table = (file.read_text(encoding="utf-8") for file in files[:2])
    assert rows_of(whole) == [line.split(",") for line in table.splitlines()[1:]]
    assert main([*SMALL, "--table", str(files[2])]) == 0
    assert r"\begin{tabular}{rr}" in files[2].read_text(encoding="utf-8")


def test_a_prediction_leaves_out_several_contacts_and_a_sweep_does_not(
    capsys: pytest.CaptureFixture[str],
) -> None:
    known = ["--set", "contacts=6", "--set", "contact_shares=guide"]
    assert main(["predict", *known]) == 0
    assert capsys.readouterr().err.splitlines()[-1].endswith("leaves out contacts")
    assert main(["sweep", "--vary", "preload=0.3:0.4:2", "--steps", "3", *known]) == 0
    assert "leaves out" not in capsys.readouterr().err
