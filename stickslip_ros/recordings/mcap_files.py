# SPDX-License-Identifier: Apache-2.0
"""The MCAP files of a bag: their topics, where messages are, messages in order of time.

``mcap`` parses every record. It trusts the lengths in a file, unpacks chunks to any size and lz4
without a limit, so that records are handed to it one by one, each no longer than is there, and
chunks are unpacked here.
"""

from __future__ import annotations

import contextlib
import heapq
import os
import struct
import tempfile
import zlib
from collections import Counter
from collections.abc import Iterator
from functools import partial
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import IO, Any, NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    Footer,
    Header,
    Message,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from stickslip_ros.base.opening import Allowance, open_regular
from stickslip_ros.recordings.errors import BagError, damaged, reading
from stickslip_ros.recordings.metadata import (
    FileSummary,
    StoredMetadata,
    TopicDescription,
    parse_metadata,
    qos_profiles,
)

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")
"""What a record begins with: its opcode, and the length of what follows."""

LARGEST_CHUNK = 64 * 1024 * 1024
"""Bytes of a chunk, unpacked. rosbag2 makes 768 KiB, or as much as its largest message takes."""

LARGEST_PACKED = LARGEST_CHUNK + LARGEST_CHUNK // 64
"""Bytes of a chunk as it is stored: data that cannot be packed grows a little."""

_KINDS: dict[int, Any] = {
    Opcode.HEADER: Header,
    Opcode.FOOTER: Footer,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.MESSAGE: Message,
    Opcode.CHUNK: Chunk,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.STATISTICS: Statistics,
    Opcode.METADATA: Metadata,
    Opcode.METADATA_INDEX: MetadataIndex,
}  # others are passed over, whatever their length
LARGEST_OTHER = 1024 * 1024  # bytes of a schema, channel, metadata, ...
_LARGEST_BODY = {Opcode.MESSAGE: LARGEST_CHUNK, Opcode.CHUNK: LARGEST_PACKED}
# Bytes of all schemas, and of all channels: the 65 536 that MCAP can number take half of it.
_LARGEST_SUM = {Schema: 8 * 1024 * 1024, Channel: 64 * 1024 * 1024}
_SMALLEST_MESSAGE = HEAD.size + 22  # bytes of a message without data
_FOOTER_BYTES = HEAD.size + 20
_NONE = None, 0  # where there is no record
# A frame may ask its reader to keep that much of the past; rosbag2 asks for 8 MiB at most.
_ZSTD = zstandard.ZstdDecompressor(max_window_size=64 * 1024 * 1024)
_PIECE = 1024 * 1024  # bytes that are unpacked, or enter a checksum, at a time
# Bytes given to zstd at a time; what comes of it, 32 MB at most, is in memory at once.
_PACKED_PIECE = 1024
# Bytes of messages in memory, of one span and of all. Chunks that overlap in time have to be there
# together: recorders make one or two such, tools that write topic after topic a few dozen.
_LARGEST_OPEN, _MOST_OPEN = 300 * 1024 * 1024, 160 * 1024 * 1024
_PER_MESSAGE = 200  # bytes that a message takes besides its data


class BagMessage(NamedTuple):
    """One message of a bag; times in ns since the Unix epoch."""

    topic: str  #: its name
    log_ns: int  #: when it was recorded, which is what orders a bag
    publish_ns: int  #: when it was published
    sequence: int  #: the publisher's number of it, 0 if unknown
    data: bytes  #: the message, serialized


class Wanted(NamedTuple):
    """Which messages to take: topics (None: all), from start up to but without end, ns."""

    topics: frozenset[str] | None = None
    start_ns: int = 0
    end_ns: int = 2**64


# -- records and chunks


class _Body(BytesIO):
    """The body of a record, of which nobody can read more than is there."""

    def read(self, count: int | None = -1) -> bytes:
        data = super().read(count)
        if len(data) != count:
            raise ValueError("a record is shorter than what it says is in it")
        return data


def parse(opcode: int, body: bytes) -> Any:
    """Return a record by its body; ``BROKEN`` if it is broken."""
    stream = ReadDataStream(_Body(body))
    if opcode == Opcode.MESSAGE:
        return Message.read(stream, len(body))
    return _KINDS[opcode].read(stream)


