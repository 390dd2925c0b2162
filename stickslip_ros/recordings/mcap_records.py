# SPDX-License-Identifier: Apache-2.0
"""The records of MCAP, read and unpacked without trusting any length in the file.

A length is compared with the file and with limits before anything is read or unpacked. Records that
are known to be complete are parsed by ``mcap``.
"""

from __future__ import annotations

import contextlib
import struct
import tempfile
import zlib
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import IO, Any, NamedTuple

import lz4.frame
import numpy as np
import numpy.typing as npt
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema

from stickslip_ros.base.opening import Allowance, open_regular
from stickslip_ros.recordings.errors import damaged
from stickslip_ros.recordings.metadata import TopicDescription
from stickslip_ros.recordings.qos import qos_profiles

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")  # opcode, length of the body
_MESSAGE_HEAD = np.dtype(
    [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"),
     ("log_ns", "<u8"), ("publish_ns", "<u8")]
)  # fmt: skip
MESSAGE_BYTES = _MESSAGE_HEAD.itemsize - HEAD.size
"""Bytes of the body of a message without data."""

SMALLEST_MESSAGE = _MESSAGE_HEAD.itemsize
"""Bytes of a message record without data."""

LARGEST_CHUNK = 64 * 1024 * 1024
"""Bytes of a chunk, unpacked. rosbag2 makes 768 KiB, or as much as its largest message takes."""

LARGEST_PACKED = LARGEST_CHUNK + LARGEST_CHUNK // 64
"""Bytes of a chunk as it is stored: data that cannot be packed grows a little."""

_COMPRESSIONS = ("", "lz4", "zstd")  # of chunks, as their records name them
_CHUNK_HEAD = struct.Struct("<QQQII")  # first and last time, size, CRC, length of compression
_LENGTH = struct.Struct("<Q")
_LARGEST_MESSAGE = 64 * 1024 * 1024
_LARGEST_OTHER = 1024 * 1024  # bytes of a schema, channel, metadata, ...
# Bytes of all schemas, and of all channels: the 65 536 that MCAP can number take half of it.
_LARGEST_SUM = {Schema: 8 * 1024 * 1024, Channel: 64 * 1024 * 1024}
#: Records that are passed over, whatever their length
_PASSED_OVER = (
    Opcode.MESSAGE_INDEX,
    Opcode.ATTACHMENT,
    Opcode.ATTACHMENT_INDEX,
    Opcode.SUMMARY_OFFSET,
    Opcode.DATA_END,
)
#: How long the bodies of records may be that are taken into memory, bytes
_LARGEST_BODIES = {
    **{int(opcode): _LARGEST_OTHER for opcode in Opcode if opcode not in _PASSED_OVER},
    int(Opcode.MESSAGE): LARGEST_CHUNK,
    int(Opcode.CHUNK): LARGEST_PACKED,
}
# A frame may ask its reader to keep that much of the past; rosbag2 asks for 8 MiB at most.
_LARGEST_WINDOW = 64 * 1024 * 1024
_UNPACKED_PIECE = 1024 * 1024  # bytes unpacked at a time; the allowance is checked in between
# Bytes given to zstd at a time; what comes of it, 32 MB at most, is in memory at once.
_PACKED_PIECE = 1024


_AT_ONCE = 10_000  # messages that are Python's objects at a time
_MESSAGE = int(Opcode.MESSAGE)


def parse(kind: Any, body: bytes) -> Any:
    """Return a record of ``mcap.records`` from its body; a broken one raises ``BROKEN``."""
    return kind.read(ReadDataStream(BytesIO(body)))


class Place(NamedTuple):
    """Where a record lies in its file: opcode, offset of its head and of what follows, bytes."""

    opcode: int
    start: int
    end: int


def place_at(stream: IO[bytes], at: int, end: int) -> Place:
    """Return the record that begins at a place, without reading it.

    end: of the records of the file. Raises ValueError: there is none, or it is longer than what is
    left or than makes sense.
    """
    stream.seek(at)
    opcode, length = HEAD.unpack(stream.read(HEAD.size))
    if not opcode:  # zeros, as a disk leaves them after a power failure
        raise ValueError(f"there is no record at byte {at}")
    left = end - at - HEAD.size
    if length > left:
        raise ValueError(
            f"the record at byte {at} says it is {length} bytes long, but {left} are left"
        )
    largest = _LARGEST_BODIES.get(opcode, length)
    if length > largest:
        raise ValueError(
            f"the record at byte {at} is {length} bytes long, at most {largest} are allowed"
        )
    return Place(opcode, at, at + HEAD.size + length)


