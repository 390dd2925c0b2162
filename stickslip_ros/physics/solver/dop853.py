# SPDX-License-Identifier: Apache-2.0
"""The coefficients of DOP853, an explicit method of order 8, with its continuous output.

They stand in `dop853.csv`: SciPy has the same numbers, but takes 0.6 s to import.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stickslip_ros.base.arrays import Array

#: Stages with those of the continuous output, and those of a step alone
STAGES, STEP = 16, 12
#: Weight of the square of the estimate of third order beside that of fifth: as the authors of the
#: method have it
THIRD = 0.01
#: Powers of the fraction of a step in its continuous output, from 0 on
DEGREES = 8

_TABLE = np.loadtxt(Path(__file__).with_suffix(".csv"), delimiter=",")
#: What each stage takes of those before it; estimates of the error, of order 5 and 3; the last
#: four functions of the continuous output
A, ERRORS, OUTPUT = (part.copy() for part in np.split(_TABLE, (STAGES, STAGES + 2)))
#: When each stage is, as a fraction of the step
TIMES = np.sum(A, axis=1)


def _powers() -> Array:
    """Return the output's functions x, x (1 - x), x^2 (1 - x), ... as powers of x, (7, DEGREES)."""
    found, function = np.zeros((7, DEGREES)), [1.0]
    for k in range(7):
        same, risen = [*function, 0.0], [0.0, *function]
        function = risen if k % 2 == 0 else np.subtract(same, risen).tolist()
        found[k, : len(function)] = function
    return found


#: Powers of x that the functions of the continuous output are made of
POWERS = _powers()
