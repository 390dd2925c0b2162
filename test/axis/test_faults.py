# SPDX-License-Identifier: Apache-2.0
"""Faults on demand: each does what its name says, ends, and repeats to the last bit."""

import math
import random
from contextlib import suppress
from typing import Any

import pytest
from table_1 import TABLE_1

from stickslip_ros.axis import Axis, CommandRefused
from stickslip_ros.axis.events import Event, event_texts
from stickslip_ros.axis.faults import FAULTS
from stickslip_ros.axis.resimulation import Rerun
from stickslip_ros.physics.parameters import ParameterError

QUIET = {
    **TABLE_1,
    **{"frequency": 1000.0, "allow_faults": True, "sensor_noise": 0.0, "sensor_resolution": 0.0},
}


def with_fault(fault: str, **parameters: object) -> Axis:
    """Return an axis that has run for a while before the fault."""
    axis = Axis({**QUIET, **parameters})
    axis.command("steps", 20)
    axis.advance(0.1)
    axis.command("parameters", {"fault": fault})
    return axis


def stepped(axis: Axis, steps: int) -> float:
    """Return how far (m) so many steps lead."""
    before = axis.state.x
    axis.command("steps", steps)
    axis.advance(axis.state.t + 0.1)
    return axis.state.x - before


def test_what_the_sensor_says() -> None:
    frozen = with_fault("sensor_freeze")
    before = frozen.measured
    assert stepped(frozen, 50) > 1e-6
    assert frozen.measured == before
    assert math.isnan(with_fault("sensor_dropout").measured)
    zero = with_fault("sensor_zero 3um")
    assert zero.measured - zero.state.x == pytest.approx(3e-6)
    drift = with_fault("sensor_drift 1e-6")
    drift.advance(1.1)
    assert drift.measured - drift.state.x == pytest.approx(1e-6, rel=1e-3)
    spike = with_fault("sensor_spike")
    off = []
    for k in range(101, 401):
        spike.advance((k + 0.5) * 1e-3)
        off.append(abs(spike.measured - spike.state.x) > 0.9e-6)
    assert sum(off) == 3
    for axis in (frozen, zero, drift, spike):
        axis.command("parameters", {"fault": ""})
        assert axis.measured == pytest.approx(axis.state.x, abs=1e-12)


def test_a_closed_loop_without_readings_is_a_fault() -> None:
    axis = with_fault("sensor_dropout")
    axis.command("position", 1e-5)
    axis.advance(1.0)
    assert "the sensor gives no reading" in axis.fault
    with pytest.raises(CommandRefused, match="in fault"):
        axis.command("zero")
    axis.command("reset")
    with pytest.raises(CommandRefused, match="no reading to count from"):
        axis.command("zero")


def test_what_the_runner_does() -> None:
    stuck = with_fault("axis_stuck")
    assert abs(stepped(stuck, 50)) < 1e-11
    assert stuck.status.steps_done == 50
    stuck.command("scan", 100.0)
    stuck.advance(1.0)
    assert abs(stuck.status.position - 2.4e-6) < 1e-6
    stall, free = with_fault("axis_stall 30"), with_fault("")
    assert stepped(stall, 10) == stepped(free, 10)
    assert stepped(stall, 50) == pytest.approx(stepped(free, 20), rel=0.05)
    assert abs(stepped(stall, -50)) < 1e-11
    dirt = with_fault("dirt 5um")
    stepped(dirt, 90)
    assert 4.8e-6 < dirt.state.x <= 5e-6  # steps fall back before it
    assert stepped(dirt, -20) < -1e-6
    for axis in (stuck, stall, dirt):
        assert (axis.status.limits_hit, axis.status.held_at) == (0, "")
        axis.command("parameters", {"fault": ""})
        assert stepped(axis, 90) > 5e-6
        assert axis.status.limits_hit == 0
    slack = with_fault("preload_loss 0.9")
    slack.advance(0.11)
    left = 0.1 * slack.parameters.friction.preload
    assert slack.simulation.plant.contact.sigma_0 == pytest.approx(
        Axis({**QUIET, "preload": left}).simulation.plant.contact.sigma_0
    )
    slack.command("parameters", {"fault": ""})
    assert slack.simulation.plant == free.simulation.plant


def test_refused_named_and_not_allowed() -> None:
    axis = with_fault("refuse")
    with pytest.raises(CommandRefused, match="injected fault refuse"):
        axis.command("steps", 1)
    assert axis.status.injected == "refuse"
    axis.command("parameters", {"fault": ""})
    axis.command("steps", 1)
    named = [(e.outcome, e.details["fault"]) for e in axis.take_events() if "injected" in e.name]
    assert named == [("began", "refuse"), ("ended", "refuse")]
    for fault, complaint in (
        ("mock", "known are sensor_freeze, sensor_dropout,"),
        ("axis_stuck 3", "has no value; leave out '3'"),
        ("dirt 3kg", "fault dirt: "),
        ("axis_stall 0", "has to lie between 1 and 1e"),
    ):
        with pytest.raises(CommandRefused, match=complaint):
            axis.command("parameters", {"fault": fault})
    with pytest.raises(ParameterError, match="start the axis with allow_faults"):
        Axis({"fault": "refuse"})


def test_a_refusing_axis_can_be_paused() -> None:
    """Axes of a process share their time: one that refused would leave the others paused."""
    axis = Axis({**QUIET, "fault": "refuse"})
    with pytest.raises(CommandRefused, match="refuse"):
        axis.command("steps", 3)
    axis.command("pause", True)
    assert axis.paused


def test_random_runs_with_every_fault_repeat_bit_for_bit() -> None:
    rng = random.Random(26)
    seen: set[str] = set()
    for _ in range(12):
        axis = Axis({**QUIET, "sensor_noise": 1e-9, "sensor_bandwidth": rng.choice((0.0, 300.0))})
        states, events = [], []
        for _ in range(14):
            axis.advance(axis.actuation.t + rng.uniform(0.0, 0.05))
            states.append(axis.state)
            with suppress(CommandRefused):
                act = rng.randrange(6)
                if act < 2:
                    faults = rng.sample(sorted(FAULTS), rng.randrange(4))
                    axis.command("parameters", {"fault": ", ".join(faults)})
                    seen.update(faults)
                elif act < 4:
                    axis.command("reset")
                    axis.command("steps", rng.randrange(-150, 150))
                elif act == 4:
                    axis.command("position", rng.uniform(-1e-5, 1e-5))
                else:
                    axis.command("stop")
            events += axis.take_events()
        back = [Event.of(event_texts(event)) for event in events]
        rerun = Rerun([event for event in back if event])
        assert [rerun.advance(state.t).state for state in states] == states
    assert seen == set(FAULTS)


@pytest.mark.parametrize("change", [{"fault": "sensor_drift 1e-6"}, {"sensor_noise": 5e-9}])
def test_the_motion_knows_nothing_of_its_sensor(change: dict[str, Any]) -> None:
    """The slips that were to come had been drawn anew with each parameter."""
    lone, seen = (Axis({**QUIET, "slip_spread": 0.07, "frequency": 1.1}) for _ in range(2))
    for axis in (lone, seen):
        axis.command("steps", 3)
        axis.advance(1.1)
    seen.command("parameters", change)
    for axis in (lone, seen):
        axis.advance(2.8)
    assert seen.state.x == lone.state.x
