# SPDX-License-Identifier: Apache-2.0
"""Messages out of an MCAP file that is cut or damaged: everything that is whole, nothing else.

Checksums decide. What a chunk with a right checksum says of topics counts; the index counts if its
own checksum is right; what no checksum protects is kept where nothing contradicts it, and reported.
"""

from __future__ import annotations

import contextlib
import os
import re
import zlib
from collections.abc import Callable, Generator, Iterator
from functools import lru_cache
from pathlib import Path
from typing import IO, Any

from mcap.opcode import Opcode
from mcap.records import Footer, Metadata, Statistics

from stickslip_ros.recordings.cdr import decoder_for
from stickslip_ros.recordings.errors import BagError
from stickslip_ros.recordings.mcap_reader import BagMessage, Channels
from stickslip_ros.recordings.mcap_records import (
    BROKEN,
    HEAD,
    LARGEST_PACKED,
    LONGEST_CHUNK_HEAD,
    MAGIC,
    MESSAGE_HEAD,
    PackedChunk,
    Place,
    UnpackError,
    body_at,
    largest_body,
    open_storage,
    parse,
    places,
    reading,
    records_in,
    unpack_beginning,
    unpack_message,
)
from stickslip_ros.recordings.metadata import TopicDescription

_OPCODES = frozenset(int(opcode) for opcode in Opcode)
_FIRST_PRIVATE = 0x80
#: Those that hold what a bag is made of.
_USED = frozenset({Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.METADATA})
_COMPRESSIONS = ("", "lz4", "zstd")

# A chunk record: its opcode and a length of less than 128 MiB.
_CHUNK_START = re.compile(rb"\x06.{3}[\x00-\x07]\x00{4}", re.DOTALL)
_WINDOW = 1024 * 1024
_FOOTER_BYTES = HEAD.size + 20
_CRC_BYTES = 4
_LARGEST_INDEX = 256 * 1024 * 1024
#: Looking for the next chunk ends after so many places that only seemed to be one.
_MOST_FALSE_STARTS = 1000

Found = tuple[TopicDescription, BagMessage]
#: Yields what was found, returns the place in the file where to go on.
Step = Generator[Found, None, int]


