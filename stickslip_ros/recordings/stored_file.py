# SPDX-License-Identifier: Apache-2.0
"""One MCAP file of a bag, for reading: what is in it and where."""

from __future__ import annotations

import os
import zlib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import numpy as np
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Footer, Header, Metadata, MetadataIndex, Statistics
from numpy.typing import NDArray

from stickslip_ros.recordings.channels import Channels
from stickslip_ros.recordings.compression import open_storage
from stickslip_ros.recordings.errors import damaged
from stickslip_ros.recordings.metadata import FileSummary
from stickslip_ros.recordings.record import (
    HEAD,
    MAGIC,
    MESSAGE_HEAD,
    PackedChunk,
    Place,
    body_at,
    parse,
    places,
    reading,
    records_in,
)

SPAN = np.dtype([(name, "<u8") for name in ("start", "end", "offset", "length")])
"""A part of a file that is read at once, a chunk or a run of records: times in ns, bytes."""

_FOOTER_BYTES = HEAD.size + 20
_CRC_BYTES = 4
_RUN_BYTES = 1024 * 1024  # messages outside of chunks are read by so much at a time

Row = tuple[int, int, int, int]


class StoredFile:
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
                raise ValueError("its index names places behind its end")
            (place, *others) = places(self._stream, offset, offset + length)
            if place.opcode == Opcode.CHUNK and not others:
                return PackedChunk.read(body_at(self._stream, place)).unpacked()
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
        """Read the index; return False if it does not tell all that we have to know."""
        if not len(MAGIC) <= footer.summary_start <= end:
            raise ValueError("its footer names a place outside of the file")
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
            raise ValueError("its index names metadata where there is none")
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
        run = _Run()
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
                times = self._count(_whole(self._stream, place))
                if times and not run.take(place, times[0]):
                    self._rows.append(run.row())
                    run = _Run()
                    run.take(place, times[0])
                continue
            self._rows.extend(run.rows())
            run = _Run()
        self._rows.extend(run.rows())

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
                    raise ValueError(f"a message names channel {channel}, which there is not")
                self.counts[topic.name] += 1
                first, last = min(first, log_ns), max(last, log_ns)
            else:
                self.channels.learn(opcode, records[start:end])
        return (first, last) if last >= 0 else None


class _Run:
    """Messages outside of chunks that follow each other in the file."""

    def __init__(self) -> None:
        self._first = self._last = self._offset = self._length = 0

    def take(self, place: Place, log_ns: int) -> bool:
        """Add a message; return False if the run is long enough without it."""
        if self._length and self._length + place.length > _RUN_BYTES:
            return False
        if not self._length:
            self._first = self._last = log_ns
            self._offset = place.offset
        self._first, self._last = min(self._first, log_ns), max(self._last, log_ns)
        self._length += place.length
        return True

    def row(self) -> Row:
        """Return the span of the run."""
        return self._first, self._last, self._offset, self._length

    def rows(self) -> Iterator[Row]:
        """Yield the span of the run if there is anything in it."""
        if self._length:
            yield self.row()


def _whole(stream: IO[bytes], place: Place) -> bytes:
    stream.seek(place.offset)
    return stream.read(place.length)