def records_from(stream: IO[bytes], at: int, end: int) -> Iterator[tuple[Any, int]]:
    """Yield the records of known kinds between two places, and for each where the next one begins.

    Raises ValueError: one is broken, or longer than what is left or than makes sense.
    """
    stream.seek(at)
    while at < end:
        opcode, length = HEAD.unpack(stream.read(HEAD.size))
        if not opcode:  # zeros, as a disk leaves them after a power failure
            raise ValueError(f"there is no record at byte {at}")
        left, largest = end - at - HEAD.size, _LARGEST_BODY.get(opcode, LARGEST_OTHER)
        if length > left:
            raise ValueError(
                f"the record at byte {at} says it is {length} bytes long, but {left} are left"
            )
        if opcode in _KINDS and length > largest:
            raise ValueError(
                f"the record at byte {at} is {length} bytes long, at most {largest} are allowed"
            )
        at += HEAD.size + length
        if opcode in _KINDS:
            yield parse(opcode, stream.read(length)), at
        stream.seek(at)


def unpacked(chunk: Chunk, allowance: Allowance | None) -> bytes:
    """Return the records of a chunk; ValueError if they are damaged.

    allowance: of the file; None where the sum is known to be within it.
    """
    size = chunk.uncompressed_size
    if chunk.compression not in ("", "lz4", "zstd"):
        text = f"{chunk.compression[:20]!r}"
        raise ValueError(f"compression {text} is not known, only none, lz4 and zstd")
    if size > LARGEST_CHUNK:
        raise ValueError(f"a chunk has {size} bytes; at most {LARGEST_CHUNK} are allowed")
    data = unpack(chunk.data, chunk.compression, size, allowance)
    if len(data) != size:
        raise ValueError(f"it unpacks to {len(data)} bytes instead of {size}")
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("the checksum of a chunk is wrong")
    return data


