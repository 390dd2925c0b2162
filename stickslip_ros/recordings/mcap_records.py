# SPDX-License-Identifier: Apache-2.0
"""Records of an MCAP file, taken out one by one without believing any length that stands there.

The readers of the ``mcap`` and ``rosbags`` libraries unpack a chunk to whatever it says it holds.
Here a length is held against what is there and what is sensible before anything is read or
unpacked; the records themselves, once they are known to lie in memory, are parsed by ``mcap``.
"""

from __future__ import annotations

import contextlib
import struct
import tempfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import IO, Protocol, TypeVar

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode

from stickslip_ros.recordings.errors import BagError, damaged, unreadable

# A frame may ask its reader to keep that much of the past; rosbag2 asks for 8 MiB at most.
_LARGEST_WINDOW = 64 * 1024 * 1024
_LARGEST_MESSAGE = 64 * 1024 * 1024
# Bytes given to zstd at a time; what comes of it, 32 MB at most, is in memory at once.
_PIECE = 1024

# A whole file is unpacked to a temporary one. Recordings shrink by a factor of 2 to 50; zeros, or
# a file made to fill the disk, by 10000 and more.
_LARGEST_FACTOR = 1000


class UnpackError(ValueError):
    """Compressed data do not match their size or format."""


def unpack(data: bytes | memoryview, compression: str, size: int) -> bytes:
    """Return unpacked data.

    :param compression: "", "lz4" or "zstd".
    :param size: what the result has to measure, bytes; never more than that is unpacked.
    :raises UnpackError: wrong size, broken data or an unknown compression.
    """
    unpacked = unpack_beginning(data, compression, size)
    if len(unpacked) != size:
        raise UnpackError(f"it unpacks to {len(unpacked)} bytes instead of {size}")
    return unpacked


def unpack_beginning(data: bytes | memoryview, compression: str, limit: int) -> bytes:
    """Return what can be unpacked of data that may end too early, limit + 1 bytes at most.

    :raises UnpackError: broken data or an unknown compression.
    """
    try:
        if compression == "":
            return bytes(data[: limit + 1])
        if compression == "zstd":
            return _unpack_zstd(data, limit + 1)
        if compression == "lz4":
            return lz4.frame.LZ4FrameDecompressor().decompress(bytes(data), max_length=limit + 1)
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError) as error:
        raise UnpackError(f"its {compression} data is broken ({error})") from error
    raise UnpackError(f"compression {compression!r} is not known, only none, lz4 and zstd")


def unpack_message(data: bytes) -> bytes:
    """Return a message that rosbag2 packed with zstd by itself.

    :raises UnpackError: broken data, or a message larger than makes sense.
    """
    unpacked = unpack_beginning(data, "zstd", _LARGEST_MESSAGE)
    if len(unpacked) > _LARGEST_MESSAGE:
        raise UnpackError(f"it unpacks to more than {_LARGEST_MESSAGE} bytes")
    return unpacked


def _unpack_zstd(data: bytes | memoryview, most: int) -> bytes:
    # As a stream: asked for it all, the library takes the memory that the frame says.
    reader = zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW).stream_reader(data)
    return bytes(reader.read(most))


def open_storage(path: Path) -> tuple[IO[bytes], bool]:
    """Return an open storage file, and whether all of it could be unpacked.

    A file packed with zstd as a whole is unpacked to a temporary one, gone when closed.

    :raises BagError: it is no file, or its zstd data is broken.
    :raises OSError: it cannot be read, or the temporary folder has no room.
    """
    if path.exists() and not path.is_file():  # a pipe, say, where reading would wait forever
        raise BagError(f"{path} is not a file; name the folder of a bag, or an .mcap file")
    if path.suffix != ".zstd":
        return path.open("rb"), True
    unpacked = tempfile.TemporaryFile()  # noqa: SIM115  the caller closes it
    try:
        with path.open("rb") as packed:
            whole = _unpack_to(unpacked, packed, path)
        unpacked.seek(0)
    except zstandard.ZstdError as error:
        unpacked.close()
        raise damaged(path, f"its zstd data is broken ({error})") from error
    except BaseException:
        unpacked.close()
        raise
    return unpacked, whole


def _unpack_to(unpacked: IO[bytes], packed: IO[bytes], path: Path) -> bool:
    """Unpack a file; return whether its data came to an end."""
    left = path.stat().st_size * _LARGEST_FACTOR
    unpack = zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW).decompressobj()
    while not unpack.eof and (piece := packed.read(_PIECE)):
        data = unpack.decompress(piece)
        left -= len(data)
        if left < 0:
            raise damaged(path, f"it unpacks to more than {_LARGEST_FACTOR} times its size")
        unpacked.write(data)
    return bool(unpack.eof)


MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")  # opcode, length of the body
MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_CHUNK_HEAD = struct.Struct("<QQQII")  # first and last time, size, CRC, length of compression
_LENGTH = struct.Struct("<Q")
_LONGEST_WORD = 32  # bytes of the name of a compression

