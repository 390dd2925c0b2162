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
from pathlib import Path

from mcap.records import Statistics

from stickslip_ros.files import whole_folder
from stickslip_ros.recordings.errors import BROKEN, BagError, reading, short
from stickslip_ros.recordings.mcap_file import McapFile
from stickslip_ros.recordings.mcap_records import (
    BagMessage,
    message_at,
    messages_in,
    unpack_message,
)
from stickslip_ros.recordings.metadata import (
    METADATA_FILE,
    StoredMetadata,
    TopicDescription,
    parse_metadata,
    storage_files,
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
    if files[0].suffix == ".db3":
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
            findings.append(f"{METADATA_FILE} is missing")
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
            for topic, message in source.messages(on_bytes):
                if topics.setdefault(topic.name, topic).type != topic.type:
                    source.dropped_bytes += len(message.data)
                    continue
                if not writer.has_topic(topic.name):
                    writer.add_topic(stored.completed(topic) if stored else topic)
                _, log_ns, publish_ns, number, data = message
                writer.write(
                    topic.name, data, log_ns=log_ns, publish_ns=publish_ns, sequence=number
                )
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
    return Recovered(new, writer.message_count, dropped, unprotected, tuple(findings))


class _DamagedFile(McapFile):
    """A file that may be cut or damaged."""

    def __init__(self, path: Path, findings: list[str], packed_messages: bool) -> None:
        super().__init__(path, findings)
        #: messages found that no checksum protects, or not the name of their topic
        self.unprotected = 0
        self._packed_messages = packed_messages

    def compression(self) -> str:
        """Return the word for the compression of the first whole chunk."""
        dropped = self.dropped_bytes
        found = next((block.chunk for block in self.blocks() if block.chunk), None)
        self.dropped_bytes = dropped
        return (found and found.compression) or "none"

    def messages(
        self, on_bytes: Callable[[int], object]
    ) -> Iterator[tuple[TopicDescription, BagMessage]]:
        """Yield every message that is whole, in the order of the file."""
        if not self.size:
            return
        # What stands in the index is known even if the chunk with its first description is lost.
        statistics = self._learn_from_index()
        kept = at = 0
        doubtful: set[int] = set()  # channels whose names no checksum protects
        for block in self.blocks():
            on_bytes(block.place.end - at)
            at = block.place.end
            protected = bool(block.chunk and block.chunk.crc)
            known = set(self.channels.topics)
            try:
                heads = messages_in(block.records, self.channels.learn)
            except BROKEN:
                self.dropped_bytes += len(block.records)
                continue
            finally:
                doubtful |= set() if protected else self.channels.topics.keys() - known
            for channel, start in zip(heads.channels, heads.starts, strict=True):
                topic = self.channels.topics.get(channel)
                message = message_at(block.records, start, topic.name if topic else "")
                try:
                    if self._packed_messages:
                        data = unpack_message(message.data, self.allowance)
                        message = message._replace(data=data)
                except ValueError:
                    topic = None
                if topic is None:
                    self.dropped_bytes += len(message.data)
                    continue
                kept += 1
                self.unprotected += not protected or channel in doubtful
                yield topic, message
        on_bytes(self.size - at)
        if self.dropped_bytes:
            self.find(f"is damaged: {self.dropped_bytes} bytes were left out")
        if statistics and statistics.message_count != kept:
            self.find(f"had {statistics.message_count} messages by its index, {kept} were found")
        if self.unprotected and self.findings:
            self.find(f"has no checksum for {self.unprotected} of these messages or their topics")

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
    names = {Path(name).name for name in stored.files}
    found = {file.name for file in files}
    for name in sorted(names - found):
        yield f"{METADATA_FILE} names {name}, which is not there"
    for name in sorted(found - names):
        yield f"{METADATA_FILE} does not name {name}; its messages are taken as well"
    if stored.message_count not in (None, messages):
        yield f"{METADATA_FILE} counts {stored.message_count} messages, {messages} were found"