def unpack(data: bytes, compression: str, limit: int, allowance: Allowance | None) -> bytes:
    """Unpack data; ValueError if it is broken, or unpacks to more than a limit.

    Raises ReadError: the file has unpacked to more than it may.
    """
    if not compression:
        return data
    try:
        if compression == "lz4":
            found = bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=limit + 1))
        else:  # as a stream: asked for it all, the library takes the memory that the frame says
            read = partial(_ZSTD.stream_reader(data).read, min(limit + 1, _PIECE))
            found = b"".join(islice(iter(read, b""), limit // _PIECE + 2))
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError) as error:
        raise ValueError(f"its {compression} data is broken ({error})") from error
    if allowance:
        allowance.spend(len(found))
    if len(found) > limit:
        raise ValueError(f"it unpacks to more than {limit} bytes")
    return found


# -- a file and its index


class Storage:
    """An open storage file, and what is known of its content."""

    def __init__(self, path: Path) -> None:
        """Open it; a file packed with zstd as a whole is unpacked to a temporary one.

        Raises BagError: its zstd data is broken. Raises ReadError: it is no file, or unpacks to
        more than it may. Raises OSError: it cannot be read, or the temporary folder has no room.
        """
        self.path = path
        self.topics: dict[int, TopicDescription] = {}  #: found so far, by the number of the channel
        self.metadata_text = ""  #: what rosbag2 left in the file last, "" if nothing
        self._known: dict[tuple[type, int], Any] = {}
        self._texts: dict[int, str] = {}  # of the schemas, one for all their topics
        self._left = dict(_LARGEST_SUM)
        self.stored_size = path.stat().st_size  #: as it lies on the disk, bytes
        self.allowance = Allowance(path, self.stored_size)  #: what its chunks may unpack to
        self.stream: IO[bytes] = open_regular(path)
        whole = True
        if path.suffix == ".zstd":
            with self.stream as packed:
                self.stream, whole = _unpacked_file(path, packed)
        self.size = os.fstat(self.stream.fileno()).st_size  #: unpacked, bytes
        self.begins_right = self.stream.read(len(MAGIC)) == MAGIC
        self.fault = ""  #: what is wrong with it as a whole
        if not self.stored_size:
            self.fault = "is empty: 0 bytes"
        elif not whole:
            self.fault = f"is cut: its zstd data ends early, {self.size} bytes are left"
        elif not self.begins_right:
            self.fault = "does not begin as an MCAP file does"

    def learn(self, record: Any) -> None:
        """Take a schema, channel or metadata record; other records are passed over.

        Raises ValueError: it is broken, or another one had that number.
        """
        kind = type(record)
        if kind is Metadata and record.name == "rosbag2":
            text = record.metadata.get("serialized_metadata", "")
            self.metadata_text = text or self.metadata_text
        if kind not in _LARGEST_SUM:
            return
        known = self._known.get((kind, record.id))
        if known is None:
            texts = [record.data] if kind is Schema else [record.topic, *record.metadata.values()]
            self._left[kind] -= sum(map(len, texts))
            if self._left[kind] < 0:
                raise ValueError(
                    f"more than {_LARGEST_SUM[kind]} bytes of {kind.__name__.lower()}s"
                )
            if kind is Schema:
                self._texts[record.id] = record.data.decode()
            else:
                self.topics[record.id] = self._topic(record)
            self._known[kind, record.id] = record
        elif known != record:
            raise ValueError(f"two {kind.__name__.lower()}s have the number {record.id}")

    def _topic(self, channel: Channel) -> TopicDescription:
        schema = self._known.get((Schema, channel.schema_id))
        if channel.schema_id and schema is None:
            raise ValueError(f"topic {channel.topic} names schema {channel.schema_id}; it has none")
        return TopicDescription(
            name=channel.topic,
            type=schema.name if schema else "",
            schema=self._texts[channel.schema_id] if schema else "",
            type_hash=channel.metadata.get("topic_type_hash", ""),
            offered_qos=qos_profiles(channel.metadata.get("offered_qos_profiles", "")),
            schema_encoding=schema.encoding if schema else "",
            encoding=channel.message_encoding,
        )

    def index(self) -> tuple[Footer, Iterator[Any]]:
        """Return the last record of a finished file, and what yields the records of its index.

        Raises ValueError: it has no end; while reading: its index is broken.
        """
        end = self.size - len(MAGIC) - _FOOTER_BYTES
        if end >= len(MAGIC):
            self.stream.seek(self.size - len(MAGIC))
            whole = self.stream.read() == MAGIC
            found = records_from(self.stream, end, self.size - len(MAGIC)) if whole else iter(())
            footer, _ = next(found, _NONE)
            if isinstance(footer, Footer):
                return footer, self._index(footer, end) if footer.summary_start else iter(())
        raise ValueError("it has no end; whoever wrote it was stopped")

    def _index(self, footer: Footer, end: int) -> Iterator[Any]:
        at, crc = footer.summary_start, 0
        if not len(MAGIC) <= at <= end:
            raise ValueError("its footer points outside of the file")
        self.stream.seek(at)
        left = footer.summary_crc and end + _FOOTER_BYTES - 4 - at  # the checksum stands last
        while left > 0:
            crc = zlib.crc32(self.stream.read(min(left, _PIECE)), crc)
            left -= _PIECE
        if crc != footer.summary_crc:
            raise ValueError("the checksum of its index is wrong")
        yield from (record for record, _ in records_from(self.stream, at, end))


def _unpacked_file(path: Path, packed: IO[bytes]) -> tuple[IO[bytes], bool]:
    """Return a file without a name that holds what could be unpacked, and whether that is all."""
    with contextlib.ExitStack() as closing:
        whole = closing.enter_context(tempfile.TemporaryFile())
        allowance, press = Allowance(path), _ZSTD.decompressobj()
        try:
            while not press.eof and (piece := packed.read(_PACKED_PIECE)):
                data = press.decompress(piece)
                allowance.spend(len(data))
                whole.write(data)
        except zstandard.ZstdError as error:
            raise damaged(path, f"its zstd data is broken ({error})") from error
        whole.seek(0)
        closing.pop_all()  # the caller closes it
    return whole, bool(press.eof)


class Span(NamedTuple):
    """A part of a file that is read at once, a chunk or a run of records.

    First and last time (ns), offset and length in the file, size in memory (bytes).
    """

    start_ns: int
    end_ns: int
    offset: int
    length: int
    size: int


class _File(Storage):
    """A finished MCAP file; its content is known when it has been opened."""

    def __init__(self, path: Path) -> None:
        """Open the file and read its index, or the whole file if it has no index.

        Raises BagError: it cannot be read, was not finished or is damaged.
        """
        self.counts: Counter[str] = Counter()  #: of the messages, by topic
        self.spans: list[Span] = []  #: where messages are
        self.compressions: set[str] = set()  #: of its chunks, in words
        with reading(path), contextlib.ExitStack() as closing:
            super().__init__(path)
            closing.callback(self.stream.close)
            if self.fault:
                raise ValueError(f"it {self.fault}")
            footer, index = self.index()
            self._end = footer.summary_start or self.size - len(MAGIC) - _FOOTER_BYTES
            header, _ = next(records_from(self.stream, len(MAGIC), self._end), _NONE)
            if not isinstance(header, Header):
                raise ValueError("its first record is not a header")
            self.library: str = header.library
            self.summary = self._take(index) or self._read_everything()
            closing.pop_all()

    def _take(self, index: Iterator[Any]) -> FileSummary | None:
        """Learn from the index; return None if it lacks needed information."""
        statistics: Statistics | None = None
        for record in index:
            if isinstance(record, ChunkIndex):
                self.compressions.add(record.compression)
                times = record.message_start_time, record.message_end_time
                where = record.chunk_start_offset, record.chunk_length
                self.spans.append(Span(*times, *where, record.uncompressed_size))
            elif isinstance(record, Statistics):
                statistics = record
            elif isinstance(record, MetadataIndex) and record.name == "rosbag2":
                found, _ = next(records_from(self.stream, record.offset, self._end), _NONE)
                if not isinstance(found, Metadata):
                    raise ValueError("its index points to metadata that is not there")
                self.learn(found)
            else:
                self.learn(record)
        if statistics is None:
            return None
        topics, counts = self.topics, statistics.channel_message_counts
        if (
            len(topics) < statistics.channel_count
            or len(self.spans) < statistics.chunk_count
            or not counts.keys() <= topics.keys()
            or sum(counts.values()) != statistics.message_count
            or (counts and not self.spans)
        ):
            return None
        size = sum(span.size for span in self.spans)
        self.allowance.spend(size)
        if statistics.message_count > (most := size // _SMALLEST_MESSAGE):
            raise ValueError(
                f"its index counts {statistics.message_count} messages; "
                f"{most} at most fit into its chunks"
            )
        for channel, count in counts.items():
            self.counts[topics[channel].name] += count
        times = statistics.message_start_time, statistics.message_end_time
        return FileSummary(self.path.name, self.stored_size, statistics.message_count, *times)

    def _read_everything(self) -> FileSummary:
        """Find and count the messages of a file without a full index."""
        self.spans, self.compressions = [], set()
        start = at = len(MAGIC)
        size, times = 0, list[int]()
        for record, after in records_from(self.stream, at, self._end):
            for message in self._messages(record, self.allowance):
                self.counts[self._name_of(message.channel_id)] += 1
                times.append(message.log_time)
            if isinstance(record, Chunk | Message):
                self.compressions.add(getattr(record, "compression", ""))
            size += getattr(record, "uncompressed_size", after - at)
            at = after
            if times and size > _PIECE:
                self.spans.append(Span(min(times), max(times), start, at - start, size))
                start, size, times = at, 0, []
        if times:
            self.spans.append(Span(min(times), max(times), start, at - start, size))
        first = min((span.start_ns for span in self.spans), default=0)
        last = max((span.end_ns for span in self.spans), default=0)
        return FileSummary(self.path.name, self.stored_size, self.counts.total(), first, last)

    def _name_of(self, channel: int) -> str:
        if channel not in self.topics:
            raise ValueError(f"a message names channel {channel}, which does not exist")
        return self.topics[channel].name

    def _messages(self, record: Any, allowance: Allowance | None) -> Iterator[Message]:
        """Yield the messages that a record is or holds, and learn what others say."""
        if isinstance(record, Message):
            yield record
        elif isinstance(record, Chunk):
            data = unpacked(record, allowance)
            for one, _ in records_from(BytesIO(data), 0, len(data)):
                if isinstance(one, Message):
                    yield one
                else:
                    self.learn(one)
        else:
            self.learn(record)

    def messages_of(self, span: Span, wanted: Wanted) -> Iterator[BagMessage]:
        """Yield the wanted messages of a span as they stand there; BagError: they are damaged."""
        size = 0
        with reading(self.path):
            end = span.offset + span.length
            if end > self._end:
                raise ValueError("its index points beyond its end")
            for record, _ in records_from(self.stream, span.offset, end):
                size += getattr(record, "uncompressed_size", 0)
                if size > span.size:
                    raise ValueError("a chunk is larger than its index says")
                # The allowance has covered the sizes in the index.
                for one in self._messages(record, None):
                    name, ns = self._name_of(one.channel_id), one.log_time
                    if not span.start_ns <= ns <= span.end_ns:
                        raise ValueError("a message lies outside the time range of the index")
                    chosen = wanted.topics is None or name in wanted.topics
                    if chosen and wanted.start_ns <= ns < wanted.end_ns:
                        yield BagMessage(name, ns, one.publish_time, one.sequence, one.data)


class McapFiles:
    """The open MCAP files of a bag as one."""

    def __init__(self, path: Path, files: list[Path], stored: StoredMetadata | None) -> None:
        """Open the files of a bag.

        Raises BagError: one cannot be read.
        """
        self._path = path
        self._files: list[_File] = []
        self.topics: dict[str, TopicDescription] = {}  #: by name
        self.counts: Counter[str] = Counter()  #: messages by topic
        #: what ``metadata.yaml`` says, or without one the last file that has any metadata
        self.metadata = stored or StoredMetadata()
        with contextlib.ExitStack() as opened:
            for name in files:
                file = _File(name)
                opened.callback(file.stream.close)
                self._files.append(file)
                self.counts.update(file.counts)
                for topic in file.topics.values():
                    known = self.topics.setdefault(topic.name, topic)
                    if known.type != topic.type:
                        types = f"{known.type} and {topic.type}"
                        raise damaged(name, f"topic {topic.name} has two types, {types}")
                if file.metadata_text and not stored:
                    try:
                        self.metadata = parse_metadata(file.metadata_text)
                    except ValueError as error:
                        raise damaged(name, f"its metadata: {error}") from error
            self.close = opened.pop_all().close  #: closes the files; twice does no harm
        self.files = [file.summary for file in self._files]  #: a summary of each
        #: of the chunks: "zstd", "lz4", "" for none
        self.compressions = sorted({one for file in self._files for one in file.compressions})
        #: names of the programs that wrote the files
        self.libraries = sorted({file.library for file in self._files})

    def messages(self, wanted: Wanted) -> Iterator[BagMessage]:
        """Yield messages in order of time; at one time, in the order of their spans.

        Raises BagError: a file is damaged.
        """
        found = [
            (span, file)
            for file in self._files
            for span in file.spans
            if span.start_ns < wanted.end_ns and span.end_ns >= wanted.start_ns
        ]
        found.sort(key=lambda one: one[0].start_ns)
        waiting: list[tuple[int, int, int, BagMessage]] = []  # by time, span, and place in it
        size = 0  # of them, bytes
        for number, opening in enumerate([*found, None]):
            while waiting and (not opening or waiting[0][0] < opening[0].start_ns):
                message = heapq.heappop(waiting)[-1]
                size -= len(message.data) + _PER_MESSAGE
                yield message
            if not opening:
                break
            most = _MOST_OPEN if waiting else _LARGEST_OPEN
            for place, message in enumerate(opening[1].messages_of(opening[0], wanted)):
                heapq.heappush(waiting, (message.log_ns, number, place, message))
                size += len(message.data) + _PER_MESSAGE
                if size > most:
                    raise BagError(
                        f"{self._path}: its messages are too far out of order to be sorted in "
                        "memory; sort them with `mcap sort` or `ros2 bag convert`"
                    )
