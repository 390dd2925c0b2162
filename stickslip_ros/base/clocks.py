# SPDX-License-Identifier: Apache-2.0
"""Times by the clocks of the machine: one without steps, and when things are due."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

Item = TypeVar("Item")

_STEP = 1_000_000_000  # ns by which a clock that is set differs at least from one that is trimmed
#: Largest delay (s) of a busy machine; a longer one counts as a stop.
LATE = 0.2
#: Longest sleep (s) between checks whether to end.
_SLEEP = 0.05


class UnsetClock:
    """The clock of the machine without steps, because bags are read in the order of times.

    Corrections of the clock by less than a second are followed.
    """

    def __init__(
        self,
        wall: Callable[[], int] = time.time_ns,
        steady: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """Begin with the clocks (ns) as they are."""
        self._wall, self._steady = wall, steady
        self._offset = wall() - steady()
        self.set_by = self._before = 0  #: ns since the beginning

    def time_of(self, ns: int) -> int:
        """Convert a recent time of the machine's clock (ns) to the clock without steps."""
        wall = self._wall()
        set_by = wall - self._steady() - self._offset
        if abs(set_by - self.set_by) >= _STEP:
            self._before, self.set_by = self.set_by, set_by
        # What was read off just before it was set is nearer to the present without that.
        now = wall - self.set_by
        return min(ns - self.set_by, ns - self._before, key=lambda one: abs(one - now))


class Timetable:
    """The times at which messages are due, by a given clock, at a rate."""

    def __init__(
        self, rate: float, now: Callable[[], float] = time.monotonic, late: float = LATE
    ) -> None:
        """Start at the first thing asked for; rate 2 plays in half the time.

        late: the delay (s) beyond which the process was stopped.
        """
        self._rate = rate
        self._now = now
        self._late = late
        self._start: float | None = None
        self.moved = 0.0  #: s by which stops of the process have delayed the rest

    def wait(self, t: float, ended: Callable[[], bool]) -> bool:
        """Sleep until the time t (s since the beginning) has come; return False if ended first."""
        if self._start is None:
            self._start = self._now() - t / self._rate
        due = self._start + t / self._rate
        while (left := due - self._now()) > 0.0:
            if ended():
                return False
            time.sleep(min(left, _SLEEP))
        if -left > self._late:
            self._start -= left
            self.moved -= left
        return not ended()


def with_ticks(
    messages: Iterable[tuple[int, Item]], period_ns: int
) -> Iterator[tuple[int, Item | None]]:
    """Yield messages in their order, and None every period between the first and the last.

    messages are pairs of a time (ns) and anything; with period 0 there is nothing between.
    """
    tick: int | None = None
    for time_ns, message in messages:
        if period_ns and tick is None:
            tick = time_ns
        while tick is not None and tick <= time_ns:
            yield tick, None
            tick += period_ns
        yield time_ns, message
