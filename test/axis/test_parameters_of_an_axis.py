# SPDX-License-Identifier: Apache-2.0
"""Parameters of an axis: limits of its drive, waveforms that change, every effect at once."""

import math
from pathlib import Path
from typing import Any

import pytest
from table_1 import TABLE_1, table_1

from stickslip_ros.axis import Axis, CommandRefused
from stickslip_ros.physics.model import Plant, drive_of
from stickslip_ros.physics.model.actuator_stages import follow
from stickslip_ros.physics.parameters import ParameterError
from stickslip_ros.physics.solver import Simulation
from stickslip_ros.simulation.steps import run_steps

MCS = {"max_voltage": 100.0, "amplitude": 100.0, "amplitude_levels": 4095}


def test_an_amplitude_is_rounded_to_the_levels_and_told_as_applied() -> None:
    axis = Axis({**TABLE_1, **MCS})
    level = 100.0 / 4095
    axis.command("amplitude", 33.0)
    assert axis.status.amplitude == pytest.approx(1351 * level, rel=1e-12)
    axis.command("scan", 33.0)
    axis.advance(1.0)
    assert axis.status.scan_level == pytest.approx(1351 * level, rel=1e-9)
    axis.command("amplitude", 100.0)
    with pytest.raises(CommandRefused, match=r"0\.01 V, less than half a level"):
        axis.command("amplitude", 0.01)
    assert axis.status.amplitude == 100.0
    axis = Axis({**TABLE_1, **MCS, "amplitude": 50.01})
    assert axis.status.amplitude == pytest.approx(2048 * 100.0 / 4095)


def test_more_steps_than_a_command_may_have_are_refused() -> None:
    axis = Axis({**TABLE_1, "max_steps": 30_000})
    axis.command("steps", -30_000)
    with pytest.raises(CommandRefused, match="30001 steps; a command may have at most 30000"):
        axis.command("steps", 30_001)
    axis.command("steps", 0)


@pytest.mark.parametrize("command", ["frequency", "jog"])
def test_a_frequency_below_the_lowest_is_refused(command: str) -> None:
    axis = Axis({**TABLE_1, "min_frequency": 1.0})
    with pytest.raises(CommandRefused, match=r"0\.5 Hz; it has to lie between 1 and"):
        axis.command(command, 0.5)
    axis.command("frequency", 1.0)


@pytest.mark.parametrize(
    ("parameters", "complaint"),
    [
        ({"preload": math.inf}, "finite"),
        ({"frequency": 1e9}, r"frequency is 1e\+09 Hz"),
        ({"slewrate": 0.01}, "leaves 10000 us a cycle"),
        ({"travel_low": 0.0, "travel_high": 0.0}, "travel_low and travel_high are 0 m; the runner"),
        ({"min_frequency": 200.0}, "frequency is 100 Hz"),
        ({"soft_low": 1e-3, "soft_high": 1e-3}, "soft_low is 0.001 m; it has to be less"),
        ({"amplitude_levels": 2, "amplitude": 10.0}, "less than half a level"),
    ],
)
def test_an_axis_that_cannot_be_is_not_made(parameters: dict[str, Any], complaint: str) -> None:
    """And one that runs does not become it."""
    with pytest.raises(ParameterError, match=complaint):
        Axis({**TABLE_1, **parameters})
    if not {"amplitude", "frequency", "travel_low"} & set(parameters):
        axis = Axis(TABLE_1)
        with pytest.raises(CommandRefused, match=complaint):
            axis.command("parameters", parameters)


def test_another_waveform_from_the_next_cycle_on() -> None:
    changes = {"waveform": "hold", "hold_before": 0.35, "actuator": "hysteresis"}
    p = table_1(frequency=1000.0)
    axis = Axis(p)
    axis.command("steps", 20)
    axis.advance(7.4e-3)
    axis.command("parameters", changes)
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
            axis.command("parameters", changes)
    assert axis.parameters == before


EVERYTHING: dict[str, Any] = {
    "actuator": "hysteresis",
    "hysteresis": 0.15,
    "actuator_memory": True,
    "creep": 0.015,
    "amplifier_bandwidth": 2e5,
    "amplifier_slew": 80.0,
    "actuator_resonance": 2e5,
    "actuator_damping": 0.2,
    "surface_spread": 0.1,
    "slip_spread": 0.02,
    "dwell_growth": 0.03,
    "rate_growth": 0.02,
    "wear_rate": 100.0,
    "gain_temperature": 1e-3,
    "friction_temperature": -5e-4,
    "sensor_bandwidth": 5e3,
    "sensor_noise_corner": 20.0,
    "sensor_drift": 1e-10,
}


def _axis(**changes: Any) -> Axis:
    return Axis({**TABLE_1, **EVERYTHING, **changes})


def test_an_axis_steps_as_the_run_of_steps() -> None:
    axis = _axis()
    axis.command("steps", 5)
    axis.advance(0.05)
    run = run_steps(table_1(**EVERYTHING), 5)
    assert axis.status.steps_done == 5
    assert axis.actuation.sim.position_of_cycle == run.position[-1]


def test_the_closed_loop_holds_a_target_against_hysteresis_and_creep() -> None:
    axis = _axis(frequency=1000.0, sensor_drift=0.0)
    for target in (5e-6, 4.9e-6, -1e-6):
        axis.command("position", target)
        axis.advance(axis.state.t + 1.0)
        assert axis.status.target_reached
        assert axis.state.x == pytest.approx(target, abs=2.5e-9)
    # Or a running axis compiles for seconds.
    assert len(follow.signatures) == 1  # type: ignore[attr-defined]


def test_a_scan_creeps_after_it_has_arrived() -> None:
    axis = _axis(creep=0.02)
    axis.command("scan", 300.0)
    axis.advance(1.03)  # 1 s after the end of the ramp
    before = axis.state.u
    assert axis.status.scan_level == pytest.approx(300.0)
    axis.advance(10.03)
    assert axis.state.u - before == pytest.approx(0.02 * before, rel=0.05)
    assert axis.state.x == pytest.approx(axis.state.u, rel=0.05)  # the runner is carried along


def test_what_belongs_to_the_simulation_is_set_at_the_start_only() -> None:
    axis = _axis()
    with pytest.raises(CommandRefused, match="amplifier_bandwidth can be set at the start only"):
        axis.command("parameters", {"amplifier_bandwidth": 1e5})


def test_parameters_change_however_long_a_creeping_actuator_has_stood() -> None:
    """Its course at rest is known for a second, and after that there was none to go on with."""
    axis = Axis({**TABLE_1, "creep": 0.045})
    axis.advance(5.0)
    axis.command("parameters", {"mass": 4e-4})
    axis.command("steps", 20)
    axis.advance(6.0)
    early = Axis({**TABLE_1, "creep": 0.045, "mass": 4e-4})
    early.command("steps", 20)
    early.advance(1.0)
    assert axis.state.x == pytest.approx(early.state.x, abs=1e-9)
