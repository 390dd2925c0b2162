# SPDX-License-Identifier: Apache-2.0
"""Deadlines of a periodic task, by a clock that is passed in.

Deadlines lie at whole periods after the start, so lateness never adds up. One that was not used
before the next one came is counted and skipped: late work never comes in a burst.
"""

from __future__ import annotations

import math

#: Timers may fire early by this share of the period.
_EARLY = 0.1


class Pacer:
    """Deadlines at ``start + k period``, all in seconds of one steady clock."""

    def __init__(self, period: float, start: float) -> None:
        """Set the period and the start (s): that of the timer, not of its first tick."""
        self.period = period
        self._start = start
        self._done = 0
        self.missed = 0  #: deadlines skipped since the start
        self.lag = 0.0  #: lateness of the last block behind the first deadline it serves, s
        self.worst_lag = 0.0  #: largest lag since `forget_worst`, s

    def tick(self, now: float) -> bool:
        """Note that the task runs at ``now``; return False if no deadline has come since."""
        due = math.floor((now - self._start) / self.period + _EARLY)
        if due <= self._done:
            return False
        first = self._start + (self._done + 1) * self.period  # that nothing was done for
        self.missed += due - self._done - 1
        self._done = due
        self.lag = max(0.0, now - first)
        self.worst_lag = max(self.worst_lag, self.lag)
        return True

    def forget_worst(self) -> None:
        """Start a new window for `worst_lag`."""
        self.worst_lag = 0.0
