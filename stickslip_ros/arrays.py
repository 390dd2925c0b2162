# SPDX-License-Identifier: Apache-2.0
"""The one type of arrays of numbers, and sums of products that every processor rounds alike."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def weighted_sum(weights: Array, values: Array) -> float:
    """Return the sum of products of two arrays (n,), added up in their order.

    A product of linear algebra (``weights @ values``) rounds differently with the processor.
    """
    total = 0.0
    for weight, value in zip(weights.tolist(), values.tolist(), strict=True):
        total += weight * value
    return total
