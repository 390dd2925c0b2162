# SPDX-License-Identifier: Apache-2.0
"""Drive cycles that end elsewhere than they began, and the actuator's level across them."""

import numpy as np
import pytest
from reference import follow
from table_1 import table_1

from stickslip_ros.model import DriveCycle, Plant, drive_of, ramp
from stickslip_ros.parameters import ParameterError
from stickslip_ros.solver import Simulation

P = table_1(frequency=1e3)
CYCLE = drive_of(P)
BACK = drive_of(P, -1)


def new() -> Simulation:
    return Simulation(Plant.of(P), P.solver.tolerance)


@pytest.mark.parametrize("distance", [80e-9, -80e-9, 0.0])
def test_a_ramp_is_one_segment_without_a_slip(distance: float) -> None:
    drive_cycle = ramp(distance, 0.02)
    assert len(drive_cycle.durations) == 1
    assert drive_cycle.shift == pytest.approx(distance, rel=1e-15)
    assert (drive_cycle.period, drive_cycle.slip) == (0.02, -1)
    assert drive_cycle.sign == (-1 if distance < 0.0 else 1)


@pytest.mark.parametrize("duration", [0.0, -1.0, np.inf, np.nan])
def test_a_ramp_takes_time(duration: float) -> None:
    with pytest.raises(ParameterError, match=f"duration of a ramp is {duration:g} s"):
        ramp(1e-9, duration)


def test_a_closed_drive_cycle_shifts_nothing() -> None:
    assert CYCLE.shift == 0.0
    assert DriveCycle(np.array([1e-3, 2e-3]), np.array([3e-5, -1e-5]), 1, 1).shift == pytest.approx(
        1e-8
    )


def test_open_drive_cycles_run_once() -> None:
    simulation = new()
    with pytest.raises(ValueError, match=r"2 times a drive cycle that ends 1e-08 m from where"):
        simulation.start(ramp(1e-8, 1.0), 2)
    simulation.start(CYCLE, 3)  # what was refused has left nothing behind
    simulation.run_cycles(3)
    assert simulation.state.u == 0.0


def test_a_scan_carries_the_runner_and_holds_the_level() -> None:
    """Slow enough not to slip: the runner goes along with u, and u stays where it was led."""
    simulation = new()
    simulation.start(ramp(90e-9, 0.1), 1)
    simulation.advance(0.05)
    assert simulation.state.u == pytest.approx(45e-9, rel=1e-12)
    simulation.advance(0.3)
    state = simulation.state
    assert state.u == pytest.approx(90e-9, rel=1e-12)
    assert state.rate == 0.0
    assert state.x == pytest.approx(90e-9, abs=1e-15)
    assert (simulation.cycles_done, simulation.cycles_left) == (1, 0)
    assert np.isnan(simulation.backstep)
    assert not simulation.stepping_back


@pytest.mark.parametrize("replay", [True, False])
def test_u_is_continuous_over_patterns_and_rests(replay: bool) -> None:
    """Cut short, led elsewhere, resting: u never jumps, and u' is what it rises by."""
    simulation = Simulation(Plant.of(P), P.solver.tolerance, replay)
    commands = [
        (0.0, CYCLE, 7),
        (4.3e-3, ramp(50e-9, 2e-3), 1),
        (5.1e-3, ramp(-70e-9, 1e-3), 1),  # redirected half-way
        (7.5e-3, BACK, 3),
        (9.9994e-3, CYCLE, 2),
    ]
    t, dt, before = 0.0, 0.7e-6, simulation.state
    while t < 14e-3:
        if commands and commands[0][0] <= t:
            _, drive_cycle, count = commands.pop(0)
            simulation.start(drive_cycle, count)
            assert simulation.state.u == before.u
        t += dt
        simulation.advance(t)
        now = simulation.state
        assert abs(now.u - before.u) <= 53.4e-3 * dt
        before = now
    assert not commands


def test_closed_patterns_bring_u_back_exactly() -> None:
    """However many cycles, at their ends u is exactly where they began."""
    simulation = new()
    simulation.start(ramp(33.3e-9, 1e-3), 1)
    simulation.advance(2e-3)
    level = simulation.state.u
    for drive_cycle, count in ((CYCLE, 1001), (BACK, 777)):
        simulation.start(drive_cycle, count)
        for part in (1, count // 2, count - 1 - count // 2):
            simulation.run_cycles(part)
            assert simulation.state.u == level
    simulation.advance(simulation.state.t + 1.0)
    assert simulation.state.u == level


def test_a_drive_cycle_in_the_middle_of_another_begins_where_that_one_was() -> None:
    """Position, velocity and deflection go on; the general integrator finds the same way."""
    scan, back = ramp(100e-9, 1e-3), ramp(-60e-9, 0.5e-3)
    simulation = new()
    simulation.start(scan, 1)
    simulation.advance(0.35e-3)
    before = simulation.state
    simulation.start(back, 1)
    assert simulation.state == before
    simulation.advance(0.85e-3)
    assert simulation.state.u == pytest.approx(-25e-9, abs=1e-20)
    kinked = DriveCycle(np.array([0.35e-3, 0.5e-3]), np.append(scan.rates, back.rates), -1, 1)
    expected = follow(P, kinked, [0.85e-3])[0]
    assert simulation.state.x == pytest.approx(expected, abs=1e-12)
