# SPDX-License-Identifier: Apache-2.0
"""A measured axis behind a lagging amplifier, against an integrator of its own."""

from __future__ import annotations

import math

import numpy as np
import pytest
from bench_traces import Axis, Drive
from experiments import truth_of
from other_axes import Other, other_trace

from stickslip_ros.identification.experiment import Experiment, IdentificationError, Stepping
from stickslip_ros.identification.free import free_of
from stickslip_ros.identification.identify import identify
from stickslip_ros.parameters import Parameters
from stickslip_ros.traces.motion import Motion

AXIS = Axis(preload=0.6, mass=5e-3, sigma_1=7.0)
KNOWN = {"preload": 0.6, "mass": 5e-3, "frequency": 400.0, "amplitude": 280.0}


@pytest.mark.usefixtures("compiled_solver")
@pytest.mark.parametrize("lag", [3e-7, 1.5e-6, 3e-6])
def test_twelve_lagging_cycles_are_those_of_the_integrator(lag: float) -> None:
    drive = Drive(12, frequency=400.0, amplitude=280.0, pause=5e-3)
    t, x = other_trace(AXIS, Other(lag=lag), drive, 5e5, 0.0, 3)
    p = Parameters.of({**KNOWN, **truth_of(AXIS)})
    experiment = Experiment(p, Motion("lab", t, x), (Stepping(5e-3, 12, 400.0),))
    free = free_of([p]).with_lag(lag)
    found, _ = experiment.simulation(free.applied(p, free.start), np.array([5e-3])).sample(t)
    without, _ = experiment.simulation(p, np.array([5e-3])).sample(t)
    assert np.abs(found - x).max() < 1e-10
    assert np.abs(found - x).max() < 0.03 * np.abs(without - x).max()


def test_an_amplifier_that_is_known_cannot_be_free() -> None:
    t = np.arange(0.0, 0.05, 2e-6)
    x = 1e-7 * np.floor(np.clip(400.0 * (t - 5e-3), 0.0, 10.0))
    known = Parameters.of({**KNOWN, "amplifier_bandwidth": 1.0 / (2.0 * math.pi * 1e-6)})
    with pytest.raises(IdentificationError, match="set amplifier_bandwidth"):
        identify([(known, Motion("lab", t, x))], fit_lag=True)
