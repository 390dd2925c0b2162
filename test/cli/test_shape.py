# SPDX-License-Identifier: Apache-2.0
"""``stickslip shape`` and ``stickslip elongate``: what they find can be used as it is printed."""

import json
from pathlib import Path

import pytest
import yaml

from stickslip_ros.cli.main import main
from stickslip_ros.parameters import Parameters, read_yaml
from stickslip_ros.traces import run_steps

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("arguments", "waveform"),
    [
        (["shape", "--set", "preload=1.0"], "shaped"),
        (["elongate", "--set", "frequency=1e4"], "hold"),
    ],
)
def test_json_table_and_file_say_the_same(
    arguments: list[str], waveform: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = tmp_path / "found.yaml"
    assert main([*arguments, "--json", "--out", str(file)]) == 0
    output = capsys.readouterr()
    assert output.err == ""
    found = json.loads(output.out, parse_constant=pytest.fail)
    p = Parameters.of(found["parameters"])
    assert p.drive.waveform == waveform
    assert read_yaml(file) == p
    assert list(tmp_path.iterdir()) == [file]
    position = run_steps(p, 300).position
    step = (position[-1] - position[-51]) / 50
    assert step == pytest.approx(found["step_after"], abs=2e-11)
    assert main(arguments) == 0
    table, _, lines = capsys.readouterr().out.partition("\n\n")
    assert f"{1e9 * found['step_after']:.3f} nm" in table
    printed = yaml.safe_load(lines)
    assert printed == {name: p.flat()[name] for name in printed}
    assert waveform in printed.values()


def test_holds_that_play_no_part_do_not_come_back(capsys: pytest.CaptureFixture[str]) -> None:
    """A sawtooth ignores holds; the shaped slip found for it has none."""
    values = ("hold_before=0.5", "frequency=1000", "creep=0.02", "dwell_growth=0.01")
    assert main(["shape", "--json", *(word for one in values for word in ("--set", one))]) == 0
    output = capsys.readouterr()
    assert json.loads(output.out)["parameters"]["hold_before"] == 0.0
    assert output.err == "stickslip shape: leaves out creep, dwell_growth\n"
