# SPDX-License-Identifier: Apache-2.0
"""A good bag out of one whose writer was killed, or that was damaged since."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from stickslip_ros.recordings.compression import UnpackError, unpack_message
from stickslip_ros.recordings.errors import BagError
from stickslip_ros.recordings.metadata import METADATA_FILE, TopicDescription
from stickslip_ros.recordings.reader import files_in, not_mcap
from stickslip_ros.recordings.record import reading
from stickslip_ros.recordings.salvage import Salvage
from stickslip_ros.recordings.stored_metadata import (
    METADATA_BYTES,
    StoredMetadata,
    metadata_file,
    metadata_record,
)
from stickslip_ros.recordings.writer import BagWriter


@dataclass(frozen=True)
class Recovered:
    """What came of a recovery: the new folder, messages in it, bytes of the old files left out."""

    folder: Path
    messages: int
    dropped_bytes: int


def recovered_name(bag: Path) -> Path:
    """Return the folder that a recovered bag goes to when nobody says otherwise."""
    bag = bag.expanduser().absolute()
    stem = bag.name if bag.is_dir() else bag.name.split(".mcap")[0]
    return bag.with_name(f"{stem}_recovered")


def bytes_of(bag: Path) -> int:
    """Return the size of the storage files of a bag.

    :raises BagError: there are none.
    """
    with reading(bag):
        return sum(file.stat().st_size for file in _files(bag.expanduser().absolute()))


def recover(
    bag: Path, out: Path | None = None, on_bytes: Callable[[int], object] = lambda count: None
) -> Recovered:
    """Write everything that is whole in a bag into a new one; the old one is left as it is.

    :param bag: a folder or an MCAP file, finished or not.
    :param out: folder of the new bag, which must not exist; :func:`recovered_name` if None.
    :param on_bytes: called with the bytes gone through since it was called last.
    :raises BagError: there is nothing to recover, or the new bag cannot be written; there is no
        new folder then.
    """
    bag = bag.expanduser().absolute()
    out = (out or recovered_name(bag)).expanduser().absolute()
    with reading(bag):
        files = _files(bag)
    with reading(out):
        if out.exists():
            raise BagError(f"output folder {out} exists already; name another one with --out")
        if not out.parent.is_dir():
            raise BagError(f"there is no folder {out.parent}; make it first or name another one")
    try:
        # The files of a bag carry its name, so it gets that at once, in a folder of its own.
        working = Path(tempfile.mkdtemp(prefix=f".{out.name}.", dir=out.parent))
    except OSError as error:
        raise BagError(
            f"cannot write into {out.parent}: {error.strerror}; name a folder elsewhere with --out"
        ) from error
    try:
        messages, dropped = _rewrite(bag, files, working / out.name, on_bytes)
        try:
            os.rename(working / out.name, out)
        except OSError as error:
            raise BagError(
                f"cannot name the new bag {out}: {error.strerror}; name another folder with --out"
            ) from error
    finally:
        shutil.rmtree(working, ignore_errors=True)
    return Recovered(out, messages, dropped)


def _rewrite(
    bag: Path, files: list[Path], new: Path, on_bytes: Callable[[int], object]
) -> tuple[int, int]:
    """Return the messages kept and the bytes dropped."""
    salvages: list[Salvage] = []
    with contextlib.ExitStack() as opened:
        for file in files:
            salvages.append(Salvage(file, on_bytes))
            opened.callback(salvages[-1].close)
        told = _metadata_file(bag)
        topics: dict[str, TopicDescription] = {}
        writer = opened.enter_context(
            BagWriter(new, compression=salvages[0].first_compression() or "none")
        )
        for salvage in salvages:
            writer.split()
            _copy(salvage, writer, topics, told)
        if not writer.message_count and not any(salvage.looks_right for salvage in salvages):
            raise BagError(f"there is nothing of an MCAP file in {bag}; name the bag you mean")
        told = told or _metadata_inside(salvages)
        writer.custom_data.update(told.custom_data)
        writer.ros_distro = told.ros_distro or writer.ros_distro
        for topic in told.topics:
            if not writer.has_topic(topic.name):
                writer.add_topic(topic)
        writer.close()
        return writer.message_count, sum(salvage.dropped_bytes for salvage in salvages)


def _copy(
    salvage: Salvage,
    writer: BagWriter,
    topics: dict[str, TopicDescription],
    told: StoredMetadata | None,
) -> None:
    for topic, message in salvage.messages():
        if topics.setdefault(topic.name, topic).type != topic.type:
            salvage.dropped_bytes += len(message.data)
            continue
        if not writer.has_topic(topic.name):
            writer.add_topic(told.completed(topic) if told else topic)
        data = message.data
        if told and told.compression_mode == "message":
            try:
                data = unpack_message(data)
            except UnpackError:
                salvage.dropped_bytes += len(data)
                continue
        writer.write(
            topic.name,
            data,
            log_ns=message.log_ns,
            publish_ns=message.publish_ns,
            sequence=message.sequence,
        )


def _files(bag: Path) -> list[Path]:
    if not bag.exists():
        raise BagError(f"there is no bag {bag}; check the name")
    if bag.suffix == ".db3":
        raise not_mcap(bag)
    return files_in(bag) if bag.is_dir() else [bag]


def _metadata_file(bag: Path) -> StoredMetadata | None:
    """Return what metadata.yaml says, None if it is missing or broken like the rest."""
    file = bag / METADATA_FILE
    try:
        with file.open("rb") as stream:
            return metadata_file(stream.read(METADATA_BYTES).decode())
    except (OSError, ValueError):
        return None


def _metadata_inside(salvages: list[Salvage]) -> StoredMetadata:
    for salvage in reversed(salvages):
        if salvage.metadata_text:
            with contextlib.suppress(ValueError):
                return metadata_record(salvage.metadata_text)
    return StoredMetadata()
