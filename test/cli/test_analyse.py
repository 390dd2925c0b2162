# SPDX-License-Identifier: Apache-2.0
"""``stickslip analyse`` on what ``stickslip simulate --trace`` writes."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from bench_traces import Axis, Bench, Drive, Sensor, bench_trace
from table_1 import table_1

from stickslip_ros.cli.main import main
from stickslip_ros.simulation.sampling import trace_at_rate, trace_steps
from stickslip_ros.simulation.trace import save_csv

#: First bytes of the pictures by the end of their names.
PICTURES = {"png": b"\x89PNG", "pdf": b"%PDF"}


@pytest.fixture(scope="module")
def trace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("analyse") / "run.csv"
    save_csv(trace_steps(table_1(), 4), path)
    return path


def write_bench(path: Path, bench: Bench, header: str, *factors: float) -> None:
    """Write time and position, times factors, as a table."""
    table = np.column_stack([bench.t, bench.x]) * (factors or 1.0)
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.9g")


@pytest.mark.parametrize(
    ("kind", "options"),
    [
        ("png", []),
        pytest.param("pdf", ["--runner-only", "--frequency=100"], marks=pytest.mark.long),
    ],
)
def test_json_and_picture_hold_what_was_found(
    trace: Path, tmp_path: Path, kind: str, options: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    common, picture = ["analyse", str(trace), "--zero-amplitude", "2.3e-8"], tmp_path / f"a.{kind}"
    assert main([*common, "--json", "--plot", str(picture), *options]) == bool(options)
    assert picture.read_bytes()[:4] == PICTURES[kind]
    found = json.loads(capsys.readouterr().out)
    assert found["step_size"] == pytest.approx(133.83e-9, abs=0.05e-9)
    assert found["ringing_frequency"] == pytest.approx(7549, rel=3e-3)
    assert found["points"]["D"] == [None] * (4 - bool(options))  # the last is of the actuator
    assert found["balance"]["zero_amplitude"] == 2.3e-8
    assert (found["balance"]["remainder"] is None) is bool(options)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_trace_that_ends_with_its_last_slip_warns_of_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.csv"
    save_csv(trace_steps(table_1(), 10), path)
    assert main(["analyse", str(path)]) == 0
    said = capsys.readouterr().out
    assert said.startswith("10 steps forward at 100 Hz, 0 s to 0.1 s: a step is 133.827 nm, from")


def test_the_table_names_what_is_not_there(trace: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["analyse", str(trace), "--runner-only", "--frequency", "100"]) == 1
    printed, said = capsys.readouterr()
    assert "no rest beside the run" in said
    assert "step size    133.8" in printed
    assert "Eq. 9        needs the deflection of the actuator" in printed
    assert main(["analyse", str(trace)]) == 0
    assert "0-amplitude  not measurable" in capsys.readouterr().out


def test_a_drive_faster_than_the_samples_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Joint states as in a bag, about 100 a second, of a drive at 1 kHz."""
    path = tmp_path / "joint_states.csv"
    for rate, options, code, words in (
        (100.05, [], 2, "the trace shows no steps; give the drive frequency if it is known"),
        (
            100.05,
            ["--frequency", "1000"],
            2,
            "100 samples a second show no cycles of 1000 Hz; samp",
        ),
        (103.0, [], 1, "103 samples a second are 4.2 a cycle at 24.3333 Hz; 10 are needed: sample"),
    ):
        trace = trace_at_rate(table_1(frequency=1000.0), 600, rate)
        table = np.column_stack([trace.t, trace.x, trace.u])
        np.savetxt(path, table, delimiter=",", header="t (s),x (m),u (m)", comments="")
        assert main(["analyse", str(path), *options]) == code
        assert words in capsys.readouterr().err


def test_drift_and_hum_are_told_and_taken_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Named with the option that takes them out; the steps are the same either way."""
    sensor = Sensor(rate=50e3, noise=1e-9, hum=1e-8, drift=3e-7)
    bench = bench_trace(Axis(), (Drive(12, 130.0, pause=0.06),), sensor, rest=0.06)
    path = tmp_path / "bench.csv"
    write_bench(path, bench, "t (s),x (nm)", 1.0, 1e9)
    (true,) = bench.runs
    for options in ([], ["--fit-position-drift", "--remove-hum"]):
        assert main(["analyse", str(path), "--json", "--frequency", "130", *options]) == 0
        output = capsys.readouterr()
        found = json.loads(output.out, parse_constant=pytest.fail)
        (run,) = found["runs"]
        assert abs(run["step_size"] - true.step_size) < 3.0 * run["step_size_error"]
        told = found["disturbances"]
        assert abs(told["position_drift"] - 3e-7) < 3.0 * told["position_drift_error"]
        assert told["mains"] == 50.0
        assert ("--fit-position-drift" in output.err) is not bool(options)
        assert ("hum of 50 Hz" in output.err) is not bool(options)


def test_what_the_record_does_not_hold_is_not_determined(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A record that begins and ends within cycles; a frequency that it does not have."""
    bench = bench_trace(Axis(), (Drive(14, 1000.0),), Sensor(rate=50e3, noise=1e-9), rest=6e-3)
    (true,) = bench.runs
    inner = (bench.t > true.start + 2.3e-3) & (bench.t < true.end - 2.4e-3)
    file = tmp_path / "steps.csv"
    for kept, options, words in (
        (inner, [], "are not determined: "),
        (bench.t > -1.0, ["--frequency", "700"], "are seen at 1000 Hz, not at the "),
    ):
        table = np.column_stack([bench.t[kept], bench.x[kept]])
        np.savetxt(file, table, delimiter=",", header="t (s),x (m)", comments="")
        assert main(["analyse", str(file), "--json", *options]) == 1
        shown = capsys.readouterr()
        assert words in shown.err
        for run in json.loads(shown.out)["runs"]:
            assert not run["determined"]


def test_many_measurements_make_one_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A row for each run; a file that cannot be read is a row with its reason."""
    bad, table = tmp_path / "bad.csv", tmp_path / "all.csv"
    bad.write_text("nothing\n")
    files = ["steps_100hz.csv", str(bad), "there_and_back.csv"]
    assert main(["analyse", *files, "--table", str(table)]) == 1
    assert f"{bad}: " in capsys.readouterr().out
    rows = list(csv.DictReader(table.open(encoding="utf-8")))
    assert [(row["file"], row["run"]) for row in rows] == [
        ("steps_100hz.csv", "1"),
        (str(bad), ""),
        ("there_and_back.csv", "1"),
        ("there_and_back.csv", "2"),
    ]
    assert float(rows[0]["step size (m)"]) == pytest.approx(133.8e-9, abs=0.3e-9)
    assert "no row of numbers" in rows[1]["reason"] and rows[0]["reason"] == ""
    assert main(["analyse", *files, "--plot", str(tmp_path / "a.png")]) == 2
    assert "are for a single one" in capsys.readouterr().err
