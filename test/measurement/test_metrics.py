# SPDX-License-Identifier: Apache-2.0
"""Metrics of two motions, and the clock between them, on motions that are written down."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from stickslip_ros.measurement.alignment import ClockSearch
from stickslip_ros.measurement.metric import METRICS, ComparisonMetric, most_different
from stickslip_ros.measurement.metrics import step_metrics
from stickslip_ros.measurement.motion_pair import (
    Alignment,
    ComparisonError,
    Fits,
    MotionPair,
)
from stickslip_ros.measurement.steps.ringing import Ringing
from stickslip_ros.measurement.steps.run import Run, even_cycles
from stickslip_ros.simulation.motion import Motion

Array = NDArray[np.float64]
PERIOD = 0.01  # s
T: Array = np.arange(0.0, 0.1, 1e-4)


def _steps(count: int = 8, **changed: Any) -> Run:
    ends = PERIOD * np.arange(1.0, count + 1.0)
    found = Run(
        **vars(even_cycles(ends, PERIOD, 1)), step_size=1e-7, step_size_error=0.0, backstep=2e-8,
        backstep_error=0.0, ringing=Ringing(7e3, 600.0), step_sizes=np.full(count, 1e-7),
        backsteps=np.full(count, 2e-8), points={},
    )  # fmt: skip
    return replace(found, **changed)


def search(run: Motion, sensor: Motion, **fits: bool) -> ClockSearch:
    return ClockSearch(MotionPair(run, sensor), Fits(**fits))


def _wave(t: Array) -> Array:
    """Equal steps of 100 nm with a swing in each, rest before 0 and after 0.08 s."""
    since = np.clip(t / PERIOD, 0.0, 8.0)
    part = since - np.floor(since)
    return 1e-7 * since + 4e-8 * np.sin(np.pi * part) ** 2 * np.exp(-3.0 * part)


def test_a_metric_differs_beyond_its_tolerance() -> None:
    one = ComparisonMetric("step size", "m", 50.0, 48.0, 2.1)
    assert (one.difference, one.differs) == (-2.0, False)
    assert replace(one, tolerance=1.9).differs is True
    assert replace(one, measured=52.0, tolerance=1.9).differs is True
    cases: tuple[dict[str, Any], ...]
    cases = ({"run": math.nan}, {"measured": math.inf}, {"tolerance": math.nan})
    for missing in cases:
        assert replace(one, **missing).differs is None
    assert replace(one, run=1234.5e-9, measured=3e-9).texts[:2] == ("1234.5 nm", "3.0 nm")
    assert replace(one, run=math.nan, measured=-2e-8).texts[:3] == ("–", "-20.000 nm", "–")


def test_two_values_agree_only_by_a_tolerance_that_tells_them_apart() -> None:
    """69.2 and 88.0 nm agreed by a tolerance of 31 nm, and a limit of 20 nm was kept."""
    one = replace(METRICS[2], run=69.2e-9, measured=88e-9, tolerance=31e-9, step=134e-9)
    assert one.differs is None
    assert one.verdict == (
        "cannot be told: the tolerance, 31.0 nm, is above a fifth of the larger value and 2 % of "
        "the step"
    )
    assert (one.as_json()["differs"], one.as_json()["why_missing"]) == (None, one.verdict)
    limited = replace(one, allowed=40e-9)
    assert not limited.kept
    assert "cannot be determined (cannot be told: the tolerance, 31.0 nm" in limited.judgement
    assert replace(one, tolerance=17.5e-9).differs is True
    assert replace(one, measured=75e-9, tolerance=15e-9).differs is False  # a fifth of 75 nm
    assert replace(one, measured=75e-9, tolerance=15.1e-9).differs is None
    none_at_all = replace(one, run=0.0, measured=1e-10, tolerance=2e-9)
    assert none_at_all.differs is False  # within 2 % of the step
    assert replace(none_at_all, step=90e-9).differs is None


def test_a_decay_that_few_samples_leave_open_is_as_uncertain_as_the_frequency() -> None:
    motion = Motion("axis", T, _wave(T))
    run, sensor = (_steps(ringing=Ringing(4e3, 600.0, error, math.inf)) for error in (30.0, 40.0))
    found = step_metrics(run, sensor, motion.spacing, 1.0, 3.0)
    tolerance = next(one.tolerance for one in found if one.name == "damping ratio")
    assert tolerance == pytest.approx(3.0 * 50.0 / 4e3)


def test_a_length_by_a_wrong_gain_is_scaled_and_so_is_its_error() -> None:
    motion = Motion("axis", T, _wave(T))
    run, sensor = _steps(), _steps(step_size=2e-7, step_size_error=1e-9)
    found = step_metrics(run, sensor, motion.spacing, 2.0, 3.0)
    step = next(one for one in found if one.name == "step size")
    assert (step.measured, step.tolerance) == pytest.approx((1e-7, 3.0 * 0.5e-9))


def test_a_tolerance_holds_what_the_samples_do_to_the_run() -> None:
    """Of 57.6 nm that few samples show of a backstep of 87.1 nm, 89.0 nm measured differed."""
    run, sensor = (_steps(backstep=x, backstep_error=2e-9) for x in (57.6e-9, 89e-9))
    whole = _steps(backstep=87.1e-9)
    for noisy, all_of_it, found in ((None, whole, None), (sensor, None, None), (None, None, True)):
        metrics = step_metrics(run, sensor, 1e-4, 1.0, 3.0, None, noisy, all_of_it)
        assert next(one.differs for one in metrics if one.name == "backstep") is found


def test_of_two_runs_the_one_that_differs_more_is_shown() -> None:
    near, far = (ComparisonMetric("step size", "m", 1e-7, x, 1e-9) for x in (1.02e-7, 0.9e-7))
    for runs in ([[near], [far]], [[far], [near]]):
        assert most_different(runs) == [far]
    missing = replace(METRICS[1], why_missing="no step")
    agrees = ComparisonMetric("step size", "m", 1e-7, 1e-7, 1e-9)
    assert most_different([[agrees], [missing]]) == [missing]
    assert most_different([[missing], [near]]) == [near]


def test_the_clocks_of_both_lead_to_each_other() -> None:
    clock = Alignment(offset=0.3, drift=1e-2, middle=2.0)
    t = np.array([0.0, 2.0, 3.0])
    assert clock.run_time(t) == pytest.approx([-0.28, 1.7, 2.69])
    assert clock.measurement_time(clock.run_time(t)) == pytest.approx(t)


def test_both_are_compared_at_the_samples_of_the_coarser_one() -> None:
    run = Motion("run", T, _wave(T))
    fine: Array = np.arange(-0.03, 0.15, 2e-5)
    sensor = Motion("sensor", fine, 3.0 + 2.0 * fine)
    clock = Alignment(offset=0.005)
    of_run = MotionPair(run, sensor).at(clock)
    assert of_run.t == pytest.approx(T)
    assert of_run.run == pytest.approx(run.x)
    assert of_run.measured == pytest.approx(3.0 + 2.0 * (T + 0.005))
    assert of_run.velocity == pytest.approx(np.gradient(run.x, T))
    coarse = Motion("sensor", fine[::10], 3.0 + 2.0 * fine[::10])
    of_sensor = MotionPair(run, coarse).at(clock)
    inside = (coarse.t - 0.005 >= 0.0) & (coarse.t - 0.005 <= T[-1])
    assert of_sensor.t == pytest.approx(coarse.t[inside] - 0.005)
    assert of_sensor.measured == pytest.approx(coarse.x[inside])
    assert MotionPair(run, sensor).shorter == pytest.approx(T[-1])
    assert MotionPair(run, sensor).overlap(clock) == pytest.approx(T[-1])
    assert MotionPair(run, sensor).overlap(Alignment(offset=0.1)) == pytest.approx(fine[-1] - 0.1)
    assert MotionPair(run, sensor).overlap(Alignment(offset=-0.05)) == pytest.approx(T[-1] - 0.02)
    search(run, sensor).check_overlap(Alignment(offset=0.14))
    with pytest.raises(ComparisonError, match="hardly overlap"):
        search(run, sensor).check_overlap(Alignment(offset=0.147))
    few = Motion("sensor", T[:17] + 0.095, T[:17])
    search(run, few).check_overlap(Alignment(offset=0.09505))  # 16 samples in common
    with pytest.raises(ComparisonError, match="hardly overlap"):
        search(run, few).check_overlap(Alignment(offset=0.09515))


def test_least_squares_move_the_clock_to_where_it_is() -> None:
    t: Array = np.arange(0.012, 0.09, 1.3e-4)
    run = Motion("run", T, 1e-7 * np.sin(300.0 * T) + 2e-8 * np.sin(1100.0 * T))
    true = Alignment(offset=2e-4, drift=3e-3, middle=0.05)
    x = 1e-8 + run.position_at(true.run_time(t))
    x = x + 1e-10 * np.random.default_rng(6).standard_normal(len(t))
    sensor = Motion("sensor", t, x)
    start = Alignment(offset=1e-4, middle=0.05)
    found = search(run, sensor, drift=True).fit_velocity(start, None)
    assert found.offset == pytest.approx(2e-4, abs=2e-6)
    assert found.drift == pytest.approx(3e-3, abs=1e-4)
    rigid = search(run, sensor).fit_velocity(start, None)
    assert rigid.drift == 0.0
    assert rigid.offset == pytest.approx(2e-4, abs=2e-5)
    assert 0.0 < found.offset_error < rigid.offset_error
    with pytest.raises(ComparisonError, match="hardly overlap; check that both show the same"):
        search(run, sensor).fit_velocity(replace(start, offset=1.0), None)  # nothing in common
    with pytest.raises(ComparisonError, match="no clock to fit"):
        search(Motion("run", T, np.zeros_like(T)), sensor).fit_velocity(start, None)


def test_ringing_beyond_half_the_rate_of_the_samples_is_not_compared() -> None:
    """Samples fold it to a slower swing, which looks as sure as any."""
    motion = Motion("coarse", T, _wave(T))  # 10 kHz
    sure = Ringing(7e3, 600.0, frequency_error=1.0, decay_error=10.0)
    seen = replace(sure, frequency=1e3)
    runs = _steps(ringing=sure), _steps(ringing=seen)
    found = {one.name: one for one in step_metrics(*runs, motion.spacing, 1.0, 3.0)}
    assert found["ringing frequency"].differs is None
    assert "sample faster" in found["damping ratio"].verdict
    assert found["step size"].differs is False


def test_the_decay_of_swings_of_unknown_frequency_is_unknown() -> None:
    motion = Motion("axis", T, _wave(T))
    sure = Ringing(1e3, 600.0, frequency_error=1.0, decay_error=10.0)
    runs = (
        _steps(ringing=sure),
        _steps(ringing=replace(sure, decay=300.0, frequency_error=math.inf)),
    )
    found = {one.name: one for one in step_metrics(*runs, motion.spacing, 1.0, 3.0)}
    assert found["damping ratio"].differs is None
