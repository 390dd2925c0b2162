# SPDX-License-Identifier: Apache-2.0
"""One MCAP file of a bag, for reading: topics, where messages are, the messages of a part."""

from __future__ import annotations

import os
import zlib
from array import array
from collections import Counter
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)
from numpy.typing import NDArray

from stickslip_ros.recordings.errors import damaged
from stickslip_ros.recordings.mcap_records import (
    HEAD,
    MAGIC,
    MESSAGE_HEAD,
    PackedChunk,
    body_at,
    open_storage,
    parse,
    places,
    reading,
    records_in,
)
from stickslip_ros.recordings.metadata import FileSummary, TopicDescription
from stickslip_ros.recordings.qos import profiles_in_yaml

# Bytes of schemas and channels in one file; a thousand topics have a third of it.
_LARGEST = 8 * 1024 * 1024


class Channels:
    """Learns schemas and channels as they come along in a file."""

    def __init__(self) -> None:
        """Know none."""
        self.topics: dict[int, TopicDescription] = {}
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._size = 0

    def learn(self, opcode: int, body: bytes) -> None:
        """Take a schema or channel record; other records are passed over.

        :raises ValueError: it is broken, or another one had that number.
        """
        if opcode == Opcode.SCHEMA:
            schema = parse(Schema, body)
            if schema.id not in self._schemas:
                self._grow(body)
                self._schemas[schema.id] = schema
            elif self._schemas[schema.id] != schema:
                raise ValueError(f"two schemas have the number {schema.id}")
        elif opcode == Opcode.CHANNEL:
            channel = parse(Channel, body)
            if channel.id not in self._channels:
                self._grow(body)
                self._channels[channel.id] = channel
                self.topics[channel.id] = self._topic(channel)
            elif self._channels[channel.id] != channel:
                raise ValueError(f"two channels have the number {channel.id}")

    def _grow(self, body: bytes) -> None:
        self._size += len(body)
        if self._size > _LARGEST:
            raise ValueError(f"more than {_LARGEST} bytes of schemas and channels")

    def _topic(self, channel: Channel) -> TopicDescription:
        schema = self._schemas.get(channel.schema_id)
        if channel.schema_id and schema is None:
            raise ValueError(f"topic {channel.topic} names schema {channel.schema_id}; it has none")
        return TopicDescription(
            name=channel.topic,
            type=schema.name if schema else "",
            schema=schema.data.decode() if schema else "",
            type_hash=channel.metadata.get("topic_type_hash", ""),
            offered_qos=profiles_in_yaml(channel.metadata.get("offered_qos_profiles", "")),
            schema_encoding=schema.encoding if schema else "",
            encoding=channel.message_encoding,
        )


SPAN = np.dtype([(name, "<u8") for name in ("start", "end", "offset", "length")])
"""A part of a file that is read at once, a chunk or a run of records: times in ns, bytes."""

_FOOTER_BYTES = HEAD.size + 20
_CRC_BYTES = 4
_RUN_BYTES = 1024 * 1024  # messages outside of chunks are read by so much at a time

