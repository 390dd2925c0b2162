# SPDX-License-Identifier: Apache-2.0
"""MeasuredValue, drift and hum of bench traces, within their own standard errors."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from bench_traces import Axis, Bench, Drive, Sensor, bench_trace, random_bench
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.stats import multivariate_normal

from stickslip_ros.traces import joint_fit
from stickslip_ros.traces.analysis import find_steps
from stickslip_ros.traces.even_samples import (
    SlipGrid,
    correlation_time,
    resample_evenly,
)
from stickslip_ros.traces.joint_fit import Disturbances, fit_steps
from stickslip_ros.traces.measured_value import MeasuredValue
from stickslip_ros.traces.ringing import Ringing

Array = NDArray[np.float64]


def fitted(bench: Bench) -> tuple[list[MeasuredValue], Disturbances]:
    """The fit of a trace whose runs and ringing are known."""
    mass, stiffness, damping, *_ = bench.axis.constants
    decay = 0.5 * damping / mass
    ringing = Ringing(math.sqrt(stiffness / mass - decay**2) / (2.0 * math.pi), decay)
    grids = [
        SlipGrid(
            run.start + 1.0 / run.frequency - drive.amplitude / 100e6,
            1.0 / run.frequency, run.steps, run.direction, abs(run.step_size), 1.0,
        )
        for run, drive in zip(bench.runs, bench.drives, strict=True)
    ]  # fmt: skip
    even = resample_evenly(bench.t, bench.x, 2**21)
    return fit_steps(even, grids, [ringing] * len(grids))


def ridge_fit(columns: Array, y: Array, widths: Array) -> joint_fit.RidgeFit:
    """The fit of all columns."""
    every = np.ones(len(widths))
    return joint_fit.RidgeFit(joint_fit.Rows(columns, y, every > 0.0), widths, every)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3000, 3010))
@pytest.mark.parametrize("hard", [False, True], ids=["easy", "hard"])
def test_the_step_lies_within_three_of_its_standard_errors(seed: int, hard: bool) -> None:
    bench = random_bench(seed, hard)
    for step, true in zip(fitted(bench)[0], bench.runs, strict=True):
        assert abs(true.direction * step.value - true.step_size) < 3.0 * step.error
        if not hard:
            assert step.error < 0.3e-9


@pytest.mark.slow
def test_standard_errors_are_no_larger_than_they_have_to_be() -> None:
    """Root mean square of the deviations in standard errors: 1 but for chance."""
    deviations = []
    for seed in range(3000, 3025):
        bench = random_bench(seed, hard=False)
        (step,), (true,) = fitted(bench)[0], bench.runs
        deviations.append((true.direction * step.value - true.step_size) / step.error)
    size = math.sqrt(sum(one**2 for one in deviations) / len(deviations))
    assert 0.6 < size < 1.5


@pytest.mark.parametrize("mains", [50.0, 60.0])
def test_drift_and_hum_are_told_with_their_uncertainty(mains: float) -> None:
    sensor = Sensor(rate=50e3, noise=1e-9, hum=1e-8, mains=mains, drift=1.5e-7, offset=0.3)
    bench = bench_trace(Axis(), (Drive(12, 130.0, pause=0.06),), sensor, rest=0.06)
    steps, found = fitted(bench)
    assert abs(steps[0].value - bench.runs[0].step_size) < 3.0 * steps[0].error < 0.3e-9
    assert found.drifts
    assert abs(found.drift - 1.5e-7) < 3.0 * found.drift_error
    assert found.hums
    assert found.mains == mains
    assert math.hypot(*found.waves[0]) == pytest.approx(1e-8, abs=4.0 * found.hum_error)
    assert math.hypot(*found.waves[1]) == pytest.approx(4e-9, abs=4.0 * found.hum_error)
    left = bench.x - found.at(bench.t) - bench.clean
    assert left.std() < 1.05e-9


@pytest.mark.slow
def test_what_is_not_there_is_not_told() -> None:
    sensor = Sensor(rate=50e3, noise=1e-9)
    bench = bench_trace(Axis(), (Drive(12, 130.0, pause=0.06),), sensor, rest=0.06)
    found = find_steps(bench.t, bench.x)
    assert len(found.runs) == 1
    assert not found.disturbances.drifts
    assert not found.disturbances.hums


@pytest.mark.slow
def test_a_walk_widens_the_error_and_a_bent_drift_hardly_does() -> None:
    """Both move the runner by some 20 nm; 20 walks, and one drift that bends as fast as creep."""
    sensor = Sensor(rate=50e3, noise=1e-9)
    bench = bench_trace(Axis(), (Drive(20, 400.0, pause=0.01),), sensor, rest=0.01)
    random, size, held, errors = np.random.default_rng(3), bench.runs[0].step_size, [], []
    for _ in range(20):
        walk = np.cumsum(random.standard_normal(len(bench.x))) / math.sqrt(len(bench.x))
        ((step,), found) = fitted(replace(bench, x=bench.x + 2e-8 * walk))
        held.append(abs(step.value - size) < 2.0 * step.error)
        errors.append(step.error)
    assert np.mean(held) >= 0.9
    ((alone,), _) = fitted(bench)
    assert alone.error < 0.2 * np.median(errors)
    bend = 2e-8 * np.polynomial.chebyshev.chebval(2.0 * bench.t / bench.t[-1] - 1.0, [0, 1, 1, 1])
    ((step,), found) = fitted(replace(bench, x=bench.x + bend))
    assert abs(step.value - size) < 3.0 * step.error < 0.5e-9
    assert found.mains is None


@pytest.mark.parametrize("part", [0.2, 0.5, 0.8])
def test_a_run_that_stops_within_a_cycle_does_not_drift(part: float) -> None:
    """The actuator holds what it has risen: that is no rest, and no slip ends it."""
    sensor = Sensor(rate=100e3, noise=2e-9)
    bench = bench_trace(Axis(), (Drive(40, pause=0.05),), sensor, rest=0.05)
    (run,) = bench.runs
    stopped = bench.t > run.start + (38 + part) / run.frequency
    at = np.argmax(stopped)
    x = np.where(stopped, bench.x + bench.clean[at] - bench.clean, bench.x)
    stop = replace(bench, x=x, runs=[replace(run, steps=38)])
    (step,), found = fitted(stop)
    assert abs(step.value - run.step_size) < 3.0 * step.error < 0.3e-9
    assert not found.drifts


def test_a_motion_without_noise_has_errors_all_the_same() -> None:
    """Rounding made variances negative: a long run, exact to 1e-15 m, ended in a traceback."""
    random = np.random.default_rng(1)
    one, other, third = random.standard_normal((3, 1000))
    for dissimilarity in 10.0 ** -np.arange(5.0, 10.0):
        columns = np.stack([one, one + dissimilarity * other, third], axis=1)
        fit = ridge_fit(columns, columns @ [1.0, 1.0, 2.0], np.ones(3))
        for column in range(3):
            value, error = fit.value(column, 1e-30)
            assert 0.0 <= error <= 1.0
            assert value == pytest.approx([1.0, 1.0, 2.0][column], abs=1e-3)
        assert np.isfinite(fit.evidence(1e-30))


def test_a_fit_with_widths_beforehand_is_that_of_normal_distributions() -> None:
    """Values, errors and odds against scipy's multivariate normal distribution."""
    random = np.random.default_rng(17)
    widths, chance = np.array([2.0, 0.5, 3.0]), 0.04
    columns = random.standard_normal((50, 3))
    y = columns @ [1.0, 0.2, -2.0] + 0.2 * random.standard_normal(50)
    fit = ridge_fit(columns * widths, y, widths)
    inverse = np.linalg.inv(columns.T @ columns / chance + np.diag(widths**-2.0))
    expected = inverse @ columns.T @ y / chance
    for k in range(3):
        assert fit.value(k, chance) == pytest.approx((expected[k], math.sqrt(inverse[k, k])))

    def density(width: Array) -> float:
        spread = (columns * width**2) @ columns.T + chance * np.eye(50)
        return float(multivariate_normal(np.zeros(50), spread).logpdf(y))

    other = ridge_fit(columns * [0.1, 0.1, 3.0], y, np.array([0.1, 0.1, 3.0]))
    odds = fit.evidence(chance) - other.evidence(chance)
    assert odds == pytest.approx(density(widths) - density(np.array([0.1, 0.1, 3.0])), rel=1e-6)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_neighbours_that_go_together_count_less(rho: float) -> None:
    """Of x_n = rho x_(n-1) + noise, (1 + rho) / (1 - rho) samples are worth one."""
    noise = np.random.default_rng(19).standard_normal(200_000)
    left = lfilter([1.0], [1.0, -rho], noise)
    assert correlation_time(left) == pytest.approx((1.0 + rho) / (1.0 - rho), rel=0.1)
    fit = ridge_fit(np.ones((200_000, 1)), left, np.ones(1))
    assert fit.chance == pytest.approx((1.0 - rho) ** -2.0, rel=0.1)
    assert correlation_time(np.zeros(50)) == 1.0
    assert correlation_time(np.tile([1.0, -1.0], 50)) == 1.0


