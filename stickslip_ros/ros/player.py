# SPDX-License-Identifier: Apache-2.0
"""Plays timed messages by the steady clock, without bursts of late messages.

Deadlines are absolute, so single delays do not add up. After a stop of the whole process (a
debugger, SIGSTOP, a suspended laptop), the rest is played later by the duration of the stop.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

Item = TypeVar("Item")

#: Largest delay (s) of a busy machine; a longer one counts as a stop.
LATE = 0.2
#: Longest sleep (s) between checks whether to end.
_SLEEP = 0.05


class Timetable:
    """The times at which messages are due, by a given clock, at a rate."""

    def __init__(self, rate: float, now: Callable[[], float] = time.monotonic) -> None:
        """Start at the first thing asked for; rate 2 plays in half the time."""
        self._rate = rate
        self._now = now
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
        if -left > LATE:
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