Row = tuple[int, int, int, int]


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
        self._rows: list[Row] = []
        self._times: tuple[int, int] | None = None
        with reading(path):
            self._stream: IO[bytes] = open_storage(path)[0]
            self.stored_size = path.stat().st_size
        try:
            with reading(path):
                self.size = os.fstat(self._stream.fileno()).st_size
                self._open()
        except BaseException:
            self.close()
            raise
        self.spans: NDArray[np.void] = np.array(self._rows, dtype=SPAN)
        self._rows.clear()

    def close(self) -> None:
        """Close the file; twice does no harm."""
        self._stream.close()

    def summary(self) -> FileSummary:
        """Return name, message count, first and last log time."""
        count = sum(self.counts.values())
        if not count:
            return FileSummary(self.path.name, 0, 0, 0)
        # A chunk without messages says 0; the statistics of the file know better.
        start, end = self._times or (int(self.spans["start"].min()), int(self.spans["end"].max()))
        return FileSummary(self.path.name, count, start, end)

    def records(self, offset: int, length: int) -> bytes:
        """Return the records of a span, out of their chunk if they are in one.

        :raises BagError: they are damaged.
        """
        with reading(self.path):
            if offset + length > self.size:
                raise ValueError("its index points beyond its end")
            (place, *others) = places(self._stream, offset, offset + length)
            if place.opcode == Opcode.CHUNK and not others:
                return PackedChunk.read(body_at(self._stream, place)).unpacked()
            return self._read(offset, length)

    def _read(self, offset: int, length: int) -> bytes:
        self._stream.seek(offset)
        return self._stream.read(length)

    def _open(self) -> None:
        if self._stream.read(len(MAGIC)) != MAGIC:
            raise damaged(self.path, "it does not begin as an MCAP file does")
        self._stream.seek(max(0, self.size - len(MAGIC)))
        if self._stream.read() != MAGIC or self.size < 2 * len(MAGIC) + _FOOTER_BYTES:
            raise damaged(self.path, "it has no end; whoever wrote it was stopped")
        data_end = self.size - len(MAGIC) - _FOOTER_BYTES
        (place,) = places(self._stream, data_end, self.size - len(MAGIC))
        if place.opcode != Opcode.FOOTER:
            raise ValueError("its last record is not a footer")
        footer = parse(Footer, body_at(self._stream, place))
        first = next(places(self._stream, len(MAGIC), data_end), None)
        if first is None or first.opcode != Opcode.HEADER:
            raise ValueError("its first record is not a header")
        self.library = parse(Header, body_at(self._stream, first)).library
        if not (footer.summary_start and self._read_summary(footer, data_end)):
            self._read_everything(footer.summary_start or data_end)

    def _read_summary(self, footer: Footer, end: int) -> bool:
        """Read the index; return False if it lacks something that the reader needs."""
        if not len(MAGIC) <= footer.summary_start <= end:
            raise ValueError("its footer points outside of the file")
        self._check_summary(footer, end)
        statistics: Statistics | None = None
        for place in places(self._stream, footer.summary_start, end):
            if place.opcode == Opcode.CHUNK_INDEX:
                index = parse(ChunkIndex, body_at(self._stream, place))
                self._add_chunk(index)
            elif place.opcode == Opcode.STATISTICS:
                statistics = parse(Statistics, body_at(self._stream, place))
            elif place.opcode == Opcode.METADATA_INDEX:
                self._read_metadata(parse(MetadataIndex, body_at(self._stream, place)))
            elif place.opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self.channels.learn(place.opcode, body_at(self._stream, place))
        if statistics:
            self._times = statistics.message_start_time, statistics.message_end_time
        if statistics is None or (statistics.message_count and not self._rows):
            return False
        topics = self.channels.topics
        if len(topics) < statistics.channel_count or len(self._rows) < statistics.chunk_count:
            return False
        for channel, count in statistics.channel_message_counts.items():
            if channel not in topics:
                return False
            self.counts[topics[channel].name] += count
        return sum(self.counts.values()) == statistics.message_count

    def _check_summary(self, footer: Footer, end: int) -> None:
        if not footer.summary_crc:
            return
        self._stream.seek(footer.summary_start)
        left = end + _FOOTER_BYTES - _CRC_BYTES - footer.summary_start
        crc = 0
        while left > 0 and (piece := self._stream.read(min(left, _RUN_BYTES))):
            crc = zlib.crc32(piece, crc)
            left -= len(piece)
        if crc != footer.summary_crc:
            raise ValueError("the checksum of its index is wrong")

    def _add_chunk(self, index: ChunkIndex) -> None:
        self.compressions.add(index.compression)
        self._rows.append(
            (
                index.message_start_time,
                index.message_end_time,
                index.chunk_start_offset,
                index.chunk_length,
            )
        )

    def _read_metadata(self, index: MetadataIndex) -> None:
        if index.name != "rosbag2":
            return
        end = min(index.offset + index.length, self.size)
        place = next(places(self._stream, index.offset, end), None)
        if place is None or place.opcode != Opcode.METADATA:
            raise ValueError("its index points to metadata that is not there")
        self._keep_metadata(parse(Metadata, body_at(self._stream, place)))

    def _keep_metadata(self, record: Metadata) -> None:
        if record.name == "rosbag2":
            self.metadata_text = record.metadata.get("serialized_metadata", "")

    def _read_everything(self, end: int) -> None:
        """Find and count the messages of a file without a full index."""
        self.counts.clear()
        self._times = None
        self.compressions.clear()
        self._rows.clear()
        run: Row | None = None  # messages outside of chunks that follow each other
        for place in places(self._stream, len(MAGIC), end):
            if place.opcode == Opcode.CHUNK:
                chunk = PackedChunk.read(body_at(self._stream, place))
                self.compressions.add(chunk.compression)
                times = self._count(chunk.unpacked())
                if times:
                    self._rows.append((*times, place.offset, place.length))
            elif place.opcode == Opcode.METADATA:
                self._keep_metadata(parse(Metadata, body_at(self._stream, place)))
            elif place.opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self.channels.learn(place.opcode, body_at(self._stream, place))
            elif place.opcode == Opcode.MESSAGE:
                self.compressions.add("")
                times = self._count(self._read(place.offset, place.length))
                assert times
                first, last, offset, length = run or (*times, place.offset, 0)
                if offset + length != place.offset or length + place.length > _RUN_BYTES:
                    self._rows.append((first, last, offset, length))
                    first, last, offset, length = (*times, place.offset, 0)
                first, last = min(first, times[0]), max(last, times[1])
                run = first, last, offset, length + place.length
        if run:
            self._rows.append(run)

    def _count(self, records: bytes) -> tuple[int, int] | None:
        """Count the messages in some records; return their first and last time, None if none."""
        first, last = 2**64, -1
        for opcode, start, end in records_in(records):
            if opcode == Opcode.MESSAGE:
                if end - start < MESSAGE_HEAD.size:
                    raise ValueError("a message is shorter than its head")
                channel, _, log_ns, _ = MESSAGE_HEAD.unpack_from(records, start)
                topic = self.channels.topics.get(channel)
                if topic is None:
                    raise ValueError(f"a message names channel {channel}, which does not exist")
                self.counts[topic.name] += 1
                first, last = min(first, log_ns), max(last, log_ns)
            else:
                self.channels.learn(opcode, records[start:end])
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
    """A span in memory; :attr:`next_ns` is the time of the message that comes next."""

    def __init__(self, file: McapReader, row: tuple[int, int, int, int], wanted: Wanted) -> None:
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
