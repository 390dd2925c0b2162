# SPDX-License-Identifier: Apache-2.0
"""One sound MCAP file of a bag: topics, where messages are, the messages of a part."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Header
from numpy.typing import NDArray

from stickslip_ros.recordings.channels import Channels
from stickslip_ros.recordings.mcap_file import Block, Index, McapFile
from stickslip_ros.recordings.mcap_records import (
    HEAD,
    MAGIC,
    MESSAGE_HEAD,
    SMALLEST_MESSAGE,
    PackedChunk,
    body_at,
    messages_in,
    metadata_text,
    parse,
    place_at,
    reading,
)
from stickslip_ros.recordings.metadata import FileSummary, TopicDescription

_NAMES = ("start", "end", "offset", "length", "size")
SPAN = np.dtype([(name, "<u8") for name in _NAMES])
"""A part of a file that is read at once, a chunk or a run of records.

First and last time (ns), offset and length in the file, size in memory (bytes)."""

_RUN_BYTES = 1024 * 1024  # messages outside of chunks are read by so much at a time

Row = tuple[int, int, int, int, int]


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


class McapReader(McapFile):
    """A finished MCAP file; its content is known when it has been opened.

    :ivar channels: of its topics.
    :ivar counts: of the messages, by topic.
    :ivar spans: where the messages are, dtype :data:`SPAN`.
    :ivar metadata_text: what rosbag2 left in the file, "" if nothing.
    :ivar compressions: of its chunks, in words.
    """

    def __init__(self, path: Path) -> None:
        """Open the file and read its index, or the whole file if it has no index.

        :raises BagError: it cannot be read, was not finished or is damaged.
        """
        super().__init__(path)
        self.channels = Channels()
        self.counts: Counter[str] = Counter()
        self.compressions: set[str] = set()
        self.metadata_text = ""
        self._times: tuple[int, int] | None = None
        try:
            with reading(path):
                rows = self._open()
        except BaseException:
            self.close()
            raise
        self.spans: NDArray[np.void] = np.frombuffer(rows, dtype=SPAN)

    def summary(self) -> FileSummary:
        """Return name, message count, first and last log time."""
        count = sum(self.counts.values())
        if not count:
            return FileSummary(self.path.name)
        # A chunk without messages says 0; the statistics of the file know better.
        start, end = self._times or (int(self.spans["start"].min()), int(self.spans["end"].max()))
        return FileSummary(self.path.name, count, start, end)

    def _open(self) -> array[int]:
        """Read the content of the file; return its spans, five numbers each."""
        footer = self.footer()
        first = place_at(self.stream, len(MAGIC), self.size)
        if first.opcode != Opcode.HEADER:
            raise ValueError("its first record is not a header")
        self.library: str = parse(Header, body_at(self.stream, first)).library
        if footer.summary_start:
            index = self.index(footer, self.channels)
            if self._take(index):
                return index.chunks
        return self._read_everything(footer.summary_start or self.records_end)

    def _take(self, index: Index) -> bool:
        """Use the index; return False if it lacks needed information."""
        self.metadata_text = index.metadata_text
        self.compressions = index.compressions
        statistics, topics = index.statistics, self.channels.topics
        if statistics is None:
            return False
        counts, chunks = statistics.channel_message_counts, len(index.chunks) // len(_NAMES)
        if (
            len(topics) < statistics.channel_count
            or chunks < statistics.chunk_count
            or not counts.keys() <= topics.keys()
            or sum(counts.values()) != statistics.message_count
            or (counts and not chunks)
        ):
            return False
        unpacked: int = sum(index.chunks[_NAMES.index("size") :: len(_NAMES)])
        self.allowance.spend(unpacked)
        if statistics.message_count > unpacked // SMALLEST_MESSAGE:
            raise ValueError(
                f"its index counts {statistics.message_count} messages; "
                f"{unpacked // SMALLEST_MESSAGE} at most fit into its chunks"
            )
        for channel, count in counts.items():
            self.counts[topics[channel].name] += count
        self._times = statistics.message_start_time, statistics.message_end_time
        return True

    def _read_everything(self, end: int) -> array[int]:
        """Find and count the messages of a file without a full index."""
        self.compressions.clear()
        rows = array("Q")
        run_end = 0  # of the run of records outside of chunks that the last row is, 0 if none
        for block in self.blocks(end):
            if block.place.opcode == Opcode.METADATA:
                self.metadata_text = metadata_text(block.records[HEAD.size :]) or self.metadata_text
                continue
            channels, times, _ = messages_in(block.records, self.channels.learn)
            for channel, count in Counter(channels).items():
                self.counts[self.topic_of(channel).name] += count
            if block.chunk or times:
                self.compressions.add(block.chunk.compression if block.chunk else "")
            if times:
                run_end = self._add_row(rows, block, min(times), max(times), run_end)
        return rows

    def _add_row(self, rows: array[int], block: Block, first: int, last: int, run_end: int) -> int:
        """Add a block to the spans, to the last one if that is a run that it goes on with."""
        place = block.place
        if not block.chunk and place.start == run_end and rows[-1] < _RUN_BYTES:
            length = place.end - rows[-3]
            rows[-5:] = array(
                "Q", (min(rows[-5], first), max(rows[-4], last), rows[-3], length, length)
            )
        else:
            rows.extend((first, last, place.start, place.end - place.start, len(block.records)))
        return 0 if block.chunk else place.end

    def topic_of(self, channel: int) -> TopicDescription:
        """Return the topic of a channel; ValueError if it does not exist."""
        if channel not in self.channels.topics:
            raise ValueError(f"a message names channel {channel}, which does not exist")
        return self.channels.topics[channel]

    def records(self, row: Row) -> bytes:
        """Return the records of a span, out of their chunk if they are in one.

        :raises BagError: they are damaged.
        """
        _, _, offset, length, size = row
        with reading(self.path):
            if offset + length > self.size:
                raise ValueError("its index points beyond its end")
            place = place_at(self.stream, offset, offset + length)
            if place.opcode != Opcode.CHUNK or place.end != offset + length:
                return self.read(offset, length)
            chunk = PackedChunk.read(body_at(self.stream, place))
            if chunk.size > size:
                raise ValueError("a chunk is larger than its index says")
            return chunk.unpacked(None)  # the allowance has covered the sizes in the index

    def messages_of(self, records: bytes, row: Row, wanted: Wanted) -> Iterator[BagMessage]:
        """Yield the wanted messages among the records of a span, in order of time.

        :raises BagError: they are damaged.
        """
        with reading(self.path):
            names, times, starts = self._choose(records, row, wanted)
        for log_ns, start in zip(times, starts, strict=True):
            _, length = HEAD.unpack_from(records, start - HEAD.size)
            channel, sequence, _, publish_ns = MESSAGE_HEAD.unpack_from(records, start)
            data = records[start + MESSAGE_HEAD.size : start + length]
            yield BagMessage(names[channel], log_ns, publish_ns, sequence, data)

    def _choose(
        self, records: bytes, row: Row, wanted: Wanted
    ) -> tuple[dict[int, str], array[int], array[int]]:
        """Return names by channel, times of the wanted messages and where they start."""
        heads = messages_in(records, self.channels.learn)
        channels, times, starts = (np.frombuffer(head, head.typecode) for head in heads)
        names = {number: self.topic_of(number).name for number in set(heads[0])}
        if len(times) and not (row[0] <= times.min() and times.max() <= row[1]):
            raise ValueError("a message lies outside the time range of the index")
        if wanted.topics is not None:
            numbers = [number for number, name in names.items() if name in wanted.topics]
            chosen = np.isin(channels, numbers)
            times, starts = times[chosen], starts[chosen]
        if wanted.start_ns > row[0] or wanted.end_ns <= row[1]:
            start, end = (min(ns, 2**64 - 1) for ns in (wanted.start_ns, wanted.end_ns))
            chosen = (times >= start) & (times < end)
            times, starts = times[chosen], starts[chosen]
        if np.any(times[1:] < times[:-1]):
            order = np.argsort(times, kind="stable")
            times, starts = times[order], starts[order]
        return names, array("Q", times.tobytes()), array("Q", starts.tobytes())