class DamagedScanner:
    """One pass over a file; what it says of the file is complete when :meth:`messages` has ended.

    :ivar kept: messages found.
    :ivar dropped_bytes: how much of the file was of no use.
    :ivar findings: what is wrong with the file, a sentence each; empty if it is whole.
    :ivar unprotected: messages found that no checksum protects, or not the name of their topic.
    :ivar metadata_text: the last metadata that rosbag2 left in the file, "" if none.
    :ivar looks_right: whether the file begins as an MCAP file or is empty.
    """

    def __init__(
        self, path: Path, on_bytes: Callable[[int], object], packed_messages: bool = False
    ) -> None:
        """Open the file.

        :param on_bytes: called with the bytes gone through since it was called last.
        :param packed_messages: whether rosbag2 packed each message with zstd by itself.
        :raises BagError: the operating system does not let us read it, or it is no zstd file
            though its name says so.
        """
        self.kept = self.dropped_bytes = self.unprotected = 0
        self.findings: list[str] = []
        self.metadata_text = ""
        self._path = path
        self._on_bytes = on_bytes
        self._packed_messages = packed_messages
        self._sure = Channels()  # of chunks and an index with the right checksum
        self._told = Channels()  # of what no checksum protects
        self._chunks: set[int] = set()  # seen, to notice one that damage copied
        self._statistics: Statistics | None = None
        with reading(path):
            self._stream: IO[bytes]
            self._stream, whole = open_storage(path)
            self._size = os.fstat(self._stream.fileno()).st_size
            self.looks_right = self._stream.read(len(MAGIC)) == MAGIC or not self._size
        if not path.stat().st_size:
            self._find("is empty: 0 bytes")
        elif not whole:
            self._find(f"is cut: its zstd data ends early, {self._size} bytes could be unpacked")
        elif not self.looks_right:
            self._find("does not begin as an MCAP file does")

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
        if not self._size:
            return
        finished = False
        # What stands in the index is known even if the chunk with its first description is lost.
        with contextlib.suppress(*BROKEN):
            finished = self._learn_from_index()
        at = len(MAGIC) if self.looks_right else 0
        while at < self._size:
            before = at
            at = yield from self._record(at)
            self._on_bytes(at - before)
        self._sum_up(finished)

    def _find(self, what: str) -> None:
        self.findings.append(f"{self._path.name} {what}")

    def _sum_up(self, finished: bool) -> None:
        if not finished:
            self._find("has no end: what its writer had not written yet is missing")
        if self.dropped_bytes:
            self._find(f"is damaged: {self.dropped_bytes} bytes were left out")
        counted = self._statistics.message_count if self._statistics else self.kept
        if counted != self.kept:
            self._find(f"had {counted} messages by its index, {self.kept} were found")
        if self.unprotected and self.findings:
            self._find(f"has no checksum for {self.unprotected} of these messages or their topics")

    # -- the index

    def _learn_from_index(self) -> bool:
        """Learn topics and counts; return whether the file has an end."""
        end = self._size - len(MAGIC) - _FOOTER_BYTES
        if not self._is_end(self._size - len(MAGIC)) or end < len(MAGIC):
            return False
        (place,) = places(self._stream, end, end + _FOOTER_BYTES)
        if place.opcode != Opcode.FOOTER:
            return False
        footer = parse(Footer, body_at(self._stream, place))
        start = footer.summary_start
        if not start:
            return True
        index = self._read(start, min(end - start, _LARGEST_INDEX)) if start < end else b""
        ending = self._read(end, _FOOTER_BYTES - _CRC_BYTES)
        if footer.summary_crc and zlib.crc32(ending, zlib.crc32(index)) != footer.summary_crc:
            self._find("has a damaged index: its checksum is wrong, so nothing in it is believed")
            return True
        channels = self._sure if footer.summary_crc else self._told
        for opcode, first, last in records_in(index):
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                channels.learn(opcode, index[first:last])
            elif opcode == Opcode.STATISTICS:
                self._statistics = parse(Statistics, index[first:last])
        return True

    # -- record by record

    def _record(self, at: int) -> Step:
        """Yield the messages of the record at a place; return where to go on."""
        place = self._place(at)
        if place is None:
            return self._go_on(at, self._next_chunk(at))
        if place.opcode == Opcode.CHUNK:
            return (yield from self._chunk(at))
        end = at + place.length
        if not self._plausible(end) or self._hides_a_chunk(place):
            return self._go_on(at, self._next_chunk(at))
        if place.opcode in _USED:
            yield from self._messages_in(self._read(at, place.length), None)
        return end

    def _chunk(self, at: int) -> Step:
        chunk = self._chunk_at(at)
        if chunk is None:
            return self._go_on(at, self._next_chunk(at + 1))
        end = at + HEAD.size + chunk.body_length
        records = _records_of(chunk)
        if records is not None:
            mark = hash((chunk.size, chunk.crc))  # no checksum protects its times
            if chunk.crc and mark in self._chunks:
                self._find(f"holds a chunk of {chunk.size} bytes twice; it is taken once")
                return self._go_on(at, end)
            self._chunks.add(mark)
            yield from self._messages_in(records, chunk)
            return end
        if chunk.cut and self._next_chunk(at + 1) == self._size:
            records = b""
            with contextlib.suppress(ValueError):
                records = unpack_beginning(chunk.data, chunk.compression, chunk.size)[: chunk.size]
            self._find(f"is cut inside a chunk: {len(records)} of its {chunk.size} bytes are there")
            self.dropped_bytes += 0 if records else len(chunk.data)
            yield from self._messages_in(records, chunk)
            return self._size
        if not chunk.cut and self._plausible(end):
            return self._go_on(at, end)
        return self._go_on(at, self._next_chunk(at + 1))

    def _messages_in(self, records: bytes, chunk: PackedChunk | None) -> Iterator[Found]:
        """Yield the messages of some records, up to the first that is not whole.

        :param chunk: that they are from.
        """
        sure = chunk is not None and not chunk.cut and bool(chunk.crc)
        done = 0
        with contextlib.suppress(*BROKEN):
            for opcode, start, end in records_in(records):
                if opcode == Opcode.MESSAGE:
                    found = self._message(records, start, end, chunk, sure)
                    if found is None:
                        self.dropped_bytes += end - done
                    else:
                        yield found
                elif opcode == Opcode.METADATA:
                    self._keep(parse(Metadata, records[start:end]))
                elif opcode:
                    (self._sure if sure else self._told).learn(opcode, records[start:end])
                else:  # zeros, as a disk leaves them after a power failure
                    break
                done = end
        self.dropped_bytes += len(records) - done

    def _message(
        self, records: bytes, start: int, end: int, chunk: PackedChunk | None, sure: bool
    ) -> Found | None:
        """Return and count a message, None if it belongs to no topic or is not one."""
        channel, sequence, log_ns, publish_ns = MESSAGE_HEAD.unpack_from(records, start)
        if start + MESSAGE_HEAD.size > end:
            return None
        topic = self._sure.topics.get(channel) or self._told.topics.get(channel)
        if topic is None:
            return None
        data = records[start + MESSAGE_HEAD.size : end]
        if self._packed_messages:
            try:
                data = unpack_message(data)
            except UnpackError:
                return None
        if not sure and chunk is not None and not chunk.start_ns <= log_ns <= chunk.end_ns:
            return None
        if not sure and not _fits(topic, data):
            return None
        self.kept += 1
        self.unprotected += not (sure and channel in self._sure.topics)
        return topic, BagMessage(topic.name, log_ns, publish_ns, sequence, data)

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
        if at == self._size or self._is_end(at) or self._place(at) is not None:
            return True
        head = self._read(at, HEAD.size)
        if head[0] not in _OPCODES:
            return False
        if len(head) < HEAD.size:
            return True  # the head of a record that was cut
        opcode, length = HEAD.unpack(head)
        return bool(self._size - at - HEAD.size < length <= largest_body(opcode))  # cut itself

    def _hides_a_chunk(self, place: Place) -> bool:
        """Return whether a record has a whole chunk inside: then its length is wrong.

        An attachment may be an MCAP file of its own.
        """
        end = place.offset + place.length
        return place.opcode != Opcode.ATTACHMENT and self._next_chunk(place.offset + 1, end) < end

    def _is_end(self, at: int) -> bool:
        return self._size - at == len(MAGIC) and self._read(at, len(MAGIC)) == MAGIC

    def _chunk_at(self, at: int) -> PackedChunk | None:
        """Return the chunk at a place whatever its record says of its length; None if none is."""
        at += HEAD.size
        try:
            head = PackedChunk.read(self._read(at, LONGEST_CHUNK_HEAD))
            if head.packed > LARGEST_PACKED:
                return None
            return PackedChunk.read(self._read(at, head.body_length))
        except BROKEN:
            return None

    def _next_chunk(self, at: int, limit: int | None = None) -> int:
        """Return where the first whole chunk from a place on begins.

        The end of the file, or a limit, if there is none before it.

        Chunks are the only records with a checksum: what else looks like a record need not be one.
        """
        false_starts = 0
        limit = self._size if limit is None else limit
        while at < limit and false_starts < _MOST_FALSE_STARTS:
            window = self._read(at, min(_WINDOW, limit - at))
            for match in _CHUNK_START.finditer(window):
                chunk = self._chunk_at(at + match.start())
                if chunk and chunk.compression in _COMPRESSIONS and not chunk.cut and chunk.packed:
                    if _records_of(chunk) is not None:
                        return at + match.start()
                    false_starts += 1
            if len(window) < _WINDOW:
                break
            at += _WINDOW - HEAD.size
        return limit

    def _go_on(self, at: int, next_place: int) -> int:
        """Drop what lies between two places, but for the end mark of a file."""
        if not self._is_end(at):
            self.dropped_bytes += next_place - at
        return next_place

    def _read(self, at: int, length: int) -> bytes:
        self._stream.seek(at)
        return self._stream.read(length)


def _records_of(chunk: PackedChunk) -> bytes | None:
    """Return the records in a chunk; None if they are not what was written.

    Without a checksum, they have to fill the chunk, one after the other.
    """
    with contextlib.suppress(*BROKEN):
        records = chunk.unpacked()
        if chunk.crc or all(opcode in _OPCODES for opcode, _, _ in records_in(records)):
            return records
    return None


def _fits(topic: TopicDescription, data: bytes) -> bool:
    """Return whether data can be a message on a topic, as far as that can be known."""
    decode = _decoder(topic)
    if decode is None:
        return True
    try:
        decode(data)
    except BagError:
        return False
    return True


@lru_cache(maxsize=256)
def _decoder(topic: TopicDescription) -> Callable[[bytes], Any] | None:
    if "wstring" in topic.schema:  # which the decoder does not know
        return None
    try:
        return decoder_for(topic)
    except BagError:  # of a format that is not known here
        return None
