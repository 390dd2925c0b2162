# SPDX-License-Identifier: Apache-2.0
"""Choices between values that laws make, for one operating point and for columns of many.

A law is arithmetic on parameters, and arithmetic is the same for numbers and for arrays of them.
Only choices are not; with these in place of ``or`` and ``min`` a law is written once for both.
"""

from __future__ import annotations

from typing import Any

import numpy as np


def chosen(value: Any, own: Any) -> Any:
    """Return value where it is set, the law's own one where it is 0."""
    if isinstance(value, np.ndarray):
        return np.where(value == 0.0, own, value)
    return value or own


def smaller(a: Any, b: Any) -> Any:
    """Return the smaller of two values, element by element if one is an array."""
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return np.minimum(a, b)
    return min(a, b)
