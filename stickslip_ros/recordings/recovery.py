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
from itertools import chain
from pathlib import Path
from typing import Any

from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Statistics

from stickslip_ros.base.errors import printable
from stickslip_ros.base.files import whole_folder
from stickslip_ros.recordings.errors import BROKEN, BagError, reading, short
from stickslip_ros.recordings.mcap_files import (
    HEAD,
    LARGEST_PACKED,
    MAGIC,
    BagMessage,
    Channels,
    Storage,
    index_of,
    parse,
    records_from,
    unpack_message,
    unpacked,
)
from stickslip_ros.recordings.metadata import (
    METADATA_FILE,
    StoredMetadata,
    TopicDescription,
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
_LARGEST_OTHER = 1024 * 1024  # bytes of a record outside of chunks that is used
_PIECE = 1024 * 1024  # bytes of the file that are read and searched together
# A chunk record: its opcode and a length of less than 128 MiB; and its least bytes.
_CHUNK_START = re.compile(rb"\x06.{3}[\x00-\x07]\x00{4}", re.DOTALL)
_SMALLEST_CHUNK = 49
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


def recovered_name(bag: Path) -> Path:
    """Return the default folder of a recovered bag."""
    bag = bag.expanduser().absolute()
    stem = bag.name if bag.is_dir() else re.split(r"\.mcap", bag.name)[0]
    return bag.with_name(f"{stem}_recovered")


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
    out: folder of the new bag, which must not exist; :func:`recovered_name` if None.
    on_bytes: called with the bytes gone through since it was called last.
    Raises BagError: there is nothing to recover, or the disk takes no more; there is no new
    folder then.
    Raises WriteError: the new folder exists or cannot be made.
    """
    bag = Path(bag).expanduser().absolute()
    out = Path(out).expanduser().absolute() if out else recovered_name(bag)
    with reading(bag):
        files = storage_files(bag)
        kinds = [storage_of(file) for file in files]
    if kinds[0] == "sqlite3":
        raise BagError(
            f"{files[0]} is a SQLite file, of which SQLite itself takes what is whole: "
            f"sqlite3 {files[0].name} .recover | sqlite3 NEW.db3"
        )
    with whole_folder(out) as folder, reading(bag):
        found = _rewrite(bag, files, folder, on_bytes)
    return replace(found, folder=out)


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
        found = ((one, source) for source in sources for one in source.messages(topics, on_bytes))
        first = next(found, None)  # the chunks are packed as the first one was
        writer = opened.enter_context(BagWriter(new, compression=sources[0].compression or "none"))
        latest = sources[0]
        for message, source in chain([first] if first else [], found):
            name, log_ns, publish_ns, number, data = message
            if source is not latest:
                writer.split()
                latest = source
            if not writer.has_topic(name):
                writer.add_topic(stored.completed(topics[name]) if stored else topics[name])
            writer.write(name, data, log_ns=log_ns, publish_ns=publish_ns, sequence=number)
        if not writer.message_count and not any(
            source.begins_right or not source.size for source in sources
        ):
            raise BagError(f"there is no part of a recording in {bag}; name the bag you mean")
        if stored:
            findings += _differences(stored, files, writer.message_count)
        for text in [source.channels.metadata_text for source in reversed(sources)]:
            with contextlib.suppress(ValueError):
                stored = stored or (parse_metadata(text) if text else None)
        stored = stored or StoredMetadata()
        writer.custom_data.update(stored.custom_data)
        writer.ros_distro = stored.ros_distro or writer.ros_distro
        for topic in stored.topics:
            if not writer.has_topic(topic.name):
                writer.add_topic(topic)
        writer.close()
    dropped = sum(source.dropped_bytes for source in sources)
    unprotected = sum(source.unprotected for source in sources)
    said = tuple(map(printable, findings))
    return Recovered(new, writer.message_count, dropped, unprotected, said)


class _DamagedFile:
    """A file that may be cut or damaged."""

    def __init__(self, path: Path, findings: list[str], packed_messages: bool) -> None:
        """Open it; findings takes what is wrong with it, a sentence each."""
        self.dropped_bytes = 0  #: how much of it was of no use
        #: messages found that no checksum protects, or not the name of their topic
        self.unprotected = 0
        self.compression = ""  #: of its first whole chunk
        self.channels = Channels()  #: the topics and metadata read so far
        self._name, self._findings, self._packed_messages = path.name, findings, packed_messages
        self._doubtful: set[int] = set()  # channels whose names no checksum protects
        self._window, self._window_at = b"", 0
        storage = Storage(path)
        self.stream, self.size, self._allowance = storage.stream, storage.size, storage.allowance
        self.begins_right = storage.begins_right
        self._false_left = _FALSE_FACTOR * self.size + _FALSE_BYTES
        if storage.fault:
            self._find(storage.fault)

    def _find(self, what: str) -> None:
        self._findings.append(f"{self._name} {what}")

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
            footer, index = index_of(self.stream, self.size)
        except BROKEN:
            self._find("has no end: what its writer had not written yet is missing")
            return None
        statistics = None
        try:
            for record in index if footer.summary_crc else ():
                if isinstance(record, Statistics):
                    statistics = record
                self.channels.learn(record)
        except BROKEN as error:
            self._find(f"has a damaged index, which is not believed: {short(error)}")
            return None
        return statistics

    def _learn(self, record: Any, protected: bool) -> None:
        """Learn what a record says; one that is broken is passed over."""
        known = len(self.channels.topics)
        try:
            self.channels.learn(record)
        except BROKEN:
            self.dropped_bytes += HEAD.size
        if len(self.channels.topics) > known and not protected and isinstance(record, Channel):
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
        topic, data = self.channels.topics.get(found.channel_id), found.data
        if topic is None or topics.setdefault(topic.name, topic).type != topic.type:
            return None
        try:
            data = unpack_message(data, self._allowance) if self._packed_messages else data
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
        while at < end:
            try:
                opcode, after = self._head_at(at, end)
                record = None
                if opcode == Opcode.CHUNK:
                    record = self._chunk_at(at, after)
                    mark = len(record.data), record.uncompressed_crc
                    if mark in seen and mark[1]:
                        raise ValueError("it holds a chunk twice")
                    seen.add(mark)
                elif not self._is_record(opcode, at, after):
                    raise ValueError(f"there is no record at byte {at}")
                elif opcode in _USED and after - at <= _LARGEST_OTHER:
                    record = parse(opcode, self._read(at + HEAD.size, after - at - HEAD.size))
            except BROKEN:
                after = self._next_chunk(at + 1, end)
                self.dropped_bytes += after - at
            else:
                if record is not None:
                    yield record, after
            at = after

    def _head_at(self, at: int, end: int) -> tuple[int, int]:
        """Return opcode and end of the record at a place; ``BROKEN`` if there is none."""
        opcode, length = HEAD.unpack(self._read(at, HEAD.size))
        if length > end - at - HEAD.size:
            raise ValueError("a record is longer than what is left")
        return opcode, at + HEAD.size + length

    def _chunk_at(self, at: int, end: int) -> Chunk:
        """Return a chunk with its records unpacked; ``BROKEN`` if it is not whole."""
        if end - at > LARGEST_PACKED:
            raise ValueError("a chunk is too large")
        chunk = parse(Opcode.CHUNK, self._read(at + HEAD.size, end - at - HEAD.size))
        data = unpacked(chunk, self._allowance)
        self.compression = self.compression or chunk.compression
        return replace(chunk, data=data)

    def _is_record(self, opcode: int, at: int, end: int) -> bool:
        """Return whether a record without a checksum is at a place, and does not just look so.

        Another record, or a part of one, or the end of the file has to follow; and there must not
        be a chunk inside, as there is when its length is wrong, unless it is an attachment.
        """
        head = self._read(end, HEAD.size)
        if len(head) == HEAD.size:
            following, length = HEAD.unpack(head)
            if not (_is_known(following) and length <= self.size + LARGEST_PACKED - end):
                return False
        if not _is_known(opcode):
            return False
        hides = opcode != Opcode.ATTACHMENT and end - at > _SMALLEST_CHUNK
        return not hides or self._next_chunk(at + 1, end) == end

    def _next_chunk(self, at: int, limit: int) -> int:
        """Return where the first whole chunk from a place on begins, a limit if there is none."""
        while at < limit and self._false_left > 0:
            window = self._read(at, min(_PIECE, limit - at))
            for match in _CHUNK_START.finditer(window):
                start, after = at + match.start(), at
                with contextlib.suppress(*BROKEN):
                    _, after = self._head_at(start, self.size)
                    if self._chunk_at(start, after).data:
                        return start
                self._false_left -= max(0, min(after - start, LARGEST_PACKED)) + _FALSE_LEAST
                if self._false_left < 0:
                    return limit
            if len(window) < _PIECE:
                break
            at += _PIECE - HEAD.size
        return limit


def _is_known(opcode: int) -> bool:
    return opcode in _OPCODES or opcode >= _FIRST_PRIVATE


def _differences(stored: StoredMetadata, files: list[Path], messages: int) -> Iterator[str]:
    """Yield the differences between metadata.yaml and the files."""
    if stored.storage != "mcap":
        yield f"{METADATA_FILE} says {stored.storage or 'nothing'} of the storage, which is mcap"
    names = {Path(name).name for name in stored.files}
    found = {file.name for file in files}
    for name in sorted(names - found):
        yield f"{METADATA_FILE} names {name}, which is not there"
    for name in sorted(found - names):
        yield f"{METADATA_FILE} does not name {name}; its messages are taken as well"
    if stored.message_count not in (None, messages):
        yield f"{METADATA_FILE} counts {stored.message_count} messages, {messages} were found"
