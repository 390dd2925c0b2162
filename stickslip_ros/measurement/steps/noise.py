# SPDX-License-Identifier: Apache-2.0
"""The noise of samples, and which of them are spikes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.arrays import Array

#: A spike differs from the median of its neighbours by this many times the noise, and by this many
#: times the difference of all but a hundredth of the samples; and by this many times that of three
#: quarters of those beside it.
_SPIKE, _USUAL, _ALONE = 8.0, 3.0, 4.0
_NEIGHBOURS, _ALL_BUT_FEW, _MOST_BESIDE = 5, 0.99, 0.75
#: Least differences within which most neighbours are on a coarse converter; part of one by which
#: they may miss whole numbers of it, as printed.
_COARSE, _WHOLE = 20.0, 0.1
#: Samples from which noise is estimated, at most and at least.
_LOOKED_AT, _SHORT = 2**20, 8
#: Samples of one spectrum of the noise; times the noise beside its lines that is no noise alone.
_STRETCH_OF_NOISE, _LINE = 1024, 1.5


def robust_std(x: Array) -> float:
    """Return the standard deviation by the median deviation, which outliers hardly change."""
    return 1.4826 * float(np.median(np.abs(x - np.median(x))))


def quantum_of(x: Array) -> float:
    """Return the step (m) of a converter that samples are whole multiples of; 0 where none is seen.

    It is the least difference of neighbours, if they differ by few of it, which hides the noise;
    neighbours on a straight line differ by one alone.
    """
    apart = np.diff(x[:_LOOKED_AT])
    apart = apart[apart != 0.0]
    if not len(apart):
        return 0.0
    least = float(np.abs(apart).min())
    steps = apart / least
    few = steps[np.abs(steps) < _COARSE]
    whole = np.rint(few)
    seen = 2 * len(few) > len(apart) and len(np.unique(whole)) > 1
    return least if seen and (np.abs(few - whole) < _WHOLE).all() else 0.0


def noise_of(x: Array) -> float:
    """Return the standard deviation (m) of the noise of a sample, that of rounding at least."""
    return max(_scatter_of(x), quantum_of(x) / math.sqrt(12.0))


def _scatter_of(x: Array) -> float:
    if len(x) < _SHORT:
        return 0.0
    if len(x) > _LOOKED_AT:  # stretches of neighbouring samples from all over
        count = _LOOKED_AT // _STRETCH_OF_NOISE
        starts = np.linspace(0, len(x) - _STRETCH_OF_NOISE, count).astype(np.int64)
        x = np.concatenate([x[k : k + _STRETCH_OF_NOISE] for k in starts])
    third = np.diff(x, 3)  # removes smooth motion; its variance is 20 times that of the noise
    usual = robust_std(third) / math.sqrt(20.0)
    # Ringing of two to four samples a swing is no smooth motion, but few lines of the spectrum.
    width = min(len(third), _STRETCH_OF_NOISE)
    window = np.hanning(width + 2)[1:-1]
    parts = third[: len(third) // width * width].reshape(-1, width) * window
    power = np.mean(np.abs(np.fft.rfft(parts)) ** 2, axis=0) / float(window @ window)
    upper = slice(len(power) // 2, None)
    white = (2.0 * np.sin(np.pi * np.fft.rfftfreq(width))) ** 6
    median_of_mean = (1.0 - 1.0 / (9.0 * len(parts))) ** 3  # of powers of chance, as parts of it
    floor = math.sqrt(float(np.median(power[upper] / white[upper])) / median_of_mean)
    return floor if _LINE * floor < usual else usual


def without_spikes(x: Array, noise: float) -> NDArray[np.bool_]:
    """Return which samples (m) with such noise (m) are no spikes, shape (samples,).

    A spike is alone: beside the first swing after a slip, others are nearly as large.
    """
    away = np.abs(x - _median_of_five(x))
    sample = away[:: max(1, len(away) // _LOOKED_AT)]
    usual = max(_SPIKE * robust_std(sample), _USUAL * float(np.quantile(sample, _ALL_BUT_FEW)))
    far = np.flatnonzero(away > max(usual, _SPIKE * noise))
    beside = np.delete(np.arange(-_NEIGHBOURS, _NEIGHBOURS + 1), _NEIGHBOURS)
    others = away[np.clip(far[:, None] + beside, 0, len(x) - 1)]
    alone = away[far] > _ALONE * np.quantile(others, _MOST_BESIDE, axis=1)
    return ~np.isin(np.arange(len(x)), far[alone])


def _median_of_five(x: Array) -> Array:
    """Return the running median of five samples, by the exchanges that sort five."""
    a, b, c, d, e = (np.pad(x, 2, mode="edge")[k : k + len(x)] for k in range(5))
    low = np.maximum(np.minimum(a, b), np.minimum(d, e))
    high = np.minimum(np.maximum(a, b), np.maximum(d, e))
    return np.maximum(np.minimum(np.maximum(low, high), c), np.minimum(low, high))
