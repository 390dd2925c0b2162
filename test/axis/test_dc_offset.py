# SPDX-License-Identifier: Apache-2.0
"""The level of an actuator with a memory: scans go round its loop, whatever happens on the way."""

import random
from typing import Any

import pytest
from table_1 import TABLE_1, table_1

from stickslip_ros.axis import Axis, CommandRefused
from stickslip_ros.physics.model.actuator import Actuator

LOOP = {"actuator": "hysteresis", "scan_rate": 1000.0}
FAST = {"frequency": 1000.0}
STROKE = 160e-9  # m


def _scan(axis: Axis, volts: float) -> float:
    """Return the deflection (m) after a scan to a level."""
    axis.command("scan", volts)
    axis.advance(axis.state.t + 1.0)
    assert axis.status.state == "stopped"
    assert axis.status.scan_level == pytest.approx(volts, abs=1e-9)
    return axis.state.u


@pytest.mark.parametrize("levels", [[300, 150, 0, 150, 300], [200, 50, 120, 0, 300, -60, 10]])
def test_scans_follow_the_memory_of_the_actuator(levels: list[float]) -> None:
    """Deflection at every level is that of the play operators, each moved in turn."""
    p = table_1(**{**LOOP, "min_voltage": -60.0})
    axis, actuator = Axis(p), Actuator.of(p.actuator)
    memory = actuator.rest()
    for volts in levels:
        memory = memory.moved(volts, actuator.thresholds)
        assert _scan(axis, volts) == pytest.approx(actuator.deflection(memory), abs=1e-18)
        assert axis.state.x == pytest.approx(axis.state.u, rel=0.01, abs=5e-11)


def test_a_scan_up_and_down_shows_the_loop() -> None:
    """At half of the voltage it is as wide as the parameter says, and it closes."""
    axis = Axis({**TABLE_1, **LOOP, "hysteresis": 0.15})
    for volts in (300.0, 0.0):
        _scan(axis, volts)
    bottom = axis.state.u
    up, top, down, closed = (_scan(axis, volts) for volts in (150.0, 300.0, 150.0, 0.0))
    assert down - up == pytest.approx(0.15 * STROKE, rel=1e-9)
    assert top - bottom == pytest.approx(STROKE, rel=1e-9)
    assert closed == pytest.approx(bottom, abs=1e-18)


def test_a_scan_cut_short_and_redirected_ends_as_one_that_was_not() -> None:
    """Level and deflection are continuous, and what was passed twice is forgotten."""
    straight, halting = Axis({**TABLE_1, **LOOP}), Axis({**TABLE_1, **LOOP})
    end = _scan(straight, 280.0)
    rng = random.Random(3)
    u = 0.0
    for _ in range(40):
        if rng.random() < 0.3:
            halting.command("stop")
        else:
            halting.command("scan", rng.uniform(0.0, 250.0))
        assert halting.state.u == u
        level = halting.status.scan_level
        dt = rng.uniform(0.0, 0.1)
        halting.advance(halting.state.t + dt)
        u = halting.state.u
        assert abs(halting.status.scan_level - level) <= 1000.0 * dt + 1e-9
    assert _scan(halting, 280.0) == pytest.approx(end, abs=1e-18)


@pytest.mark.parametrize("steps", [5, -5])
def test_cycles_leave_their_mark_on_the_memory(steps: int) -> None:
    """A scan after them goes up as from the end of their loop, not as the first one did."""
    p = table_1(**{**LOOP, **FAST})
    axis, actuator = Axis(p), Actuator.of(p.actuator)
    axis.command("steps", steps)
    axis.advance(0.5)
    memory = actuator.rest().moved(300.0 if steps > 0 else -300.0, actuator.thresholds)
    before = memory.moved(0.0, actuator.thresholds)
    after = before.moved(200.0, actuator.thresholds)
    rise = actuator.deflection(after) - actuator.deflection(before)
    u = axis.state.u
    assert _scan(axis, 200.0) - u == pytest.approx(rise, rel=1e-9)
    fresh = _scan(Axis(p), 200.0)
    assert abs(fresh - rise) > 5e-9


def test_steps_after_a_scan_wait_for_the_level() -> None:
    axis = Axis({**TABLE_1, **LOOP, **FAST})
    _scan(axis, 200.0)
    axis.command("steps", 3)
    axis.advance(axis.state.t + 0.1)
    assert axis.status.steps_done == 0
    axis.advance(axis.state.t + 0.2)
    assert axis.status.steps_done == 3
    assert axis.status.scan_level == 0.0


def test_another_actuator_takes_over_at_the_same_voltage_and_deflection() -> None:
    """On the way as well; the scan still ends at its level."""
    axis = Axis({**TABLE_1, "scan_rate": 1000.0})
    axis.command("scan", 250.0)
    changes: list[dict[str, Any]] = [
        {"actuator": "hysteresis"},
        {"hysteresis": 0.3},
        {"gain": 5e-10},
        {"hysteresis": 0.0},
        {"hysteresis": 0.2},
        {"max_voltage": 320.0},
        {"actuator": "linear"},
    ]
    for k, change in enumerate(changes, 1):
        axis.advance(0.03 * k)
        before = axis.state.u
        axis.command("parameters", change)
        assert axis.state.u == before
        assert axis.status.scan_level == pytest.approx(30.0 * k, rel=1e-9)
    axis.advance(0.2501)
    assert axis.status.state == "stopped"
    assert axis.status.scan_level == pytest.approx(250.0, rel=1e-9)
    u = axis.state.u
    assert _scan(axis, 0.0) == pytest.approx(u - 250.0 * 5e-10, abs=1e-18)


@pytest.mark.parametrize("actuator", ["linear", "hysteresis"])
def test_levels_below_zero_down_to_where_the_actuator_depolarises(actuator: str) -> None:
    axis = Axis({**TABLE_1, "actuator": actuator, "min_voltage": -60.0, "scan_rate": 1000.0})
    assert _scan(axis, -60.0) < -0.6 * 60.0 * STROKE / 300.0
    assert axis.state.x == pytest.approx(axis.state.u, rel=0.01)
    with pytest.raises(
        CommandRefused, match=r"-60\.1 V is below min_voltage, -60 V, .* depolarises"
    ):
        axis.command("scan", -60.1)
    axis.command("steps", 2)
    axis.advance(axis.state.t + 0.1)
    assert axis.status.scan_level == 0.0


def test_a_closed_loop_uses_levels_below_zero() -> None:
    axis = Axis({**TABLE_1, "min_voltage": -60.0, **FAST})
    axis.command("position", -2e-8)
    axis.advance(1.0)
    assert axis.status.state == "holding"
    assert axis.status.step_count == 0
    assert axis.status.scan_level == pytest.approx(-2e-8 / STROKE * 300.0, abs=4.0)
