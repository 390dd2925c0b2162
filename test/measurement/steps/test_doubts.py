# SPDX-License-Identifier: Apache-2.0
"""What a record does not determine is said with its reason."""

import math

import numpy as np
import pytest
from bench_traces import Axis, Drive, Sensor, bench_trace
from records import bench

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.steps.analysis import find_steps
from stickslip_ros.measurement.steps.drive import Drive as Known


def doubts(t: Array, x: Array, frequency: float | None = None) -> str:
    """Return all doubts about a record."""
    runs = find_steps(t, x, Known.given(frequency)).runs
    assert runs
    return "; ".join(one for run in runs for one in run.doubts)


def test_without_rest_step_and_drift_are_not_told_apart() -> None:
    made = bench(20, 500.0)
    true = made.runs[0]
    inside = (made.t > true.start + 4.6e-3) & (made.t < true.end - 5.4e-3)
    assert "no rest beside the run" in doubts(made.t[inside], made.x[inside])


def test_a_run_that_is_cut_off_is_said() -> None:
    made = bench(20, 500.0)
    limit = np.interp(made.runs[0].end - 8e-3, made.t, made.x)
    assert "it was cut off there" in doubts(made.t, np.minimum(made.x, limit))


def test_too_few_samples_are_said() -> None:
    made = bench(40, 500.0, Sensor(rate=2100.0, noise=1e-9))
    assert "Hz; 5 are needed" in doubts(made.t, made.x, 500.0)


def test_uneven_slips_are_no_run_that_is_determined() -> None:
    drives = tuple(Drive(1, 500.0 * 1.03**k, pause=6e-3 if k == 0 else 0.0) for k in range(14))
    made = bench_trace(Axis(), drives, Sensor(rate=1e5, noise=1e-9), rest=6e-3)
    assert not any(run.determined for run in find_steps(made.t, made.x).runs)


def test_a_step_within_its_noise_is_not_clear() -> None:
    made = bench(6, 500.0, Sensor(rate=1e4, noise=1.5e-7))
    for run in find_steps(made.t, made.x, Known.given(500.0)).runs:
        assert not run.determined


@pytest.mark.parametrize("rate", [1e3, 1e4, 2e4, 5e4, 1e5, 1e6])
def test_a_backstep_is_right_or_not_determined_at_any_rate(rate: float) -> None:
    """At 1 kHz, a backstep of 6.5 nm had been determined where it is 87 nm."""
    made = bench(30, 50.0 if rate < 1e4 else 200.0, Sensor(rate=rate))
    for run in find_steps(made.t, made.x).runs:
        if math.isfinite(run.backstep):
            off = abs(run.backstep - made.runs[0].backstep)
            assert off < max(3.0 * run.backstep_error, 1e-9)
        else:
            assert run.why_no_backstep


def test_hum_is_claimed_from_two_of_its_periods_on() -> None:
    for cycles, claimed in ((8, False), (120, True)):
        made = bench(cycles, 1000.0)
        x = made.x + 2e-8 * np.sin(2.0 * np.pi * 50.0 * made.t)
        assert find_steps(made.t, x, Known.given(1000.0)).disturbances.hums == claimed


def test_a_runner_that_jumps_the_way_it_steps_is_doubted() -> None:
    """A load carried it off, and its ringing was taken for slips the other way."""
    made = bench(30, 125.0)
    run = made.runs[0]
    carried = 1.4 * run.step_size * 125.0 * np.clip(made.t - run.start, 0.0, run.end - run.start)
    assert "jumps the way it steps" in doubts(made.t, made.x - carried)


def test_a_gap_that_hides_a_slip_is_named() -> None:
    made = bench(20, 73.0, Sensor(rate=1e4, noise=5e-10))
    lost = made.runs[0].start + np.array([7.5, 8.1]) / 73.0
    seen = (made.t < lost[0]) | (made.t > lost[1])
    assert "8.30 ms without samples from" in doubts(made.t[seen], made.x[seen])


def test_every_second_cycle_of_the_frequency_given_is_doubted() -> None:
    drives = Drive(20, 200.0, pause=0.01), Drive(20, 200.0, direction=-1, pause=0.015)
    made = bench_trace(Axis(), drives, Sensor(rate=2500.0, noise=5e-10), rest=0.01)
    for run in find_steps(made.t, made.x, Known.given(200.0)).runs:
        assert abs(run.frequency / 200.0 - 1.0) < 0.01 or not run.determined


@pytest.mark.parametrize(
    ("told", "seen"),
    [
        (700.0, "steps are seen at 1000 Hz"),
        (500.0, "slips are"),
        (1014.0, "Hz, not at the 1014 Hz that are given"),
    ],
)
def test_a_wrong_frequency_is_doubted(told: float, seen: str) -> None:
    """Steps of 173 nm, ten of them, were read where there are fourteen of 122."""
    made = bench(14, 1000.0, Sensor(rate=5e4, noise=1e-9))
    assert seen in doubts(made.t, made.x, told)


def test_steps_that_change_are_seen_with_their_time() -> None:
    """A mean of both was read: 135.14 nm where the steps were 130.4 and 137.3."""
    made = bench(40, 100.0, Sensor(rate=2e4, noise=1e-9))
    run, step = made.runs[0], made.runs[0].step_size
    grown = 0.05 * step * np.clip((made.t - run.start) * 100.0 - 20.0, 0.0, 20.0)
    said = doubts(made.t, made.x + grown, 100.0)
    at = float(said.partition("the steps change at ")[2].partition(" s")[0])
    assert abs(at - run.start - 0.2) < 0.03
