# SPDX-License-Identifier: Apache-2.0
"""Bags that are no MCAP, through ``rosbags``: rosbag2 in sqlite3, and those of ROS 1.

Their messages come as CDR with a ``ros2msg`` schema, so that everything else need not know.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_ros.recordings.errors import BagError
from stickslip_ros.recordings.mcap_reader import BagMessage
from stickslip_ros.recordings.metadata import FileSummary, StoredMetadata, TopicDescription
from stickslip_ros.recordings.qos import OfferedQos
from stickslip_ros.recordings.reader import BagReader

if TYPE_CHECKING:
    from rosbags.interfaces import Connection


class OtherBag(BagReader):
    """A recording in another format than MCAP, open for reading."""

    def __init__(self, path: Path, stored: StoredMetadata | None) -> None:
        """Open a folder or a file.

        :param stored: what its ``metadata.yaml`` says, None if there is none.
        :raises BagError: it cannot be read, or ``rosbags`` is not installed.
        """
        try:
            from rosbags.highlevel import AnyReader
            from rosbags.typesys import Stores, get_typestore
        except ImportError:
            raise BagError(
                f"{path} is not an MCAP bag; pip install 'stickslip_ros[formats]' to read bags of "
                "sqlite3 and of ROS 1"
            ) from None
        super()._begin(path)
        self._reader: Any = None
        if stored and stored.compression_mode:
            raise BagError(
                f"{path} is compressed, which only MCAP bags may be; unpack it with "
                "`ros2 bag convert`"
            )
        try:
            # Definitions stand in bags of ROS 1 and, since Iron, in those of ROS 2.
            store = None if path.suffix == ".bag" else get_typestore(Stores.LATEST)
            paths = [path] if stored or path.is_file() else sorted(path.glob("*.db3"))
            reader = AnyReader(paths, default_typestore=store)
            reader.open()
            self._reader = reader
            self._describe(stored or StoredMetadata(storage="", version=0))
        except BagError:
            raise
        except Exception as error:  # whatever a damaged file leads to, in several libraries
            self.close()
            raise self._unreadable(error) from error

    def close(self) -> None:
        """Close the files; twice does no harm."""
        if self._reader is not None:
            self._reader.close()
            self._reader = None

    def _describe(self, stored: StoredMetadata) -> None:
        reader = self._reader
        self.metadata = stored
        counts: Counter[str] = Counter()
        for connection in reader.connections:
            self.topics.setdefault(connection.topic, self._topic(connection, stored))
            counts[connection.topic] += connection.msgcount
        self.topics = dict(sorted(self.topics.items()))
        self.counts = {name: counts[name] for name in self.topics}
        count = sum(counts.values())
        files = [self.path] if self.path.is_file() else sorted(self.path.glob("*.db3"))
        self.sizes = {file.name: file.stat().st_size for file in files}
        ends = (reader.start_time, reader.end_time - 1) if count else (0, 0)
        self.files = [FileSummary(files[0].name, count, *ends)]
        self.files += [FileSummary(file.name, 0, 0, 0) for file in files[1:]]
        self.compressions = []
        self.libraries = ["rosbag2 sqlite3" if reader.is2 else "rosbag of ROS 1"]

    def _topic(self, connection: Connection, stored: StoredMetadata) -> TopicDescription:
        store = self._reader.typestore
        schema = ""
        if connection.msgtype in store.fielddefs:
            schema = store.generate_msgdef(connection.msgtype, ros_version=2)[0]
        topic = TopicDescription(
            name=connection.topic,
            type=connection.msgtype,
            schema=schema,
            type_hash=connection.digest if self._reader.is2 else "",
            offered_qos=() if self._reader.is2 else (OfferedQos(),),
        )
        return stored.completed(topic)

    def messages(
        self,
        topics: Iterable[str] | None = None,
        start: int | None = None,
        end: int | None = None,
    ) -> Iterator[BagMessage]:
        """Yield messages in order of time, as :meth:`BagReader.messages` does.

        :raises BagError: a topic is not in the bag; while reading: a file is damaged.
        """
        wanted = self._wanted(topics, start, end)
        return self._yield_messages(wanted.topics, wanted.start_ns, wanted.end_ns)

    def _yield_messages(
        self, topics: frozenset[str] | None, start: int, end: int
    ) -> Iterator[BagMessage]:
        reader = self._reader
        chosen = [c for c in reader.connections if topics is None or c.topic in topics]
        if not chosen:
            return
        try:
            found = reader.messages(chosen, start=start or None, stop=min(end, 2**63 - 1))
            for connection, ns, data in found:
                if not reader.is2:
                    message = reader.deserialize(data, connection.msgtype)
                    data = reader.typestore.serialize_cdr(message, connection.msgtype)
                yield BagMessage(connection.topic, ns, ns, 0, bytes(data))
        except Exception as error:  # as when opening
            raise self._unreadable(error) from error

    def _unreadable(self, error: Exception) -> BagError:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        return BagError(
            f"{self.path} cannot be read: {reason}; record it anew, or make an MCAP bag of it with "
            "`ros2 bag convert`"
        )
