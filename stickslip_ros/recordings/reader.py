# SPDX-License-Identifier: Apache-2.0
"""Reads recordings of any program: rosbag2 folders, their single files, and files of ROS 1."""

from __future__ import annotations

import logging
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_ros.base.errors import printable
from stickslip_ros.base.opening import Allowance, open_regular
from stickslip_ros.recordings.clocks import FEW, HOUR, Bulk, Moments
from stickslip_ros.recordings.errors import BagError, damaged, reading, short
from stickslip_ros.recordings.mcap_files import BagMessage, McapFiles, Wanted, unpack_message
from stickslip_ros.recordings.metadata import (
    METADATA_FILE,
    METADATA_VERSION,
    FileSummary,
    OfferedQos,
    StoredMetadata,
    TopicDescription,
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
    return BagReader(path)


class BagReader:
    """A recording, open for reading; also a context manager that closes it."""

    def __init__(self, path: Path | str) -> None:
        """Open a folder or a file; messages are read later.

        Raises BagError: it cannot be read; the text names the file and the cure.
        """
        self.path = Path(path).expanduser().absolute()  #: what was opened
        self.warnings: list[str] = []  #: what may be missing, a sentence each; none if nothing is
        with reading(self.path):
            stored = stored_metadata(self.path)
            if not stored and self.path.is_dir() and (self.path / METADATA_FILE).exists():
                self._warn(f"{self.path / METADATA_FILE} is too long; its bag is read without it")
            files = self._storage_files(stored)
            kind = storage_of(files[0])
            by_rosbags = kind != "mcap"
            if stored and stored.storage != kind:
                self._warn(
                    f"{METADATA_FILE} of {self.path} says {stored.storage or 'nothing'} of its "
                    f"storage, but {files[0].name} is {kind}, and is read as that"
                )
            if stored:
                _check_supported(self.path, stored, by_rosbags)
            self._storage = (RosbagsFiles if by_rosbags else McapFiles)(self.path, files)
        try:
            #: what ``metadata.yaml``, or without one the files, say besides
            self.metadata = stored or self._storage.metadata
        except BaseException:
            self.close()
            raise
        #: text by key that the recorder left in the metadata
        self.custom_data: dict[str, str] = self.metadata.custom_data
        topics = {topic.name: topic for topic in self.metadata.topics}
        topics |= {name: self.metadata.completed(one) for name, one in self._storage.topics.items()}
        #: every topic by its name, those without messages too
        self.topics: dict[str, TopicDescription] = dict(sorted(topics.items()))
        #: messages by topic
        self.counts: dict[str, int] = {name: self._storage.counts[name] for name in self.topics}
        self.files: list[FileSummary] = self._storage.files  #: the storage files
        #: of the chunks: "zstd", "lz4", "" for none
        self.compressions: list[str] = self._storage.compressions
        #: names of the programs that wrote the files
        self.libraries: list[str] = self._storage.libraries
        if stored and stored.message_count not in (None, self.message_count) and not self.warnings:
            self._warn(
                f"{METADATA_FILE} of {self.path} counts {stored.message_count} messages, its files "
                f"hold {self.message_count}; `ros2 bag reindex` writes it anew"
            )

    def _storage_files(self, stored: StoredMetadata | None) -> list[Path]:
        if not (stored and stored.files):
            return storage_files(self.path, stored)
        # Some versions put the name of the folder in front; the files lie in it in any case.
        named = [self.path / Path(name).name for name in stored.files]
        if missing := [file.name for file in named if not file.exists()]:
            raise BagError(
                f"{self.path} lacks {', '.join(missing)}, which its {METADATA_FILE} names; "
                f"restore it, or move {METADATA_FILE} away to read the rest"
            )
        others = [file.name for file in storage_files(self.path, stored) if file not in named]
        if others:
            self._warn(
                f"{METADATA_FILE} of {self.path} does not name {', '.join(others)}, which is "
                "left out; `stickslip bag recover` makes a bag with all files"
            )
        return named

    def _warn(self, what: str) -> None:
        what = printable(what)
        self.warnings.append(what)
        _LOG.warning(what)  # on stderr, unless the program says otherwise

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
        if end - start <= HOUR:
            return Bulk(start, end)
        times = Moments()
        for ns, count in self._storage.log_times():
            times.add(ns, count)
        return times.bulk()

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
                    message = message._replace(data=unpack_message(message.data, allowance))
            yield message
        topics = self.counts if wanted.topics is None else wanted.topics
        counted = sum(self.counts[name] for name in topics)
        if wanted == Wanted(wanted.topics) and found != counted:
            raise damaged(self.path, f"{counted} messages are counted, {found} were found")


def _check_supported(path: Path, stored: StoredMetadata, by_rosbags: bool) -> None:
    if stored.version > METADATA_VERSION:
        raise BagError(
            f"{path / METADATA_FILE} has version {stored.version}; the newest known version is "
            f"{METADATA_VERSION}; install a newer stickslip_ros"
        )
    if stored.compression_mode and (by_rosbags or stored.compression_format != "zstd"):
        raise BagError(
            f"{path} is compressed with '{stored.compression_format}', but only zstd is supported, "
            "and only of MCAP bags; unpack it with `ros2 bag convert`"
        )


class RosbagsFiles:
    """The open files of a bag of SQLite or of ROS 1 as one, with the attributes of `McapFiles`.

    Their messages come as CDR with a ``ros2msg`` schema, so that everything else need not know.
    """

    metadata = StoredMetadata(storage="", version=0)  # there are none inside

    def __init__(self, path: Path, files: list[Path]) -> None:
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
        self._reader: Any = None
        self.topics: dict[str, TopicDescription] = {}
        self.counts: Counter[str] = Counter()
        self.compressions: list[str] = []
        self.files: list[FileSummary] = []
        for file in files:
            open_regular(file).close()
        self._links = tempfile.TemporaryDirectory(prefix="stickslip-")
        try:
            named = [self._named(file, number) for number, file in enumerate(files)]
            # Definitions stand in bags of ROS 1 and, since Iron, in those of ROS 2.
            store = None if named[0].suffix == ".bag" else get_typestore(Stores.LATEST)
            reader = AnyReader(named, default_typestore=store)
            reader.open()
            self._reader = reader
            self._describe(files)
        except Exception as error:  # whatever a damaged file leads to, in several libraries
            self.close()
            raise self._unreadable(error) from error

    def close(self) -> None:
        """Close the files; twice does no harm."""
        if self._reader is not None:
            self._reader.close()
            self._reader = None
        self._links.cleanup()

    def _named(self, file: Path, number: int) -> Path:
        """Return a file under a name that tells `rosbags` what it is."""
        end = {"sqlite3": ".db3", "ros1": ".bag"}.get(storage_of(file), file.suffix)
        if file.suffix == end:
            return file
        link = Path(self._links.name, f"{number}{end}")
        link.symlink_to(file)
        return link

    def _describe(self, files: list[Path]) -> None:
        for connection in self._reader.connections:
            self.topics.setdefault(connection.topic, self._topic(connection))
            self.counts[connection.topic] += connection.msgcount
        for file, one in zip(files, self._reader.readers, strict=True):
            times = (one.start_time, one.end_time - 1) if one.message_count else (0, 0)
            size = file.stat().st_size
            self.files.append(FileSummary(file.name, size, one.message_count, *times))
        self.libraries = ["rosbag2 sqlite3" if self._reader.is2 else "rosbag of ROS 1"]

    def _topic(self, connection: Connection) -> TopicDescription:
        store = self._reader.typestore
        schema = ""
        if connection.msgtype in store.fielddefs:
            schema = store.generate_msgdef(connection.msgtype, ros_version=2)[0]
        return TopicDescription(
            name=connection.topic,
            type=connection.msgtype,
            schema=schema,
            type_hash=connection.digest if self._reader.is2 else "",
            offered_qos=() if self._reader.is2 else (OfferedQos(),),
        )

    def log_times(self) -> Iterator[tuple[int, int]]:
        """Yield times (ns) of messages, and of how many each is; BagError: a file is damaged.

        Where many were recorded in the first and in the last hour, none are apart from the others,
        and the files need not be read as a whole.
        """
        filled = [file for file in self.files if file.messages]
        first, last = min(f.start_ns for f in filled), max(f.end_ns for f in filled)
        hours = Wanted(None, first, first + HOUR), Wanted(None, last - HOUR, last + 1)
        if all(sum(1 for _ in islice(self.messages(one), FEW + 1)) > FEW for one in hours):
            return iter(((first, FEW + 1), (last, FEW + 1)))
        return ((message.log_ns, 1) for message in self.messages(Wanted()))

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
