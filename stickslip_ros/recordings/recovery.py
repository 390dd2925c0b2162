# SPDX-License-Identifier: Apache-2.0
"""A good bag out of one whose writer was killed, or that was damaged since.

Everything that is whole is kept, nothing else: chunks with a right checksum, which are the only
records that have one, and records outside of chunks that parse and fit between their neighbours.
After damage the scan goes on with the next whole chunk.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any

from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Statistics

from stickslip_ros.base.errors import printable
from stickslip_ros.base.files import whole_folder
from stickslip_ros.recordings.errors import BROKEN, BagError, reading, short
from stickslip_ros.recordings.mcap_files import (
    HEAD,
    LARGEST_CHUNK,
    LARGEST_OTHER,
    LARGEST_PACKED,
    MAGIC,
    BagMessage,
    Storage,
    parse,
    records_from,
    unpack,
    unpacked,
)
from stickslip_ros.recordings.metadata import (
    METADATA_FILE,
    StoredMetadata,
    TopicDescription,
    differences,
    parse_metadata,
    storage_files,
    storage_of,
    stored_metadata,
)
from stickslip_ros.recordings.writer import BagWriter

#: Records outside of chunks that hold what a bag is made of
_USED = frozenset({Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.METADATA})
_OPCODES = frozenset(int(opcode) for opcode in Opcode)
_FIRST_PRIVATE = 0x80  # opcodes from here on are anybody's
_PIECE = 1024 * 1024  # bytes of the file that are read and searched together
# A chunk record: its opcode and a length of less than 128 MiB.
_CHUNK_START = re.compile(rb"\x06(?=.{3}[\x00-\x07]\x00{4})", re.DOTALL)
# What looks like a chunk and is none may be read again and again, one inside the other: so many
# times the size of the file, and so many bytes besides. One costs as much as some bytes at least.
_FALSE_FACTOR, _FALSE_BYTES, _FALSE_LEAST = 4, 256 * 1024 * 1024, 4096


@dataclass(frozen=True)
class Recovered:
    """Result of a recovery."""

    folder: Path  #: of the new bag
    messages: int  #: in it
    dropped_bytes: int  #: of the old files, left out
    unprotected: int  #: messages in it that no checksum protected, or not the name of their topic
    #: what was wrong with the old bag, a sentence each; none if it was whole
    findings: tuple[str, ...]


def bytes_of(bag: Path) -> int:
    """Return the size of the storage files of a bag.

    Raises BagError: there are none.
    """
    with reading(bag):
        return sum(file.stat().st_size for file in storage_files(bag.expanduser().absolute()))


def recover(
    bag: Path | str,
    out: Path | str | None = None,
    on_bytes: Callable[[int], object] = lambda count: None,
) -> Recovered:
    """Write the undamaged parts of a bag into a new one; the old bag stays unchanged.

    bag: a folder or an MCAP file, finished or not.
    out: folder of the new bag, which must not exist; if None, that of the old one with _recovered.
    on_bytes: called with the bytes gone through since it was called last.
    Raises BagError: there is nothing to recover, or the disk takes no more; there is no new
    folder then.
    Raises WriteError: the new folder exists or cannot be made.
    """
    bag = Path(bag).expanduser().absolute()
    stem = bag.name if bag.is_dir() else bag.name.partition(".mcap")[0]
    out = Path(out or bag.with_name(f"{stem}_recovered")).expanduser().absolute()
    with reading(bag):
        files = storage_files(bag)
        kind = storage_of(files[0])
    if kind == "sqlite3":
        raise BagError(
            f"{files[0]} is a SQLite file, of which SQLite itself takes what is whole: "
            f"sqlite3 {files[0].name} .recover | sqlite3 NEW.db3"
        )
    with whole_folder(out) as folder, reading(bag):
        return replace(_rewrite(bag, files, folder, on_bytes), folder=out)


def _rewrite(
    bag: Path, files: list[Path], new: Path, on_bytes: Callable[[int], object]
) -> Recovered:
    findings: list[str] = []
    stored = None
    try:
        stored = stored_metadata(bag)
        if stored is None and bag.is_dir():
            there = (bag / METADATA_FILE).exists()
            findings.append(f"{METADATA_FILE} is {'too long to be read' if there else 'missing'}")
    except BagError as error:
        findings.append(f"{METADATA_FILE} is broken: {error}")
    packed = stored is not None and stored.compression_mode == "message"
    with contextlib.ExitStack() as opened:
        sources: list[_DamagedFile] = []
        for file in files:
            sources.append(_DamagedFile(file, findings, packed))
            opened.callback(sources[-1].stream.close)
        topics: dict[str, TopicDescription] = {}
        _, _, first = sources[0].next_chunk(0, sources[0].size)
        packing = (first and first.compression) or "none"
        writer = opened.enter_context(BagWriter(new, compression=packing))
        for source in sources:
            writer.split()
            for name, log_ns, publish_ns, number, data in source.messages(topics, on_bytes):
                if name not in writer.counts:
                    writer.add_topic(stored.completed(topics[name]) if stored else topics[name])
                writer.write(name, data, log_ns=log_ns, publish_ns=publish_ns, sequence=number)
        if not writer.message_count and not any(
            source.begins_right or not source.size for source in sources
        ):
            raise BagError(f"there is no part of a recording in {bag}; name the bag you mean")
        if stored:
            findings += differences(stored, files, "mcap", writer.message_count)
        for source in reversed(sources):
            with contextlib.suppress(ValueError):
                stored = stored or parse_metadata(source.metadata_text)
        stored = stored or StoredMetadata()
        writer.custom_data.update(stored.custom_data)
        writer.ros_distro = stored.ros_distro or writer.ros_distro
        for topic in stored.topics.values():
            if topic.name not in writer.counts:
                writer.add_topic(topic)
        writer.close()
    dropped = sum(source.dropped_bytes for source in sources)
    unprotected = sum(source.unprotected for source in sources)
    said = tuple(map(printable, findings))
    return Recovered(new, writer.message_count, dropped, unprotected, said)


class _DamagedFile(Storage):
    """A file that may be cut or damaged."""

    def __init__(self, path: Path, findings: list[str], packed_messages: bool) -> None:
        """Open it; findings takes what is wrong with it, a sentence each."""
        super().__init__(path)
        self.dropped_bytes = 0  #: how much of it was of no use
        #: messages found that no checksum protects, or not the name of their topic
        self.unprotected = 0
        self._findings, self._packed_messages = findings, packed_messages
        self._doubtful: set[int] = set()  # channels whose names no checksum protects
        self._window, self._window_at = b"", 0
        self._false_left = _FALSE_FACTOR * self.size + _FALSE_BYTES
        if self.fault:
            self._find(self.fault)

    def _find(self, what: str) -> None:
        self._findings.append(f"{self.path.name} {what}")

    def _read(self, at: int, length: int) -> bytes:
        """Return a part of the file, shorter at its end."""
        start = at - self._window_at
        if start < 0 or start + length > len(self._window):
            self.stream.seek(at)
            self._window, self._window_at, start = self.stream.read(max(length, _PIECE)), at, 0
        return self._window[start : start + length]

    def messages(
        self, topics: dict[str, TopicDescription], on_bytes: Callable[[int], object]
    ) -> Iterator[BagMessage]:
        """Yield every message that is whole, in the order of the file.

        topics: by name; takes those that are found. on_bytes: of `recover`.
        """
        if not self.size:
            return
        # What stands in the index is known even if the chunk with its first description is lost.
        statistics = self._learn_from_index()
        kept = done = 0
        for record, end in self._records():
            on_bytes(end - done)
            done = end
            protected = isinstance(record, Chunk) and bool(record.uncompressed_crc)
            for one in self._unpacked(record):
                if not isinstance(one, Message):
                    self._learn(one, protected)
                elif message := self._message(one, topics):
                    kept += 1
                    self.unprotected += not protected or one.channel_id in self._doubtful
                    yield message
                else:
                    self.dropped_bytes += len(one.data)
        on_bytes(self.size - done)
        if self.dropped_bytes:
            self._find(f"is damaged: {self.dropped_bytes} bytes were left out")
        if statistics and statistics.message_count != kept:
            self._find(f"had {statistics.message_count} messages by its index, {kept} were found")
        if self.unprotected and self._findings:
            self._find(f"has no checksum for {self.unprotected} of these messages or their topics")

    def _learn_from_index(self) -> Statistics | None:
        """Learn topics; return the counts that the index holds, None without a checksum."""
        try:
            footer, index = self.index()
        except BROKEN:
            self._find("has no end: what its writer had not written yet is missing")
            return None
        statistics = None
        try:
            for record in index if footer.summary_crc else ():
                if isinstance(record, Statistics):
                    statistics = record
                self.learn(record)
        except BROKEN as error:
            self._find(f"has a damaged index, which is not believed: {short(error)}")
            return None
        return statistics

    def _learn(self, record: Any, protected: bool) -> None:
        """Learn what a record says; one that is broken is passed over."""
        known = len(self.topics)
        try:
            self.learn(record)
        except BROKEN:
            self.dropped_bytes += HEAD.size
        if len(self.topics) > known and not protected and isinstance(record, Channel):
            self._doubtful.add(record.id)

    def _unpacked(self, record: Any) -> Iterator[Any]:
        """Yield the records in a chunk up to the first that is broken, or the record itself."""
        if not isinstance(record, Chunk):
            yield record
            return
        at, size = 0, len(record.data)
        try:
            for one, after in records_from(BytesIO(record.data), 0, size):
                yield one
                at = after
        except BROKEN:
            self.dropped_bytes += size - at

    def _message(self, found: Message, topics: dict[str, TopicDescription]) -> BagMessage | None:
        """Return a message; None if its topic is not known, or was of another type before."""
        topic, data = self.topics.get(found.channel_id), found.data
        if topic is None or topics.setdefault(topic.name, topic).type != topic.type:
            return None
        try:
            if self._packed_messages:
                data = unpack(data, "zstd", LARGEST_CHUNK, self.allowance)
        except ValueError:
            return None
        return BagMessage(topic.name, found.log_time, found.publish_time, found.sequence, data)

    # -- finding records

    def _records(self) -> Iterator[tuple[Any, int]]:
        """Yield whole chunks, unpacked, and used records outside of them, and where each ends."""
        at = len(MAGIC) if self.begins_right else 0
        closed = self._read(max(0, self.size - len(MAGIC)), len(MAGIC)) == MAGIC
        end = self.size - closed * len(MAGIC)
        seen: set[tuple[int, int]] = set()  # size and CRC of chunks; damage copies some
        start, behind, chunk = self.next_chunk(at, end)
        while at < end:
            if at < start:
                try:
                    record, after = self._loose_record(at, start, end)
                except BROKEN:
                    self.dropped_bytes += start - at
                    record, after = None, start
            elif chunk:
                mark, after, record = (len(chunk.data), chunk.uncompressed_crc), behind, chunk
                if mark in seen and mark[1]:
                    self.dropped_bytes += after - at
                    record = None
                seen.add(mark)
            if record is not None:
                yield record, after
            at = after
            if at > start:
                start, behind, chunk = self.next_chunk(at, end)

    def next_chunk(self, at: int, end: int) -> tuple[int, int, Chunk | None]:
        """Return begin and end of the first whole chunk from a place on, and it, with its records
        unpacked; the end of all if there is none."""
        while at + HEAD.size <= end and self._false_left >= 0:
            self._read(at, HEAD.size)
            found = _CHUNK_START.search(self._window, at - self._window_at)
            if not found:
                at = self._window_at + len(self._window) - HEAD.size + 1
                continue
            start = after = self._window_at + found.start()
            at = start + 1
            try:
                _, after = self._head_at(start, end)
                if after - start > LARGEST_PACKED:
                    raise ValueError("a chunk is too large")
                body = self._read(start + HEAD.size, after - start - HEAD.size)
                chunk: Chunk = parse(Opcode.CHUNK, body)
                if data := unpacked(chunk, self.allowance):
                    return start, after, replace(chunk, data=data)
            except BROKEN:
                self._false_left -= min(after - start, LARGEST_PACKED) + _FALSE_LEAST
        return end, end, None

    def _head_at(self, at: int, end: int) -> tuple[int, int]:
        """Return opcode and end of the record at a place; ``BROKEN`` if there is none."""
        opcode, length = HEAD.unpack(self._read(at, HEAD.size))
        if length > end - at - HEAD.size:
            raise ValueError("a record is longer than what is left")
        return opcode, at + HEAD.size + length

    def _loose_record(self, at: int, limit: int, end: int) -> tuple[Any, int]:
        """Return a record outside of chunks, None if it is of no use, and where it ends.

        It has no checksum: it has to end where the next chunk begins, a limit, or another record,
        or a part of one, has to follow. An attachment may hold what looks like chunks. ``BROKEN``
        if it is none.
        """
        opcode, after = self._head_at(
            at, limit if self._read(at, 1)[0] != Opcode.ATTACHMENT else end
        )
        following, length = opcode, 0
        if after != limit and len(head := self._read(after, HEAD.size)) == HEAD.size:
            following, length = HEAD.unpack(head)
        known = all(one in _OPCODES or one >= _FIRST_PRIVATE for one in (opcode, following))
        if opcode == Opcode.CHUNK or not known or length > self.size + LARGEST_PACKED - after:
            raise ValueError(f"there is no record at byte {at}")
        if opcode not in _USED or after - at > LARGEST_OTHER:
            return None, after
        return parse(opcode, self._read(at + HEAD.size, after - at - HEAD.size)), after
