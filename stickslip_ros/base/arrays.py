# SPDX-License-Identifier: Apache-2.0
"""The one type of arrays of numbers, and sums that every machine rounds alike."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def add_up(values: Iterable[Any]) -> Any:
    """Return the sum of numbers or arrays, in their order.

    `sum` makes up for rounding since Python 3.12, and so rounds differently with the version.
    """
    total: Any = 0.0
    for value in values:
        total = total + value
    return total


def weighted_sum(weights: Array, values: Array) -> float:
    """Return the sum of products of two arrays (n,), added up in their order.

    A product of linear algebra (``weights @ values``) rounds differently with the processor.
    """
    pairs = zip(weights.tolist(), values.tolist(), strict=True)
    return float(add_up(weight * value for weight, value in pairs))
