# SPDX-License-Identifier: Apache-2.0
"""Hum of the mains in the residuals of a fit.

A measurement shorter than some tenths of a second hardly distinguishes 50 from 60 Hz, and does not
show the error of the mains frequency. A wrong choice biases everything else that is fitted. So if
there is hum, that of both mains is removed, with errors of their frequencies of some hundredths.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.traces.hum import HARMONICS, MAINS, USUAL, hum_columns

Array = NDArray[np.float64]

#: Significance of hum: ratio of the part that each of its columns explains to that of chance; lags
#: for the correlation of neighbouring residuals.
_CLEAR, _LAGS = 4.0, 12
#: Prior standard deviation of the amplitudes in terms of the amplitude found; of the frequency, Hz.
_TIMES, _OFF = 1.5, 0.05


@dataclass(frozen=True)
class Hum:
    """Hum that a measurement has."""

    mains: tuple[float, ...]  #: the mains that it is of, Hz
    middle: float  #: of the measurement, s
    widths: Array  #: standard deviation of the amplitude of each column beforehand, m, (columns,)

    @classmethod
    def of(cls, t: Array, left: Array, mains: tuple[float, ...]) -> Hum | None:
        """Return the hum of some mains (Hz) in residuals (m) at times (s); None without mains."""
        if not mains:
            return None
        columns = np.column_stack([np.ones_like(t), t - t.mean(), *hum_columns(t, mains)])
        found = np.linalg.lstsq(columns, left, rcond=1e-3)[0][2:]
        width = max(USUAL, _TIMES * float(np.abs(found).max()))
        harmonics = np.repeat(np.arange(1.0, HARMONICS + 1.0), 2)
        both = np.tile(width / harmonics, len(MAINS))
        return cls(mains, float(t.mean()), np.concatenate([both, 2.0 * np.pi * _OFF * both]))

    def columns(self, t: Array) -> list[Array]:
        """Return the waves of all mains, and their change with the frequency, at times t (s)."""
        waves = hum_columns(t, MAINS)
        orders = np.tile(np.repeat(np.arange(1, HARMONICS + 1), 2), len(MAINS))
        moved = [k * (t - self.middle) * wave for k, wave in zip(orders, waves, strict=True)]
        return [*waves, *moved]


def hum_in(t: Array, left: Array) -> tuple[float, ...]:
    """Return the mains frequencies (Hz) of significant hum in residuals (m).

    In a short measurement one frequency may fit most of the hum of the other; the second is
    returned, too, if it is still significant after the first is removed.
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
    """Return the significance of a frequency (Hz) besides other columns: 1 is that of chance."""
    known, _ = np.linalg.qr(np.column_stack(plain))
    columns = np.column_stack([*plain, *hum_columns(t, (frequency,))])
    basis, _ = np.linalg.qr(columns)
    before = left - known @ (known.T @ left)
    after = left - basis @ (basis.T @ left)
    noise = float(after @ after) / max(len(t) - columns.shape[1], 1)
    # Neighbouring residuals may go together: what their mean over a while leaves is chance.
    size = float(before @ before - after @ after) / max(noise, 1e-40) / (2 * HARMONICS)
    inflation = 1.0 + 2.0 * float(np.sum(np.maximum(autocorrelation(after, _LAGS)[1:], 0.0)))
    return size / inflation


def autocorrelation(left: Array, most: int) -> Array:
    """Return the autocorrelation at lags from 0 to most, (most + 1,)."""
    power = float(left @ left)
    return np.array([float(left[: len(left) - k] @ left[k:]) / power for k in range(most + 1)])
