# SPDX-License-Identifier: Apache-2.0
"""The common time base of a comparison and its low-pass filter."""

from __future__ import annotations

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.measurement.alignment import ComparisonError, Pairs

#: Order of the Butterworth filter, run to and fro: twice that in effect, without any delay.
ORDER = 4
#: Samples are even if their distances are within this part.
_EVEN = 1e-3


def filtered(pairs: Pairs, cutoff: float) -> Pairs:
    """Return run and measurement, both below the cutoff (Hz), on even samples.

    Raises ComparisonError for a cutoff that the samples cannot carry.
    """
    distances = np.diff(pairs.t)
    tick = float(np.median(distances))
    if not 0.0 < cutoff < 0.45 / tick:
        raise ComparisonError(
            f"the filter is {cutoff:g} Hz; it has to lie above 0 and below {0.45 / tick:g} Hz, "
            "0.45 of the sampling rate"
        )
    if np.ptp(distances) > _EVEN * tick:
        pairs = _evenly(pairs, tick)
    sections = scipy.signal.butter(ORDER, cutoff, fs=1.0 / tick, output="sos")

    def smooth(x: NDArray[np.float64]) -> NDArray[np.float64]:
        reach = min(len(x) - 1, int(3.0 / (cutoff * tick)))
        return np.asarray(scipy.signal.sosfiltfilt(sections, x, padlen=reach))

    return Pairs(pairs.t, smooth(pairs.run), smooth(pairs.measured), smooth(pairs.velocity))


def _evenly(pairs: Pairs, tick: float) -> Pairs:
    t = np.arange(pairs.t[0], pairs.t[-1], tick)
    parts = (pairs.run, pairs.measured, pairs.velocity)
    return Pairs(t, *(np.interp(t, pairs.t, part) for part in parts))
