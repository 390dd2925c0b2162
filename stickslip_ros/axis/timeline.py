# SPDX-License-Identifier: Apache-2.0
"""Simulated time by a steady clock that is passed in, in whole nanoseconds, and its stamps."""

from __future__ import annotations


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
        """Go on by so many nanoseconds."""
        self.ns += ns
