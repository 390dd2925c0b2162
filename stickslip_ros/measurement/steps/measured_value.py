# SPDX-License-Identifier: Apache-2.0
"""A measured value with its error."""

from __future__ import annotations

import math
from dataclasses import dataclass

#: Standard errors of a significant difference: 0.3 % of a normal distribution lie beyond.
COVERAGE = 3.0


@dataclass(frozen=True)
class MeasuredValue:
    """A value with its standard error; both nan where it cannot be determined."""

    value: float = math.nan
    error: float = math.nan
