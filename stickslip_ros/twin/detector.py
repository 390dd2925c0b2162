# SPDX-License-Identifier: Apache-2.0
"""Tells a change, with a bound on the rate of false alarms that holds at every time.

While nothing changes, the tracker's prediction of a reading is normal with the mean and deviation
that it states, whatever came before. So the likelihood ratio of a shifted mean is an e-value:
its expectation is 1. The procedure of Shiryaev and Roberts adds up the e-values of all times at
which a change may have begun,

    M_k = (M_(k-1) + w_k) L_k,

with the time w_k of stepping that reading k ends. M - t is then a martingale, so the alarm M >= A
comes after a time of A in the mean at the earliest (Shiryaev 1963; Pollak 1985; for mixtures of
alternatives as here, e-detectors: Shin, Ramdas, Rinaldo 2023, arXiv:2203.03532).
"""

from __future__ import annotations

import numpy as np

#: Shifts of the mean that are looked for, in standard deviations, in and against the direction
SHIFTS = np.array([sign * size for size in (0.25, 0.5, 1.0, 2.0, 3.0) for sign in (1.0, -1.0)])
#: Deviations beyond which a reading counts no more: two glitches alone make no alarm
_MOST = 3.0


class ChangeDetector:
    """Sums evidence of a change; call `see` for each reading while the axis steps."""

    def __init__(self, interval: float) -> None:
        """Allow one false alarm in an interval (s) of stepping, in the mean."""
        self.interval = interval
        self.reset()

    def reset(self) -> None:
        """Begin anew, with no evidence."""
        self._sums = np.zeros(len(SHIFTS))
        self._runs = np.zeros(len(SHIFTS))  # logarithms of Page's sums, for the time of onset
        self._onsets = np.zeros(len(SHIFTS))

    @property
    def evidence(self) -> float:
        """Evidence of a change, s; an alarm where it reaches the interval."""
        return float(self._sums.mean())

    @property
    def onset(self) -> float:
        """Time (s) at which the likeliest change began."""
        return float(self._onsets[np.argmax(self._runs)])

    def see(self, t: float, duration: float, deviation: float) -> bool:
        """Take a reading at t (s) after a duration (s) of stepping; return whether it is a change.

        deviation is that from the prediction, in its standard deviations, positive in the direction
        of the steps.
        """
        # A deviation is cut on the side where it would count: the ratio only falls by that.
        seen = np.minimum(np.sign(SHIFTS) * deviation, _MOST)
        log_ratio = np.abs(SHIFTS) * (seen - 0.5 * np.abs(SHIFTS))
        self._sums = (self._sums + duration) * np.exp(log_ratio)
        np.minimum(self._sums, 1e100, out=self._sums)
        begins = self._runs <= 0.0
        self._onsets[begins] = t - duration
        self._runs = np.where(begins, 0.0, self._runs) + log_ratio
        return self.evidence >= self.interval
