# SPDX-License-Identifier: Apache-2.0
"""Runs of steps are found as they were made, or nothing is said of them."""

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from bench_traces import Axis, Drive, Sensor, bench_trace
from records import assert_right, bench

from stickslip_ros import Axis as Simulated
from stickslip_ros import simulate
from stickslip_ros.base.arrays import Array
from stickslip_ros.base.errors import StickslipError
from stickslip_ros.measurement.steps.analysis import find_steps
from stickslip_ros.measurement.steps.drive import Drive as Known
from stickslip_ros.measurement.steps.fold import find_rests
from stickslip_ros.measurement.steps.record import MeanPosition, clean_record
from stickslip_ros.measurement.steps.slips import SlipGrid
from stickslip_ros.measurement.steps.step_fit import fit_steps


@pytest.mark.parametrize("told", [False, True])
@pytest.mark.parametrize(
    ("cycles", "frequency"), [(12, 500.0), (40, 120.0), (25, 900.0), (4, 200.0)]
)
def test_a_plain_run_is_found(cycles: int, frequency: float, told: bool) -> None:
    made = bench(cycles, frequency)
    (run,) = find_steps(made.t, made.x, Known.given(frequency if told else None)).runs
    assert_right(run, made.runs[0])


def test_runs_there_and_back_are_two() -> None:
    drives = Drive(12, 500.0, pause=5e-3), Drive(9, 500.0, direction=-1, pause=6e-3)
    made = bench_trace(Axis(), drives, Sensor(rate=1e5, noise=1e-9), rest=6e-3)
    found = find_steps(made.t, made.x).runs
    for run, true in zip(found, made.runs, strict=True):
        assert_right(run, true)


def test_runs_of_several_frequencies_are_found_but_not_at_that_of_one_of_them() -> None:
    drives = Drive(20, 300.0, pause=8e-3), Drive(15, 700.0, pause=9e-3)
    made = bench_trace(Axis(), drives, Sensor(rate=1e5, noise=1e-9), rest=8e-3)
    found = find_steps(made.t, made.x, Known.given([300.0, 700.0])).runs
    assert [(one.steps, one.doubts) for one in found] == [(20, ()), (15, ())]
    for frequency in (None, 300.0):
        assert all(run.doubts for run in find_steps(made.t, made.x, Known.given(frequency)).runs)
    for sent in ([300.0, 700.0, 300.0], [700.0, 300.0]):
        with pytest.raises(StickslipError, match="runs of steps were sent, 2 are seen"):
            find_steps(made.t, made.x, Known.given(sent))


def test_one_step_is_not_determined_where_it_is_not() -> None:
    made = bench(1, 500.0)
    assert all(run.doubts for run in find_steps(made.t, made.x).runs)


@pytest.mark.parametrize("samples", [20, 60])
def test_long_runs_stay_whole(samples: int) -> None:
    made = bench(500, 400.0, Sensor(rate=400.0 * samples, noise=2e-9))
    (run,) = find_steps(made.t, made.x, Known.given(400.0)).runs
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
            runs = find_steps(t, x, Known.given(frequency)).runs
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
    found = find_steps(t, swing - 6.6e-5 * t + 1e-9 * draw.standard_normal(len(t))).runs
    assert not any(one.determined for one in found)


def test_a_frequency_that_the_record_cannot_hold_is_refused() -> None:
    with pytest.raises(StickslipError, match=r"no whole cycle at 5 Hz"):
        find_steps(T, NOISE, Known.given(5.0))
    with pytest.raises(StickslipError, match=r"show no cycles of 8000 Hz"):
        find_steps(T, NOISE, Known.given(8000.0))


