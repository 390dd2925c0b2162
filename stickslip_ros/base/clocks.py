# SPDX-License-Identifier: Apache-2.0
"""Times by the clocks of the machine: one without steps, and when things are due."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

Item = TypeVar("Item")

_STEP = 1_000_000_000  # ns by which a clock that is set differs at least from one that is trimmed
#: Largest delay (s) of a busy machine; a longer one counts as a stop.
LATE = 0.2
#: Longest sleep (s) between checks whether to end.
_SLEEP = 0.05
#: Timers may fire early by this fraction of the period.
_EARLY = 0.1
#: Part of the deadlines, and of so many at least, that may be missed without a word: single blocks
#: are late at times.
_UNSAID, _AMONG = 0.01, 1000


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


class Pacer:
    """Deadlines at ``start + k period``, all in seconds of one steady clock.

    So lateness never adds up. A deadline that was not used before the next one came is counted and
    skipped: late work never comes in a burst.
    """

    def __init__(self, period: float, start: float, excused: float = 0.0) -> None:
        """Set the period and the start (s): that of the timer, not of its first tick.

        What is missed in the time excused (s) from then on is not counted.
        """
        self.period = period
        self._start = start
        self._counts_from = start + excused
        self._done = 0
        self._deadlines = 0  # since the start
        self._told = 0  # of the missed ones, when `misses_more` was last True
        self.missed = 0  #: deadlines skipped since the start
        self.lag = 0.0  #: lateness of the last block behind the first deadline it serves, s
        self.worst_lag = 0.0  #: largest lag since `forget_worst`, s

    def tick(self, now: float) -> bool:
        """Note that the task runs at ``now``; return False if no deadline has come since."""
        due = math.floor((now - self._start) / self.period + _EARLY)
        if due <= self._done:
            return False
        first = self._start + (self._done + 1) * self.period  # that nothing was done for
        missed, self._done = due - self._done - 1, due
        self.lag = max(0.0, now - first)
        if now >= self._counts_from:
            self._deadlines += missed + 1
            self.missed += missed
            self.worst_lag = max(self.worst_lag, self.lag)
        return True

    def misses_more(self) -> bool:
        """Return True if more than 1 % was missed, and twice as many as when it last was True."""
        many = self.missed > _UNSAID * max(self._deadlines, _AMONG)
        news = many and self.missed >= 2 * self._told
        self._told = self.missed if news else self._told
        return news

    def restart(self, now: float) -> None:
        """Begin at ``now`` (s) again, after a while without deadlines."""
        self._start, self._done = now, 0

    def forget_worst(self) -> None:
        """Start a new window for `worst_lag`."""
        self.worst_lag = 0.0


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
