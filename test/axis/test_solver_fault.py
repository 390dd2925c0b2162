# SPDX-License-Identifier: Apache-2.0
"""What the solver cannot do in time is a fault of the axis, and a way leads out of it."""

from __future__ import annotations

import time

import pytest

from stickslip_ros.axis import Axis, CommandRefused

FAST = {"frequency": 1000.0, "mass": 0.004, "preload": 0.4}
#: A ringing of 160 MHz without damping: no integrator gets through a cycle of 1 ms in time.
HARD = {"sigma_1": 0.0, "sigma_0_offset": 1e12, "mass": 1e-6}
SOFT = {"sigma_1": 5.0, "sigma_0_offset": 7e6, "mass": 0.004}


def test_a_budget_that_is_used_up_is_a_fault_until_a_reset() -> None:
    axis = Axis(FAST)
    axis.command_jog(1000.0)
    axis.advance(0.01)
    axis.set_parameters(HARD)  # while it rings
    started = time.process_time()
    for k in range(2, 50):
        axis.advance(k * 0.01)
    assert time.process_time() - started < 5.0  # once, and not in every block again
    assert (axis.mode, axis.moving) == ("fault", False)
    assert "the solver cannot go on: a cycle takes more than the" in axis.status.fault
    faults = [event for event in axis.take_events() if event.outcome == "fault"]
    assert [event.details["reason"] for event in faults] == [axis.status.fault]
    with pytest.raises(CommandRefused, match="reset it first"):
        axis.command_steps(1)
    # A reset alone leads back into it with the next cycle; other parameters lead out.
    axis.set_parameters(SOFT)
    axis.reset()
    axis.advance(0.6)
    before = axis.state.x
    axis.command_steps(20)
    axis.advance(1.0)
    assert (axis.mode, axis.status.steps_done) == ("stopped", 20)
    free = Axis(FAST)
    free.command_steps(20)
    free.advance(1.0)
    assert axis.state.x - before == pytest.approx(free.state.x, abs=200e-9)
