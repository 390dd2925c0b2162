# SPDX-License-Identifier: Apache-2.0
"""Reads recordings of any program: rosbag2 folders, their single files, and files of ROS 1."""

from __future__ import annotations

import contextlib
import logging
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_ros.base.errors import printable
from stickslip_ros.base.opening import Allowance
from stickslip_ros.recordings.clocks import FEW, HOUR, UNSET, Bulk, bulk_of
from stickslip_ros.recordings.errors import BagError, damaged, reading, short
from stickslip_ros.recordings.mcap_files import LARGEST_CHUNK, BagMessage, McapFiles, Wanted, unpack
from stickslip_ros.recordings.metadata import (
    METADATA_FILE,
    METADATA_VERSION,
    FileSummary,
    OfferedQos,
    StoredMetadata,
    TopicDescription,
    differences,
    storage_files,
    storage_of,
    stored_metadata,
)

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

_LOG = logging.getLogger(__name__)


def open_bag(path: Path | str) -> BagReader:
    """Open a recording: a rosbag2 folder, one ``.mcap`` or ``.db3`` file, a ``.bag`` of ROS 1.

    Raises BagError: it cannot be read; the text names the file and the cure.
    """
    path = Path(path).expanduser().absolute()
    with reading(path):
        stored = stored_metadata(path)
        there = storage_files(path, stored)
        files = [one for one in there if stored and one.name in stored.names] or there
        kind = storage_of(files[0])
        if stored:
            if stored.version > METADATA_VERSION:
                raise BagError(
                    f"{path / METADATA_FILE} has version {stored.version}; the newest known is "
                    f"version {METADATA_VERSION}; install a newer stickslip_ros"
                )
            if stored.compression_mode and (kind != "mcap" or stored.compression_format != "zstd"):
                raise BagError(
                    f"{path} is compressed with '{stored.compression_format}', but only zstd is "
                    "supported, and only of MCAP bags; unpack it with `ros2 bag convert`"
                )
            if missing := stored.names - {file.name for file in there}:
                raise BagError(
                    f"{path} lacks {', '.join(sorted(missing))}, which its {METADATA_FILE} names; "
                    f"restore it, or move {METADATA_FILE} away to read the rest"
                )
        bag = BagReader(path, (McapFiles if kind == "mcap" else RosbagsFiles)(path, files, stored))
    if stored:
        for text in islice(differences(stored, there, kind, bag.message_count), 1):
            bag.warn(f"{path}: {text}; `ros2 bag reindex` writes it anew")
    elif (path / METADATA_FILE).exists():
        bag.warn(f"{path / METADATA_FILE} is too long; its bag is read without it")
    return bag


class BagReader:
    """A recording, open for reading; also a context manager that closes it."""

    def __init__(self, path: Path, storage: McapFiles | RosbagsFiles) -> None:
        """Take open files."""
        self.path = path  #: what was opened
        #: what ``metadata.yaml``, or without one the files, say besides
        self.metadata = metadata = storage.metadata
        self.warnings: list[str] = []  #: what may be missing, a sentence each; none if nothing is
        #: text by key that the recorder left in the metadata
        self.custom_data: dict[str, str] = metadata.custom_data
        topics = metadata.topics | {
            name: metadata.completed(one) for name, one in storage.topics.items()
        }
        #: every topic by its name, those without messages too
        self.topics: dict[str, TopicDescription] = dict(sorted(topics.items()))
        #: messages by topic
        self.counts: dict[str, int] = {name: storage.counts[name] for name in self.topics}
        self.files: list[FileSummary] = storage.files  #: the storage files
        #: of the chunks: "zstd", "lz4", "" for none
        self.compressions: list[str] = storage.compressions
        #: names of the programs that wrote the files
        self.libraries: list[str] = storage.libraries
        self._storage = storage

    def warn(self, what: str) -> None:
        """Take a warning, and log it."""
        self.warnings.append(printable(what))
        _LOG.warning(self.warnings[-1])  # on stderr, unless the program says otherwise

    def __enter__(self) -> BagReader:
        """Return the open bag."""
        return self

    def __exit__(self, *error: object) -> None:
        """Close the bag."""
        self.close()

    def close(self) -> None:
        """Close the files; twice does no harm."""
        self._storage.close()

    @property
    def message_count(self) -> int:
        """Messages in the bag."""
        return sum(self.counts.values())

    @cached_property
    def bulk(self) -> Bulk:
        """When it was recorded, but for messages that are hours from all others.

        Raises BagError: a file is damaged.
        """
        filled = [file for file in self.files if file.messages]
        start = min((file.start_ns for file in filled), default=0)
        end = max((file.end_ns for file in filled), default=0)
        hours = Wanted(None, start, start + HOUR), Wanted(None, end - HOUR, end + 1)
        # Of more than a few in its first and in its last hour, a bag is not read as a whole.
        if end - start <= HOUR or (
            start > UNSET and all(len([*islice(self._read(one), FEW + 1)]) > FEW for one in hours)
        ):
            return Bulk(start, end)
        return bulk_of(message.log_ns for message in self._read(Wanted()))

    @property
    def start_ns(self) -> int:
        """Log time of the first message of the bulk, ns since the Unix epoch; 0 if there is none.

        Raises BagError: a file is damaged.
        """
        return self.bulk.start_ns

    @property
    def end_ns(self) -> int:
        """Log time of the last message of the bulk, likewise."""
        return self.bulk.end_ns

    def messages(
        self,
        topics: Iterable[str] | None = None,
        start: int = 0,
        end: int = Wanted().end_ns,
    ) -> Iterator[BagMessage]:
        """Yield messages in order of log time, over all files, reading as it goes.

        topics: names, all topics if None.
        start: ns since the Unix epoch, the first time to take.
        end: ns since the Unix epoch, the first time not to take.
        Raises BagError: a topic is not in the bag; while reading: a file is damaged.
        """
        wanted = Wanted(None if topics is None else frozenset(topics), start, end)
        for name in sorted(wanted.topics or ()):
            if name not in self.topics:
                known = ", ".join(sorted(self.topics)) or "none at all"
                raise BagError(f"{self.path} has no topic {name}; it has {known}")
        return self._read(wanted)

    def bulk_messages(self, topics: Iterable[str] | None = None) -> Iterator[BagMessage]:
        """Yield the messages of the bulk, as :meth:`messages` does."""
        window = (self.bulk.start_ns, self.bulk.end_ns + 1) if self.bulk.apart else ()
        return self.messages(topics, *window)

    def _read(self, wanted: Wanted) -> Iterator[BagMessage]:
        """Yield messages; a whole topic with fewer or more than are counted is an error."""
        packed = self.metadata.compression_mode == "message"
        allowance = Allowance(self.path, sum(file.size for file in self.files))
        found = 0
        for message in self._storage.messages(wanted):
            found += 1
            if packed:
                with reading(self.path):
                    data = unpack(message.data, "zstd", LARGEST_CHUNK, allowance)
                    message = message._replace(data=data)
            yield message
        topics = self.counts if wanted.topics is None else wanted.topics
        counted = sum(self.counts[name] for name in topics)
        if wanted == Wanted(wanted.topics) and found != counted:
            raise damaged(self.path, f"{counted} messages are counted, {found} were found")