def test_a_run_of_two_cycles_leaves_the_step_of_a_long_one_known() -> None:
    """It has no settled step of its own, and every other step was no number."""
    period, t = 2e-3, np.arange(0.0, 0.12, 5e-5)
    since = np.clip((t - 0.02) / period, 0.0, 30.0) + np.clip((t - 0.1) / period, 0.0, 2.0)
    x = 1e-7 * since + 3e-8 * np.abs(np.sin(np.pi * since))
    x += 1e-9 * np.random.default_rng(2).standard_normal(len(t))
    record = clean_record(t, x)
    grids = [SlipGrid(0.02 + period, period, 30, 1), SlipGrid(0.1 + period, period, 2, 1)]
    rests = find_rests(grids, float(t[0]), float(t[-1]))
    steps, _, _ = fit_steps(record, MeanPosition(record), grids, None, rests)
    assert 0.0 < steps[0].error < 1e-8
    assert steps[0].value == pytest.approx(1e-7, abs=4.0 * steps[0].error)


@pytest.mark.parametrize("frequency", [60.0, 400.0])
@pytest.mark.parametrize("cycles", [1, 2])
def test_one_step_and_two_are_measured_where_the_frequency_is_given(
    cycles: int, frequency: float
) -> None:
    """One was refused as no steps, although its frequency was given."""
    made = bench(cycles, frequency)
    (run,) = find_steps(made.t, made.x, Known.given(frequency)).runs
    assert (run.steps, run.determined) == (cycles, True)
    level = [float(np.mean(one)) for one in (made.x[:50], made.x[-50:])]
    step = (level[1] - level[0]) / cycles
    assert run.step_size == pytest.approx(step, abs=3.0 * run.step_size_error)
    assert run.step_size_error < 0.1 * abs(run.step_size)


def test_a_rest_at_one_value_before_quick_steps_is_no_end_of_the_range() -> None:
    """Without noise and with few samples a swing, the runner is fast at once."""
    made = bench(20, 90.0, Sensor(rate=12e3))
    begun = made.runs[0].start
    inside = made.t < begun + 15.3 / 90.0
    x = np.where(made.t < begun, made.x[0], made.x)
    (run,) = find_steps(made.t[inside], x[inside]).runs
    assert not run.doubts


def driven(steps: int, frequency: float, rate: float, before: float, after: float) -> Array:
    """Positions of a running axis, which rings on in its rest, with noise."""
    axis = Simulated({"preload": 0.4, "mass": 0.004, "frequency": frequency})
    sent, t = False, np.arange(int((before + steps / frequency + after) * rate)) / rate
    x = np.empty(len(t))
    for k, at in enumerate(t):
        if not sent and at >= before:
            axis.advance(before)
            axis.command("steps", steps)
            sent = True
        axis.advance(at)
        x[k] = axis.state.x
    return np.asarray(x + 5e-10 * np.random.default_rng(5).standard_normal(len(t)))


@pytest.mark.parametrize("frequency", [8e3, 10e3, 12e3])
def test_drives_as_quick_as_the_ringing_are_read(frequency: float) -> None:
    """They were refused as no steps; their slips are hidden by ringing that lasts for cycles."""
    x = driven(100, frequency, 1e6, 0.004, 0.006)
    (run,) = find_steps(np.arange(len(x)) * 1e-6, x, Known.given(frequency)).runs
    assert (run.steps, run.doubts) == (100, ())
    made = simulate({"preload": 0.4, "mass": 0.004, "frequency": frequency}, steps=100)
    assert run.step_size == pytest.approx(made.step_size, abs=4.0 * run.step_size_error + 2e-10)
    assert np.isnan(run.backstep)
    assert run.why_no_backstep


