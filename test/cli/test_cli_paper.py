# SPDX-License-Identifier: Apache-2.0
"""``stickslip paper`` as a user meets it: output, exit codes, errors."""

import csv
from pathlib import Path

import pytest

from stickslip_ros import paper
from stickslip_ros.cli.main import main

QUICK = ("tab03", "fig11", "tab05")


def test_verdicts_are_printed_and_the_page_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    quickest = tuple(claim for claim in paper.CLAIMS if claim.name in QUICK)
    monkeypatch.setattr(paper, "CLAIMS", quickest)
    out = tmp_path / "report"
    table = tmp_path / "numbers.csv"
    assert main(["paper", "--out", str(out), "--table", str(table)]) == 0
    rows = list(csv.DictReader(table.read_text(encoding="utf-8").splitlines()))
    assert {row["claim"] for row in rows} <= set(QUICK)
    forces = [float(row["simulated"]) for row in rows if row["claim"] == "tab05"]
    assert forces
    assert all(row["verdict"] in ("holds", "does not hold", "") for row in rows)
    output = capsys.readouterr()
    lines = output.out.splitlines()
    assert lines.pop(0) == "3 claims; all take about a minute"
    assert [line.split()[0] for line in lines[:-1]] == ["tab03", "fig11", "tab05"]
    assert lines[0].endswith("Runner materials: data only")
    assert lines[1].endswith("agrees in kind; joint set agrees in kind")
    assert lines[-1] == f"report: {out / 'index.html'}"
    assert "could not be computed" not in output.err
    assert (out / "tab05.csv").is_file()
    assert main(["paper", "--out", str(table / "report")]) == 2
    assert f"cannot write {table / 'report'}" in capsys.readouterr().err


def test_an_item_that_fails_is_named_with_exit_code_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail() -> paper.Result:
        raise ValueError("no such law")

    broken = paper.Claim("fig99", "broken", "Fig. 99", "it steps", "a drive", fail, ())
    monkeypatch.setattr(paper, "CLAIMS", (broken,))
    assert main(["paper", "--out", str(tmp_path / "report")]) == 1
    assert "stickslip paper: fig99 could not be computed: ValueError: no such law" in (
        capsys.readouterr().err
    )
    assert "no such law" in (tmp_path / "report" / "index.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_items_are_chosen_by_name_and_one_is_drawn(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, picture = tmp_path / "report", tmp_path / "fig08.svg"
    assert main(["paper", "fig08", "--out", str(out)]) == 0
    assert {path.stem for path in out.iterdir()} == {"contents", "fig08", "fig08_joint", "index"}
    assert main(["paper", "fig08", "--plot", str(picture), "--out", str(tmp_path / "no")]) == 0
    assert "<svg" in picture.read_text(encoding="utf-8")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["fig08.svg", "report"]
