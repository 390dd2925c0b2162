# SPDX-License-Identifier: Apache-2.0
"""One sound MCAP file of a bag: topics, where messages are, the messages of a part."""

from __future__ import annotations

import struct
from array import array
from collections import Counter
from collections.abc import Iterable, Iterator
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
    PackedChunk,
    Place,
    body_at,
    messages_in,
    parse,
    place_at,
    reading,
)
from stickslip_ros.recordings.mcap_scanner import Block, Index, McapScanner, metadata_text
from stickslip_ros.recordings.metadata import FileSummary, TopicDescription

_NAMES = ("start", "end", "offset", "length", "size")
_COLUMNS = len(_NAMES)
SPAN = np.dtype([(name, "<u8") for name in _NAMES])
"""A part of a file that is read at once, a chunk or a run of records.

First and last time (ns), offset and length in the file, size in memory (bytes)."""

_LENGTH = struct.Struct("<Q")  # of a record, before its body
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
        self.stored_size = self._scanner.stored_size
        try:
            with reading(path):
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
        chunks = len(index.chunks) // _COLUMNS
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
        unpacked: int = sum(index.chunks[_COLUMNS - 1 :: _COLUMNS])
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
        for place, records, chunk in _runs(self._scanner.blocks(end)):
            if place.opcode == Opcode.METADATA:
                text = metadata_text(records[HEAD.size :])
                self.metadata_text = text or self.metadata_text
                continue
            channels, times, _ = messages_in(records, self.channels.learn)
            for channel, count in Counter(channels.tolist()).items():
                self.counts[self.topic_of(channel).name] += count
            if chunk or len(times):
                self.compressions.add(chunk.compression if chunk else "")
            if len(times):
                first, last = int(times.min()), int(times.max())
                rows.extend((first, last, place.offset, place.length, len(records)))
        return rows

    def topic_of(self, channel: int) -> TopicDescription:
        """Return the topic of a channel; ValueError if it does not exist."""
        if channel not in self.channels.topics:
            raise ValueError(f"a message names channel {channel}, which does not exist")
        return self.channels.topics[channel]


def _runs(blocks: Iterable[Block]) -> Iterator[tuple[Place, bytes, PackedChunk | None]]:
    """Yield place, records and chunk of blocks, records outside of chunks as runs of many."""
    run: list[Block] = []

    def joined() -> Iterator[tuple[Place, bytes, None]]:
        if run:
            first, last = run[0].place, run[-1].place
            place = Place(first.opcode, first.offset, last.end - first.offset)
            yield place, b"".join(block.records for block in run), None
            run.clear()

    for block in blocks:
        alone = block.chunk is not None or block.place.opcode == Opcode.METADATA
        if run and (
            alone
            or run[-1].place.end != block.place.offset
            or block.place.end - run[0].place.offset > _RUN_BYTES
        ):
            yield from joined()
        if alone:
            yield block.place, block.records, block.chunk
        else:
            run.append(block)
    yield from joined()


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
        with reading(file.path):
            times, starts = self._chosen(file, row, wanted)
        self.count = len(times)
        rows = (array("Q", column.tobytes()) for column in (times, starts))
        self._messages = zip(*rows, strict=True)
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
        (length,) = _LENGTH.unpack_from(self._data, start - _LENGTH.size)
        channel, sequence, _, publish_ns = MESSAGE_HEAD.unpack_from(self._data, start)
        data = self._data[start + MESSAGE_HEAD.size : start + length]
        return BagMessage(self._names[channel], log_ns, publish_ns, sequence, data)

    def _chosen(
        self, file: McapReader, row: Row, wanted: Wanted
    ) -> tuple[NDArray[np.uint64], NDArray[np.uint64]]:
        """Return the times of the wanted messages and where they start, in order of time."""
        channels, times, starts = messages_in(self._data, file.channels.learn)
        self._names = {n: file.topic_of(n).name for n in set(channels.tolist())}
        if len(times) and not (row[0] <= times.min() and times.max() <= row[1]):
            raise ValueError("a message lies outside the time range of the index")
        if wanted.topics is not None:
            chosen = np.zeros(len(times), dtype=bool)
            for number, name in self._names.items():
                if name in wanted.topics:
                    chosen |= channels == number
            times, starts = times[chosen], starts[chosen]
        if wanted.start_ns > row[0] or wanted.end_ns <= row[1]:
            start, end = (min(ns, 2**64 - 1) for ns in (wanted.start_ns, wanted.end_ns))
            chosen = (times >= start) & (times < end)
            times, starts = times[chosen], starts[chosen]
        if np.any(times[1:] < times[:-1]):
            order = np.argsort(times, kind="stable")
            times, starts = times[order], starts[order]
        return times, starts
