# SPDX-License-Identifier: Apache-2.0
"""Reads the records of an MCAP file one by one, without trusting any length in the file.

The readers of the ``mcap`` and ``rosbags`` libraries unpack a chunk to any size that it states.
Here a length is compared with the file and with limits before anything is read or unpacked. Records
that are known to be complete are parsed by ``mcap``.
"""

from __future__ import annotations

import contextlib
import struct
import zlib
from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import IO, Any, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Metadata

from stickslip_ros.opening import Allowance, ReadError
from stickslip_ros.recordings.errors import BagError, damaged, unreadable
from stickslip_ros.recordings.unpacking import COMPRESSIONS, UnpackError, unpack

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")  # opcode, length of the body
MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
SMALLEST_MESSAGE = HEAD.size + MESSAGE_HEAD.size
"""Bytes of a message record without data."""

_CHUNK_HEAD = struct.Struct("<QQQII")  # first and last time, size, CRC, length of compression
_LENGTH = struct.Struct("<Q")

LONGEST_CHUNK_HEAD = _CHUNK_HEAD.size + max(map(len, COMPRESSIONS)) + _LENGTH.size
"""Bytes at the beginning of the body of a chunk that hold everything but the data."""

LARGEST_CHUNK = 64 * 1024 * 1024
"""Bytes of a chunk, unpacked. rosbag2 makes 768 KiB, or as much as its largest message takes."""

LARGEST_PACKED = LARGEST_CHUNK + LARGEST_CHUNK // 64
"""Bytes of a chunk as it is stored: data that cannot be packed grows a little."""

_LARGEST_OTHER = 1024 * 1024  # bytes of a schema, channel, metadata, ...
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

BROKEN = (struct.error, McapError, UnpackError, ValueError, OverflowError)
"""What reading broken bytes ends in, here and in the library."""


def parse(kind: Any, body: bytes) -> Any:
    """Return a record of ``mcap.records`` from its body; a broken one raises :data:`BROKEN`."""
    return kind.read(ReadDataStream(BytesIO(body)))


@contextlib.contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn whatever broken bytes lead to into a BagError that names the file."""
    try:
        yield
    except BagError:
        raise
    except ReadError as error:
        raise BagError(str(error)) from error
    except OSError as error:
        raise unreadable(path, error) from error
    except BROKEN as error:
        reason = " ".join(str(error).split()) or "it ends inside a record"
        raise damaged(path, reason[:200]) from error


class Place(NamedTuple):
    """Where a record lies in its file: opcode, offset of its head and of what follows, bytes."""

    opcode: int
    start: int
    end: int


def place_at(stream: IO[bytes], at: int, end: int) -> Place:
    """Return the record that begins at a place, without reading it.

    :param end: of the records of the file.
    :raises ValueError: there is none, or it is longer than what is left or than makes sense.
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


def record_places(stream: IO[bytes], start: int, end: int) -> Iterator[Place]:
    """Yield where the records of a part of a file lie; ValueError where one cannot be."""
    while start < end:
        place = place_at(stream, start, end)
        start = place.end
        yield place


def body_at(stream: IO[bytes], place: Place) -> bytes:
    """Return the body of a record."""
    stream.seek(place.start + HEAD.size)
    return stream.read(place.end - place.start - HEAD.size)


@dataclass(frozen=True)
class PackedChunk:
    """A chunk as it stands in the file; times in ns, size in bytes once unpacked.

    :ivar packed: how many bytes of data there should be, and are unless the file was cut.
    :ivar body_length: bytes that the body of the record should have.
    """

    start_ns: int
    end_ns: int
    size: int
    crc: int
    compression: str
    packed: int
    body_length: int
    data: memoryview

    @staticmethod
    def read(body: bytes) -> PackedChunk:
        """Parse the body of a chunk record; its data may be cut, or followed by other bytes.

        :raises ValueError: it is not a chunk, or too large a one.
        """
        start_ns, end_ns, size, crc, length = _CHUNK_HEAD.unpack_from(body)
        at = _CHUNK_HEAD.size
        compression = body[at : at + length].decode()
        if compression not in COMPRESSIONS:
            raise ValueError(f"compression {compression!r} is not known, only none, lz4 and zstd")
        at += length
        (packed,) = _LENGTH.unpack_from(body, at)
        at += _LENGTH.size
        if size > LARGEST_CHUNK:
            raise ValueError(f"a chunk has {size} bytes; at most {LARGEST_CHUNK} are allowed")
        data = memoryview(body)[at : at + packed]
        return PackedChunk(start_ns, end_ns, size, crc, compression, packed, at + packed, data)

    @property
    def cut(self) -> bool:
        """Whether data is missing at the end."""
        return len(self.data) < self.packed

    def unpacked(self, allowance: Allowance | None) -> bytes:
        """Return the unpacked records; ValueError if they are damaged.

        :param allowance: of the file; None where the sum is known to be within it.
        """
        if self.cut:
            raise ValueError(f"a chunk has {len(self.data)} bytes instead of {self.packed}")
        data = unpack(self.data, self.compression, self.size, allowance)
        if len(data) != self.size:
            raise UnpackError(f"it unpacks to {len(data)} bytes instead of {self.size}")
        if self.crc and zlib.crc32(data) != self.crc:
            raise ValueError("the checksum of a chunk is wrong")
        return data


def records_in(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, start and end of the body of each record in a piece of memory.

    :raises ValueError: a record goes on behind the end.
    """
    head, size, end = HEAD.unpack_from, HEAD.size, len(data)
    start = 0
    while start < end:
        opcode, length = head(data, start)
        body = start + size
        start = body + length
        if start > end:
            raise ValueError("a record inside a chunk extends beyond its end")
        yield opcode, body, start


Heads = tuple["array[int]", "array[int]", "array[int]"]


def messages_in(records: bytes, learn: Callable[[int, bytes], object]) -> Heads:
    """Return channel, log time (ns) and start of each message record in a piece of memory.

    :param learn: called with opcode and body of every other record.
    :raises ValueError: a record is broken.
    """
    channels, times, starts = array("H"), array("Q"), array("Q")
    unpack_head = MESSAGE_HEAD.unpack_from
    for opcode, start, end in records_in(records):
        if opcode != Opcode.MESSAGE:
            learn(opcode, records[start:end])
            continue
        if end - start < MESSAGE_HEAD.size:
            raise ValueError("a message is shorter than its head")
        channel, _, log_ns, _ = unpack_head(records, start)
        channels.append(channel)
        times.append(log_ns)
        starts.append(start)
    return channels, times, starts


def metadata_text(body: bytes) -> str:
    """Return the text of rosbag2 in a metadata record, "" for other records."""
    record = parse(Metadata, body)
    return str(record.metadata.get("serialized_metadata", "")) if record.name == "rosbag2" else ""
