# SPDX-License-Identifier: Apache-2.0
"""An MCAP file: its index, and its blocks of records one after the other, whole or damaged.

In a file that has to be sound, any damage is an error. In one that is recovered, damage is noted,
and the scan goes on with the next whole chunk: chunks are the only records with a checksum. Records
outside of chunks are kept where they parse and fit between their neighbours.
"""

from __future__ import annotations

import os
import re
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Footer, MetadataIndex, Statistics

from stickslip_ros.base.opening import Allowance
from stickslip_ros.recordings.errors import BROKEN, reading
from stickslip_ros.recordings.mcap_records import (
    HEAD,
    LARGEST_PACKED,
    MAGIC,
    Channels,
    Chunk,
    Place,
    body_at,
    open_storage,
    parse,
    place_at,
)

#: Records outside of chunks that hold what a bag is made of
_USED = frozenset({Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.METADATA})
_OPCODES = frozenset(int(opcode) for opcode in Opcode)
_FIRST_PRIVATE = 0x80  # opcodes from here on are anybody's
_FOOTER_BYTES = HEAD.size + 20
_CRC_BYTES = 4
_PIECE = 1024 * 1024  # bytes of the file that are searched, or enter a checksum, together
_RUN_BYTES = 1024 * 1024  # records outside of chunks are read by so much at a time
# A chunk record: its opcode and a length of less than 128 MiB.
_CHUNK_START = re.compile(rb"\x06.{3}[\x00-\x07]\x00{4}", re.DOTALL)
# What looks like a chunk and is none may be read again and again, one inside the other: so many
# times the size of the file, and so many bytes besides. One costs as much as some bytes at least.
_FALSE_FACTOR, _FALSE_BYTES, _FALSE_LEAST = 4, 256 * 1024 * 1024, 4096


class Piece(NamedTuple):
    """A chunk, or a run of records outside of chunks; where it lies, and its records, unpacked."""

    start: int
    end: int
    records: bytes  #: b"" if they are of no use
    chunk: Chunk | None = None  #: None outside of chunks


class Span(NamedTuple):
    """A part of a file that is read at once, a chunk or a run of records.

    First and last time (ns), offset and length in the file, size in memory (bytes).
    """

    start_ns: int
    end_ns: int
    offset: int
    length: int
    size: int


