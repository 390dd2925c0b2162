# SPDX-License-Identifier: Apache-2.0
"""Soft limits: how many cycles are sure to stay within them."""

from __future__ import annotations

import math

#: As good as no limit
ANY = 2**62


def cycles_that_fit(room: float, stroke: float) -> int:
    """Return how many cycles surely stay within ``room`` (m) in the direction of the step.

    Within a cycle the runner gets ahead by the stroke of the actuator (m) at most.
    """
    if room < stroke:
        return 0
    return int(min(math.floor(room / stroke), ANY))