class RosbagsFiles:
    """The open files of a bag of SQLite or of ROS 1 as one, with the attributes of `McapFiles`.

    Their messages come as CDR with a ``ros2msg`` schema, so that everything else need not know.
    """

    def __init__(self, path: Path, files: list[Path], stored: StoredMetadata | None) -> None:
        """Open the files by themselves, because the topics in ``metadata.yaml`` may be wrong.

        Raises BagError: one cannot be read, or ``rosbags`` is not installed.
        """
        try:
            from rosbags.highlevel import AnyReader
            from rosbags.typesys import Stores, get_typestore
        except ImportError:
            raise BagError(
                f"{path} is not an MCAP bag; pip install 'stickslip_ros[formats]' to read bags of "
                "sqlite3 and of ROS 1"
            ) from None
        self._path = path
        self.metadata = stored or StoredMetadata(storage="", version=0)  # there are none inside
        self.topics: dict[str, TopicDescription] = {}
        self.counts: Counter[str] = Counter()
        self.compressions: list[str] = []
        self.files: list[FileSummary] = []
        try:
            with contextlib.ExitStack() as opened:
                links = opened.enter_context(tempfile.TemporaryDirectory(prefix="stickslip-"))
                named = [_named(file, Path(links, str(k))) for k, file in enumerate(files)]
                # Definitions stand in bags of ROS 1 and, since Iron, in those of ROS 2.
                store = None if named[0].suffix == ".bag" else get_typestore(Stores.LATEST)
                reader: Any = AnyReader(named, default_typestore=store)
                self._reader = opened.enter_context(reader)
                for connection in reader.connections:
                    self.topics.setdefault(connection.topic, self._topic(connection))
                    self.counts[connection.topic] += connection.msgcount
                self.close = opened.pop_all().close  #: closes the files; twice does no harm
        except Exception as error:  # whatever a damaged file leads to, in several libraries
            raise self._unreadable(error) from error
        for file, one in zip(files, reader.readers, strict=True):
            times = (one.start_time, one.end_time - 1) if one.message_count else (0, 0)
            size = file.stat().st_size
            self.files.append(FileSummary(file.name, size, one.message_count, *times))
        self.libraries = ["rosbag2 sqlite3" if reader.is2 else "rosbag of ROS 1"]

    def _topic(self, connection: Connection) -> TopicDescription:
        store, is2 = self._reader.typestore, self._reader.is2
        known = connection.msgtype in store.fielddefs
        return TopicDescription(
            name=connection.topic,
            type=connection.msgtype,
            schema=store.generate_msgdef(connection.msgtype, ros_version=2)[0] if known else "",
            type_hash=connection.digest if is2 else "",
            offered_qos=() if is2 else (OfferedQos(),),
        )

    def messages(self, wanted: Wanted) -> Iterator[BagMessage]:
        """Yield messages in order of time.

        Raises BagError: a file is damaged.
        """
        reader = self._reader
        chosen = [
            connection
            for connection in reader.connections
            if wanted.topics is None or connection.topic in wanted.topics
        ]
        if not chosen:  # which would mean all of them to rosbags
            return
        try:
            stop = min(wanted.end_ns, 2**63 - 1)
            for connection, ns, data in reader.messages(chosen, wanted.start_ns or None, stop):
                if not reader.is2:
                    message = reader.deserialize(data, connection.msgtype)
                    data = reader.typestore.serialize_cdr(message, connection.msgtype)
                yield BagMessage(connection.topic, ns, ns, 0, bytes(data))
        except Exception as error:  # as when opening
            raise self._unreadable(error) from error

    def _unreadable(self, error: Exception) -> BagError:
        return BagError(
            f"{self._path} cannot be read: {short(error)}; record it anew, or make an MCAP bag of "
            "it with `ros2 bag convert`"
        )


def _named(file: Path, link: Path) -> Path:
    """Return a file, which has to be one, under a name that tells ``rosbags`` what it is."""
    end = {"sqlite3": ".db3", "ros1": ".bag"}.get(storage_of(file), file.suffix)
    if file.suffix == end:
        return file
    link = link.with_suffix(end)
    link.symlink_to(file)
    return link
