# SPDX-License-Identifier: Apache-2.0
"""Bags of any format: MCAP by our own reader, those of SQLite and of ROS 1 through ``rosbags``.

Their messages come as CDR with a ``ros2msg`` schema, so that everything else need not know.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_ros.opening import open_regular
from stickslip_ros.recordings.errors import BagError
from stickslip_ros.recordings.folder import stored_metadata
from stickslip_ros.recordings.mcap_reader import BagMessage, Wanted
from stickslip_ros.recordings.mcap_records import reading
from stickslip_ros.recordings.metadata import FileSummary, StoredMetadata, TopicDescription
from stickslip_ros.recordings.qos import OfferedQos
from stickslip_ros.recordings.reader import BagReader

if TYPE_CHECKING:
    from rosbags.interfaces import Connection


#: Ends of the names of storage files that are read through ``rosbags``
_SQLITE, _ROS_1 = (".db3",), (".bag",)


def open_bag(path: Path | str) -> BagReader:
    """Open a recording: a rosbag2 folder, one ``.mcap`` or ``.db3`` file, a ``.bag`` of ROS 1.

    :raises BagError: it cannot be read; the text names the file and the cure.
    """
    path = Path(path).expanduser().absolute()
    with reading(path):
        stored = stored_metadata(path)
        if path.is_dir():
            told = stored.storage == "sqlite3" if stored else not any(path.glob("*.mcap*"))
            other = told and any(path.glob("*.db3"))
        else:
            other = path.suffix in (*_SQLITE, *_ROS_1) and path.exists()
        return OtherBag(path, stored) if other else BagReader(path)


class OtherBag(BagReader):
    """A recording in another format than MCAP, open for reading."""

    def __init__(self, path: Path, stored: StoredMetadata | None) -> None:
        """Open its files by themselves: what ``metadata.yaml`` says of topics need not be so.

        :param path: a folder or a file.
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
        files = self._storage_files(stored, _SQLITE)
        for file in files:
            open_regular(file).close()
        try:
            # Definitions stand in bags of ROS 1 and, since Iron, in those of ROS 2.
            store = None if path.suffix == ".bag" else get_typestore(Stores.LATEST)
            reader = AnyReader(files, default_typestore=store)
            reader.open()
            self._reader = reader
            self._describe(files, stored or StoredMetadata(storage="", version=0))
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

    def _describe(self, files: list[Path], stored: StoredMetadata) -> None:
        reader = self._reader
        self.metadata = stored
        counts: Counter[str] = Counter()
        for connection in reader.connections:
            self.topics.setdefault(connection.topic, self._topic(connection))
            counts[connection.topic] += connection.msgcount
        self.topics = dict(sorted(self.topics.items()))
        self.counts = {name: counts[name] for name in self.topics}
        self.sizes = {file.name: file.stat().st_size for file in files}
        self.files = [
            FileSummary(file.name, one.message_count, one.start_time, one.end_time - 1)
            if one.message_count
            else FileSummary(file.name, 0, 0, 0)
            for file, one in zip(files, reader.readers, strict=True)
        ]
        self.compressions = []
        self.libraries = ["rosbag2 sqlite3" if reader.is2 else "rosbag of ROS 1"]
        self._compare_with_metadata()

    def _topic(self, connection: Connection) -> TopicDescription:
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
        return self.metadata.completed(topic)

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
        chosen = [
            connection
            for connection in self._reader.connections
            if wanted.topics is None or connection.topic in wanted.topics
        ]
        return self._in_turn(chosen, wanted) if chosen else iter(())

    def _in_turn(self, chosen: list[Connection], wanted: Wanted) -> Iterator[BagMessage]:
        reader, count = self._reader, 0
        try:
            stop = min(wanted.end_ns, 2**63 - 1)
            for connection, ns, data in reader.messages(chosen, wanted.start_ns or None, stop):
                if not reader.is2:
                    message = reader.deserialize(data, connection.msgtype)
                    data = reader.typestore.serialize_cdr(message, connection.msgtype)
                count += 1
                yield BagMessage(connection.topic, ns, ns, 0, bytes(data))
        except Exception as error:  # as when opening
            raise self._unreadable(error) from error
        self._compare_counts(wanted, count)

    def _unreadable(self, error: Exception) -> BagError:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        return BagError(
            f"{self.path} cannot be read: {reason}; record it anew, or make an MCAP bag of it with "
            "`ros2 bag convert`"
        )
