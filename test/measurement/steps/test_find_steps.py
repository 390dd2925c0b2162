# SPDX-License-Identifier: Apache-2.0
"""Runs of steps are found as they were made, or nothing is said of them."""

from collections.abc import Callable

import numpy as np
import pytest
from bench_traces import Axis, Drive, Sensor, bench_trace
from records import assert_right, bench

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.errors import StickslipError
from stickslip_ros.measurement.steps.analysis import find_steps
from stickslip_ros.measurement.steps.fold import find_rests
from stickslip_ros.measurement.steps.motions import find_runs
from stickslip_ros.measurement.steps.record import MeanPosition, clean_record
from stickslip_ros.measurement.steps.step_fit import fit_steps
from stickslip_ros.measurement.steps.timing import SlipGrid


@pytest.mark.parametrize("told", [False, True])
@pytest.mark.parametrize(
    ("cycles", "frequency"), [(12, 500.0), (40, 120.0), (25, 900.0), (4, 200.0)]
)
def test_a_plain_run_is_found(cycles: int, frequency: float, told: bool) -> None:
    made = bench(cycles, frequency)
    (run,) = find_steps(made.t, made.x, frequency if told else None).runs
    assert_right(run, made.runs[0])


def test_runs_there_and_back_are_two() -> None:
    drives = Drive(12, 500.0, pause=5e-3), Drive(9, 500.0, direction=-1, pause=6e-3)
    made = bench_trace(Axis(), drives, Sensor(rate=1e5, noise=1e-9), rest=6e-3)
    found = find_steps(made.t, made.x).runs
    for run, true in zip(found, made.runs, strict=True):
        assert_right(run, true)


def test_runs_of_other_frequencies_are_found_beside_the_one_that_is_given() -> None:
    drives = Drive(20, 300.0, pause=8e-3), Drive(15, 700.0, pause=9e-3)
    made = bench_trace(Axis(), drives, Sensor(rate=1e5, noise=1e-9), rest=8e-3)
    for frequency in (None, 300.0):
        found = find_steps(made.t, made.x, frequency).runs
        assert [one.steps for one in found] == [20, 15]


def test_one_step_is_not_determined_where_it_is_not() -> None:
    made = bench(1, 500.0)
    assert all(run.doubts for run in find_steps(made.t, made.x).runs)


@pytest.mark.parametrize("samples", [20, 60])
def test_long_runs_stay_whole(samples: int) -> None:
    made = bench(500, 400.0, Sensor(rate=400.0 * samples, noise=2e-9))
    (run,) = find_steps(made.t, made.x, 400.0).runs
    assert run.steps == 500


def test_a_run_without_noise_is_no_run_that_is_cut_off() -> None:
    made = bench(20, 400.0, Sensor(rate=2e5))
    (run,) = find_steps(made.t, made.x).runs
    assert_right(run, made.runs[0])


@pytest.mark.parametrize(
    "disturbance",
    [
        lambda t, step: 0.3 * step * np.sin(2.0 * np.pi * 50.0 * t),
        lambda t, step: 0.05 * step * np.log1p(np.maximum(t - 6e-3, 0.0) * 500.0),
        lambda t, step: 3e-7 * t,
        lambda t, step: 0.2 * step * np.polynomial.chebyshev.chebval(t / t[-1], [0.0, 1.0, 1.0]),
    ],
)
def test_what_drifts_and_hums_is_no_step(disturbance: Callable[[Array, float], Array]) -> None:
    made = bench(25, 500.0)
    true = made.runs[0]
    x = made.x + disturbance(made.t, true.step_size)
    (run,) = find_steps(made.t, x).runs
    assert_right(run, true)


def test_samples_that_are_spikes_or_jumps_of_a_fringe_counter_do_no_harm() -> None:
    made = bench(25, 500.0)
    x = made.x.copy()
    x[[300, 2000, 4000]] += 3e-6
    x[2500:] += 316.4e-9
    (run,) = find_steps(made.t, x).runs
    assert_right(run, made.runs[0])


T: Array = np.arange(0.0, 0.1, 1e-4)
NOISE: Array = 1e-9 * np.random.default_rng(3).standard_normal(len(T))


