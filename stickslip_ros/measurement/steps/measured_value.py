# SPDX-License-Identifier: Apache-2.0
"""Means of measured values with the errors that their scatter shows."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.simulation.settled import settled_from

#: Standard errors of a significant difference: 0.3 % of a normal distribution lie beyond.
COVERAGE = 3.0
#: So many settled values show their scatter by themselves. Of fewer, all but the first cycles of a
#: run do, which differ most.
_SHOW_SCATTER, _FIRST = 8, 3


@dataclass(frozen=True)
class MeasuredValue:
    """A value with its standard error; both nan where it cannot be determined."""

    value: float = math.nan
    error: float = math.nan


def estimate_settled_mean(values: NDArray[np.float64], exact: bool) -> MeasuredValue:
    """Return the mean of the settled values, (steps,), with the error that their scatter shows.

    Where few of them are settled, earlier ones show the scatter, too. Of exact values (without
    noise) it is no chance: a single one has no error.
    """
    kept, earlier = values[settled_from(len(values)) :], values[_FIRST:]
    kept, earlier = kept[np.isfinite(kept)], earlier[np.isfinite(earlier)]
    if not len(kept):
        return MeasuredValue(math.nan, math.nan)
    among = kept if exact or len(kept) >= _SHOW_SCATTER else max(kept, earlier, key=len)
    if len(among) < 2:
        return MeasuredValue(float(np.mean(kept)), 0.0 if exact else math.nan)
    error = float(np.std(among, ddof=1)) / math.sqrt(len(kept))
    if not exact:
        # `COVERAGE` of the widened ones hold the mean as often as those of a normal distribution do
        # (Student, Biometrika 6 (1908) 1).
        tail = scipy.special.ndtr(COVERAGE)
        error *= float(scipy.special.stdtrit(len(among) - 1, tail)) / COVERAGE
    return MeasuredValue(float(np.mean(kept)), error)
