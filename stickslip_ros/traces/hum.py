# SPDX-License-Identifier: Apache-2.0
"""Hum of the mains in a measurement: its frequencies, its usual size, its waves."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from stickslip_ros.arrays import Array

#: Mains frequencies, Hz, and the default number of harmonics of each.
MAINS, HARMONICS = (50.0, 60.0), 3
#: Slower oscillations (Hz) are hum, up to the seventh harmonic: axes ring at kilohertz.
HUMMING = 350.0
#: Prior standard deviation of the amplitudes of the fundamental, m; that of harmonic n is n times
#: smaller.
USUAL = 2e-8


def hum_columns(t: Array, mains: Sequence[float], harmonics: int = HARMONICS) -> list[Array]:
    """Return cosine and sine of each harmonic of the mains (Hz) at times t (s)."""
    found = []
    for frequency in mains:
        first = np.exp(2j * math.pi * frequency * t)
        wave = np.ones_like(first)
        for _ in range(harmonics):
            wave = wave * first
            found += [wave.real, wave.imag]
    return found