@pytest.mark.parametrize(
    ("t", "x"),
    [
        (T, NOISE),
        (T, 5e-8 * np.sin(2.0 * np.pi * 80.0 * T) + NOISE),
        (T, np.where(T > 0.09, 1e-7, 0.0)),
        (T, np.where(T[500] == T, 1e-6, 0.0)),
        (T, np.round(1e-6 * T / 2e-8) * 2e-8),
        (T, np.where(T > 0.05, 1e-6, 0.0) + NOISE),
        (T[:32], NOISE[:32]),
        (T, np.sign(np.sin(900.0 * T))),
    ],
)
def test_records_without_steps_show_none(t: Array, x: Array) -> None:
    for frequency in (None, 50.0, 333.0):
        try:
            runs = find_runs(t, x, frequency)
        except StickslipError:
            continue
        assert not any(run.determined for run in runs)


@pytest.mark.parametrize(
    ("t", "x", "words"),
    [
        (T[:20], NOISE[:20], "20 samples; at least 32"),
        (T, 0.0 * T, "does not move"),
        (T, NOISE[:-1], "position has shape"),
    ],
)
def test_what_cannot_be_a_record_is_refused(t: Array, x: Array, words: str) -> None:
    with pytest.raises(StickslipError, match=words):
        find_steps(t, x)


def test_a_sinusoid_on_a_slope_is_not_two_of_its_periods_a_step() -> None:
    draw = np.random.default_rng(1)
    t = np.flatnonzero(draw.random(12_000) > 0.02) / (40 * 2136.8)
    turn = 2.0 * np.pi * 2136.8 * t
    swing = 45e-9 * np.sin(turn) + 1.5e-9 * np.sin(2.0 * turn + 1.0)
    assert not find_runs(t, swing - 6.6e-5 * t + 1e-9 * draw.standard_normal(len(t)))


def test_a_frequency_that_the_record_cannot_hold_is_refused() -> None:
    with pytest.raises(StickslipError, match=r"no whole cycle at 5 Hz"):
        find_steps(T, NOISE, 5.0)
    with pytest.raises(StickslipError, match=r"show no cycles of 8000 Hz"):
        find_steps(T, NOISE, 8000.0)


def test_a_run_of_two_cycles_leaves_the_step_of_a_long_one_known() -> None:
    """It has no settled step of its own, and every other step was no number."""
    period, t = 2e-3, np.arange(0.0, 0.12, 5e-5)
    since = np.clip((t - 0.02) / period, 0.0, 30.0) + np.clip((t - 0.1) / period, 0.0, 2.0)
    x = 1e-7 * since + 3e-8 * np.abs(np.sin(np.pi * since))
    x += 1e-9 * np.random.default_rng(2).standard_normal(len(t))
    record = clean_record(t, x)
    grids = [SlipGrid(0.02 + period, period, 30, 1), SlipGrid(0.1 + period, period, 2, 1)]
    rests = find_rests(grids, float(t[0]), float(t[-1]))
    steps, _ = fit_steps(record, MeanPosition(record), grids, [None, None], rests)
    assert 0.0 < steps[0].error < 1e-8
    assert steps[0].value == pytest.approx(1e-7, abs=4.0 * steps[0].error)


@pytest.mark.parametrize("frequency", [60.0, 400.0])
@pytest.mark.parametrize("cycles", [1, 2])
def test_one_step_and_two_are_measured_where_the_frequency_is_given(
    cycles: int, frequency: float
) -> None:
    """One was refused as no steps, although its frequency was given."""
    made = bench(cycles, frequency)
    (run,) = find_steps(made.t, made.x, frequency).runs
    assert (run.steps, run.determined) == (cycles, True)
    assert run.step_size == pytest.approx(made.runs[0].step_size, abs=3.0 * run.step_size_error)
    assert run.step_size_error < 0.1 * abs(run.step_size)


def test_a_rest_at_one_value_before_quick_steps_is_no_end_of_the_range() -> None:
    """Without noise and with few samples a swing, the runner is fast at once."""
    made = bench(20, 90.0, Sensor(rate=12e3))
    begun = made.runs[0].start
    inside = made.t < begun + 15.3 / 90.0
    x = np.where(made.t < begun, made.x[0], made.x)
    (run,) = find_steps(made.t[inside], x[inside]).runs
    assert not run.doubts
