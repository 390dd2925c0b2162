# SPDX-License-Identifier: Apache-2.0
"""Times in a recording: which of them lie apart from all others."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

HOUR = 3_600_000_000_000
"""ns; times that are further from all others are of another clock, or of none."""

UNSET = 10 * 365 * 24 * HOUR
"""ns; a clock that shows an earlier time since the Unix epoch was not set, or is simulated."""

FEW = 100
"""Messages that are few at most; of fewer than 10 000 a hundredth, but one of 20 already."""


class Bulk(NamedTuple):
    """First and last time of the bulk of messages, ns; and the messages apart from it."""

    start_ns: int
    end_ns: int
    apart: int = 0  #: how many
    by_ns: int = 0  #: the longest that one is from the bulk, ns

    def holds(self, ns: int) -> bool:
        """Return whether a time (ns) is inside."""
        return self.start_ns <= ns <= self.end_ns

    @property
    def told(self) -> str:
        """What is said of those apart, if there are some."""
        messages = "1 message is" if self.apart == 1 else f"{self.apart} messages are up to"
        seconds = f"{float(f'{self.by_ns / 1e9:.3g}'):,.0f}".replace(",", " ")
        return f"{messages} {seconds} s from the others: left out"


class Moments:
    """Times of messages, by the hour."""

    def __init__(self) -> None:
        """Know none."""
        self._hours: dict[int, tuple[int, int, int]] = {}

    def add(self, ns: int) -> None:
        """Take the time (ns) of a message."""
        count, first, last = self._hours.get(ns // HOUR, (0, ns, ns))
        self._hours[ns // HOUR] = count + 1, min(first, ns), max(last, ns)

    def bulk(self) -> Bulk:
        """Return where the bulk is.

        Apart from it are few messages more than an hour from all others, and those from within
        ten years of 0, which a clock shows that was not set, if most others are from later.
        """
        groups: list[list[int]] = []  # count, first, last
        for _, (count, first, last) in sorted(self._hours.items()):
            if groups and first - groups[-1][2] <= HOUR:
                groups[-1][0] += count
                groups[-1][2] = last
            else:
                groups.append([count, first, last])
        total = sum(count for count, *_ in groups)
        later = [one for one in groups if one[1] > UNSET]
        kept = later if 2 * sum(count for count, *_ in later) >= total else groups
        left = sum(count for count, *_ in kept)
        largest = max(kept, default=[0, 0, 0])
        few = min(FEW, max(left // 100, left >= 20))
        if left - largest[0] <= few:
            kept = [largest]
        if not kept:
            return Bulk(0, 0)
        start, end = kept[0][1], kept[-1][2]
        ends = [one for one in groups if not start <= one[1] <= end]
        by = max((max(start - first, last - end) for _, first, last in ends), default=0)
        return Bulk(start, end, sum(count for count, *_ in ends), by)


def bulk_of(times: Iterable[int]) -> Bulk:
    """Return the bulk of some times, ns."""
    moments = Moments()
    for ns in times:
        moments.add(ns)
    return moments.bulk()
