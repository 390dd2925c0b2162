# SPDX-License-Identifier: Apache-2.0
"""Swapped columns and impossible units are refused with what is likely."""

import numpy as np
import pytest

import stickslip_ros as ss

STEPS = 40


@pytest.fixture(scope="module")
def run() -> ss.Motion:
    """Runner and actuator of a run without noise."""
    return ss.Motion.of_trace(ss.simulate(steps=STEPS).trace_at(200e3), "run")


def test_swapped_columns_are_said(run: ss.Motion) -> None:
    with pytest.raises(ss.MeasurementError, match="as if both columns were swapped"):
        ss.analyse(run.t, np.asarray(run.u), run.x)


def test_the_runner_cannot_outrun_its_actuator(run: ss.Motion) -> None:
    with pytest.raises(ss.TraceError, match="which it cannot outrun"):
        ss.analyse(run.t, 1e3 * run.x, np.asarray(run.u))


def test_no_drive_steps_by_a_metre(run: ss.Motion) -> None:
    with pytest.raises(ss.TraceError, match="which no stick-slip drive makes"):
        ss.analyse(run.t, 1e9 * run.x)


def test_a_runner_that_only_follows_its_actuator_is_no_swapped_column() -> None:
    t = np.linspace(0.0, 0.1, 4001)
    actuator = 1e-7 * (t / 0.01 % 1.0)
    follows = ss.read_measurement((t, 0.5 * actuator, actuator))
    assert follows.u is not None
    assert np.ptp(follows.u) > np.ptp(follows.x)
