# SPDX-License-Identifier: Apache-2.0
"""What ``stickslip shape`` and ``elongate`` find can be used."""

import json
from pathlib import Path

import numpy as np
import pytest

import stickslip_ros as ss
from stickslip_ros.cli.main import main
from stickslip_ros.physics.parameters import Parameters


def test_holds_that_play_no_part_do_not_come_back(capsys: pytest.CaptureFixture[str]) -> None:
    """A sawtooth ignores holds; the shaped slip found for it has none."""
    values = ("hold_before=0.5", "frequency=1000", "creep=0.02", "dwell_growth=0.01")
    assert main(["shape", "--json", *(word for one in values for word in ("--set", one))]) == 0
    output = capsys.readouterr()
    assert json.loads(output.out)["parameters"]["hold_before"] == 0.0
    idle, left_out = output.err.splitlines()
    assert idle.startswith("stickslip: without effect: hold_before: the waveform sawtooth")
    assert left_out == "stickslip shape: leaves out creep, dwell_growth"


@pytest.mark.parametrize("rate", [(), ("--generator-rate", "2e7")])
def test_the_waveform_of_elongate_is_ready_for_a_generator_and_a_table(
    tmp_path: Path, rate: tuple[str, ...]
) -> None:
    """The drive with the file makes the step that was promised."""
    file, yaml = tmp_path / "wave.csv", tmp_path / "found.yaml"
    words = ["elongate", "--set", "frequency=10000", "--waveform", str(file), "--out", str(yaml)]
    assert main([*words, *rate]) == 0
    rows = np.loadtxt(file, delimiter=",")
    assert (rows[0, 0], rows[-1, 0], rows[:, 1].max()) == (0.0, pytest.approx(1e-4), 300.0)
    found = Parameters.of(yaml)
    played = found.replace(waveform="table", waveform_table=str(file))
    steps = [ss.simulate(p, steps=40).step_size for p in (found, played)]
    assert steps[1] == pytest.approx(steps[0], abs=1e-12 if not rate else 2e-10)


def test_a_picture_of_the_waveform(tmp_path: Path) -> None:
    assert main(["shape", "--waveform", str(tmp_path / "wave.svg")]) == 0
    assert "voltage (V)" in (tmp_path / "wave.svg").read_text(encoding="utf-8")
    assert main(["shape", "--waveform", str(tmp_path / "wave.txt")]) == 2
    assert main(["shape", "--generator-rate", "1e6"]) == 2
    for rate in ("1", "nan", "inf"):  # the last two were tracebacks
        words = ["--waveform", str(tmp_path / "w.csv"), "--generator-rate", rate]
        assert main(["shape", *words]) == 2
        assert not (tmp_path / "w.csv").exists()