LONGEST_CHUNK_HEAD = _CHUNK_HEAD.size + _LONGEST_WORD + _LENGTH.size
"""Bytes at the beginning of the body of a chunk that hold everything but the data."""

LARGEST_CHUNK = 64 * 1024 * 1024
"""Bytes of a chunk, unpacked. rosbag2 makes 768 KiB, or as much as its largest message takes."""

LARGEST_PACKED = LARGEST_CHUNK + LARGEST_CHUNK // 64
"""Bytes of a chunk as it is stored: what does not shrink grows a little."""

_LARGEST_OTHER = 1024 * 1024  # schemas, channels, indexes, metadata
#: Passed over unread, so that they may be as long as the file.
_SKIPPED = frozenset({Opcode.ATTACHMENT, Opcode.MESSAGE_INDEX})

BROKEN = (struct.error, McapError, UnpackError, ValueError, OverflowError)
"""What reading broken bytes ends in, here and in the library."""

Record = TypeVar("Record", covariant=True)


class _RecordType(Protocol[Record]):
    @staticmethod
    def read(stream: ReadDataStream) -> Record: ...


def parse(kind: _RecordType[Record], body: bytes | memoryview) -> Record:
    """Return a record from its body; a broken one raises what :func:`reading` knows."""
    return kind.read(ReadDataStream(BytesIO(body)))


@contextlib.contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn whatever broken bytes lead to into a BagError that names the file."""
    try:
        yield
    except BagError:
        raise
    except OSError as error:
        raise unreadable(path, error) from error
    except BROKEN as error:
        reason = " ".join(str(error).split()) or "it ends inside a record"
        raise damaged(path, reason[:200]) from error


@dataclass(frozen=True)
class Place:
    """Where a record lies in its file: opcode, offset and length with the head, bytes."""

    opcode: int
    offset: int
    length: int


def places(stream: IO[bytes], start: int, end: int) -> Iterator[Place]:
    """Yield where the records of a part of a file lie, without reading them.

    :raises ValueError: a record is longer than what is left or than makes sense.
    """
    while start < end:
        stream.seek(start)
        opcode, length = HEAD.unpack(stream.read(HEAD.size))
        if not opcode:  # zeros, as a disk leaves them after a power failure
            raise ValueError(f"there is no record at byte {start}")
        place = Place(opcode, start, HEAD.size + length)
        start += place.length
        if start > end:
            raise ValueError(
                f"the record at byte {place.offset} says it is {length} bytes long, "
                f"but {end - place.offset - HEAD.size} are left"
            )
        if opcode not in _SKIPPED and length > largest_body(opcode):
            raise ValueError(
                f"the record at byte {place.offset} is {length} bytes long, "
                f"at most {largest_body(opcode)} are allowed"
            )
        yield place


def largest_body(opcode: int) -> int:
    """Return how long the body of a record may be, bytes."""
    if opcode == Opcode.CHUNK:
        return LARGEST_PACKED
    return LARGEST_CHUNK if opcode == Opcode.MESSAGE else _LARGEST_OTHER


def body_at(stream: IO[bytes], place: Place) -> bytes:
    """Return the body of a record."""
    stream.seek(place.offset + HEAD.size)
    return stream.read(place.length - HEAD.size)


@dataclass(frozen=True)
class PackedChunk:
    """A chunk as it stands in the file; times in ns, size in bytes once unpacked.

    :ivar packed: how many bytes of data there should be, and are unless the file was cut.
    """

    start_ns: int
    end_ns: int
    size: int
    crc: int
    compression: str
    packed: int
    data: memoryview

    @staticmethod
    def read(body: bytes) -> PackedChunk:
        """Take the body of a chunk record apart; its data may lack an end or have too much of it.

        :raises ValueError: it is not a chunk, or too large a one.
        """
        start_ns, end_ns, size, crc, length = _CHUNK_HEAD.unpack_from(body)
        at = _CHUNK_HEAD.size
        if length > _LONGEST_WORD:
            raise ValueError("a chunk has an unknown compression")
        compression = body[at : at + length].decode()
        at += length
        (packed,) = _LENGTH.unpack_from(body, at)
        at += _LENGTH.size
        if size > LARGEST_CHUNK:
            raise ValueError(f"a chunk has {size} bytes; at most {LARGEST_CHUNK} are allowed")
        data = memoryview(body)[at : at + packed]
        return PackedChunk(start_ns, end_ns, size, crc, compression, packed, data)

    @property
    def body_length(self) -> int:
        """Bytes that the body of the record should have."""
        return _CHUNK_HEAD.size + len(self.compression.encode()) + _LENGTH.size + self.packed

    @property
    def cut(self) -> bool:
        """Whether data is missing at the end."""
        return len(self.data) < self.packed

    def unpacked(self) -> bytes:
        """Return the records inside; ValueError if they are not what was written."""
        if self.cut:
            raise ValueError(f"a chunk has {len(self.data)} bytes instead of {self.packed}")
        data = unpack(self.data, self.compression, self.size)
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
