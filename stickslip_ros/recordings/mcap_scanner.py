# SPDX-License-Identifier: Apache-2.0
"""An MCAP file, sound or damaged: its index, and its blocks of records one after the other.

The same code walks through both. In a sound file the first thing that is wrong is an error; of a
damaged one everything that is whole is found, and what is wrong is noted.
"""

from __future__ import annotations

import contextlib
import os
import re
import zlib
from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Footer, Metadata, MetadataIndex, Statistics

from stickslip_ros.opening import Allowance
from stickslip_ros.recordings.channels import Channels
from stickslip_ros.recordings.mcap_records import (
    BROKEN,
    HEAD,
    LARGEST_PACKED,
    LONGEST_CHUNK_HEAD,
    MAGIC,
    PackedChunk,
    Place,
    body_at,
    parse,
    place_at,
    places,
    reading,
    records_in,
)
from stickslip_ros.recordings.unpacking import open_storage, unpack

_OPCODES = frozenset(int(opcode) for opcode in Opcode)
_FIRST_PRIVATE = 0x80  # opcodes from here on are anybody's
#: Those outside of chunks that hold what a bag is made of
_USED = frozenset({Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.METADATA})

_FOOTER_BYTES = HEAD.size + 20
_CRC_BYTES = 4
_PIECE = 1024 * 1024  # bytes of the file that are looked at together

# A chunk record: its opcode and a length of less than 128 MiB.
_CHUNK_START = re.compile(rb"\x06.{3}[\x00-\x07]\x00{4}", re.DOTALL)
#: Looking for the next chunk ends after so many places that only seemed to be one: each costs as
#: much as a chunk.
_MOST_FALSE_STARTS = 1000


@dataclass(frozen=True)
class Block:
    """A chunk, or a record outside of chunks, out of its file.

    :ivar records: of the chunk, unpacked, or the one record.
    :ivar chunk: None outside of chunks.
    :ivar protected: whether a checksum says that the records are what was written.
    """

    place: Place
    records: bytes
    chunk: PackedChunk | None = None
    protected: bool = False


@dataclass
class Index:
    """What the end of a file says of it.

    :ivar protected: whether a checksum says that it is what was written.
    :ivar chunks: first and last time (ns), offset, length, size unpacked (bytes) of each, in turn.
    :ivar metadata_text: what rosbag2 left in the file, "" if nothing.
    """

    protected: bool
    statistics: Statistics | None = None
    chunks: array[int] = field(default_factory=lambda: array("Q"))
    compressions: set[str] = field(default_factory=set)
    metadata_text: str = ""


@dataclass
class Damage:
    """What is wrong with a file; complete when all of it has been gone through.

    :ivar findings: a sentence each; empty if it is whole.
    :ivar dropped_bytes: how much of it was of no use.
    :ivar unprotected: messages found that no checksum protects, or not the name of their topic.
    :ivar looks_right: whether the file begins as one of its format, or is empty.
    """

    file: str
    findings: list[str] = field(default_factory=list)
    dropped_bytes: int = 0
    unprotected: int = 0
    looks_right: bool = True

    def find(self, what: str) -> None:
        """Note what is wrong with the file."""
        self.findings.append(f"{self.file} {what}")


