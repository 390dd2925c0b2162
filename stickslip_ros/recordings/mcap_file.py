# SPDX-License-Identifier: Apache-2.0
"""One ``.mcap`` storage file of a bag, with the profile and the records rosbag2 expects."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from mcap.writer import CompressionType, Writer

from stickslip_ros import __version__
from stickslip_ros.recordings.metadata import (
    BagMetadata,
    FileSummary,
    TopicDescription,
    metadata_yaml,
)
from stickslip_ros.recordings.qos import qos_yaml

# The writer closes a chunk with the first message that passes this size, so it lies below the
# 64 KiB that may be lost at most when the process dies.
CHUNK_BYTES = 48 * 1024

COMPRESSIONS = {
    "none": CompressionType.NONE,
    "lz4": CompressionType.LZ4,
    "zstd": CompressionType.ZSTD,
}
"""How the chunks of a file can be packed, by the words for it."""


class McapFile:
    """Appends messages to a new file and knows how many, from when to when.

    Schemas and channels are written with the first message that needs them: a channel without
    messages would stand in the summary of the file but not in its data.
    """

    def __init__(self, path: Path, metadata: BagMetadata, compression: str = "none") -> None:
        """Create the file.

        :param path: must not exist.
        :param metadata: the state of the bag at this moment, kept inside the file as well.
        :param compression: one of :data:`COMPRESSIONS`.
        :raises OSError: the file cannot be created or exists.
        """
        self.path = path
        self._stream = path.open("xb")
        self._writer = Writer(
            self._stream,
            chunk_size=CHUNK_BYTES,
            compression=COMPRESSIONS[compression],
            use_summary_offsets=False,  # the library writes some of them for what is not there
        )
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._count = 0
        self._start_ns = 0
        self._end_ns = 0
        try:
            self._writer.start(profile="ros2", library=f"stickslip_ros {__version__}")
            self._add_metadata(metadata)
            self._stream.flush()  # so that from here on it is a file that can be recovered
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

    def flush(self) -> None:
        """Hand everything written so far to the operating system."""
        self._writer.flush()

    def finish(self, metadata: BagMetadata) -> None:
        """Write the final metadata and the index, bring it to the disk, close the file."""
        try:
            self._writer.flush()
            self._add_metadata(metadata)
            self._writer.finish()
            self._stream.flush()
            os.fsync(self._stream.fileno())
        finally:
            self.abandon()

    def abandon(self) -> None:
        """Close the file as it is, without an index; never fails."""
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

    def _add_metadata(self, metadata: BagMetadata) -> None:
        self._writer.add_metadata("rosbag2", {"serialized_metadata": metadata_yaml(metadata)})
