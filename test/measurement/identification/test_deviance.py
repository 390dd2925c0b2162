# SPDX-License-Identifier: Apache-2.0
"""Which of two laws made a trace, by the deviances of two fits."""

import math
from typing import Any

import numpy as np
import pytest
from bench_traces import Axis, Drive
from experiments import small, truth_of
from other_axes import Other, other_trace

from stickslip_ros.measurement.identification import Experiment, identify
from stickslip_ros.measurement.identification.free import free_parameters
from stickslip_ros.measurement.identification.problem import Problem
from stickslip_ros.measurement.identification.trace import Trace
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.simulation.motion import Motion

AXIS = Axis(preload=0.6, mass=5e-3, sigma_1=7.0)


def test_it_is_least_at_the_noise_that_is_there() -> None:
    """The sum of squares alone falls with each noise that is taken for larger."""
    axis, (known, motion) = small()
    truth = truth_of(axis)
    trace = Trace(Experiment.of(known.replace(**truth), motion))
    problem = Problem([trace], free_parameters([trace.parameters], list(truth)))
    begun = problem.point(problem.begin(np.log(list(truth.values()))))
    assert begun is not None
    at = problem.descend(begun, 8)
    trace.learn(at.seen[0])
    learnt, found = trace.noise, {}
    for factor in (0.5, 1.0, 2.0):
        trace.set_noise(factor * learnt)
        found[factor] = problem.point_of(at.unknowns, at.seen).deviance + trace.loudness
    assert min(found, key=lambda factor: found[factor]) == 1.0
    assert found[2.0] - found[1.0] == pytest.approx((math.log(2.0) - 0.5) * trace.known, rel=0.2)


def deviance(law: str, model: str, fit: list[str] | None = None, **more: Any) -> float:
    """Deviance of a model, fitted to a trace with 1 nm of noise that a law made."""
    drive = Drive(10, frequency=700.0, amplitude=280.0, pause=4e-3)
    t, x = other_trace(AXIS, Other(law=law), drive, 5e5, 1e-9, 3)
    known = {"preload": 0.6, "mass": 5e-3, "frequency": 700.0, "amplitude": 280.0, "model": model}
    start = {name: 1.5 * value for name, value in truth_of(AXIS).items()}
    return identify(
        [(Parameters.of({**known, **start, **more}), Motion("lab", t, x))], fit
    ).deviance


@pytest.mark.long
@pytest.mark.parametrize(("law", "other"), [("ceim", "lugre"), ("lugre", "ceim")])
def test_the_law_of_the_axis_has_the_lower_one(law: str, other: str) -> None:
    assert deviance(law, other) - deviance(law, law) > 50.0


@pytest.mark.long
def test_a_law_under_another_name_has_the_same() -> None:
    """With mu_s = mu_k, epm_fix is the CEIM with a free z_ss."""
    fix = deviance("ceim", "epm_fix", mu_s=0.2, mu_k=0.2)
    free = ["sigma_0", "sigma_1", "z_ba", "sigma_0ss", "z_ss"]
    assert deviance("ceim", "ceim", free, z_ss=6e-8) == pytest.approx(fix, abs=2.0)


def test_the_derivatives_are_those_of_the_residuals() -> None:
    """Of two records with clocks of their own: by differences of what is computed, row by row."""
    traces = [Trace(Experiment.of(*small(seed)[1])) for seed in (3, 4)]
    problem = Problem(traces, free_parameters([one.parameters for one in traces], ["sigma_1"]))
    at = problem.point(problem.begin(problem.free.start))
    assert at
    jacobian = problem.jacobian(at, central=True)
    for k in range(problem.size):
        step = np.zeros(problem.size)
        step[k] = 1e-3
        ends = [problem.point(at.unknowns + sign * step) for sign in (1.0, -1.0)]
        assert ends[0] and ends[1]
        quotient = (ends[0].residuals - ends[1].residuals) / 2e-3
        assert jacobian[:, k] == pytest.approx(quotient, abs=0.02 * float(np.abs(quotient).max()))
