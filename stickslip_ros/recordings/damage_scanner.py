# SPDX-License-Identifier: Apache-2.0
"""Scans an MCAP file that is cut or damaged, like a sound file up to the first damage.

The scan continues with the next whole chunk: chunks are the only records with a checksum.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from mcap.opcode import Opcode

from stickslip_ros.opening import Allowance
from stickslip_ros.recordings.mcap_file import Block, McapFile
from stickslip_ros.recordings.mcap_records import (
    BROKEN,
    HEAD,
    LARGEST_PACKED,
    LONGEST_CHUNK_HEAD,
    MAGIC,
    PackedChunk,
    Place,
    place_at,
    reading,
    record_places,
    records_in,
)
from stickslip_ros.recordings.unpacking import unpack

_OPCODES = frozenset(int(opcode) for opcode in Opcode)
_FIRST_PRIVATE = 0x80  # opcodes from here on are anybody's
_PIECE = 1024 * 1024  # bytes of the file that are searched together

# A chunk record: its opcode and a length of less than 128 MiB.
_CHUNK_START = re.compile(rb"\x06.{3}[\x00-\x07]\x00{4}", re.DOTALL)
#: The search for the next chunk ends after this many false starts: each costs as much as a chunk.
_MOST_FALSE_STARTS = 1000


@dataclass
class Damage:
    """The damage of a file; complete after the whole file was scanned.

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
        """Note a damage of the file."""
        self.findings.append(f"{self.file} {what}")


class DamageScanner(McapFile):
    """An open file; its damage is known after all blocks were read.

    :ivar damage: what is wrong with the file.
    :ivar compression: of the first chunk, "" if it has none or there is no chunk.
    """

    def __init__(self, path: Path, on_bytes: Callable[[int], object]) -> None:
        """Open the file.

        :param on_bytes: called with the bytes gone through since it was called last.
        :raises BagError: the operating system does not let us read it, or it is no zstd file
            though its name says so.
        """
        self.damage = Damage(path.name)
        self._on_bytes = on_bytes
        self._seen: set[tuple[int, int]] = set()  # size and CRC of chunks; damage copies some
        super().__init__(path)
        self.damage.looks_right = self.begins_right or not self.size
        with reading(path):
            self.compression = self._look_ahead()

    def _wrong(self, what: str) -> None:
        self.damage.find(what)

    def _look_ahead(self) -> str:
        """Return the compression of the first chunk, "" if it has none or there is no chunk.

        :raises ReadError: the chunks say that they unpack to more than they may, one that damage
            has made lie left aside. Better now than when half of it is written.
        """
        compression, told, largest = "", 0, 0
        with contextlib.suppress(*BROKEN):
            for place in record_places(self.stream, len(MAGIC), self.size):
                if place.opcode == Opcode.CHUNK:
                    chunk = PackedChunk.read(self.read(place.start + HEAD.size, LONGEST_CHUNK_HEAD))
                    compression = compression if told else chunk.compression
                    told, largest = told + chunk.size, max(largest, chunk.size)
        Allowance(self.path, self.stored_size).spend(told - largest)
        return compression

    def _block(self, at: int, end: int) -> tuple[Block | None, int]:
        try:
            block, following = super()._block(at, end)
            self._doubt(at, block, following)
        except BROKEN:
            block, following = self._mend(at)
        if block and block.chunk:
            if not block.chunk.cut:
                following = at + HEAD.size + block.chunk.body_length
            block = self._once(block, following)
        self._on_bytes(following - at)
        return block, following

    def _doubt(self, at: int, block: Block | None, following: int) -> None:
        """Raise ValueError if the bytes of a damaged file only look like a record.

        Only chunks have a checksum; without it, known records have to fill the chunk. Any other
        record has to be of a known kind and be followed by a record, and must not contain a chunk,
        unless it is an attachment.
        """
        if block and block.chunk:
            if not block.protected and not _all_known(block.records):
                raise ValueError("a chunk without a checksum is damaged")
            return
        (opcode,) = self.read(at, 1)
        if not (opcode in _OPCODES or opcode >= _FIRST_PRIVATE) or not self._plausible(following):
            raise ValueError("it is no record")
        if opcode != Opcode.ATTACHMENT and self._next_chunk(at + 1, following) < following:
            raise ValueError("it hides a chunk")

    def _once(self, block: Block, end: int) -> Block | None:
        """Return a chunk that was not there before; times, which damage alters, do not count."""
        chunk = block.chunk
        if not chunk or not block.protected:
            return block
        mark = chunk.size, chunk.crc
        if mark in self._seen:
            self.damage.find(f"holds a chunk of {chunk.size} bytes twice; it is taken once")
            self.damage.dropped_bytes += end - block.place.start
            return None
        self._seen.add(mark)
        return block

    def _mend(self, at: int) -> tuple[Block | None, int]:
        """Return the whole part of a damaged block, and where to continue."""
        chunk = self._chunk_at(at)
        end = at + HEAD.size + chunk.body_length if chunk else at
        if chunk:
            records = self._records_of(chunk)
            if records is not None:  # only the length of the record was wrong
                return Block(Place(Opcode.CHUNK, at, end), records, chunk), end
        if chunk is None or chunk.cut or not self._plausible(end):
            end = self._next_chunk(at + 1)
        if chunk and chunk.cut and end == self.size:
            return self._cut(at, chunk), end
        if not self._is_end(at):
            self.damage.dropped_bytes += end - at
        return None, end

    def _cut(self, at: int, chunk: PackedChunk) -> Block:
        """Unpack the readable part of a chunk that is cut by the end of the file."""
        records = b""
        with contextlib.suppress(ValueError):
            records = unpack(chunk.data, chunk.compression, chunk.size, self.allowance)
            records = records[: chunk.size]
        there = f"{len(records)} of its {chunk.size} bytes are there"
        self.damage.find(f"is cut inside a chunk: {there}")
        self.damage.dropped_bytes += 0 if records else len(chunk.data)
        return Block(Place(Opcode.CHUNK, at, self.size), records, chunk)

    def _plausible(self, at: int) -> bool:
        """Return whether a record, also a cut one, or the end of the file may follow at a place."""
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
        """Return the chunk at a place, ignoring the length in its record; None if there is none."""
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
        """Return the records in a chunk; None if they are damaged."""
        with contextlib.suppress(*BROKEN):
            records = chunk.unpacked(self.allowance)
            if chunk.crc or _all_known(records):
                return records
        return None

    def _next_chunk(self, at: int, limit: int | None = None) -> int:
        """Return where the first whole chunk from a place on begins.

        The end of the file, or a limit, if there is no chunk before it. Chunks are the only records
        with a checksum: other bytes may only look like a record.
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
