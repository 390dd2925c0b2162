# SPDX-License-Identifier: Apache-2.0
"""The judge of the accuracy campaign, held against SciPy: code of neither is shared."""

from typing import Any

import numpy as np
import pytest
from reference import integrate

from stickslip_ros.model import Plant, drive_of
from stickslip_ros.parameters import Parameters
from stickslip_ros.solver import Simulation
from validation.benchmark import judge


@pytest.mark.slow
@pytest.mark.parametrize(
    "values",
    [
        {"model": "lugre"},
        {"model": "epm_fix", "spring": 1e5},
        {"model": "epm_calc", "preload": 1.0, "force": 0.05},
        {"preload": 1.0, "sigma_2": 0.5},
    ],
    ids=str,
)
def test_the_judge_agrees_with_scipy(values: dict[str, Any]) -> None:
    """DOP853 of SciPy, as the tests of the solver use it: code of neither."""
    p = Parameters.of({"frequency": 1e4, **values})
    expected = integrate(p, drive_of(p), 2)
    np.testing.assert_allclose(judge.positions(Plant.of(p), drive_of(p), 2), expected, atol=2e-12)


#: The set of which 20 steps were 10 nm off before the Stribeck curve was in the error control
NARROW = {
    "model": "epm_calc",
    "preload": 1.03,
    "mass": 0.01226,
    "sigma_1": 5.8,
    "sigma_0": 4.28e6,
    "mu_s": 0.3855,
    "mu_k": 0.1127,
    "v_stribeck": 6.1e-5,
    "z_ba": 2.22e-8,
    "amplitude": 168.0,
    "frequency": 3490.0,
    "slewrate": 233.0,
}


def test_a_narrow_stribeck_curve() -> None:
    """Within a thousandth of a nanometre a cycle of the judge, and of itself at its finest."""
    p = Parameters.of(NARROW)
    runs = []
    for tolerance in (p.solver.tolerance, 1e-14):
        simulation = Simulation(Plant.of(p), tolerance)
        simulation.start(drive_of(p), 20)
        runs.append(simulation.run_cycles(20).position)
    assert abs(runs[0][-1] - runs[1][-1]) < 20e-12
    assert runs[0][-1] == pytest.approx(1360.189e-9, abs=0.01e-9)
    true = judge.positions(Plant.of(p), drive_of(p), 2)
    np.testing.assert_allclose(runs[0][:2], true, atol=2e-12)
