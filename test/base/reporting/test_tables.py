# SPDX-License-Identifier: Apache-2.0
"""Tables in files: read back by csv, and as LaTeX takes them."""

import csv
import math
from pathlib import Path

import pytest

from stickslip_ros.base.reporting.tables import TableError, write_table

HEADING = ("metric", "run", "100 % of_it & more")
ROWS = [("step size (µm)", 1.5e-7, "σ ± 2°"), ("none", math.nan, "a\\b{c}~^#$"), ("x", None, "")]


def test_csv_holds_every_digit(tmp_path: Path) -> None:
    file = tmp_path / "t.csv"
    write_table(file, HEADING, ROWS)
    with file.open(newline="", encoding="utf-8") as stream:
        found = list(csv.reader(stream))
    assert found[0] == list(HEADING)
    assert float(found[1][1]) == 1.5e-7
    assert found[2] == ["none", "", "a\\b{c}~^#$"]
    assert found[3] == ["x", "", ""]


def test_latex_is_a_tabular(tmp_path: Path) -> None:
    file = tmp_path / "t.tex"
    write_table(file, HEADING, ROWS)
    text = file.read_text(encoding="utf-8")
    assert r"\begin{tabular}{lrl}" in text
    assert r"$1.5 \times 10^{-7}$" in text
    assert r"none & -- & a\textbackslash{}b\{c\}" in text
    bare = text.replace(r"\&", "").replace(r"\_", "")
    assert {line.count("&") for line in bare.splitlines() if line.endswith(r"\\")} == {2}


def test_another_ending_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TableError, match=r"end it in \.csv or \.tex"):
        write_table(tmp_path / "t.xls", HEADING, ROWS)
    assert not list(tmp_path.iterdir())
