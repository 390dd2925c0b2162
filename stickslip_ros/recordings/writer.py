# SPDX-License-Identifier: Apache-2.0
"""Writer of a rosbag2 folder: ``metadata.yaml`` and ``<name>_0.mcap``, ``<name>_1.mcap``, ..."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from stickslip_ros.files import WriteError, reason_and_cure, write_text
from stickslip_ros.recordings.errors import BagError
from stickslip_ros.recordings.mcap_writer import CHUNK_BYTES, COMPRESSIONS, McapWriter
from stickslip_ros.recordings.metadata import (
    METADATA_FILE,
    FileSummary,
    TopicDescription,
    bag_metadata,
    in_file,
)

#: After a write that memory did not suffice for, the file may hold half a record as well.
_FAULTS = (OSError, MemoryError)


class BagWriter:
    """Writes serialized messages into a new bag; also a context manager that closes it.

    It owns no clock: the caller stamps the messages and calls :meth:`flush`, best once a second.

    :ivar custom_data: text by key that stands in the metadata when the bag is closed.
    :ivar ros_distro: stands there too.
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

        :param folder: must not exist.
        :param custom_data: text that goes into the metadata; :attr:`custom_data` takes more of it
            until the bag is closed.
        :param compression: of the chunks: "none", "lz4" (quick) or "zstd" (small).
        :param max_bytes: a file that has grown to this size is followed by a new one; 0: never.
        :param max_duration_ns: so is one whose messages cover this time in ns; 0: never.
        :param sync: bring what is flushed to the disk as well, so that it outlives a power cut.
        :raises BagError: the folder exists or cannot be made, or a value is out of range; nothing
            is left behind then.
        """
        _check(compression, max_bytes, max_duration_ns)
        self.folder = Path(folder).expanduser().absolute()
        self.custom_data: dict[str, str] = dict(custom_data or {})
        self.ros_distro = ros_distro
        self._topics: dict[str, TopicDescription] = {}
        self._counts: dict[str, int] = {}
        self._compression = compression
        self._max_bytes = max_bytes
        self._max_duration_ns = max_duration_ns
        self._sync = sync
        self._finished: list[FileSummary] = []
        self._finished_size = 0
        self._file: McapWriter | None = None
        self._complete = False
        self._failure: OSError | MemoryError | None = None
        self._missing: list[Path] = []
        with self._telling("create"):
            self._missing = [p for p in (self.folder, *self.folder.parents) if not p.exists()]
            try:
                self.folder.mkdir(parents=True)
                self._file = self._new_file()
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
    def closed(self) -> bool:
        """Whether the bag takes no more messages."""
        return self._file is None

    @property
    def counts(self) -> dict[str, int]:
        """Messages written so far, by topic."""
        return dict(self._counts)

    @property
    def message_count(self) -> int:
        """Messages written so far."""
        return sum(self._counts.values())

    @property
    def file_count(self) -> int:
        """Files begun so far."""
        return len(self._finished) + (self._file is not None)

    @property
    def size(self) -> int:
        """Bytes of all files so far, without the chunk that is being filled."""
        return self._finished_size + (self._file.size if self._file else 0)

    def metadata(self) -> dict[str, Any]:
        """Return the metadata of the bag as it is now."""
        files = [*self._finished, *([self._file.summary()] if self._file else [])]
        topics = [(topic, self._counts[name]) for name, topic in self._topics.items()]
        return bag_metadata(files, topics, self.ros_distro, self.custom_data)

    def has_topic(self, name: str) -> bool:
        """Return whether :meth:`add_topic` was called for that topic."""
        return name in self._topics

    def add_topic(self, topic: TopicDescription) -> None:
        """Make a topic known; it stands in the metadata even if no message follows.

        :raises BagError: the topic is known already.
        """
        if topic.name in self._topics:
            raise BagError(f"topic {topic.name} is already in the bag {self.folder}; add it once")
        self._topics[topic.name] = topic
        self._counts[topic.name] = 0

    def write(
        self, topic_name: str, data: bytes, *, log_ns: int, publish_ns: int, sequence: int = 0
    ) -> None:
        """Append one message.

        :param topic_name: a topic made known with :meth:`add_topic`.
        :param data: the message in CDR, with its encapsulation header.
        :param log_ns: when it was received, ns since the Unix epoch.
        :param publish_ns: when it was published, ns since the Unix epoch.
        :param sequence: the publisher's number of the message, 0 if unknown.
        :raises BagError: unknown topic, closed bag, or a disk that takes no more.
        """
        topic = self._topics.get(topic_name)
        if topic is None:
            raise BagError(f"topic {topic_name} is not in the bag {self.folder}; add it first")
        if self._file is None:
            raise BagError(f"the bag {self.folder} is closed; write to a new one")
        if self._is_full(self._file, log_ns):
            self.split()
        with self._telling("write"):
            self._file.write(topic, data, log_ns, publish_ns, sequence)
        self._counts[topic_name] += 1

    def split(self) -> None:
        """Finish the file and go on with a new one; does nothing as long as the file is empty.

        :raises BagError: the disk does not take it; what was flushed before stays.
        """
        if self._file is None or self._file.start_ns is None:
            return
        with self._telling("write"):
            metadata = self.metadata()
            file, self._file = self._file, None  # if that fails, the bag takes no more
            self._finish(file, metadata)
            self._finished.append(file.summary())
            self._finished_size += file.path.stat().st_size
            self._file = self._new_file()

    def flush(self) -> None:
        """Pass the written data to the operating system, so that it survives this process.

        Unless the bag was opened without ``sync``, a thread brings it to the disk meanwhile.

        :raises BagError: the disk takes no more.
        """
        if self._file is not None:
            with self._telling("write"):
                self._file.flush(self._sync)

    def wait_for_disk(self) -> None:
        """Wait until the flushed data is on the disk.

        :raises BagError: the disk does not take it.
        """
        if self._file is not None:
            with self._telling("write"):
                self._file.wait_for_disk()

    def close(self) -> None:
        """Finish the file, write ``metadata.yaml``, bring both to the disk; twice does no harm.

        :raises BagError: the disk does not take it; what was flushed before stays.
        """
        if self._complete:
            return
        file, self._complete = self._file, True
        try:
            with self._telling("close"):
                metadata = self.metadata()
                if file is not None:
                    self._finish(file, metadata)
                text = yaml.safe_dump(in_file(metadata), sort_keys=False)
                write_text(self.folder / METADATA_FILE, text)
        finally:
            self._file = None
            if file is not None:
                file.abandon()

    def discard(self) -> None:
        """Close the bag and remove it, with the parent folders that were made for it."""
        if self._file is not None:
            self._file.abandon()
        self._file, self._complete = None, True
        if self.folder in self._missing:
            shutil.rmtree(self.folder, ignore_errors=True)
        for parent in self._missing[1:]:
            with contextlib.suppress(OSError):
                parent.rmdir()

    def _finish(self, file: McapWriter, metadata: dict[str, Any]) -> None:
        """Finish and close a file; after a failure without an index, which would count too much."""
        try:
            if self._failure:
                raise self._failure
            file.finish(metadata)
        finally:
            file.abandon()

    def _new_file(self) -> McapWriter:
        path = self.folder / f"{self.folder.name}_{len(self._finished)}.mcap"
        try:
            return McapWriter(path, self.metadata(), self._compression)
        except FileExistsError:  # somebody else's
            raise
        except _FAULTS:
            path.unlink(missing_ok=True)  # half a beginning would only be in the way
            raise

    def _is_full(self, file: McapWriter, log_ns: int) -> bool:
        if self._max_bytes and file.size >= self._max_bytes:
            return True
        start_ns = file.start_ns
        return bool(
            self._max_duration_ns
            and start_ns is not None
            and log_ns - start_ns >= self._max_duration_ns
        )

    @contextlib.contextmanager
    def _telling(self, action: str) -> Iterator[None]:
        """Turn errors of the operating system into a BagError that names the failed action."""
        try:
            yield
        except _FAULTS as error:
            self._failure = error
            text = f"cannot {action} the bag {self.folder}: {reason_and_cure(error)}"
            raise BagError(text) from error
        except WriteError as error:
            raise BagError(f"cannot {action} the bag {self.folder}: {error}") from error


def _check(compression: str, max_bytes: int, max_duration_ns: int) -> None:
    if compression not in COMPRESSIONS:
        known = ", ".join(COMPRESSIONS)
        raise BagError(f"compression is {compression!r}; it has to be one of {known}")
    if max_bytes and max_bytes < CHUNK_BYTES:
        raise BagError(
            f"max_bytes is {max_bytes}; it has to be {CHUNK_BYTES} (one chunk) or more, or 0"
        )
    if max_duration_ns < 0:
        raise BagError(f"max_duration_ns is {max_duration_ns}; it has to be positive, or 0")
