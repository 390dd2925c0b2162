# SPDX-License-Identifier: Apache-2.0
"""Deadlines of a periodic task and simulated time, both by a clock that is passed in.

Deadlines lie at whole periods after the start, so lateness never adds up. One that was not used
before the next one came is counted and skipped: late work never comes in a burst.
"""

from __future__ import annotations

import math

#: Timers may fire early by this share of the period.
_EARLY = 0.1


class Pacer:
    """Deadlines at ``start + k period``, all in seconds of one steady clock."""

    def __init__(self, period: float) -> None:
        """Set the period (s); the first tick is the start."""
        self.period = period
        self._start: float | None = None
        self._done = 0
        self.missed = 0  #: deadlines skipped since the start
        self.lag = 0.0  #: lateness of the last block behind its deadline, s
        self.worst_lag = 0.0  #: largest lag since `forget_worst`, s

    def tick(self, now: float) -> bool:
        """Note that the task runs at ``now``; return False if no deadline has come since."""
        if self._start is None:
            self._start = now
            return True
        late = now - self._start
        due = math.floor(late / self.period + _EARLY)
        if due <= self._done:
            return False
        self.missed += due - self._done - 1
        self._done = due
        self.lag = max(0.0, late - due * self.period)
        self.worst_lag = max(self.worst_lag, self.lag)
        return True

    def forget_worst(self) -> None:
        """Start a new window for `worst_lag`."""
        self.worst_lag = 0.0


class Timeline:
    """Simulated time from 0 on. Readings of clocks and stamps are nanoseconds too.

    A stamp is that of the start plus the time simulated, so stamps rise with it whatever is done
    to the clock of the machine meanwhile.
    """

    def __init__(self, steady: int, stamp: int, factor: float) -> None:
        """Start where the steady clock shows ``steady`` and the clock of the machine ``stamp``.

        factor is simulated by real time; with 0 only `leap` moves the time.
        """
        self.ns = 0  #: the present time of the simulation
        self._steady = steady
        self._start_stamp = stamp
        self._factor = factor

    @property
    def seconds(self) -> float:
        """The present time of the simulation, s."""
        return self.ns * 1e-9

    @property
    def stamp(self) -> int:
        """The stamp of the present time."""
        return self._start_stamp + self.ns

    def follow(self, steady: int) -> None:
        """Go on to where a reading of the steady clock belongs; never back."""
        elapsed = steady - self._steady
        # Whole numbers as long as they do: a float counts single nanoseconds for 104 days only.
        now = elapsed if self._factor == 1.0 else int(elapsed * self._factor)
        self.ns = max(self.ns, now)

    def leap(self, ns: int) -> None:
        """Advance by this many nanoseconds."""
        self.ns += ns
