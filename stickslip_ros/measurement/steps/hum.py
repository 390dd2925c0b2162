# SPDX-License-Identifier: Apache-2.0
"""Hum of the mains in a measurement."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from stickslip_ros.base.arrays import Array

#: Mains frequencies, Hz, and the number of harmonics of each.
MAINS, HARMONICS = (50.0, 60.0), 3


def hum_columns(
    t: Array, mains: Sequence[float], harmonics: int = HARMONICS, width: Array | float = 0.0
) -> list[Array]:
    """Return cosine and sine of each harmonic of the mains (Hz) at times t (s).

    They are means over a width (s).
    """
    found = []
    for frequency in mains:
        first = np.exp(2j * math.pi * frequency * t)
        wave = np.ones_like(first)
        for k in range(1, harmonics + 1):
            wave = wave * first
            mean = wave * np.sinc(k * frequency * np.asarray(width))
            found += [mean.real, mean.imag]
    return found
