# SPDX-License-Identifier: Apache-2.0
"""An MCAP file: its index, and its blocks of records one after the other.

Any damage is an error here. The scanner of damaged files reads in the same way, and continues after
damage.
"""

from __future__ import annotations

import os
import zlib
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Footer, MetadataIndex, Statistics

from stickslip_ros.opening import Allowance
from stickslip_ros.recordings.channels import Channels
from stickslip_ros.recordings.mcap_records import (
    HEAD,
    MAGIC,
    PackedChunk,
    Place,
    body_at,
    metadata_text,
    parse,
    place_at,
    reading,
    record_places,
)
from stickslip_ros.recordings.unpacking import open_storage

#: Records outside of chunks that hold what a bag is made of
_USED = frozenset({Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.METADATA})

_FOOTER_BYTES = HEAD.size + 20
_CRC_BYTES = 4
_PIECE = 1024 * 1024  # bytes of the index whose checksum is taken together


@dataclass(frozen=True)
class Block:
    """A chunk, or a record outside of chunks, out of its file.

    :ivar records: of the chunk, unpacked, or the one record.
    :ivar chunk: None outside of chunks.
    """

    place: Place
    records: bytes
    chunk: PackedChunk | None = None

    @property
    def protected(self) -> bool:
        """Whether a checksum protects the records, unless the block is cut."""
        return bool(self.chunk and self.chunk.crc and not self.chunk.cut)


@dataclass
class Index:
    """The index at the end of a file.

    :ivar chunks: first and last time (ns), offset, length, size unpacked (bytes) of each, in turn.
    :ivar compressions: of the chunks.
    :ivar metadata_text: what rosbag2 left in the file, "" if nothing.
    """

    statistics: Statistics | None = None
    chunks: array[int] = field(default_factory=lambda: array("Q"))
    compressions: set[str] = field(default_factory=set)
    metadata_text: str = ""


class McapFile:
    """An open file.

    :ivar size: of the file, unpacked, bytes.
    :ivar stored_size: as it lies on the disk, bytes.
    :ivar allowance: what its chunks may still unpack to.
    """

    def __init__(self, path: Path) -> None:
        """Open the file.

        :raises BagError: the operating system does not let us read it, it is cut, or no MCAP file.
        """
        self.path = path
        with reading(path):
            self.stream, whole = open_storage(path)
            self.stored_size = path.stat().st_size
            self.size = os.fstat(self.stream.fileno()).st_size
            self.allowance = Allowance(path, self.stored_size)
            self.begins_right = self.stream.read(len(MAGIC)) == MAGIC
            if not self.stored_size:
                self._wrong("is empty: 0 bytes")
            elif not whole:
                self._wrong(f"is cut: its zstd data ends early, {self.size} bytes are left")
            elif self.size and not self.begins_right:
                self._wrong("does not begin as an MCAP file does")

    def close(self) -> None:
        """Close the file; twice does no harm."""
        self.stream.close()

    def _wrong(self, what: str) -> None:
        self.close()
        raise ValueError(f"it {what}")

    def read(self, at: int, length: int) -> bytes:
        """Return a part of the file, shorter at its end."""
        self.stream.seek(at)
        return self.stream.read(length)

    def _is_end(self, at: int) -> bool:
        return self.size - at == len(MAGIC) and self.read(at, len(MAGIC)) == MAGIC

    # -- the index

    @property
    def records_end(self) -> int:
        """Where the footer of a finished file begins."""
        return self.size - len(MAGIC) - _FOOTER_BYTES

    def footer(self) -> Footer:
        """Return the last record.

        :raises ValueError: the file has no end.
        """
        end = self.size - len(MAGIC)
        if self.records_end < len(MAGIC) or not self._is_end(end):
            raise ValueError("it has no end; whoever wrote it was stopped")
        place = place_at(self.stream, self.records_end, end)
        if place.opcode != Opcode.FOOTER:
            raise ValueError("its last record is not a footer")
        footer: Footer = parse(Footer, body_at(self.stream, place))
        return footer

    def index(self, footer: Footer, channels: Channels) -> Index:
        """Read the index.

        :param channels: learns the topics, unless the checksum is wrong.
        :raises ValueError: it is broken, or its checksum is wrong.
        """
        start, end = footer.summary_start, self.records_end
        if not len(MAGIC) <= start <= end:
            raise ValueError("its footer points outside of the file")
        if footer.summary_crc and footer.summary_crc != self._checksum(start, end):
            raise ValueError("the checksum of its index is wrong")
        index = Index()
        for place in record_places(self.stream, start, end):
            if place.opcode == Opcode.CHUNK_INDEX:
                chunk = parse(ChunkIndex, body_at(self.stream, place))
                index.compressions.add(chunk.compression)
                times = chunk.message_start_time, chunk.message_end_time
                where = chunk.chunk_start_offset, chunk.chunk_length
                index.chunks.extend((*times, *where, chunk.uncompressed_size))
            elif place.opcode == Opcode.STATISTICS:
                index.statistics = parse(Statistics, body_at(self.stream, place))
            elif place.opcode == Opcode.METADATA_INDEX:
                found = parse(MetadataIndex, body_at(self.stream, place))
                index.metadata_text = self._metadata_at(found) or index.metadata_text
            elif place.opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                channels.learn(place.opcode, body_at(self.stream, place))
        return index

    def _checksum(self, start: int, end: int) -> int:
        self.stream.seek(start)
        left, crc = end + _FOOTER_BYTES - _CRC_BYTES - start, 0
        while left > 0 and (piece := self.stream.read(min(left, _PIECE))):
            crc = zlib.crc32(piece, crc)
            left -= len(piece)
        return crc

    def _metadata_at(self, index: MetadataIndex) -> str:
        if index.name != "rosbag2":
            return ""
        place = place_at(self.stream, index.offset, self.size)
        if place.opcode != Opcode.METADATA:
            raise ValueError("its index points to metadata that is not there")
        return metadata_text(body_at(self.stream, place))

    # -- block by block

    def blocks(self, end: int | None = None) -> Iterator[Block]:
        """Yield all chunks and other used records, in the order of the file.

        :param end: of the part that is read; the whole file if None.
        :raises ValueError: something is wrong with the file.
        """
        at, end = len(MAGIC) if self.begins_right else 0, self.size if end is None else end
        while at < end:
            block, at = self._block(at, end)
            if block:
                yield block

    def _block(self, at: int, end: int) -> tuple[Block | None, int]:
        """Return the block at a place, None if it is of no use, and where the next one begins."""
        place = place_at(self.stream, at, end)
        if place.opcode == Opcode.CHUNK:
            chunk = PackedChunk.read(body_at(self.stream, place))
            return Block(place, chunk.unpacked(self.allowance), chunk), place.end
        if place.opcode in _USED:
            return Block(place, self.read(at, place.end - at)), place.end
        return None, place.end
