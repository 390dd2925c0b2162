# SPDX-License-Identifier: Apache-2.0
"""Waveform and actuator are parameters like others: a moving axis changes them between cycles."""

from pathlib import Path

import pytest
from table_1 import TABLE_1, table_1

from stickslip_ros.axis import Axis, CommandRefused
from stickslip_ros.model import Plant, drive_of
from stickslip_ros.solver import Simulation


def test_another_waveform_from_the_next_cycle_on() -> None:
    changes = {"waveform": "hold", "hold_before": 0.35, "actuator": "hysteresis"}
    p = table_1(frequency=1000.0)
    axis = Axis(p)
    axis.command_steps(20)
    axis.advance(7.4e-3)
    axis.set_parameters(changes)
    axis.advance(0.1)
    alone = Simulation(Plant.of(p), p.solver.tolerance)
    alone.start(drive_of(p), 8)
    alone.run_cycles(8)
    alone.start(drive_of(p.replace(**changes)), 12)
    alone.run_cycles(12)
    alone.advance(0.1)
    assert axis.state.x == pytest.approx(alone.state.x, abs=1e-15)
    assert axis.status.steps_done == 20


def test_an_impossible_waveform_is_refused(tmp_path: Path) -> None:
    """Whatever its reason: a name, a file, no time; the axis keeps what it had."""
    axis = Axis({**TABLE_1, "frequency": 1000.0})
    before = axis.parameters
    for changes, words in (
        ({"waveform": "sine"}, "known: sawtooth"),
        ({"waveform": "table", "waveform_table": str(tmp_path / "none.csv")}, "cannot read"),
        ({"waveform": "hold", "hold_before": 0.9, "hold_after": 0.2}, "lower hold_before"),
        ({"actuator": "hysteresis", "hysteresis_file": str(tmp_path)}, "cannot read"),
    ):
        with pytest.raises(CommandRefused, match=words):
            axis.set_parameters(changes)
    assert axis.parameters == before
