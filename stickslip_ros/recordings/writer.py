# SPDX-License-Identifier: Apache-2.0
"""Writer of a rosbag2 folder: ``metadata.yaml`` and ``<name>_0.mcap``, ``<name>_1.mcap``, ..."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from textwrap import indent
from typing import IO

from mcap.data_stream import RecordBuilder
from mcap.records import ChunkIndex
from mcap.writer import CompressionType, Writer

from stickslip_ros.base.files import WriteError, reason_and_cure, synchronize, write_text
from stickslip_ros.recordings.errors import BagError
from stickslip_ros.recordings.metadata import (
    METADATA_FILE,
    OUTER_KEY,
    FileSummary,
    TopicDescription,
    bag_metadata,
    qos_yaml,
    yaml_text,
)
from stickslip_ros.version import __version__

# The writer closes a chunk with the first message that passes this size, so it lies below the
# 64 KiB that may be lost at most when the process dies.
_CHUNK_BYTES = 48 * 1024
_INDEX_BYTES = 256 * 1024  # of the index are kept in memory, five minutes at 1 kHz
_MOST_IN_FILE = 1000  # topics that are named in the metadata inside a file
#: Brings files to the disk, one after the other.
_DISK = ThreadPoolExecutor(1, thread_name_prefix="fsync")
#: After a write that memory did not suffice for, the file may hold half a record as well.
_FAULTS = (OSError, MemoryError)

COMPRESSIONS = {
    "none": CompressionType.NONE,
    "lz4": CompressionType.LZ4,
    "zstd": CompressionType.ZSTD,
}
"""How the chunks of a file can be packed, by the words for it."""


class BagWriter:
    """Writes serialized messages into a new bag; also a context manager that closes it.

    It owns no clock: the caller stamps the messages and calls :meth:`flush`, best once a second.
    """

    def __init__(
        self,
        folder: Path | str,
        *,
        ros_distro: str = "jazzy",
        custom_data: Mapping[str, str] | None = None,
        compression: str = "none",
        max_bytes: int = 0,
        max_duration_ns: int = 0,
        sync: bool = True,
    ) -> None:
        """Create the folder, with the parents it needs, and open the first file.

        folder: must not exist.
        custom_data: text that goes into the metadata; :attr:`custom_data` takes more of it
        until the bag is closed.
        compression: of the chunks: "none", "lz4" (quick) or "zstd" (small).
        max_bytes: a file that has grown to this size is followed by a new one; 0: never.
        max_duration_ns: so is one during which the latest log time grew by so much, ns; 0: never.
        sync: bring what is flushed to the disk as well, so that it outlives a power cut.
        Raises BagError: the folder exists or cannot be made, or a value is out of range; nothing
        is left behind then.
        """
        if compression not in COMPRESSIONS:
            known = ", ".join(COMPRESSIONS)
            raise BagError(f"compression is {compression!r}; it has to be one of {known}")
        if max_bytes and max_bytes < _CHUNK_BYTES:
            raise BagError(
                f"max_bytes is {max_bytes}; it has to be {_CHUNK_BYTES} (one chunk) or more, or 0"
            )
        if max_duration_ns < 0:
            raise BagError(f"max_duration_ns is {max_duration_ns}; it has to be positive, or 0")
        self.folder = Path(folder).expanduser().absolute()
        #: text by key that stands in the metadata when the bag is closed
        self.custom_data: dict[str, str] = dict(custom_data or {})
        self.ros_distro = ros_distro  #: stands there too
        self.counts: dict[str, int] = {}  #: messages written so far, by topic
        self.files: list[FileSummary] = []  #: begun so far
        self.closed = True  #: whether the bag takes no more messages
        self._topics: dict[str, TopicDescription] = {}
        self._compression = COMPRESSIONS[compression]
        self._max_bytes = max_bytes
        self._max_duration_ns = max_duration_ns
        self._sync = sync
        self._syncing: Future[None] | None = None
        # Times may come from several clocks, or run back: the latest of all of them counts.
        self._latest_ns = self._began_ns = 0
        self._complete = False
        self._failure: OSError | MemoryError | None = None
        self._missing: list[Path] = []
        with self._naming("create"):
            self._missing = [p for p in (self.folder, *self.folder.parents) if not p.exists()]
            try:
                self.folder.mkdir(parents=True)
                self._begin_file()
            except FileExistsError as error:
                raise BagError(
                    f"output folder {self.folder} exists already; "
                    "name another one, or remove it if it is not needed"
                ) from error
            except _FAULTS:
                self.discard()
                raise

    def __enter__(self) -> BagWriter:
        """Return the open bag."""
        return self

    def __exit__(self, *error: object) -> None:
        """Close the bag in any case, so that the written data can be read."""
        self.close()

    @property
    def message_count(self) -> int:
        """Messages written so far."""
        return sum(self.counts.values())

    @property
    def size(self) -> int:
        """Bytes of all files so far, without the chunk that is being filled."""
        return sum(file.size for file in self.files) + (0 if self.closed else self._stream.tell())

    def add_topic(self, topic: TopicDescription) -> None:
        """Make a topic known; it stands in the metadata even if no message follows.

        Raises BagError: the topic is known already.
        """
        if topic.name in self._topics:
            raise BagError(f"topic {topic.name} is already in the bag {self.folder}; add it once")
        self._topics[topic.name] = topic
        self.counts[topic.name] = 0

    def write(
        self, topic_name: str, data: bytes, *, log_ns: int, publish_ns: int, sequence: int = 0
    ) -> None:
        """Append one message.

        topic_name: a topic made known with :meth:`add_topic`.
        data: the message in CDR, with its encapsulation header.
        log_ns: when it was received, ns since the Unix epoch.
        publish_ns: when it was published, ns since the Unix epoch.
        sequence: the publisher's number of the message, 0 if unknown.
        Raises BagError: unknown topic, closed bag, or a disk that takes no more.
        """
        if topic_name not in self._topics:
            raise BagError(f"topic {topic_name} is not in the bag {self.folder}; add it first")
        if self.closed:
            raise BagError(f"the bag {self.folder} is closed; write to a new one")
        self._latest_ns = max(self._latest_ns, log_ns)
        if not self.files[-1].messages:
            self._began_ns = self._latest_ns
        lasted = self._latest_ns - self._began_ns
        large = self._max_bytes and self._stream.tell() >= self._max_bytes
        if large or (self._max_duration_ns and lasted >= self._max_duration_ns):
            self.split()
            self._began_ns = self._latest_ns
        with self._naming("write"):
            channel = self._channels.get(topic_name) or self._new_channel(self._topics[topic_name])
            self._writer.add_message(channel, log_ns, data, publish_ns, sequence)
        file = self.files[-1]
        file.start_ns = min(file.start_ns, log_ns) if file.messages else log_ns
        file.end_ns = max(file.end_ns, log_ns)
        file.messages += 1
        self.counts[topic_name] += 1

    def _new_channel(self, topic: TopicDescription) -> int:
        """Write schema and channel, with the first message that needs them: a channel without
        messages would stand in the summary of the file but not in its data."""
        if topic.type not in self._schemas:
            self._schemas[topic.type] = self._writer.register_schema(
                topic.type, topic.schema_encoding, topic.schema.encode()
            )
        about = {
            "offered_qos_profiles": qos_yaml(topic.offered_qos),
            "topic_type_hash": topic.type_hash,
        }
        self._channels[topic.name] = self._writer.register_channel(
            topic.name, topic.encoding, self._schemas[topic.type], about
        )
        return self._channels[topic.name]

    def split(self) -> None:
        """Finish the file and go on with a new one; does nothing as long as the file is empty.

        Raises BagError: the disk does not take it; what was flushed before stays.
        """
        if not self.closed and self.files[-1].messages:
            with self._naming("write"):
                self._finish_file()
                self._begin_file()

    def flush(self) -> None:
        """Pass the written data to the operating system, so that it survives this process.

        Unless the bag was opened without ``sync``, a thread brings it to the disk meanwhile: a
        slow disk takes seconds.

        Raises BagError: the disk takes no more.
        """
        if not self.closed:
            with self._naming("write"):
                self._writer.flush()
                if self._sync and (self._syncing is None or self._syncing.done()):
                    self.wait_for_disk()
                    self._syncing = _DISK.submit(synchronize, self.folder / self.files[-1].name)

    def wait_for_disk(self) -> None:
        """Wait until the flushed data is on the disk.

        Raises BagError: the disk does not take it.
        """
        if self._syncing is not None:
            syncing, self._syncing = self._syncing, None
            with self._naming("write"):
                syncing.result()

    def close(self) -> None:
        """Finish the file, write ``metadata.yaml``, bring both to the disk; twice does no harm.

        Raises BagError: the disk does not take it; what was flushed before stays.
        """
        if self._complete:
            return
        self._complete = True
        with self._naming("close"):
            self._finish_file()
            text = indent(self._metadata(), "  ")
            write_text(self.folder / METADATA_FILE, f"{OUTER_KEY}:\n{text}")

    def discard(self) -> None:
        """Close the bag and remove it, with the parent folders that were made for it."""
        self._complete = True
        self._abandon_file()
        if self.folder in self._missing:
            shutil.rmtree(self.folder, ignore_errors=True)
        for parent in self._missing[1:]:
            with contextlib.suppress(OSError):
                parent.rmdir()

    def _metadata(self, in_file: bool = False) -> str:
        """Return the metadata of the bag as it is now, as YAML.

        in_file: for a record, of which most readers take no more than a megabyte; a file names its
        topics elsewhere, too.
        """
        topics = [(topic, self.counts[name]) for name, topic in self._topics.items()]
        if in_file and len(topics) > _MOST_IN_FILE:
            topics = []
        return yaml_text(bag_metadata(self.files, topics, self.ros_distro, self.custom_data))

    def _begin_file(self) -> None:
        """Create a file, with the profile and the records rosbag2 expects, as the bag is now."""
        file = FileSummary(f"{self.folder.name}_{len(self.files)}.mcap")
        path = self.folder / file.name
        try:
            metadata = {"serialized_metadata": self._metadata(in_file=True)}
            self._stream = path.open("xb")
            self.closed = False
            self._writer = Writer(
                self._stream,
                chunk_size=_CHUNK_BYTES,
                compression=self._compression,
                use_summary_offsets=False,  # the library writes some for what is not there
            )
            # The library keeps an object for each chunk, 0.2 MB a minute; no public way is there.
            indexes = _ChunkIndexes(self.folder)
            self._writer._Writer__chunk_indices = indexes  # type: ignore[attr-defined]
            self._schemas: dict[str, int] = {}
            self._channels: dict[str, int] = {}
            self._writer.start(profile="ros2", library=f"stickslip_ros {__version__}")
            self._writer.add_metadata("rosbag2", metadata)
            self._stream.flush()  # so that from here on it is a file that can be recovered
            synchronize(self.folder)
        except FileExistsError:  # somebody else's
            raise
        except BaseException:
            self._abandon_file()
            path.unlink(missing_ok=True)  # half a beginning would only be in the way
            raise
        self.files.append(file)

    def _finish_file(self) -> None:
        """Finish the file, if there is one; after a failure without an index, which would count
        too much."""
        if self.closed:
            return
        try:
            if self._failure:
                raise self._failure
            self._writer.flush()
            metadata = {"serialized_metadata": self._metadata(in_file=True)}
            self._writer.add_metadata("rosbag2", metadata)
            self._writer.finish()
            self._stream.flush()
            self.wait_for_disk()
            os.fsync(self._stream.fileno())
            self.files[-1].size = self._stream.tell()
        finally:
            self._abandon_file()

    def _abandon_file(self) -> None:
        """Close the file as it is, without an index; never fails."""
        if not self.closed:
            self.closed = True
            with contextlib.suppress(BagError):
                self.wait_for_disk()
            with contextlib.suppress(OSError):
                self._stream.close()

    @contextlib.contextmanager
    def _naming(self, action: str) -> Iterator[None]:
        """Turn errors of the operating system into a BagError that names the failed action."""
        try:
            yield
        except _FAULTS as error:
            self._failure = error
            text = f"cannot {action} the bag {self.folder}: {reason_and_cure(error)}"
            raise BagError(text) from error
        except WriteError as error:
            raise BagError(f"cannot {action} the bag {self.folder}: {error}") from error


class _ChunkIndexes:
    """Takes the place of a list of chunk indexes; many of them are kept as bytes in a file.

    The file has no name, so that nothing of it is left when the process is killed.
    """

    def __init__(self, folder: Path) -> None:
        self._file: IO[bytes] = tempfile.SpooledTemporaryFile(_INDEX_BYTES, dir=str(folder))  # noqa: SIM115  closed by write

    def append(self, index: ChunkIndex) -> None:
        """Take the index of a chunk that was written."""
        builder = RecordBuilder()
        index.write(builder)
        self._file.write(builder.end())

    def __iter__(self) -> Iterator[_ChunkIndexes]:
        """Yield this object, which writes all indexes into the summary."""
        yield self

    def write(self, summary: RecordBuilder) -> None:
        """Write them all."""
        self._file.seek(0)
        summary.write(self._file.read())
        self._file.close()