@pytest.mark.parametrize(
    ("sent", "seen", "words"),
    [
        (None, 29, "first or last slip is not clear: give the steps that were sent"),
        (30, 30, ""),
        (31, 29, r"\+31 steps were sent, \+29 are seen: the record ends before the last"),
        (-30, 29, r"-30 steps were sent, \+29 are seen"),
    ],
)
def test_steps_that_were_sent_settle_the_ends(sent: int | None, seen: int, words: str) -> None:
    """Thirty steps and no rest after the last were 29, without a doubt."""
    run = simulate("table1_typical", steps=30, frequency=100.0).trace_at(5e4)
    x = np.r_[np.full(2500, run.x[0]), run.x]
    x = x + 1e-9 * np.random.default_rng(5).standard_normal(len(x))
    t, drive = np.arange(len(x)) / 5e4, Known.given(100.0, sent)
    (found,) = find_steps(t, x, drive).runs
    assert found.steps == seen
    assert re.search(words, "; ".join(found.doubts))
    assert bool(found.doubts) is bool(words)
    if sent == 30:
        voltage = np.r_[np.zeros(2500), np.interp(t[: len(run.x)], run.t, run.u)]
        for sign in (1e9, -1e9):  # of any unit and polarity
            (same,) = find_steps(t, x, Known.of_voltage(t, sign * voltage)).runs
            assert (same.steps, same.doubts) == (30, ())


def test_pauses_and_stray_times_are_no_samples() -> None:
    """A stray time took 40 s and hid all steps; a pause made a drift that is not there."""
    made = bench(20, 300.0)
    t = made.t.copy()
    t[100] = 1e6
    found = find_steps(t, made.x, Known.given(300.0))
    assert_right(found.runs[0], made.runs[0])
    assert "a sample at 1e+06 s is left out" in found.notes[0]
    t = made.t + np.where(made.t > 0.5 * made.runs[0].start, 500.0, 0.0)
    moved = made.x + 3e-8 * np.sin(2.0 * np.pi * t / 900.0)
    found = find_steps(t, moved, Known.given(300.0))
    assert (found.runs[0].steps, found.runs[0].doubts) == (20, ())
    assert not found.disturbances.drifts


def test_a_deflection_that_is_no_number_is_refused() -> None:
    """The actuator was left out in silence, and one step with it."""
    made = bench(12, 200.0)
    deflection = np.where(np.arange(len(made.t)) == 100, np.nan, made.u)
    with pytest.raises(StickslipError, match="actuator sample 100 is nan; leave such samples out"):
        find_steps(made.t, made.x, None, deflection)
    with pytest.raises(StickslipError, match="actuator sample 100 is nan; leave such samples out"):
        Known.of_voltage(made.t, deflection)
    with pytest.raises(StickslipError, match="the voltage makes no whole cycle"):
        Known.of_voltage(made.t, 0.0 * made.t)


@pytest.mark.parametrize(
    ("frequency", "steps", "words"),
    [
        ([100.0, "x"], None, "give numbers"),
        (100.0, 1.5, "have to be whole numbers"),
        (100.0, 0, "a run has 0 steps"),
        ([100.0, 200.0], [1, 2, 3], "2 frequencies and 3 numbers of steps"),
    ],
)
def test_what_cannot_be_a_drive_is_refused(frequency: Any, steps: Any, words: str) -> None:
    with pytest.raises(StickslipError, match=words):
        Known.given(frequency, steps)
    assert Known.given(np.array([100.0, 200.0])).frequencies == (100.0, 200.0)


def test_quick_runs_are_no_slow_ones_where_both_frequencies_are_given() -> None:
    """Ten cycles at 1 kHz are one at 100 Hz, too, and hid the run that was one."""
    drives = Drive(200, 1000.0, pause=0.1), Drive(20, 100.0, pause=0.1)
    made = bench_trace(Axis(), drives, Sensor(rate=5e4, noise=1e-9), rest=0.05)
    found = find_steps(made.t, made.x, Known.given([1000.0, 100.0])).runs
    assert [(one.steps, one.doubts) for one in found] == [(200, ()), (20, ())]


def test_rests_of_few_samples_are_no_stray_times() -> None:
    """As of a motion that is simulated finely only while it moves."""
    made = bench(30, 300.0)
    true = made.runs[0]
    dense = (made.t > true.start - 2e-3) & (made.t < true.end + 2e-3)
    kept = dense | (np.arange(len(made.t)) % 50 == 0)
    found = find_steps(made.t[kept], made.x[kept], Known.given(300.0))
    assert found.notes == ()
    assert_right(found.runs[0], true)
