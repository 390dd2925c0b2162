# SPDX-License-Identifier: Apache-2.0
"""The judge of the accuracy campaign, held against SciPy: code of neither is shared."""

from typing import Any

import numpy as np
import pytest
from reference import integrate

from stickslip_ros.model import Plant, drive_of
from stickslip_ros.parameters import Parameters
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
