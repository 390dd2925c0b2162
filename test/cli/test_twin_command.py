# SPDX-License-Identifier: Apache-2.0
"""``stickslip twin`` over tables and bags: what it prints, writes and refuses."""

import json
from pathlib import Path

import numpy as np
import pytest

from stickslip_ros.cli.main import main
from stickslip_ros.measurement.bags.load_motion import load_motion
from stickslip_ros.measurement.twin import TwinCommand
from stickslip_ros.measurement.twin.recording import read_log
from stickslip_ros.physics.model import Plant
from stickslip_ros.physics.model.waveforms import command_of
from stickslip_ros.physics.parameters import Parameters, yaml_text
from stickslip_ros.physics.solver import Simulation

BAG = Path(__file__).parents[1] / "golden" / "bags" / "plain"


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Readings of 400 steps, 2 nm of noise, whose preload falls by a fifth after 200."""
    random, p = np.random.default_rng(1), Parameters.of(frequency=100.0)
    simulation = Simulation(Plant.of(p), 1e-11)
    simulation.start(command_of(p), 400)
    times = 0.01 * (np.arange(400) + 0.3 + 0.3 * random.random(400))
    x = [*simulation.sample(times[:200]).x]
    simulation.advance(2.0)
    simulation.set_plant(Plant.of(p.replace(preload=0.32)), 1e-11)
    x += [*simulation.sample(times[200:]).x]
    rows = [
        f"{t!r},{1e9 * one + 2.0 * random.standard_normal()!r},{400 * (k == 0)},100"
        for k, (t, one) in enumerate(zip(times.tolist(), x, strict=True))
    ]
    path = tmp_path_factory.mktemp("twin") / "axis.csv"
    path.write_text("\n".join(["time (s),position (nm),steps,frequency (Hz)", *rows]))
    return path


def _with_start(table: Path) -> list[str]:
    """Return a drive file's options: the steps begin at 0, before the first reading."""
    drive = table.with_name("drive.csv")
    drive.write_text("time,command,value\n0,frequency,100\n0,steps,400\n")
    return ["--drive", str(drive)]


@pytest.mark.long
def test_change_page_table_and_picture(
    table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page, picture, out = (tmp_path / name for name in ("a.html", "a.png", "a.csv"))
    files = ["--report", str(page), "--plot", str(picture), "--table", str(out)]
    asked = ["--predict-steps", "100", "--predict-position", "60um", "--json"]
    assert main(["twin", str(table), *_with_start(table), *files, *asked]) == 1
    found = json.loads(capsys.readouterr().out)
    (change,) = found["changes"]
    assert 2.0 < change["told"] < 2.5 and abs(change["onset"] - 2.0) < 0.1
    assert found["level"] == "changed"
    steps, there = found["predictions"]
    assert steps["end"] - steps["begin"] == pytest.approx(1.0)
    assert abs(there["position"] - 60e-6) < 70e-9
    assert "Residual" in page.read_text(encoding="utf-8") and picture.stat().st_size > 5000
    assert len(out.read_text().splitlines()) == 400


@pytest.mark.long
def test_columns_and_drive_file_are_told_the_same_way(
    table: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = read_log(table)
    first = log[2]
    assert not isinstance(first, TwinCommand)
    assert log[:2] == [
        TwinCommand(first[0], "frequency", 100.0),
        TwinCommand(first[0], "steps", 400.0),
    ]
    wrong = ["--set", "preload=0.8", "--set", "mu=0.4", *_with_start(table)]
    assert main(["twin", str(table), *wrong]) == 1
    assert "the file is not of this axis" in capsys.readouterr().out


def test_a_bag_of_the_axis_itself_fits(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = load_motion(BAG)
    assert {"start", "steps"} <= {one.name for one in read_log(BAG) if isinstance(one, TwinCommand)}
    config = tmp_path / "axis.yaml"
    config.write_text(yaml_text(Parameters.of(found.parameters)))
    assert main(["twin", str(BAG), "--config", str(config)]) == 0
    out = capsys.readouterr().out
    assert "step size" in out and "change:" not in out


@pytest.mark.parametrize(
    ("drive", "message"),
    [
        ("time,command,value\n0,hop,3\n", "no command 'hop'"),
        ("time,command,value\nsoon,steps,3\n", "line 2"),
        ("when,what\n0,steps\n", "columns time (s)"),
        (None, "no column steps"),
    ],
)
def test_bad_commands_are_bad_use(
    table: Path, tmp_path: Path, drive: str | None, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    plain = tmp_path / "plain.csv"
    rows = [",".join(row.split(",")[:2]) for row in table.read_text().splitlines()]
    plain.write_text("\n".join(rows))
    more = []
    if drive is not None:
        (tmp_path / "drive.csv").write_text(drive)
        more = ["--drive", str(tmp_path / "drive.csv")]
    assert main(["twin", str(plain), *more]) == 2
    assert message in capsys.readouterr().err
    assert main(["twin", str(table), "--noise", "0"]) == 2
    assert "noise is 0" in capsys.readouterr().err


def test_a_damaged_line_of_a_fit_is_bad_use(
    table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "fitted.yaml"
    config.write_text('# ensemble: {"names": ["preload"]}\n' + yaml_text(Parameters.of()))
    assert main(["twin", str(table), "--config", str(config)]) == 2
    assert "'# ensemble' is damaged" in capsys.readouterr().err


def test_doubled_late_and_missing_rows_are_told(
    table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    head, *rows = table.read_text().splitlines()
    rows = rows[:199]
    rows[100:100] = [rows[50], rows[99], "0.99,,0,100"]
    damaged = tmp_path / "damaged.csv"
    damaged.write_text("\n".join([head, *rows]))
    assert main(["twin", str(damaged), *_with_start(table)]) == 0
    out = capsys.readouterr().out
    for trouble in ("late readings: 1", "doubled readings: 1", "readings that are no numbers: 1"):
        assert trouble in out
