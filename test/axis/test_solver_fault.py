# SPDX-License-Identifier: Apache-2.0
"""What the solver cannot do in time is a fault of the axis, and a way leads out of it."""

import contextlib
import random
import time
from collections import Counter
from typing import Any

import pytest

from stickslip_ros.axis import Axis, CommandRefused, actuation
from stickslip_ros.physics.solver import advance

FAST = {"frequency": 1000.0, "mass": 0.004, "preload": 0.4}
#: A ringing of 160 MHz without damping: no integrator gets through a cycle of 1 ms in time.
HARD = {"sigma_1": 0.0, "sigma_0_offset": 1e12, "mass": 1e-6}
SOFT = {"sigma_1": 5.0, "sigma_0_offset": 7e6, "mass": 0.004}


def test_a_budget_that_is_used_up_is_a_fault_until_a_reset() -> None:
    axis = Axis(FAST)
    axis.command("jog", 1000.0)
    axis.advance(0.01)
    axis.command("parameters", HARD)  # while it rings
    started = time.process_time()
    for k in range(2, 50):
        axis.advance(k * 0.01)
    assert time.process_time() - started < 5.0  # once, and not in every block again
    assert (axis.mode, axis.moving) == ("fault", False)
    assert "the solver cannot go on: a cycle takes more than the" in axis.status.fault
    faults = [event for event in axis.take_events() if event.outcome == "fault"]
    assert [event.details["reason"] for event in faults] == [axis.status.fault]
    with pytest.raises(CommandRefused, match="reset it first"):
        axis.command("steps", 1)
    # A reset alone leads back into it with the next cycle; other parameters lead out.
    axis.command("parameters", SOFT)
    axis.command("reset")
    axis.advance(0.6)
    before = axis.state.x
    axis.command("steps", 20)
    axis.advance(1.0)
    assert (axis.mode, axis.status.steps_done) == ("stopped", 20)
    free = Axis(FAST)
    free.command("steps", 20)
    free.advance(1.0)
    assert axis.state.x - before == pytest.approx(free.state.x, abs=200e-9)


def test_parameters_that_come_before_the_fault_are_in_force_after_the_reset() -> None:
    """The running cycle keeps the old ones to its end, which it never reaches."""
    axis = Axis(FAST)
    axis.command("jog", 1000.0)
    axis.advance(0.0105)
    axis.command("parameters", HARD)
    axis.advance(0.0112)
    axis.command("parameters", SOFT)
    axis.command("reset")  # nothing to reset yet
    axis.advance(0.05)
    assert axis.mode == "fault"
    axis.command("reset")
    axis.command("steps", 10)
    axis.advance(1.0)
    assert (axis.mode, axis.status.steps_done) == ("stopped", 10)


ANYTHING: tuple[tuple[Any, ...], ...] = (
    *(("steps", steps) for steps in (-20, 0, 1, 300)),
    *(("jog", hertz) for hertz in (1000.0, -300.0, 0.0)),
    *(("scan", volts) for volts in (0.0, 50.0, 200.0)),
    *(("position", x) for x in (1e-6, -1e-6)),
    *(("frequency", hertz) for hertz in (100.0, 3000.0)),
    *(("amplitude", volts) for volts in (100.0, 300.0)),
    *(("load", newtons) for newtons in (0.01, -0.01)),
    *(("enable", on) for on in (True, False)),
    *(("parameters", changes) for changes in (HARD, HARD, SOFT, {"preload": 1.0})),
    *((name,) for name in ("stop", "zero", "reset", "reset")),
)


def test_whatever_was_commanded_other_parameters_and_one_reset_lead_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Random commands; a small budget, so that a fault costs milliseconds."""
    monkeypatch.setattr(advance, "SLICE", 500)
    monkeypatch.setattr(actuation, "_BUDGET", 3000)
    dice = random.Random(16)
    ended: Counter[str] = Counter()
    for _ in range(50):
        axis, t, done = Axis(FAST), 0.0, []
        for _ in range(dice.randint(6, 30)):
            t += dice.choice([0.0, 1e-4, 1e-3, 7e-3, 0.03]) * dice.random()
            axis.advance(t)
            done.append(dice.choice(ANYTHING))
            with contextlib.suppress(CommandRefused):
                axis.command(*done[-1])
        axis.command("enable", True)
        axis.advance(t := t + 0.1)
        ended[axis.mode] += 1
        if not axis.fault:
            continue
        axis.command("parameters", {**SOFT, "preload": 0.4})
        axis.command("reset")
        for name, value in (("load", 0.0), ("frequency", 1000.0), ("amplitude", 300.0)):
            axis.command(name, value)
        axis.command("steps", 10)
        axis.advance(t + 2.0)
        assert (axis.mode, axis.status.steps_done) == ("stopped", 10), (axis.fault, done)
    assert ended["fault"] >= 5
