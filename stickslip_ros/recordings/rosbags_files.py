# SPDX-License-Identifier: Apache-2.0
"""The files of a bag of SQLite or of ROS 1 as one, through ``rosbags``.

Their messages come as CDR with a ``ros2msg`` schema, so that everything else need not know.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_ros.opening import open_regular
from stickslip_ros.recordings.errors import BagError, short
from stickslip_ros.recordings.mcap_reader import Wanted
from stickslip_ros.recordings.mcap_records import BagMessage
from stickslip_ros.recordings.metadata import FileSummary, StoredMetadata, TopicDescription
from stickslip_ros.recordings.qos import OfferedQos

if TYPE_CHECKING:
    from rosbags.interfaces import Connection


class RosbagsFiles:
    """Open files; they have the attributes of :class:`McapFiles`."""

    metadata = StoredMetadata(storage="", version=0)  # there are none inside

    def __init__(self, path: Path, files: list[Path]) -> None:
        """Open the files by themselves, because the topics in ``metadata.yaml`` may be wrong.

        :raises BagError: one cannot be read, or ``rosbags`` is not installed.
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
        for file in files:
            open_regular(file).close()
        try:
            # Definitions stand in bags of ROS 1 and, since Iron, in those of ROS 2.
            store = None if path.suffix == ".bag" else get_typestore(Stores.LATEST)
            reader = AnyReader(files, default_typestore=store)
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

    def _describe(self, files: list[Path]) -> None:
        reader = self._reader
        for connection in reader.connections:
            self.topics.setdefault(connection.topic, self._topic(connection))
            self.counts[connection.topic] += connection.msgcount
        self.files = [
            FileSummary(
                file.name,
                file.stat().st_size,
                one.message_count,
                *((one.start_time, one.end_time - 1) if one.message_count else ()),
            )
            for file, one in zip(files, reader.readers, strict=True)
        ]
        self.libraries = ["rosbag2 sqlite3" if reader.is2 else "rosbag of ROS 1"]

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

    def messages(self, wanted: Wanted) -> Iterator[BagMessage]:
        """Yield messages in order of time.

        :raises BagError: a file is damaged.
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
