# SPDX-License-Identifier: Apache-2.0
"""A good bag out of one whose writer was killed, or that was damaged since.

Everything that is whole is kept, nothing else: chunks with a right checksum, and records outside of
chunks that fit between their neighbours.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from mcap.records import Statistics

from stickslip_ros.base.errors import printable
from stickslip_ros.base.files import whole_folder
from stickslip_ros.recordings.errors import BROKEN, BagError, reading, short
from stickslip_ros.recordings.mcap_file import McapFile, Piece
from stickslip_ros.recordings.mcap_records import (
    MESSAGE_BYTES,
    Block,
    merged,
    messages_in,
    unpack_message,
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
        sources = [_DamagedFile(file, findings, packed) for file in files]
        for source in sources:
            opened.callback(source.close)
        writer = opened.enter_context(BagWriter(new, compression=sources[0].compression()))
        topics: dict[str, TopicDescription] = {}
        for source in sources:
            writer.split()
            for block in source.blocks(topics, on_bytes):
                for name, log_ns, publish_ns, number, data in block.messages():
                    if not writer.has_topic(name):
                        topic = topics[name]
                        writer.add_topic(stored.completed(topic) if stored else topic)
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


class _DamagedFile(McapFile):
    """A file that may be cut or damaged."""

    def __init__(self, path: Path, findings: list[str], packed_messages: bool) -> None:
        super().__init__(path, findings)
        #: messages found that no checksum protects, or not the name of their topic
        self.unprotected = 0
        self._packed_messages = packed_messages
        self._doubtful: set[int] = set()  # channels whose names no checksum protects

    def compression(self) -> str:
        """Return the word for the compression of the first whole chunk."""
        dropped = self.dropped_bytes
        found = next((piece.chunk for piece in self.pieces() if piece.chunk), None)
        self.dropped_bytes = dropped
        return (found and found.compression) or "none"

    def blocks(
        self, topics: dict[str, TopicDescription], on_bytes: Callable[[int], object]
    ) -> Iterator[Block]:
        """Yield every message that is whole, in the order of the file.

        topics: by name; takes those that are found.
        """
        if not self.size:
            return
        # What stands in the index is known even if the chunk with its first description is lost.
        statistics = self._learn_from_index()
        kept = at = 0
        for piece in self.pieces():
            on_bytes(piece.end - at)
            at = piece.end
            for block in self._blocks_of(piece, topics):
                yield block
                kept += len(block.data)
        on_bytes(self.size - at)
        if self.dropped_bytes:
            self.find(f"is damaged: {self.dropped_bytes} bytes were left out")
        if statistics and statistics.message_count != kept:
            self.find(f"had {statistics.message_count} messages by its index, {kept} were found")
        if self.unprotected and self.findings:
            self.find(f"has no checksum for {self.unprotected} of these messages or their topics")

    def _blocks_of(self, piece: Piece, topics: dict[str, TopicDescription]) -> Iterator[Block]:
        """Yield the messages in a piece of the file whose topics are known."""
        protected = bool(piece.chunk and piece.chunk.crc)
        try:
            found = messages_in(piece.records, partial(self._learn, protected))
        except BROKEN:
            self.dropped_bytes += len(piece.records)
            return
        channels = found.heads["channel"]
        names = {one: self._name_of(one, topics) for one in np.unique(channels).tolist()}
        known = np.isin(channels, [one for one, name in names.items() if name])
        lost = found.heads["length"][~known].astype(np.int64)
        self.dropped_bytes += int(lost.sum()) - MESSAGE_BYTES * len(lost)
        found = found.chosen(known)
        doubtful = np.isin(found.heads["channel"], list(self._doubtful))
        self.unprotected += int(doubtful.sum()) if protected else len(doubtful)
        for block in merged([(found, names)], in_time=False):
            if not self._packed_messages:
                yield block
                continue
            for name, log_ns, publish_ns, number, data in block.messages():
                try:
                    data = unpack_message(data, self.allowance)
                except ValueError:
                    self.dropped_bytes += len(data)
                    self.unprotected -= not protected
                else:
                    yield Block([name], [log_ns], [publish_ns], [number], [data])

    def _learn(self, protected: bool, opcode: int, body: bytes) -> None:
        """Learn what a record says; one that is broken is passed over."""
        known = len(self.channels.topics)
        try:
            self.channels.learn(opcode, body)
        except BROKEN:
            self.dropped_bytes += len(body)
        if not protected and len(self.channels.topics) > known:
            self._doubtful.add(next(reversed(self.channels.topics)))

    def _name_of(self, channel: int, topics: dict[str, TopicDescription]) -> str:
        """Return the topic of a channel; empty if it is not known, or of another type before."""
        topic = self.channels.topics.get(channel)
        known = topic and topics.setdefault(topic.name, topic)
        return topic.name if topic and known and known.type == topic.type else ""

    def _learn_from_index(self) -> Statistics | None:
        """Learn topics; return the counts that the index holds, None without a checksum."""
        try:
            footer = self.footer()
        except BROKEN:
            self.find("has no end: what its writer had not written yet is missing")
            return None
        try:
            if footer.summary_start and footer.summary_crc:
                self.read_index(footer)
            return self.statistics
        except BROKEN as error:
            self.find(f"has a damaged index, which is not believed: {short(error)}")
            return None


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