def body_at(stream: IO[bytes], place: Place) -> bytes:
    """Return the body of a record."""
    stream.seek(place.start + HEAD.size)
    return stream.read(place.end - place.start - HEAD.size)


@dataclass(frozen=True)
class Chunk:
    """A chunk as it stands in the file; its size in bytes once unpacked, no checksum if 0."""

    size: int
    crc: int
    compression: str
    data: bytes

    @staticmethod
    def read(stream: IO[bytes], place: Place) -> Chunk:
        """Read a chunk record; ``BROKEN`` if it is none, or too large a one."""
        stream.seek(place.start + HEAD.size)
        _, _, size, crc, length = _CHUNK_HEAD.unpack(stream.read(_CHUNK_HEAD.size))
        compression = stream.read(min(length, 20)).decode()
        if compression not in _COMPRESSIONS:
            raise ValueError(f"compression {compression!r} is not known, only none, lz4 and zstd")
        (packed,) = _LENGTH.unpack(stream.read(_LENGTH.size))
        left = place.end - stream.tell()
        if packed != left:
            raise ValueError(f"a chunk has {left} bytes instead of {packed}")
        if size > LARGEST_CHUNK:
            raise ValueError(f"a chunk has {size} bytes; at most {LARGEST_CHUNK} are allowed")
        return Chunk(size, crc, compression, stream.read(packed))

    def unpacked(self, allowance: Allowance | None) -> bytes:
        """Return the unpacked records; ValueError if they are damaged.

        allowance: of the file; None where the sum is known to be within it.
        """
        data = _unpack(self.data, self.compression, self.size, allowance)
        if len(data) != self.size:
            raise ValueError(f"it unpacks to {len(data)} bytes instead of {self.size}")
        if self.crc and zlib.crc32(data) != self.crc:
            raise ValueError("the checksum of a chunk is wrong")
        return data


def _unpack(data: bytes, compression: str, limit: int, allowance: Allowance | None) -> bytes:
    """Unpack data; return limit + 1 bytes at most.

    Raises ValueError: broken data. Raises ReadError: the file has unpacked to more than it may.
    """
    if not compression:
        return data[: limit + 1]
    pieces, most = [], limit + 1
    try:
        if compression == "lz4":
            press = lz4.frame.LZ4FrameDecompressor()
            pieces = [bytes(press.decompress(data, max_length=most))]
            if allowance:
                allowance.spend(len(pieces[0]))
            return pieces[0]
        # As a stream: asked for it all, the library takes the memory that the frame says.
        reader = zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW).stream_reader(data)
        while most and (piece := reader.read(min(most, _UNPACKED_PIECE))):
            if allowance:
                allowance.spend(len(piece))
            pieces.append(piece)
            most -= len(piece)
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError) as error:
        raise ValueError(f"its {compression} data is broken ({error})") from error
    return b"".join(pieces)


def unpack_message(data: bytes, allowance: Allowance) -> bytes:
    """Return a message that rosbag2 packed with zstd by itself.

    Raises ValueError: broken data, or a message larger than makes sense. Raises ReadError: the file
    has unpacked to more than it may.
    """
    unpacked = _unpack(data, "zstd", _LARGEST_MESSAGE, allowance)
    if len(unpacked) > _LARGEST_MESSAGE:
        raise ValueError(f"it unpacks to more than {_LARGEST_MESSAGE} bytes")
    return unpacked


def open_storage(path: Path) -> tuple[IO[bytes], bool]:
    """Return an open storage file, and whether all of it could be unpacked.

    A file packed with zstd as a whole is unpacked to a temporary one, gone when closed.

    Raises BagError: its zstd data is broken. Raises ReadError: it is no file, or unpacks to more
    than it may. Raises OSError: it cannot be read, or the temporary folder has no room.
    """
    stream = open_regular(path)
    if path.suffix != ".zstd":
        return stream, True
    with contextlib.ExitStack() as closing, stream:
        unpacked = closing.enter_context(tempfile.TemporaryFile())
        allowance = Allowance(path)
        press = zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW).decompressobj()
        try:
            while not press.eof and (piece := stream.read(_PACKED_PIECE)):
                data = press.decompress(piece)
                allowance.spend(len(data))
                unpacked.write(data)
        except zstandard.ZstdError as error:
            raise damaged(path, f"its zstd data is broken ({error})") from error
        unpacked.seek(0)
        closing.pop_all()  # the caller closes it
    return unpacked, bool(press.eof)


class BagMessage(NamedTuple):
    """One message of a bag; times in ns since the Unix epoch."""

    topic: str  #: its name
    log_ns: int  #: when it was recorded, which is what orders a bag
    publish_ns: int  #: when it was published
    sequence: int  #: the publisher's number of it, 0 if unknown
    data: bytes  #: the message, serialized