def test_a_run_too_short_to_settle_says_so_in_its_error() -> None:
    """Ringing lasts into the next cycles at 1 kHz: of seven, the last four have not settled."""
    errors = []
    for cycles in (7, 12):
        drive = Drive(cycles, 1000.0, pause=0.01)
        bench = bench_trace(Axis(), (drive,), Sensor(rate=1e6, noise=1e-10), rest=0.01)
        (step,), _ = fitted(bench)
        errors.append(step.error)
        assert abs(step.value - bench.runs[0].step_size) < 3.0 * step.error
    assert errors[0] > 4.0 * errors[1]
    assert errors[1] < 0.5e-9


def test_drift_and_hum_are_told_from_so_many_standard_errors_on() -> None:
    known = Disturbances(1e-7, 1e-8, 0.1, 50.0, ((3e-9, 4e-9), (1e-9, 0.0)), 5e-10)
    assert known.hum == pytest.approx(5e-9)
    assert known.drifts
    assert known.hums
    assert not replace(known, drift_error=2.1e-8).drifts
    assert replace(known, drift=-1e-7).drifts
    assert not replace(known, duration=0.019).drifts
    assert replace(known, duration=0.021).drifts
    assert not replace(known, hum_error=1.1e-9).hums
    assert not replace(known, waves=((4e-10, 2e-10),), hum_error=1e-12).hums
    assert replace(known, waves=((5e-10, 2e-10),), hum_error=1e-12).hums
    t = np.array([0.3, 0.304, 0.31])
    wave = 3e-9 * np.cos(100 * np.pi * t) + 4e-9 * np.sin(100 * np.pi * t)
    wave += 1e-9 * np.cos(200 * np.pi * t)
    assert known.at(t, drift=False) == pytest.approx(wave, abs=1e-15)
    assert known.at(t, hum=False) == pytest.approx([0.0, 4e-10, 1e-9], abs=1e-15)
    assert known.at(t) == pytest.approx(wave + known.drift * (t - 0.3), abs=1e-15)
    assert known.as_json() == {
        "position_drift": 1e-7, "position_drift_error": 1e-8,
        "mains": 50.0, "hum": known.hum, "hum_error": 5e-10,
    }  # fmt: skip
    assert set(Disturbances().as_json().values()) == {None}
    assert not Disturbances().drifts
    assert not Disturbances().hums
