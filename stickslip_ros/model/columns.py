# SPDX-License-Identifier: Apache-2.0
"""Column sets: full sets of parameters of many operating points, numbers as arrays (points,)."""

from __future__ import annotations

import numpy as np

from stickslip_ros.parameters import Values


def row_of(p: Values, index: int) -> Values:
    """Return the plain set of parameters of one point of a column set."""
    return {
        name: value[index].item() if isinstance(value, np.ndarray) else value
        for name, value in p.items()
    }
