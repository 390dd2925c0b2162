# SPDX-License-Identifier: Apache-2.0
"""Steps of least squares beside bounds."""

import numpy as np

from stickslip_ros.identification.free import FreeParameters
from stickslip_ros.identification.least_squares import Problem


def test_what_a_bound_holds_back_moves_nothing_else() -> None:
    """The second unknown would fall below its bound: the first one does not follow it."""
    free = FreeParameters(("sigma_0", "z_ba"), np.zeros(2), np.array([-1.0, 0.0]), np.ones(2), {})
    problem = Problem([], free)
    jacobian = np.array([[1.0, 1.0], [0.0, 1.0]])
    residuals = np.array([0.5, 1.0])

    def solve(some: list[int]) -> np.ndarray:
        return np.asarray(-np.linalg.lstsq(jacobian[:, some], residuals, rcond=None)[0])

    both = range(problem.size)
    assert np.allclose(problem.step(np.array([0.0, 0.5]), both, solve), [0.5, -1.0])
    assert np.allclose(problem.step(np.array([0.0, 0.0]), both, solve), [-0.5, 0.0])
    assert np.allclose(problem.step(np.array([-1.0, 0.0]), both, solve), [0.0, 0.0])
