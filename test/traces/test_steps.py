# SPDX-License-Identifier: Apache-2.0
"""Step size, backstep and 0-amplitude of a run from rest."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from table_1 import table_1

from stickslip_ros.model import Plant, drive_of
from stickslip_ros.motion.sampling import trace_steps
from stickslip_ros.motion.settled import MEASURABLE, SETTLING, settled_from, settled_mean
from stickslip_ros.motion.steps import run_steps
from stickslip_ros.parameters import ParameterError
from stickslip_ros.simulation.operating_points import zero_amplitude
from stickslip_ros.solver import Simulation


def test_the_settled_mean_leaves_out_the_start_and_what_is_missing() -> None:
    start = [100.0] * SETTLING
    assert settled_mean(np.array([*start, 1.0, math.nan, 3.0, 2.0])) == 2.0
    assert settled_mean(np.array([100.0, 5.0, 7.0])) == 6.0  # of few, the later half
    assert settled_mean(np.array([5.0])) == 5.0
    assert math.isnan(settled_mean(np.array([])))
    assert math.isnan(settled_mean(np.array([math.nan])))
    kept = [steps - settled_from(steps) for steps in range(1, 16)]
    assert kept == [1, 1, 2, 2, 3, 3, 4, 4, 4, 4, 4, 5, 6, 7, 8]  # eight kept one, seven kept four


def test_positions_and_steps_belong_together() -> None:
    run = run_steps(table_1(), 12)
    assert run.position.shape == (12,)
    assert run.step_size == pytest.approx((run.position[11] - run.position[6]) / 5, rel=1e-12)


def test_backward_is_forward_in_the_mirror() -> None:
    """The contact knows no direction: with no load the motion is the same but for the sign."""
    there, back = run_steps(table_1(), 15), run_steps(table_1(), -15)
    assert np.array_equal(there.position, -back.position)
    assert back.step_size == -there.step_size
    assert back.backstep == there.backstep


def test_the_backstep_is_how_far_the_runner_falls_back_after_a_slip() -> None:
    """Held against the lowest of many samples of the motion after a slip.

    A single step falls back into rest. Of many steps those count that are followed by another: the
    actuator, rising again, catches the runner a nanometre earlier.
    """
    p = table_1()
    for steps, sampled in ((1, 1), (12, 11), (40, 20)):
        simulation = Simulation(Plant.of(p), p.solver.tolerance)
        drive_cycle = drive_of(p)
        simulation.start(drive_cycle, steps)
        slip = sampled * drive_cycle.period - float(drive_cycle.durations[1])
        simulation.advance(slip)
        top = simulation.state.x
        low = float(simulation.sample(np.linspace(slip, slip + 2e-4, 20_000)).x.min())
        assert simulation.backstep == pytest.approx(top - low, abs=1e-13)
        assert run_steps(p, steps).backstep == pytest.approx(top - low, abs=1e-12)


@pytest.mark.parametrize("split", [0.3, 0.7])
def test_the_backstep_of_a_slip_in_parts_ends_at_the_lowest_turn(split: float) -> None:
    """The runner turns between the parts, falls on, and is deepest after the last of them."""
    p = table_1(waveform="shaped", preload=1.0, split=split, latency=8e-5)
    drive_cycle, cycle = drive_of(p), 9
    slip = cycle * drive_cycle.period + float(np.sum(drive_cycle.durations[: drive_cycle.slip]))
    trace = trace_steps(p, 12)
    after = (trace.t > slip) & (trace.t < slip + 0.1 * drive_cycle.period)
    fall = float(np.interp(slip, trace.t, trace.x)) - trace.x[after]
    turned = int(np.argmax((trace.v[after][1:] > 0.0) & (trace.v[after][:-1] < 0.0)))
    assert fall[turned] < 0.8 * fall.max()  # or this test would show nothing
    assert run_steps(p, 12).backstep == pytest.approx(fall.max(), abs=0.2e-9)


def test_long_runs_are_told_of_and_made_of_one_piece() -> None:
    told: list[int] = []
    p = table_1(frequency=20_000.0)
    run = run_steps(p, 20_001, told.append)
    assert told == [10_000, 10_000, 1]
    simulation = Simulation(Plant.of(p), p.solver.tolerance)
    simulation.start(drive_of(p), 20_001)
    assert np.array_equal(run.position, simulation.run_cycles(20_001).position)


def test_an_impossible_drive_is_refused() -> None:
    with pytest.raises(ParameterError, match="amplitude is 301 V"):
        run_steps(table_1(amplitude=301.0), 1)


@pytest.mark.parametrize(
    "parameters", [{}, {"preload": 1.0}, {"model": "epm_fix", "z_ba": 5e-8, "z_ss": 1e-7}]
)
def test_above_the_zero_amplitude_it_steps_below_it_does_not(parameters: dict[str, Any]) -> None:
    p = table_1(**parameters)
    zero = zero_amplitude(p)
    assert zero is not None
    for factor, steps in ((0.98, False), (1.02, True)):
        run = run_steps(p.replace(amplitude=factor * zero / p.actuator.gain), 12)
        assert (run.step_size >= MEASURABLE) is steps


def test_the_zero_amplitude_does_not_hang_on_the_amplitude() -> None:
    assert zero_amplitude(table_1(amplitude=10.0)) == zero_amplitude(table_1())


def test_where_nothing_steps_there_is_no_zero_amplitude() -> None:
    assert zero_amplitude(table_1(preload=20.0)) is None


def test_the_zero_amplitude_fits_into_the_cycle() -> None:
    """At 90 kHz and 30 V/us a cycle has room for the slip of 333 V, at 10 V/us for 111 V only."""
    fast = {"frequency": 90e3, "slewrate": 10.0, "amplitude": 100.0}
    zero = zero_amplitude(table_1(**fast))
    assert zero is None or zero < 111.2 * table_1().actuator.gain
