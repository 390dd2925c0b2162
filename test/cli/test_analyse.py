# SPDX-License-Identifier: Apache-2.0
"""``stickslip analyse`` on what ``stickslip simulate --trace`` writes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from table_1 import table_1

from stickslip_ros.cli.main import main
from stickslip_ros.traces import save_csv, trace_steps

pytestmark = pytest.mark.usefixtures("compiled_solver")


@pytest.fixture(scope="module")
def trace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("analyse") / "run.csv"
    save_csv(trace_steps(table_1(), 4), path)
    return path


@pytest.mark.parametrize("options", [[], ["--runner-only"]])
def test_json_holds_what_was_found(
    trace: Path, options: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["analyse", str(trace), "--json", "--zero-amplitude", "2.3e-8", *options]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["step_size"] == pytest.approx(133.83e-9, abs=0.05e-9)
    assert found["ringing_frequency"] == pytest.approx(7549, rel=1e-3)
    assert found["points"]["D"] == [None] * 4
    assert found["balance"]["zero_amplitude"] == 2.3e-8
    assert (found["balance"]["remainder"] is None) is bool(options)


def test_the_table_names_what_is_not_there(trace: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["analyse", str(trace), "--runner-only"]) == 0
    printed = capsys.readouterr().out
    assert "step size    133.8" in printed
    assert "0-amplitude  not measurable" in printed


def test_bad_use(tmp_path: Path, trace: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = tmp_path / "other.csv"
    other.write_text("a,b\n1,2\n", encoding="utf-8")
    empty = tmp_path / "empty.csv"
    empty.touch()
    broken = tmp_path / "broken.csv"
    broken.write_text(trace.read_text(encoding="utf-8")[:-40] + "x\n", encoding="utf-8")
    for arguments, words in (
        ([str(tmp_path / "none.csv")], "cannot read"),
        ([str(other)], "its first line has to be time (s),runner (m)"),
        ([str(broken)], "holds no trace"),
        ([str(empty)], "its first line has to be time (s),runner (m)"),
        ([str(trace), "--zero-amplitude", "nan"], "--zero-amplitude is nan m"),
        ([str(trace), "--zero-amplitude", "-1e-9"], "--zero-amplitude is -1e-09 m"),
        ([str(trace), "--frequency", "0"], "--frequency is 0 Hz"),
        ([str(trace), "--frequency", "1"], "correct the frequency"),
    ):
        assert main(["analyse", *arguments]) == 2
        error = capsys.readouterr().err
        assert words in error
        assert error.count("\n") == 1
