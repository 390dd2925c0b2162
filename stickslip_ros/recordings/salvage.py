# SPDX-License-Identifier: Apache-2.0
"""Messages out of an MCAP file that is cut or damaged: everything that is whole, nothing else."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import IO

from mcap.opcode import Opcode
from mcap.records import Footer, Metadata

from stickslip_ros.recordings.channels import Channels
from stickslip_ros.recordings.compression import open_storage, unpack_beginning
from stickslip_ros.recordings.errors import BagError
from stickslip_ros.recordings.metadata import TopicDescription
from stickslip_ros.recordings.open_span import BagMessage
from stickslip_ros.recordings.record import (
    BROKEN,
    HEAD,
    LARGEST_PACKED,
    LONGEST_CHUNK_HEAD,
    MAGIC,
    MESSAGE_HEAD,
    PackedChunk,
    Place,
    body_at,
    largest_body,
    parse,
    places,
    reading,
    records_in,
)

_OPCODES = frozenset(int(opcode) for opcode in Opcode)
_FIRST_PRIVATE = 0x80
#: Those that hold what a bag is made of.
_USED = frozenset({Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.METADATA})
_COMPRESSIONS = ("", "lz4", "zstd")

# A chunk record: its opcode and a length of less than 128 MiB.
_CHUNK_START = re.compile(rb"\x06.{3}[\x00-\x07]\x00{4}", re.DOTALL)
_WINDOW = 1024 * 1024
_FOOTER_BYTES = HEAD.size + 20
#: Looking for the next chunk ends after so many places that only seemed to be one.
_MOST_FALSE_STARTS = 1000

Found = tuple[TopicDescription, BagMessage]
#: Yields what was found, returns the place in the file where to go on.
Step = Generator[Found, None, int]


class Salvage:
    """One pass over a file.

    :ivar dropped_bytes: how much of the file was of no use.
    :ivar metadata_text: the last metadata that rosbag2 left in the file, "" if none.
    :ivar looks_right: whether the file begins as an MCAP file or is empty.
    """

    def __init__(self, path: Path, on_bytes: Callable[[int], object]) -> None:
        """Open the file.

        :param on_bytes: called with the bytes gone through since it was called last.
        :raises BagError: the operating system does not let us read it, or it is no zstd file
            though its name says so.
        """
        self.dropped_bytes = 0
        self.metadata_text = ""
        self._on_bytes = on_bytes
        self._channels = Channels()
        with reading(path):
            self._stream: IO[bytes] = open_storage(path)
            self._size = os.fstat(self._stream.fileno()).st_size
            self.looks_right = self._stream.read(len(MAGIC)) == MAGIC or not self._size
        self._path = path

    def close(self) -> None:
        """Close the file."""
        self._stream.close()

    def first_compression(self) -> str:
        """Return the compression of the first chunk, "" if it has none or there is no chunk."""
        with contextlib.suppress(BagError), reading(self._path):
            for place in places(self._stream, len(MAGIC), self._size):
                if place.opcode == Opcode.CHUNK:
                    chunk = self._chunk_at(place.offset)
                    return chunk.compression if chunk and chunk.compression in _COMPRESSIONS else ""
        return ""

    def messages(self) -> Iterator[Found]:
        """Yield every message that is whole, in the order of the file."""
        # What stands in the index is known even if the chunk that told it first is lost.
        with contextlib.suppress(BagError), reading(self._path):
            self._learn_from_index()
        at = len(MAGIC) if self.looks_right else 0
        while at < self._size:
            before = at
            at = yield from self._record(at)
            self._on_bytes(at - before)

    def _learn_from_index(self) -> None:
        end = self._size - len(MAGIC) - _FOOTER_BYTES
        (place,) = places(self._stream, end, end + _FOOTER_BYTES)
        if place.opcode != Opcode.FOOTER:
            return
        start = parse(Footer, body_at(self._stream, place)).summary_start
        for place in places(self._stream, start, end if start else start):
            if place.opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._channels.learn(place.opcode, body_at(self._stream, place))

    def _record(self, at: int) -> Step:
        """Yield the messages of the record at a place; return where to go on."""
        place = self._place(at)
        if place is None:
            return self._go_on(at, self._next_chunk(at))
        if place.opcode == Opcode.CHUNK:
            return (yield from self._chunk(at))
        end = at + place.length
        if not self._plausible(end):
            return self._go_on(at, self._next_chunk(at))
        if place.opcode in _USED:
            records = self._read(at, place.length)
            yield from self._messages_in(records)
        return end

    def _chunk(self, at: int) -> Step:
        chunk = self._chunk_at(at)
        if chunk is None:
            return self._go_on(at, self._next_chunk(at + 1))
        end = at + HEAD.size + chunk.body_length
        records = _records_of(chunk)
        if records is not None:
            yield from self._messages_in(records)
            return end
        if chunk.cut and self._next_chunk(at + 1) == self._size:
            with contextlib.suppress(ValueError):
                records = unpack_beginning(chunk.data, chunk.compression, chunk.size)
                yield from self._messages_in(records[: chunk.size])
                return self._size
        elif not chunk.cut and self._plausible(end):
            return self._go_on(at, end)
        return self._go_on(at, self._next_chunk(at + 1))

    def _messages_in(self, records: bytes) -> Iterator[Found]:
        """Yield the messages of some records, up to the first that is not whole."""
        done = 0
        try:
            for opcode, start, end in records_in(records):
                if opcode == Opcode.MESSAGE:
                    channel, sequence, log_ns, publish_ns = MESSAGE_HEAD.unpack_from(records, start)
                    topic = self._channels.topics.get(channel)
                    if topic is None:
                        self.dropped_bytes += end - done
                    else:
                        data = records[start + MESSAGE_HEAD.size : end]
                        yield topic, BagMessage(topic.name, log_ns, publish_ns, sequence, data)
                elif opcode == Opcode.METADATA:
                    self._keep(parse(Metadata, records[start:end]))
                elif opcode:
                    self._channels.learn(opcode, records[start:end])
                else:  # zeros, as a disk leaves them after a power failure
                    break
                done = end
        except BROKEN:
            pass
        self.dropped_bytes += len(records) - done

    def _keep(self, record: Metadata) -> None:
        if record.name == "rosbag2":
            self.metadata_text = record.metadata.get("serialized_metadata", "")

    def _place(self, at: int) -> Place | None:
        """Return the record at a place; None if there cannot be one, whole or, a chunk, cut."""
        head = self._read(at, HEAD.size)
        if len(head) < HEAD.size:
            return None
        opcode, length = HEAD.unpack(head)
        known = opcode in _OPCODES or opcode >= _FIRST_PRIVATE
        whole = at + HEAD.size + length <= self._size and length <= self._largest(opcode)
        if opcode == Opcode.CHUNK or (known and whole):
            return Place(opcode, at, HEAD.size + length)
        return None

    def _largest(self, opcode: int) -> int:
        return largest_body(opcode) if opcode in _USED else self._size

    def _plausible(self, at: int) -> bool:
        """Return whether the file can go on, or end, at a place."""
        left = self._size - at
        return left == 0 or self._is_end(at) or self._place(at) is not None

    def _is_end(self, at: int) -> bool:
        return self._size - at == len(MAGIC) and self._read(at, len(MAGIC)) == MAGIC

    def _chunk_at(self, at: int) -> PackedChunk | None:
        """Return the chunk at a place whatever its record says of its length; None if none is."""
        at += HEAD.size
        try:
            told = PackedChunk.read(self._read(at, LONGEST_CHUNK_HEAD))
            if told.packed > LARGEST_PACKED:
                return None
            return PackedChunk.read(self._read(at, told.body_length))
        except BROKEN:
            return None

    def _next_chunk(self, at: int) -> int:
        """Return where the first whole chunk from a place on begins; the size of the file if none.

        Chunks are the only records with a checksum: what else looks like a record need not be one.
        """
        false_starts = 0
        while at < self._size and false_starts < _MOST_FALSE_STARTS:
            window = self._read(at, _WINDOW)
            for match in _CHUNK_START.finditer(window):
                chunk = self._chunk_at(at + match.start())
                if chunk and chunk.compression in _COMPRESSIONS and not chunk.cut and chunk.packed:
                    if _records_of(chunk) is not None:
                        return at + match.start()
                    false_starts += 1
            if len(window) < _WINDOW:
                break
            at += _WINDOW - HEAD.size
        return self._size

    def _go_on(self, at: int, next_place: int) -> int:
        """Drop what lies between two places, but for the end mark of a file."""
        if not self._is_end(at):
            self.dropped_bytes += next_place - at
        return next_place

    def _read(self, at: int, length: int) -> bytes:
        self._stream.seek(at)
        return self._stream.read(length)


def _records_of(chunk: PackedChunk) -> bytes | None:
    try:
        return chunk.unpacked()
    except BROKEN:
        return None
