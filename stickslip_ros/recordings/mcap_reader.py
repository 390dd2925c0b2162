# SPDX-License-Identifier: Apache-2.0
"""One sound MCAP file of a bag: topics, where messages are, the messages of a part."""

from __future__ import annotations

from array import array
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Header, Statistics
from numpy.typing import NDArray

from stickslip_ros.recordings.channels import Channels
from stickslip_ros.recordings.mcap_records import (
    HEAD,
    MAGIC,
    MESSAGE_HEAD,
    SMALLEST_MESSAGE,
    body_at,
    parse,
    place_at,
    reading,
    records_in,
)
from stickslip_ros.recordings.mcap_scanner import Block, Index, McapScanner, metadata_text
from stickslip_ros.recordings.metadata import FileSummary

SPAN = np.dtype([(name, "<u8") for name in ("start", "end", "offset", "length", "size")])
"""A part of a file that is read at once, a chunk or a run of records.

First and last time (ns), offset and length in the file, size in memory (bytes)."""

_RUN_BYTES = 1024 * 1024  # messages outside of chunks are read by so much at a time

Row = tuple[int, int, int, int, int]


class McapReader:
    """A finished MCAP file; what it holds is known when it has been opened.

    :ivar channels: of its topics.
    :ivar counts: of the messages, by topic.
    :ivar spans: where the messages are, dtype :data:`SPAN`.
    :ivar metadata_text: what rosbag2 left in the file, "" if nothing.
    :ivar compressions: of its chunks, in words.
    :ivar stored_size: as it lies on the disk, bytes.
    """

    def __init__(self, path: Path) -> None:
        """Open the file and read its index, or all of it if it has none.

        :raises BagError: it cannot be read, was not finished or is damaged.
        """
        self.path = path
        self.channels = Channels()
        self.counts: Counter[str] = Counter()
        self.compressions: set[str] = set()
        self.metadata_text = ""
        self.library = ""
        self._times: tuple[int, int] | None = None
        self._scanner = McapScanner(path)
        try:
            with reading(path):
                self.stored_size = path.stat().st_size
                rows = self._open()
        except BaseException:
            self.close()
            raise
        self.spans: NDArray[np.void] = np.frombuffer(rows, dtype=SPAN)

    def close(self) -> None:
        """Close the file; twice does no harm."""
        self._scanner.close()

    def summary(self) -> FileSummary:
        """Return name, message count, first and last log time."""
        count = sum(self.counts.values())
        if not count:
            return FileSummary(self.path.name, 0, 0, 0)
        # A chunk without messages says 0; the statistics of the file know better.
        start, end = self._times or (int(self.spans["start"].min()), int(self.spans["end"].max()))
        return FileSummary(self.path.name, count, start, end)

    def records(self, row: Row) -> bytes:
        """Return the records of a span, out of their chunk if they are in one.

        :raises BagError: they are damaged.
        """
        with reading(self.path):
            return self._scanner.records_at(*row[2:])

    def _open(self) -> array[int]:
        """Learn what the file holds; return its spans, five numbers each."""
        footer = self._scanner.footer()
        first = place_at(self._scanner.stream, len(MAGIC), self._scanner.size)
        if first.opcode != Opcode.HEADER:
            raise ValueError("its first record is not a header")
        self.library = parse(Header, body_at(self._scanner.stream, first)).library
        if footer.summary_start:
            index = self._scanner.index(footer, self.channels)
            if index is None:
                raise ValueError("the checksum of its index is wrong")
            if self._take(index):
                return index.chunks
        return self._read_everything(footer.summary_start or self._scanner.records_end)

    def _take(self, index: Index) -> bool:
        """Take what the index says; return False if it lacks something that is needed."""
        self.metadata_text = index.metadata_text
        self.compressions = index.compressions
        statistics, topics = index.statistics, self.channels.topics
        chunks = len(index.chunks) // len(SPAN)
        if statistics is None or (statistics.message_count and not chunks):
            return False
        if len(topics) < statistics.channel_count or chunks < statistics.chunk_count:
            return False
        for channel, count in statistics.channel_message_counts.items():
            if channel not in topics:
                return False
            self.counts[topics[channel].name] += count
        if sum(self.counts.values()) != statistics.message_count:
            return False
        self._check_counts(index, statistics)
        self._times = statistics.message_start_time, statistics.message_end_time
        return True

    def _check_counts(self, index: Index, statistics: Statistics) -> None:
        unpacked = sum(index.chunks[4 :: len(SPAN)])
        self._scanner.allowance.spend(unpacked)
        if statistics.message_count > unpacked // SMALLEST_MESSAGE:
            raise ValueError(
                f"its index counts {statistics.message_count} messages; "
                f"{unpacked // SMALLEST_MESSAGE} at most fit into its chunks"
            )

    def _read_everything(self, end: int) -> array[int]:
        """Find and count the messages of a file without a full index."""
        self.counts.clear()
        self.compressions.clear()
        rows = array("Q")
        run: Row | None = None  # messages outside of chunks that follow each other
        for block in self._scanner.blocks(end):
            times = self._count(block)
            if times is None:
                continue
            row = (*times, block.place.offset, block.place.length, len(block.records))
            if block.chunk:
                rows.extend(row)
            elif run and run[2] + run[3] == row[2] and run[3] + row[3] <= _RUN_BYTES:
                size = run[3] + row[3]
                run = min(run[0], row[0]), max(run[1], row[1]), run[2], size, size
            else:
                rows.extend(run or ())
                run = row
        rows.extend(run or ())
        return rows

    def _count(self, block: Block) -> tuple[int, int] | None:
        """Count the messages of a block; return their first and last time, None if none."""
        if block.place.opcode == Opcode.METADATA:
            self.metadata_text = metadata_text(block.records[HEAD.size :]) or self.metadata_text
            return None
        first, last = 2**64, -1
        for opcode, start, end in records_in(block.records):
            if opcode == Opcode.MESSAGE:
                if end - start < MESSAGE_HEAD.size:
                    raise ValueError("a message is shorter than its head")
                channel, _, log_ns, _ = MESSAGE_HEAD.unpack_from(block.records, start)
                topic = self.channels.topics.get(channel)
                if topic is None:
                    raise ValueError(f"a message names channel {channel}, which does not exist")
                self.counts[topic.name] += 1
                first, last = min(first, log_ns), max(last, log_ns)
            else:
                self.channels.learn(opcode, block.records[start:end])
        if block.chunk or last >= 0:
            self.compressions.add(block.chunk.compression if block.chunk else "")
        return (first, last) if last >= 0 else None


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


class Span:
    """A span in memory.

    :ivar count: of the wanted messages in it.
    """

    def __init__(self, file: McapReader, row: Row, wanted: Wanted) -> None:
        """Read it; BagError if it is damaged."""
        self._data = file.records(row)
        self._topics: dict[int, str] = {}
        self._file = file
        with reading(file.path):
            times, starts = self._index(row[0], row[1], wanted)
        self.count = len(times)
        self._messages = zip(times, starts, strict=True)
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
                    raise ValueError(f"a message names channel {channel}, which does not exist")
                name = self._topics[channel] = known[channel].name
                takes[channel] = wanted.topics is None or name in wanted.topics
            if not first <= log_ns <= last:
                raise ValueError("a message lies outside the time range of the index")
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
