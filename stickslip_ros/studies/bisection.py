# SPDX-License-Identifier: Apache-2.0
"""Bisection at many operating points at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

#: (values to try, at which points) -> at which points the value is high enough
Trial = Callable[[NDArray[np.float64], NDArray[np.bool_]], NDArray[np.bool_]]


def bisect(
    is_enough: Trial,
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    where: NDArray[np.bool_],
    accuracy: NDArray[np.float64] | float,
) -> NDArray[np.float64]:
    """Return the lowest value found that is enough, shape (points,); nan where ``where`` is false.

    low is known not to be enough and high to be enough. Ends where the two are no further apart
    than accuracy; every point takes the same path as if it were alone.
    """
    low, high = low.copy(), high.copy()
    while True:
        active = where & (high - low > accuracy)
        if not active.any():
            return np.where(where, high, np.nan)
        middle = 0.5 * (low + high)
        enough = is_enough(middle, active)
        high = np.where(active & enough, middle, high)
        low = np.where(active & ~enough, middle, low)