class McapFile:
    """An open file."""

    def __init__(self, path: Path, findings: list[str] | None = None) -> None:
        """Open the file.

        findings: takes what is wrong with the file; None: that is an error. Raises BagError: the
        operating system does not let us read it, it is cut, or no MCAP file.
        """
        self.path = path
        #: what is wrong with it, a sentence each; None if it has to be sound
        self.findings = findings
        self.dropped_bytes = 0  #: how much of it was of no use so far
        self.channels = Channels()  #: the topics and metadata read so far
        self.statistics: Statistics | None = None  #: counts in its index, None if it has none
        self.spans: list[Span] = []  #: where messages are, by its index its chunks
        self.compressions: set[str] = set()  #: of its chunks, in words
        with reading(path):
            self.stream, whole = open_storage(path)
            try:
                self.stored_size = path.stat().st_size  #: as it lies on the disk, bytes
                self.size = os.fstat(self.stream.fileno()).st_size  #: of the file, unpacked, bytes
                #: what its chunks may still unpack to
                self.allowance = Allowance(path, self.stored_size)
                self._false_left = _FALSE_FACTOR * self.size + _FALSE_BYTES
                self.begins_right = self.read(0, len(MAGIC)) == MAGIC
                if not self.stored_size:
                    self.find("is empty: 0 bytes")
                elif not whole:
                    self.find(f"is cut: its zstd data ends early, {self.size} bytes are left")
                elif self.size and not self.begins_right:
                    self.find("does not begin as an MCAP file does")
            except BaseException:
                self.close()
                raise

    def close(self) -> None:
        """Close the file; twice does no harm."""
        self.stream.close()

    def find(self, what: str) -> None:
        """Note what is wrong; ValueError if nothing may be."""
        if self.findings is None:
            raise ValueError(f"it {what}")
        self.findings.append(f"{self.path.name} {what}")

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

        Raises ValueError: the file has no end.
        """
        end = self.size - len(MAGIC)
        if self.records_end < len(MAGIC) or self.read(end, len(MAGIC)) != MAGIC:
            raise ValueError("it has no end; whoever wrote it was stopped")
        place = place_at(self.stream, self.records_end, end)
        if place.opcode != Opcode.FOOTER:
            raise ValueError("its last record is not a footer")
        return parse(Footer, body_at(self.stream, place))

    def read_index(self, footer: Footer) -> None:
        """Read the index, and learn topics and metadata unless its checksum is wrong.

        Raises ValueError: it is broken, or its checksum is wrong.
        """
        start, end = footer.summary_start, self.records_end
        if not len(MAGIC) <= start <= end:
            raise ValueError("its footer points outside of the file")
        if footer.summary_crc:
            crc, at, checked = 0, start, end + _FOOTER_BYTES - _CRC_BYTES
            while at < checked and (piece := self.read(at, min(checked - at, _PIECE))):
                crc = zlib.crc32(piece, crc)
                at += len(piece)
            if crc != footer.summary_crc:
                raise ValueError("the checksum of its index is wrong")
        while start < end:
            place = place_at(self.stream, start, end)
            start = place.end
            if place.opcode == Opcode.CHUNK_INDEX:
                chunk = parse(ChunkIndex, body_at(self.stream, place))
                self.compressions.add(chunk.compression)
                times = chunk.message_start_time, chunk.message_end_time
                where = chunk.chunk_start_offset, chunk.chunk_length
                self.spans.append(Span(*times, *where, chunk.uncompressed_size))
            elif place.opcode == Opcode.STATISTICS:
                self.statistics = parse(Statistics, body_at(self.stream, place))
            elif place.opcode == Opcode.METADATA_INDEX:
                found = place_at(
                    self.stream, parse(MetadataIndex, body_at(self.stream, place)).offset, self.size
                )
                if found.opcode != Opcode.METADATA:
                    raise ValueError("its index points to metadata that is not there")
                self.channels.learn(found.opcode, body_at(self.stream, found))
            elif place.opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self.channels.learn(place.opcode, body_at(self.stream, place))

    # -- piece by piece

    def pieces(self, end: int | None = None) -> Iterator[Piece]:
        """Yield all chunks and runs of other used records, in the order of the file.

        end: of the part that is read; the whole file if None. Raises ValueError: something is wrong
        with a file that has to be sound.
        """
        run: list[Piece] = []
        for piece in self._pieces(end):
            ends = piece.chunk or piece.start != run[-1].end if run else False
            if ends or (run and piece.end - run[0].start > _RUN_BYTES):
                yield _joined(run)
                run = []
            if piece.chunk:
                yield piece
            elif piece.records:
                run.append(piece)
        if run:
            yield _joined(run)

    def _pieces(self, end: int | None) -> Iterator[Piece]:
        """Yield chunks, and every other record by itself."""
        at = len(MAGIC) if self.begins_right else 0
        if end is None:
            closed = self.read(max(0, self.size - len(MAGIC)), len(MAGIC)) == MAGIC
            end = self.size - closed * len(MAGIC)
        seen: set[tuple[int, int]] = set()  # size and CRC of chunks; damage copies some
        while at < end:
            try:
                piece = self._piece_at(at, end)
                if piece.chunk and piece.chunk.crc and self.findings is not None:
                    mark = piece.chunk.size, piece.chunk.crc
                    if mark in seen:
                        raise ValueError("it holds a chunk twice")
                    seen.add(mark)
            except BROKEN:
                if self.findings is None:
                    raise
                following = self._next_chunk(at + 1, end)
                self.dropped_bytes += following - at
                at = following
                continue
            at = piece.end
            yield piece

    def _piece_at(self, at: int, end: int) -> Piece:
        """Return the chunk, or the record outside of chunks, at a place.

        Raises ValueError: it is broken.
        """
        place = place_at(self.stream, at, end)
        if place.opcode == Opcode.CHUNK:
            chunk = Chunk.read(self.stream, place)
            return Piece(at, place.end, chunk.unpacked(self.allowance), chunk)
        if self.findings is not None and not self._is_record(place):
            raise ValueError(f"there is no record at byte {at}")
        return Piece(at, place.end, self.read(at, place.end - at) if place.opcode in _USED else b"")

    def _is_record(self, place: Place) -> bool:
        """Return whether a record without a checksum is at a place, and does not just look so.

        Another record, or a part of one, or the end of the file has to follow; and there must not
        be a chunk inside, as there is when its length is wrong, unless it is an attachment.
        """
        head = self.read(place.end, HEAD.size)
        if len(head) == HEAD.size:
            following, length = HEAD.unpack(head)
            fits = length <= self.size + LARGEST_PACKED - place.end
            if not (_is_known(following) and fits):
                return False
        hides = place.opcode != Opcode.ATTACHMENT and (
            self._next_chunk(place.start + 1, place.end) < place.end
        )
        return _is_known(place.opcode) and not hides

    def _next_chunk(self, at: int, limit: int) -> int:
        """Return where the first whole chunk from a place on begins, a limit if there is none."""
        while at < limit and self._false_left > 0:
            window = self.read(at, min(_PIECE, limit - at))
            for match in _CHUNK_START.finditer(window):
                try:
                    found = place_at(self.stream, at + match.start(), self.size)
                    chunk = Chunk.read(self.stream, found)
                except BROKEN:
                    continue
                try:
                    if chunk.unpacked(self.allowance):
                        return found.start
                except BROKEN:
                    self._false_left -= len(chunk.data) + _FALSE_LEAST
                    if self._false_left < 0:
                        return limit
            if len(window) < _PIECE:
                break
            at += _PIECE - HEAD.size
        return limit


def _joined(run: list[Piece]) -> Piece:
    return Piece(run[0].start, run[-1].end, b"".join([piece.records for piece in run]))


def _is_known(opcode: int) -> bool:
    return opcode in _OPCODES or opcode >= _FIRST_PRIVATE
