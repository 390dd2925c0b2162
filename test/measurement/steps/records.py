# SPDX-License-Identifier: Apache-2.0
"""Records whose steps are known, for the tests of the search."""

import math

import numpy as np
from bench_traces import Axis, Bench, Drive, Sensor, TrueRun, bench_trace

from stickslip_ros.measurement.steps.run import Run

NOISY = Sensor(rate=1e5, noise=1e-9)


def bench(
    cycles: int = 12, frequency: float = 500.0, sensor: Sensor = NOISY, **drive: float
) -> Bench:
    """Return one run with a rest on both sides."""
    plan = Drive(cycles, frequency, pause=3.0 / frequency, **drive)  # type: ignore[arg-type]
    return bench_trace(Axis(), (plan,), sensor, rest=max(3.0 / frequency, 2e-3), seed=5)


def assert_right(run: Run, true: TrueRun) -> None:
    """Assert that a run is what was made, each value within three of its errors."""
    assert (run.steps, run.direction) == (true.steps, true.direction)
    assert run.frequency == np.float64(true.frequency) or math.isclose(
        run.frequency, true.frequency, rel_tol=1e-3
    )
    assert run.doubts == ()
    assert abs(run.step_size - true.step_size) < max(
        3.0 * run.step_size_error, 0.01 * abs(true.step_size)
    )
    if math.isfinite(run.backstep):
        off = abs(run.backstep - true.backstep)
        assert off < max(3.0 * run.backstep_error, 0.01 * true.backstep)
