# SPDX-License-Identifier: Apache-2.0
"""An axis with every effect on: commands, closed loop and scans meet them, and runs repeat."""

from typing import Any

import pytest
from table_1 import TABLE_1, table_1

from stickslip_ros.axis import Axis
from stickslip_ros.axis.events import CommandRefused
from stickslip_ros.model.actuator_stages import follow
from stickslip_ros.traces import run_steps

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
    axis.command_steps(5)
    axis.advance(0.05)
    run = run_steps(table_1(**EVERYTHING), 5)
    assert axis.status.steps_done == 5
    assert axis.actuation.sim.position_of_cycle == run.position[-1]


@pytest.mark.slow
def test_the_closed_loop_holds_a_target_against_hysteresis_and_creep() -> None:
    axis = _axis(frequency=1000.0, sensor_drift=0.0)
    for target in (5e-6, 4.9e-6, -1e-6):
        axis.command_position(target)
        axis.advance(axis.state.t + 1.0)
        assert axis.status.target_reached
        assert axis.state.x == pytest.approx(target, abs=2.5e-9)
    # Or a running axis compiles for seconds.
    assert len(follow.signatures) == 1  # type: ignore[attr-defined]


@pytest.mark.slow
def test_a_scan_creeps_after_it_has_arrived() -> None:
    axis = _axis(creep=0.02)
    axis.command_scan(300.0)
    axis.advance(1.03)  # 1 s after the end of the ramp
    before = axis.state.u
    assert axis.status.scan_level == pytest.approx(300.0)
    axis.advance(10.03)
    assert axis.state.u - before == pytest.approx(0.02 * before, rel=0.05)
    assert axis.state.x == pytest.approx(axis.state.u, rel=0.05)  # the runner is carried along


def test_what_belongs_to_the_simulation_is_set_at_the_start_only() -> None:
    axis = _axis()
    with pytest.raises(CommandRefused, match="amplifier_bandwidth can be set at the start only"):
        axis.set_parameters({"amplifier_bandwidth": 1e5})


def test_parameters_change_however_long_a_creeping_actuator_has_stood() -> None:
    """Its course at rest is known for a second, and after that there was none to go on with."""
    axis = Axis({**TABLE_1, "creep": 0.045})
    axis.advance(5.0)
    axis.set_parameters({"mass": 4e-4})
    axis.command_steps(20)
    axis.advance(6.0)
    early = Axis({**TABLE_1, "creep": 0.045, "mass": 4e-4})
    early.command_steps(20)
    early.advance(1.0)
    assert axis.state.x == pytest.approx(early.state.x, abs=1e-9)
