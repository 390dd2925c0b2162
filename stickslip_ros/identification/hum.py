# SPDX-License-Identifier: Apache-2.0
"""Hum of the mains in a measurement."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Mains frequencies, Hz, and how many harmonics of each may hum.
MAINS, HARMONICS = (50.0, 60.0), 3
#: Hum stands out if each of its columns takes so many times what chance would give; lags that tell
#: how neighbouring residuals go together.
_CLEAR, _LAGS = 4.0, 12


def hum_columns(t: Array, mains: tuple[float, ...]) -> list[Array]:
    """Return cosine and sine of each harmonic of the mains at times t (s)."""
    found = []
    for frequency in mains:
        for harmonic in range(1, HARMONICS + 1):
            angle = 2.0 * math.pi * harmonic * frequency * t
            found += [np.cos(angle), np.sin(angle)]
    return found


def hum_in(t: Array, left: Array) -> tuple[float, ...]:
    """Return the mains frequencies (Hz) that residuals (m) hum with, beyond chance.

    In a short measurement one frequency may take up most of the hum of the other; the second is
    named, too, if it still stands out when the first is taken out.
    """
    place = (t - t.mean()) / np.ptp(t)
    plain = [np.ones_like(t), place]
    found: tuple[float, ...] = ()
    while len(found) < len(MAINS):
        others = [one for one in MAINS if one not in found]
        sizes = [_standing_out(t, left, plain, one) for one in others]
        best = int(np.argmax(sizes))
        if not sizes[best] > _CLEAR:
            break
        found = (*found, others[best])
        plain += hum_columns(t, (others[best],))
    return found


def _standing_out(t: Array, left: Array, plain: list[Array], frequency: float) -> float:
    """Return how many times what chance would give a frequency (Hz) takes, beside other columns."""
    known, _ = np.linalg.qr(np.column_stack(plain))
    columns = np.column_stack([*plain, *hum_columns(t, (frequency,))])
    basis, _ = np.linalg.qr(columns)
    before = left - known @ (known.T @ left)
    after = left - basis @ (basis.T @ left)
    noise = float(after @ after) / max(len(t) - columns.shape[1], 1)
    # Neighbouring residuals may go together: what their mean over a while leaves is chance.
    size = float(before @ before - after @ after) / max(noise, 1e-40) / (2 * HARMONICS)
    inflation = 1.0 + 2.0 * float(np.sum(np.maximum(correlation_of(after, _LAGS)[1:], 0.0)))
    return size / inflation


def correlation_of(left: Array, most: int) -> Array:
    """Return the autocorrelation at lags from 0 to most, (most + 1,)."""
    power = float(left @ left)
    return np.array([float(left[: len(left) - k] @ left[k:]) / power for k in range(most + 1)])
