# SPDX-License-Identifier: Apache-2.0
"""The messages of one span of a file, in order of time."""

from __future__ import annotations

from array import array
from typing import NamedTuple

import numpy as np
from mcap.opcode import Opcode

from stickslip_ros.recordings.record import HEAD, MESSAGE_HEAD, reading, records_in
from stickslip_ros.recordings.stored_file import StoredFile


class BagMessage(NamedTuple):
    """One message of a bag; times in ns since the Unix epoch.

    :ivar topic: its name.
    :ivar log_ns: when it was recorded, which is what orders a bag.
    :ivar publish_ns: when it was published.
    :ivar sequence: the publisher's number of it, 0 if unknown.
    :ivar data: the message, serialized.
    """

    topic: str
    log_ns: int
    publish_ns: int
    sequence: int
    data: bytes


class Wanted(NamedTuple):
    """Which messages to take: topics (None: all), from start up to but without end, ns."""

    topics: frozenset[str] | None = None
    start_ns: int = 0
    end_ns: int = 2**64


class OpenSpan:
    """A span in memory; :attr:`next_ns` is the time of the message that comes next."""

    def __init__(self, file: StoredFile, row: tuple[int, int, int, int], wanted: Wanted) -> None:
        """Read it.

        :param row: first time, last time, offset, length of the span.
        :raises BagError: it is damaged.
        """
        first, last, offset, length = row
        self._data = file.records(offset, length)
        self._topics: dict[int, str] = {}
        self._file = file
        with reading(file.path):
            self._messages = iter(zip(*self._index(first, last, wanted), strict=True))
        self._next = next(self._messages, None)

    @property
    def size(self) -> int:
        """Bytes of the records in memory."""
        return len(self._data)

    @property
    def next_ns(self) -> int | None:
        """Time of the next message, None after the last one."""
        return self._next[0] if self._next else None

    def take(self) -> BagMessage:
        """Return the next message."""
        assert self._next is not None
        log_ns, start = self._next
        self._next = next(self._messages, None)
        _, length = HEAD.unpack_from(self._data, start)
        start += HEAD.size
        channel, sequence, _, publish_ns = MESSAGE_HEAD.unpack_from(self._data, start)
        data = self._data[start + MESSAGE_HEAD.size : start + length]
        return BagMessage(self._topics[channel], log_ns, publish_ns, sequence, data)

    def _index(self, first: int, last: int, wanted: Wanted) -> tuple[array[int], array[int]]:
        """Return the times of the wanted messages and where they start, in order of time."""
        times, starts = array("Q"), array("Q")
        known = self._file.channels.topics
        takes: dict[int, bool] = {}
        ordered, before = True, 0
        unpack = MESSAGE_HEAD.unpack_from
        for opcode, start, end in records_in(self._data):
            if opcode != Opcode.MESSAGE:
                self._file.channels.learn(opcode, self._data[start:end])
                continue
            if end - start < MESSAGE_HEAD.size:
                raise ValueError("a message is shorter than its head")
            channel, _, log_ns, _ = unpack(self._data, start)
            if channel not in takes:
                if channel not in known:
                    raise ValueError(f"a message names channel {channel}, which there is not")
                name = self._topics[channel] = known[channel].name
                takes[channel] = wanted.topics is None or name in wanted.topics
            if not first <= log_ns <= last:
                raise ValueError("a message lies outside of the time that the index gives")
            if takes[channel] and wanted.start_ns <= log_ns < wanted.end_ns:
                ordered = ordered and log_ns >= before
                before = log_ns
                times.append(log_ns)
                starts.append(start - HEAD.size)
        return (times, starts) if ordered else _sorted(times, starts)


def _sorted(times: array[int], starts: array[int]) -> tuple[array[int], array[int]]:
    order = np.argsort(np.frombuffer(times, np.uint64), kind="stable")
    by_time = (np.frombuffer(a, np.uint64)[order].tobytes() for a in (times, starts))
    ordered_times, ordered_starts = (array("Q", each) for each in by_time)
    return ordered_times, ordered_starts
