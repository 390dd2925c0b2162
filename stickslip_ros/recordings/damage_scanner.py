# SPDX-License-Identifier: Apache-2.0
"""Scans an MCAP file that is cut or damaged.

Whole chunks are kept: they are the only records with a checksum. Others are kept where they parse
and fit between their neighbours. The scan goes on behind a damaged chunk whose end is known, with
the next whole chunk after any other damage.
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
        chunk = self._chunk_at(at)
        records = self._records_of(chunk) if chunk else None
        if chunk and records is not None:
            following = at + HEAD.size + chunk.body_length  # whatever the length of the record says
            block = self._once(Block(Place(Opcode.CHUNK, at, following), records, chunk), chunk)
        elif not chunk and self._is_record(at):
            block, following = super()._block(at, end)
        else:
            block, following = None, at + HEAD.size + chunk.body_length if chunk else at
            if not chunk or chunk.cut or not self._begins(following):
                following = self._next_chunk(at + 1, end)
            if chunk and chunk.cut and following == end:
                block = self._cut(at, chunk)
            elif not self._is_end(at):
                self.damage.dropped_bytes += following - at
        self._on_bytes(following - at)
        return block, following

    def _is_record(self, at: int) -> bool:
        """Return whether a record without a checksum is at a place, and does not just look so.

        Another record, or a part of one, or the end of the file has to follow; and there must not
        be a chunk inside, as there is when its length is wrong, unless it is an attachment.
        """
        try:
            opcode, _, following = place_at(self.stream, at, self.size)
        except BROKEN:
            return False
        if opcode == Opcode.CHUNK or not _known(opcode) or not self._begins(following):
            return False
        hides = opcode != Opcode.ATTACHMENT and self._next_chunk(at + 1, following) < following
        return not hides

    def _begins(self, at: int) -> bool:
        """Return whether a record, also a cut one, or the end of the file may be at a place."""
        head = self.read(at, HEAD.size)
        if len(head) < HEAD.size:
            return True
        opcode, length = HEAD.unpack(head)
        fits = length <= self.size + LARGEST_PACKED - at
        return opcode == Opcode.CHUNK or (_known(opcode) and fits)

    def _once(self, block: Block, chunk: PackedChunk) -> Block | None:
        """Return a chunk that was not there before; times, which damage alters, do not count."""
        mark = chunk.size, chunk.crc
        if chunk.crc and mark in self._seen:
            self.damage.find(f"holds a chunk of {chunk.size} bytes twice; it is taken once")
            self.damage.dropped_bytes += block.place.end - block.place.start
            return None
        self._seen.add(mark)
        return block

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
            if chunk.crc or all(_known(opcode) for opcode, _, _ in records_in(records)):
                return records
        return None

    def _next_chunk(self, at: int, limit: int) -> int:
        """Return where the first whole chunk from a place on begins, a limit if there is none."""
        false_starts = 0
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


def _known(opcode: int) -> bool:
    return opcode in _OPCODES or opcode >= _FIRST_PRIVATE