class McapScanner:
    """An open file.

    :ivar allowance: what its chunks may still unpack to.
    """

    def __init__(
        self,
        path: Path,
        damage: Damage | None = None,
        on_bytes: Callable[[int], object] = lambda count: None,
    ) -> None:
        """Open the file.

        :param damage: takes what is wrong; None: whatever is wrong is an error.
        :param on_bytes: called with the bytes gone through since it was called last.
        :raises BagError: the operating system does not let us read it, or it is no zstd file
            though its name says so; without ``damage`` also if it is cut or no MCAP file.
        """
        self._damage = damage
        self._on_bytes = on_bytes
        self._seen: set[tuple[int, int]] = set()  # size and CRC of chunks; damage copies some
        with reading(path):
            self.stream, whole = open_storage(path)
            self.size = os.fstat(self.stream.fileno()).st_size
            begins_right = self.stream.read(len(MAGIC)) == MAGIC
            self._start = len(MAGIC) if begins_right else 0
            self.allowance = Allowance(path)
            what = ""
            if not path.stat().st_size:
                what = "is empty: 0 bytes"
            elif not whole:
                what = f"is cut: its zstd data ends early, {self.size} bytes could be unpacked"
            elif self.size and not begins_right:
                what = "does not begin as an MCAP file does"
            if what and damage is None:
                self.close()
                raise ValueError(f"it {what}")
        if damage and what:
            damage.find(what)
            damage.looks_right = begins_right or not self.size

    def close(self) -> None:
        """Close the file; twice does no harm."""
        self.stream.close()

    def read(self, at: int, length: int) -> bytes:
        """Return a part of the file, shorter at its end."""
        self.stream.seek(at)
        return self.stream.read(length)

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
        return parse(Footer, body_at(self.stream, place))

    def index(self, footer: Footer, channels: Channels) -> Index | None:
        """Return what the index says, None if its checksum is wrong.

        :param channels: learns the topics, unless the checksum is wrong.
        :raises ValueError: it is broken.
        """
        start, end = footer.summary_start, self.records_end
        if not len(MAGIC) <= start <= end:
            raise ValueError("its footer points outside of the file")
        index = Index(bool(footer.summary_crc))
        if index.protected and footer.summary_crc != self._checksum(start, end):
            return None
        for place in places(self.stream, start, end):
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
        if index.name != "rosbag2" or self._damage:  # each is met on the way as well
            return ""
        place = place_at(self.stream, index.offset, self.size)
        if place.opcode != Opcode.METADATA:
            raise ValueError("its index points to metadata that is not there")
        return metadata_text(body_at(self.stream, place))

    def first_compression(self) -> str:
        """Return the compression of the first chunk, "" if it has none or there is no chunk."""
        with contextlib.suppress(*BROKEN):
            for place in places(self.stream, len(MAGIC), self.size):
                if place.opcode == Opcode.CHUNK:
                    chunk = self._chunk_at(place.offset)
                    return chunk.compression if chunk else ""
        return ""

    # -- block by block

    def blocks(self, end: int | None = None) -> Iterator[Block]:
        """Yield every chunk and every other record that is of use, in the order of the file.

        :param end: of what is looked at; the whole file if None.
        :raises ValueError: something is wrong, unless damage is passed over.
        """
        end = self.size if end is None else end
        at = self._start
        while at < end:
            block, following = self._block(at, end)
            if block:
                yield block
            self._on_bytes(following - at)
            at = following

    def records_at(self, offset: int, length: int, size: int) -> bytes:
        """Return the records of a part of a sound file, out of their chunk if they are in one.

        :param size: bytes that they may have, of what the allowance covers.
        :raises ValueError: they are damaged.
        """
        if offset + length > self.size:
            raise ValueError("its index points beyond its end")
        place = place_at(self.stream, offset, offset + length)
        if place.opcode != Opcode.CHUNK or place.length != length:
            return self.read(offset, length)
        chunk = PackedChunk.read(body_at(self.stream, place))
        if chunk.size > size:
            raise ValueError("a chunk is larger than its index says")
        return chunk.unpacked(None)

    def _block(self, at: int, end: int) -> tuple[Block | None, int]:
        """Return the block at a place, None if there is none of use, and where to go on."""
        try:
            place = place_at(self.stream, at, end)
            block = self._sound(place)
            if self._damage:
                self._doubt(place, block)
        except BROKEN:
            if self._damage is None:
                raise
            return self._mend(at, self._damage)
        if block and block.chunk and self._damage:
            end = at + HEAD.size + block.chunk.body_length
            return self._once(block, end, self._damage), end
        return block, place.end

    def _sound(self, place: Place) -> Block | None:
        """Return the block of a record, None if it is of no use; ValueError if it is damaged."""
        if place.opcode == Opcode.CHUNK:
            chunk = PackedChunk.read(body_at(self.stream, place))
            return Block(place, chunk.unpacked(self.allowance), chunk, bool(chunk.crc))
        if place.opcode in _USED:
            return Block(place, self.read(place.offset, place.length))
        return None

    # -- what is damaged

    def _doubt(self, place: Place, block: Block | None) -> None:
        """Raise ValueError if a record of a damaged file is not what it seems to be.

        Only chunks have a checksum; without one, known records have to fill them. Another record
        has to be of a known kind, the file has to go on behind it, and it may not hide a chunk,
        unless it is an attachment.
        """
        if block and block.chunk:
            if not block.protected and not _all_known(block.records):
                raise ValueError("a chunk without a checksum is damaged")
            return
        known = place.opcode in _OPCODES or place.opcode >= _FIRST_PRIVATE
        if not known or not self._plausible(place.end):
            raise ValueError("it is no record")
        inside = place.offset + 1
        if place.opcode != Opcode.ATTACHMENT and self._next_chunk(inside, place.end) < place.end:
            raise ValueError("it hides a chunk")

    def _once(self, block: Block, end: int, damage: Damage) -> Block | None:
        """Return a chunk that was not there before; times, which damage alters, do not count."""
        chunk = block.chunk
        assert chunk
        mark = chunk.size, chunk.crc
        if chunk.crc and mark in self._seen:
            damage.find(f"holds a chunk of {chunk.size} bytes twice; it is taken once")
            damage.dropped_bytes += end - block.place.offset
            return None
        self._seen.add(mark)
        return block

    def _mend(self, at: int, damage: Damage) -> tuple[Block | None, int]:
        """Return what is whole at a damaged place, and where to go on."""
        chunk = self._chunk_at(at)
        end = at + HEAD.size + chunk.body_length if chunk else at
        if chunk:
            records = self._records_of(chunk)
            if records is not None:  # only the length of the record was wrong
                place = Place(Opcode.CHUNK, at, end - at)
                return self._once(Block(place, records, chunk, bool(chunk.crc)), end, damage), end
        if chunk is None or chunk.cut or not self._plausible(end):
            end = self._next_chunk(at + 1)
        if chunk and chunk.cut and end == self.size:
            return self._cut(at, chunk, damage), end
        if not self._is_end(at):
            damage.dropped_bytes += end - at
        return None, end

    def _cut(self, at: int, chunk: PackedChunk, damage: Damage) -> Block:
        """Return what can be unpacked of a chunk that the end of the file has cut."""
        records = b""
        with contextlib.suppress(ValueError):
            records = unpack(chunk.data, chunk.compression, chunk.size, self.allowance)
            records = records[: chunk.size]
        damage.find(f"is cut inside a chunk: {len(records)} of its {chunk.size} bytes are there")
        damage.dropped_bytes += 0 if records else len(chunk.data)
        return Block(Place(Opcode.CHUNK, at, self.size - at), records, chunk)

    def _is_end(self, at: int) -> bool:
        return self.size - at == len(MAGIC) and self.read(at, len(MAGIC)) == MAGIC

    def _plausible(self, at: int) -> bool:
        """Return whether the file can go on, or end, at a place, be it in a record that is cut."""
        head = self.read(at, HEAD.size)
        if not head or self._is_end(at):
            return True
        if len(head) < HEAD.size:
            return head[0] in _OPCODES
        with contextlib.suppress(ValueError):
            place = place_at(self.stream, at, max(self.size, at + LARGEST_PACKED))
            private = place.opcode >= _FIRST_PRIVATE and place.end <= self.size
            return place.opcode in _OPCODES or private
        return head[0] == Opcode.CHUNK  # which may be whole whatever its length says

    def _chunk_at(self, at: int) -> PackedChunk | None:
        """Return the chunk at a place whatever its record says of its length; None if none is."""
        if self.read(at, 1) != bytes([Opcode.CHUNK]):
            return None
        at += HEAD.size
        try:
            head = PackedChunk.read(self.read(at, LONGEST_CHUNK_HEAD))
            if head.packed > LARGEST_PACKED:
                return None
            return PackedChunk.read(self.read(at, head.body_length))
        except BROKEN:
            return None

    def _records_of(self, chunk: PackedChunk) -> bytes | None:
        """Return the records in a chunk; None if they are not what was written."""
        with contextlib.suppress(*BROKEN):
            records = chunk.unpacked(self.allowance)
            if chunk.crc or _all_known(records):
                return records
        return None

    def _next_chunk(self, at: int, limit: int | None = None) -> int:
        """Return where the first whole chunk from a place on begins.

        The end of the file, or a limit, if there is none before it. Chunks are the only records
        with a checksum: what else looks like a record need not be one.
        """
        false_starts = 0
        limit = self.size if limit is None else limit
        while at < limit and false_starts < _MOST_FALSE_STARTS:
            window = self.read(at, min(_PIECE, limit - at))
            for match in _CHUNK_START.finditer(window):
                chunk = self._chunk_at(at + match.start())
                if chunk and not chunk.cut and chunk.packed:
                    if self._records_of(chunk) is not None:
                        return at + match.start()
                    false_starts += 1
            if len(window) < _PIECE:
                break
            at += _PIECE - HEAD.size
        return limit


def _all_known(records: bytes) -> bool:
    return all(opcode in _OPCODES for opcode, _, _ in records_in(records))


def metadata_text(body: bytes | memoryview) -> str:
    """Return what rosbag2 left in a metadata record, "" if it is another's."""
    record = parse(Metadata, body)
    return record.metadata.get("serialized_metadata", "") if record.name == "rosbag2" else ""
