# SPDX-License-Identifier: Apache-2.0
"""Records that are no run of steps end every command in one sentence."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stickslip_ros.cli.main import main
from stickslip_ros.measurement.actuator_identification import identify_hysteresis
from stickslip_ros.measurement.steps import analysis
from stickslip_ros.measurement.steps.analysis import find_steps
from stickslip_ros.measurement.steps.record import TraceError
from stickslip_ros.physics.parameters import ParameterError

COUNT, TICK = 4000, 1e-4
NUMBER = np.arange(COUNT)
#: m
RECORDS = {
    "one move near the end": 8e-8 * (NUMBER > 3850),
    "one sample that stands out": 5e-8 * (NUMBER == 2000),
}
COMMANDS = {
    "analyse": ["analyse", "RECORD"],
    "analyse --to": ["analyse", "RECORD", "--to=0.39"],
    "compare": ["compare", "POINT", "RECORD"],
    "identify": ["identify", "--run", "POINT", "RECORD"],
}


@pytest.mark.parametrize("record", RECORDS)
@pytest.mark.parametrize("command", COMMANDS)
def test_a_record_without_steps_is_refused_in_a_sentence(
    tmp_path: Path, record: str, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Once what was fitted to it is taken away, nothing is left of it but rounding."""
    files = {"RECORD": tmp_path / "record.csv", "POINT": tmp_path / "point.yaml"}
    table = np.column_stack([TICK * NUMBER, RECORDS[record]])
    header = "time (s),position (m)"
    np.savetxt(files["RECORD"], table, delimiter=",", header=header, comments="", fmt="%.9g")
    files["POINT"].write_text("preload: 0.4\namplitude: 300.0\nfrequency: 100.0\n", "utf-8")
    assert main([str(files.get(word, word)) for word in COMMANDS[command]]) == 2
    said = capsys.readouterr().err.splitlines()
    (error,) = [line for line in said if line.startswith("stickslip ")]
    assert "no steps" in error


def test_what_the_search_does_not_foresee_is_an_error_with_a_cure(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail(*_: object) -> None:
        raise IndexError("index 0 is out of bounds")

    monkeypatch.setattr(analysis, "clean_record", fail)
    t: Any = TICK * NUMBER
    x = np.sin(NUMBER * 0.1)
    with pytest.raises(TraceError, match=r"index 0 .* report it with the record"):
        find_steps(t, x)


def test_a_deflection_that_is_none_has_no_loop() -> None:
    volts = 60.0 - 60.0 * np.cos(2.0 * np.pi * np.arange(1000) / 200.0)
    with pytest.raises(ParameterError, match=r"spans 1\.2e-298 m, and 1e-15 m or more show one"):
        identify_hysteresis(volts, 1e-300 * volts, 16)