class Block(NamedTuple):
    """Some messages after the other, field by field, as those of :class:`BagMessage`."""

    topics: list[str]
    log_ns: list[int]
    publish_ns: list[int]
    sequences: list[int]
    data: list[bytes]

    def messages(self) -> Iterator[BagMessage]:
        """Yield them."""
        return map(BagMessage, *self)


class Messages(NamedTuple):
    """The messages among records in memory."""

    records: bytes
    starts: npt.NDArray[np.int64]  #: of their records
    heads: npt.NDArray[np.void]  #: the fields of each besides its data

    def chosen(self, which: Any) -> Messages:
        """Return some of them."""
        return Messages(self.records, self.starts[which], self.heads[which])


def messages_in(records: bytes, learn: Callable[[int, bytes], object]) -> Messages:
    """Return the messages among records in memory.

    learn: called with opcode and body of every other record, and of messages that are too short.
    Raises ValueError: a record is broken.
    """
    found = array("q")
    unpack, following, end = HEAD.unpack_from, 0, len(records)
    while following < end:
        start = following
        opcode, length = unpack(records, start)
        following += HEAD.size + length
        if following > end:
            raise ValueError("a record inside a chunk extends beyond its end")
        if opcode == _MESSAGE and following - start >= SMALLEST_MESSAGE:
            found.append(start)
        else:
            learn(opcode, records[start + HEAD.size : following])
    starts = np.frombuffer(found, np.int64)
    heads = np.empty(len(starts), _MESSAGE_HEAD)
    for at in range(0, len(starts), _AT_ONCE):
        piece = slice(at, at + _AT_ONCE)
        places = starts[piece, None] + np.arange(SMALLEST_MESSAGE)
        heads[piece] = np.frombuffer(records, np.uint8)[places].view(_MESSAGE_HEAD)[:, 0]
    return Messages(records, starts, heads)


Part = tuple[Messages, Mapping[int, str]]
"""Messages, and the topics of their channels."""


def merged(parts: Sequence[Part], in_time: bool = True) -> Iterator[Block]:
    """Yield messages in order of time; those of one time, or without that, as the parts have them.

    A block has 10 000 of them at most.
    """
    counts = [len(messages.starts) for messages, _ in parts]
    part_of = np.repeat(np.arange(len(parts)), counts)
    starts = np.concatenate([messages.starts for messages, _ in parts])
    heads = np.concatenate([messages.heads for messages, _ in parts])
    order = np.argsort(heads["log_ns"], kind="stable") if in_time else np.arange(len(heads))
    for at in range(0, len(order), _AT_ONCE):
        piece = order[at : at + _AT_ONCE]
        own, first = heads[piece], starts[piece] + SMALLEST_MESSAGE
        end = first + own["length"].astype(np.int64) - MESSAGE_BYTES
        of = [parts[number] for number in part_of[piece].tolist()]
        channels, spans = own["channel"].tolist(), zip(first.tolist(), end.tolist(), strict=True)
        yield Block(
            [names[channel] for (_, names), channel in zip(of, channels, strict=True)],
            own["log_ns"].tolist(),
            own["publish_ns"].tolist(),
            own["sequence"].tolist(),
            [one.records[a:b] for (one, _), (a, b) in zip(of, spans, strict=True)],
        )


class Channels:
    """What the records of a file besides messages say."""

    def __init__(self) -> None:
        """Know nothing."""
        self.topics: dict[int, TopicDescription] = {}  #: by the number of their channel
        self.metadata_text = ""  #: what rosbag2 left in the file last, "" if nothing
        self._known: dict[tuple[type, int], Any] = {}
        self._texts: dict[int, str] = {}  # of the schemas, one for all their topics
        self._left = dict(_LARGEST_SUM)

    def learn(self, opcode: int, body: bytes) -> None:
        """Take a schema, channel or metadata record; other records are passed over.

        Raises ValueError: it is broken, a message, or another one had that number.
        """
        if opcode == Opcode.MESSAGE:
            raise ValueError("a message is shorter than its head")
        if opcode == Opcode.METADATA:
            found = parse(Metadata, body)
            if found.name == "rosbag2":
                text = found.metadata.get("serialized_metadata", "")
                self.metadata_text = text or self.metadata_text
        if opcode not in (Opcode.SCHEMA, Opcode.CHANNEL):
            return
        kind = Schema if opcode == Opcode.SCHEMA else Channel
        record = parse(kind, body)
        known = self._known.get((kind, record.id))
        if known is None:
            self._left[kind] -= len(body)
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
