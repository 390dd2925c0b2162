# SPDX-License-Identifier: Apache-2.0
"""One ``.mcap`` storage file of a bag, with the profile and the records rosbag2 expects."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import IO, Any

import yaml
from mcap.data_stream import RecordBuilder
from mcap.records import ChunkIndex
from mcap.writer import CompressionType, Writer

from stickslip_ros.files import synchronize
from stickslip_ros.recordings.metadata import FileSummary, TopicDescription
from stickslip_ros.recordings.qos import qos_yaml
from stickslip_ros.version import __version__

# The writer closes a chunk with the first message that passes this size, so it lies below the
# 64 KiB that may be lost at most when the process dies.
CHUNK_BYTES = 48 * 1024

_INDEX_BYTES = 256 * 1024  # of the index are kept in memory, five minutes at 1 kHz
#: Brings files to the disk, one after the other.
_DISK = ThreadPoolExecutor(1, thread_name_prefix="fsync")

COMPRESSIONS = {
    "none": CompressionType.NONE,
    "lz4": CompressionType.LZ4,
    "zstd": CompressionType.ZSTD,
}
"""How the chunks of a file can be packed, by the words for it."""


class McapWriter:
    """Appends messages to a new file and knows how many, from when to when.

    Schemas and channels are written with the first message that needs them: a channel without
    messages would stand in the summary of the file but not in its data.
    """

    def __init__(self, path: Path, metadata: dict[str, Any], compression: str = "none") -> None:
        """Create the file.

        :param path: must not exist.
        :param metadata: the state of the bag at this moment, kept inside the file as well.
        :param compression: one of :data:`COMPRESSIONS`.
        :raises OSError: the file cannot be created or exists.
        """
        self.path = path
        self._stream = path.open("xb")
        self._syncing: Future[None] | None = None
        self._writer = Writer(
            self._stream,
            chunk_size=CHUNK_BYTES,
            compression=COMPRESSIONS[compression],
            use_summary_offsets=False,  # the library writes some of them for what is not there
        )
        # The library keeps an object for each chunk, 0.2 MB a minute; there is no public way in.
        self._writer._Writer__chunk_indices = _ChunkIndexes(path.parent)  # type: ignore[attr-defined]
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._count = 0
        self._start_ns = 0
        self._end_ns = 0
        try:
            self._writer.start(profile="ros2", library=f"stickslip_ros {__version__}")
            self._add_metadata(metadata)
            self._stream.flush()  # so that from here on it is a file that can be recovered
            synchronize(path.parent)
        except BaseException:
            self.abandon()
            raise

    def summary(self) -> FileSummary:
        """Return name, message count, first and last log time."""
        return FileSummary(self.path.name, self._count, self._start_ns, self._end_ns)

    @property
    def size(self) -> int:
        """Bytes of the file so far, without the chunk that is being filled."""
        return self._stream.tell()

    @property
    def start_ns(self) -> int | None:
        """Earliest log time so far, None if there is no message."""
        return self._start_ns if self._count else None

    def write(
        self, topic: TopicDescription, data: bytes, log_ns: int, publish_ns: int, sequence: int
    ) -> None:
        """Append one serialized message; times in nanoseconds since the Unix epoch.

        :raises OSError: the disk does not take it.
        """
        channel = self._channels.get(topic.name)
        if channel is None:
            channel = self._channels[topic.name] = self._register(topic)
        self._writer.add_message(
            channel, log_time=log_ns, data=data, publish_time=publish_ns, sequence=sequence
        )
        self._start_ns = min(self._start_ns, log_ns) if self._count else log_ns
        self._end_ns = max(self._end_ns, log_ns)
        self._count += 1

    def flush(self, sync: bool) -> None:
        """Hand everything written so far to the operating system.

        :param sync: begin to bring it to the disk, too, in a thread: a slow disk takes seconds.
        :raises OSError: the disk does not take it, or did not take what was flushed before.
        """
        self._writer.flush()
        if sync and (self._syncing is None or self._syncing.done()):
            self.wait_for_disk()
            self._syncing = _DISK.submit(_synchronize, os.dup(self._stream.fileno()))

    def wait_for_disk(self) -> None:
        """Wait until the data flushed with ``sync`` is on the disk; OSError if that failed."""
        if self._syncing is not None:
            syncing, self._syncing = self._syncing, None
            syncing.result()

    def finish(self, metadata: dict[str, Any]) -> None:
        """Write the final metadata and the index, bring it to the disk; :meth:`abandon` closes it.

        :raises OSError: the disk does not take it, or did not take what was flushed before.
        """
        self._writer.flush()
        self._add_metadata(metadata)
        self._writer.finish()
        self._stream.flush()
        self.wait_for_disk()
        os.fsync(self._stream.fileno())

    def abandon(self) -> None:
        """Close the file as it is, without an index; never fails."""
        with contextlib.suppress(OSError):
            self.wait_for_disk()
        with contextlib.suppress(OSError):
            self._stream.close()

    def _register(self, topic: TopicDescription) -> int:
        if topic.type not in self._schemas:
            self._schemas[topic.type] = self._writer.register_schema(
                topic.type, topic.schema_encoding, topic.schema.encode()
            )
        return self._writer.register_channel(
            topic.name,
            topic.encoding,
            self._schemas[topic.type],
            {
                "offered_qos_profiles": qos_yaml(topic.offered_qos),
                "topic_type_hash": topic.type_hash,
            },
        )

    def _add_metadata(self, metadata: dict[str, Any]) -> None:
        self._writer.add_metadata(
            "rosbag2", {"serialized_metadata": yaml.safe_dump(metadata, sort_keys=False)}
        )


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


def _synchronize(file: int) -> None:
    try:
        os.fsync(file)
    finally:
        os.close(file)
