# SPDX-License-Identifier: Apache-2.0
"""Steps, drift and hum of bench traces, within their own standard errors."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bench_traces import Axis, Bench, Drive, Sensor, bench_trace, random_bench

from stickslip_ros.traces import joint_fit
from stickslip_ros.traces.cycle_rows import Course
from stickslip_ros.traces.evenly import even_samples
from stickslip_ros.traces.joint_fit import Disturbances, Steps, fit_steps
from stickslip_ros.traces.ringing import Ringing
from stickslip_ros.traces.runs import find_steps


def fitted(bench: Bench) -> tuple[list[Steps], Disturbances]:
    """The fit of a trace whose runs and ringing are known."""
    mass, stiffness, damping, *_ = bench.axis.constants
    decay = 0.5 * damping / mass
    ringing = Ringing(math.sqrt(stiffness / mass - decay**2) / (2.0 * math.pi), decay)
    courses = [
        Course(
            run.start + 1.0 / run.frequency - drive.amplitude / 100e6,
            1.0 / run.frequency, run.steps, run.direction, abs(run.step_size), 1.0,
        )
        for run, drive in zip(bench.runs, bench.drives, strict=True)
    ]  # fmt: skip
    even = even_samples(bench.t, bench.x, 2**21)
    return fit_steps(even, courses, [ringing] * len(courses))


@pytest.mark.parametrize("seed", range(3000, 3010))
@pytest.mark.parametrize("hard", [False, True], ids=["easy", "hard"])
def test_the_step_lies_within_three_of_its_standard_errors(seed: int, hard: bool) -> None:
    bench = random_bench(seed, hard)
    for step, true in zip(fitted(bench)[0], bench.runs, strict=True):
        assert abs(true.direction * step.size - true.step_size) < 3.0 * step.error
        if not hard:
            assert step.error < 0.3e-9


def test_standard_errors_are_no_larger_than_they_have_to_be() -> None:
    """Root mean square of the deviations in standard errors: 1 but for chance."""
    deviations = []
    for seed in range(3000, 3025):
        bench = random_bench(seed, hard=False)
        (step,), (true,) = fitted(bench)[0], bench.runs
        deviations.append((true.direction * step.size - true.step_size) / step.error)
    size = math.sqrt(sum(one**2 for one in deviations) / len(deviations))
    assert 0.6 < size < 1.5


@pytest.mark.parametrize("mains", [50.0, 60.0])
def test_drift_and_hum_are_told_with_their_uncertainty(mains: float) -> None:
    sensor = Sensor(rate=50e3, noise=1e-9, hum=1e-8, mains=mains, drift=1.5e-7, offset=0.3)
    bench = bench_trace(Axis(), (Drive(12, 130.0, pause=0.06),), sensor, rest=0.06)
    steps, found = fitted(bench)
    assert abs(steps[0].size - bench.runs[0].step_size) < 3.0 * steps[0].error < 0.3e-9
    assert found.drifts
    assert abs(found.drift - 1.5e-7) < 3.0 * found.drift_error
    assert found.hums
    assert found.mains == mains
    assert math.hypot(*found.waves[0]) == pytest.approx(1e-8, abs=4.0 * found.hum_error)
    assert math.hypot(*found.waves[1]) == pytest.approx(4e-9, abs=4.0 * found.hum_error)
    left = bench.x - found.at(bench.t) - bench.clean
    assert left.std() < 1.05e-9


def test_what_is_not_there_is_not_told() -> None:
    sensor = Sensor(rate=50e3, noise=1e-9)
    bench = bench_trace(Axis(), (Drive(12, 130.0, pause=0.06),), sensor, rest=0.06)
    found = find_steps(bench.t, bench.x)
    assert len(found.runs) == 1
    assert not found.disturbances.drifts
    assert not found.disturbances.hums


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
    assert abs(step.size - run.step_size) < 3.0 * step.error < 0.3e-9
    assert not found.drifts


def test_a_motion_without_noise_has_errors_all_the_same() -> None:
    """Rounding made variances negative: a long run, exact to 1e-15 m, ended in a traceback."""
    random = np.random.default_rng(1)
    one, other, third = random.standard_normal((3, 1000))
    for unlike in 10.0 ** -np.arange(5.0, 10.0):
        columns = np.stack([one, one + unlike * other, third], axis=1)
        fit = joint_fit._Fit(columns, columns @ [1.0, 1.0, 2.0], np.ones(3))
        for column in range(3):
            value, error = fit.value(column, 1e-30)
            assert 0.0 <= error <= 1.0
            assert value == pytest.approx([1.0, 1.0, 2.0][column], abs=1e-3)
        assert np.isfinite(fit.evidence(1e-30))


class _Known:
    """A fit of which value and standard error are known."""

    def __init__(self, value: float, error: float) -> None:
        self._found = value, error

    def value(self, column: int, chance: float) -> tuple[float, float]:
        return self._found if column == 0 else (0.0, 0.0)


def test_the_error_of_an_average_over_fits_is_that_of_numbers_drawn_from_them() -> None:
    """What the fits differ by counts as well: with and without hum, steps are not the same."""
    share = np.array([0.6, 0.3, 0.1])
    values, errors = np.array([1.0, 3.0, -2.0]), np.array([0.5, 0.2, 1.0])
    one = np.ones((1, 1))
    block = joint_fit._Block(
        np.zeros(1), 1.0, lambda columns: columns, one, np.ones((1, 2)), np.ones(2)
    )
    fits: list[Any] = [_Known(*pair) for pair in zip(values, errors, strict=True)]
    (step,), _ = joint_fit._told([block], fits, share, 1.0, 2)
    random = np.random.default_rng(4)
    drawn = random.choice(3, 400_000, p=share)
    numbers = values[drawn] + errors[drawn] * random.standard_normal(len(drawn))
    assert step.size == pytest.approx(numbers.mean(), abs=0.02)
    assert step.error == pytest.approx(numbers.std(), rel=0.01)
