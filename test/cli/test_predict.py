# SPDX-License-Identifier: Apache-2.0
"""``stickslip guide``: Table 5 on the command line."""

import json

import pytest

from stickslip_ros.cli.main import main


def test_table_5_is_what_it_prints(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["guide"]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert lines[0] == ["A", "74.3", "mN"]
    assert lines[6] == ["sum", "0.566", "N"]
    assert lines[8] == ["ratio", "2.83"]


def test_json_in_si_units(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--mass", "0.003", "--inclination", "0", "--preload", "1.0", "--json"]
    assert main(["guide", *arguments]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["forces"]["E"] == pytest.approx(0.5**0.5)  # upright: nothing across the axis
    assert found["sum"] == pytest.approx(sum(found["forces"].values()))
    assert found["ratio"] == pytest.approx(8.0**0.5)
