# SPDX-License-Identifier: Apache-2.0
"""A good bag out of one whose writer was killed, or that was damaged since."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from stickslip_ros.files import whole_folder
from stickslip_ros.opening import ReadError
from stickslip_ros.recordings.errors import BagError
from stickslip_ros.recordings.folder import storage_files, stored_metadata
from stickslip_ros.recordings.mcap_records import reading
from stickslip_ros.recordings.metadata import (
    METADATA_FILE,
    StoredMetadata,
    TopicDescription,
    parse_metadata,
)
from stickslip_ros.recordings.salvage import DamagedMcap
from stickslip_ros.recordings.sqlite_salvage import DamagedSqlite
from stickslip_ros.recordings.writer import BagWriter

_Source = DamagedMcap | DamagedSqlite


@dataclass(frozen=True)
class Recovered:
    """Result of a recovery.

    :ivar folder: of the new bag.
    :ivar messages: in it.
    :ivar dropped_bytes: of the old files, left out.
    :ivar unprotected: messages in it that no checksum protected, or not the name of their topic.
    :ivar findings: what was wrong with the old bag, a sentence each; none if it was whole.
    """

    folder: Path
    messages: int
    dropped_bytes: int
    unprotected: int
    findings: tuple[str, ...]


def recovered_name(bag: Path) -> Path:
    """Return the default folder of a recovered bag."""
    bag = bag.expanduser().absolute()
    stem = bag.name if bag.is_dir() else re.split(r"\.mcap|\.db3$", bag.name)[0]
    return bag.with_name(f"{stem}_recovered")


def bytes_of(bag: Path) -> int:
    """Return the size of the storage files of a bag.

    :raises BagError: there are none.
    """
    with reading(bag):
        return sum(file.stat().st_size for file in storage_files(bag.expanduser().absolute()))


def recover(
    bag: Path | str,
    out: Path | str | None = None,
    on_bytes: Callable[[int], object] = lambda count: None,
) -> Recovered:
    """Write the undamaged parts of a bag into a new one; the old bag stays unchanged.

    :param bag: a folder or an MCAP file, finished or not.
    :param out: folder of the new bag, which must not exist; :func:`recovered_name` if None.
    :param on_bytes: called with the bytes gone through since it was called last.
    :raises BagError: there is nothing to recover, or the disk takes no more; there is no new
        folder then.
    :raises WriteError: the new folder exists or cannot be made.
    """
    bag = Path(bag).expanduser().absolute()
    out = Path(out).expanduser().absolute() if out else recovered_name(bag)
    with reading(bag):
        files = storage_files(bag)
    with whole_folder(out) as folder, reading(bag):
        found = _rewrite(bag, files, folder, on_bytes)
    return replace(found, folder=out)


def _rewrite(
    bag: Path, files: list[Path], new: Path, on_bytes: Callable[[int], object]
) -> Recovered:
    findings: list[str] = []
    stored = _metadata_file(bag, findings)
    packed = stored is not None and stored.compression_mode == "message"
    with contextlib.ExitStack() as opened:
        sources: list[_Source] = []
        for file in files:
            sources.append(
                DamagedSqlite(file, on_bytes)
                if file.suffix == ".db3"
                else DamagedMcap(file, on_bytes, packed)
            )
            opened.callback(sources[-1].close)
        writer = opened.enter_context(BagWriter(new, compression=sources[0].compression or "none"))
        topics: dict[str, TopicDescription] = {}
        for source in sources:
            writer.split()
            _copy(source, writer, topics, stored)
        damages = [source.damage for source in sources]
        if not writer.message_count and not any(damage.looks_right for damage in damages):
            raise BagError(f"there is no part of a recording in {bag}; name the bag you mean")
        findings += [finding for damage in damages for finding in damage.findings]
        if stored:
            findings += _differences(stored, files, writer.message_count)
        stored = stored or _metadata_inside(sources)
        writer.custom_data.update(stored.custom_data)
        writer.ros_distro = stored.ros_distro or writer.ros_distro
        for topic in stored.topics:
            if not writer.has_topic(topic.name):
                writer.add_topic(topic)
        writer.close()
    dropped = sum(damage.dropped_bytes for damage in damages)
    unprotected = sum(damage.unprotected for damage in damages)
    return Recovered(new, writer.message_count, dropped, unprotected, tuple(findings))


def _copy(
    source: _Source,
    writer: BagWriter,
    topics: dict[str, TopicDescription],
    stored: StoredMetadata | None,
) -> None:
    for topic, message in source.messages():
        if topics.setdefault(topic.name, topic).type != topic.type:
            source.damage.dropped_bytes += len(message.data)
            continue
        if not writer.has_topic(topic.name):
            writer.add_topic(stored.completed(topic) if stored else topic)
        writer.write(
            topic.name,
            message.data,
            log_ns=message.log_ns,
            publish_ns=message.publish_ns,
            sequence=message.sequence,
        )


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


def _metadata_file(bag: Path, findings: list[str]) -> StoredMetadata | None:
    """Return the content of metadata.yaml, None if it is missing or broken."""
    try:
        stored = stored_metadata(bag)
    except (BagError, ReadError) as error:
        findings.append(f"{METADATA_FILE} is broken: {error}")
        return None
    if stored is None and bag.is_dir():
        findings.append(f"{METADATA_FILE} is missing")
    return stored


def _metadata_inside(sources: list[_Source]) -> StoredMetadata:
    for source in reversed(sources):
        if source.metadata_text:
            with contextlib.suppress(ValueError):
                return parse_metadata(source.metadata_text)
    return StoredMetadata()
