# SPDX-License-Identifier: Apache-2.0
"""Messages out of a SQLite file of rosbag2 whose recorder was killed.

``rosbags`` opens finished files: it does not look at the log that SQLite keeps beside a file while
it is written, and refuses one that ends too early. SQLite itself reads what is there.
"""

from __future__ import annotations

import contextlib
import shutil
import sqlite3
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from stickslip_ros.opening import Allowance, open_regular
from stickslip_ros.recordings.damage_scanner import Damage
from stickslip_ros.recordings.mcap_reader import BagMessage
from stickslip_ros.recordings.mcap_records import reading
from stickslip_ros.recordings.metadata import TopicDescription
from stickslip_ros.recordings.qos import OfferedQos, qos_profiles

_MAGIC = b"SQLite format 3\0"
_HEAD_BYTES = 100
#: Endings of the files beside a database that hold what is not in it yet, or is to be undone
_LOGS = ("-wal", "-journal")


class DamagedSqlite:
    """One pass over a file; its attributes are complete when :meth:`messages` has ended.

    :ivar damage: what is wrong with the file; nothing in it has a checksum.
    """

    metadata_text = compression = ""  # such files have neither

    def __init__(self, path: Path, on_bytes: Callable[[int], object]) -> None:
        """Open the file; open a copy if it is cut, or has a log that SQLite merges into it.

        :param on_bytes: called with the bytes gone through since it was called last.
        :raises BagError: the operating system does not let us read it.
        """
        self.damage = Damage(path.name)
        self._on_bytes = on_bytes
        self._stack = contextlib.ExitStack()
        with reading(path):
            with open_regular(path) as stream:
                head = stream.read(_HEAD_BYTES)
            self.damage.looks_right = head.startswith(_MAGIC) or not head
            self._allowance = Allowance(path)
            missing = _size_in(head) - path.stat().st_size
            logs = [log for end in _LOGS if (log := path.with_name(path.name + end)).is_file()]
            if logs:
                self.damage.find("was not closed: what its log holds is taken as well")
            if logs or missing > 0:
                path = self._copy(path, logs, max(0, missing))
            place = f"{path.as_uri()}{'' if logs else '?immutable=1'}"
            self._database = sqlite3.connect(place, uri=True)
            self._stack.callback(self._database.close)
            self._database.row_factory = sqlite3.Row

    def _copy(self, path: Path, logs: list[Path], missing: int) -> Path:
        """Return a temporary copy; zeros fill it up to the size that the file had before a cut."""
        folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory()))
        for file in (path, *logs):
            shutil.copyfile(file, folder / file.name)
        self._allowance.spend(missing)
        with (folder / path.name).open("r+b") as stream:
            stream.truncate(path.stat().st_size + missing)
        return folder / path.name

    def close(self) -> None:
        """Close the file."""
        self._stack.close()

    def messages(self) -> Iterator[tuple[TopicDescription, BagMessage]]:
        """Yield every message that can be read, in the order of the file."""
        damage = self.damage
        try:
            topics = self._topics()
            rows = self._database.execute("SELECT topic_id, timestamp, data FROM messages")
            for number, ns, data in rows:
                if number not in topics or not isinstance(data, bytes) or not isinstance(ns, int):
                    damage.dropped_bytes += len(data) if isinstance(data, bytes) else 0
                    continue
                self._allowance.spend(len(data))
                self._on_bytes(len(data))
                damage.unprotected += 1
                yield topics[number], BagMessage(topics[number].name, ns, ns, 0, data)
        except (sqlite3.Error, OverflowError) as error:
            damage.find(f"is damaged: {error}; what comes before it is taken")
        if damage.dropped_bytes:
            damage.find(f"is damaged: {damage.dropped_bytes} bytes were left out")

    def _topics(self) -> dict[int, TopicDescription]:
        definitions = {}
        with contextlib.suppress(sqlite3.Error):  # lost, or never there before Iron
            for row in self._database.execute("SELECT * FROM message_definitions"):
                definitions[row["topic_type"]] = row["encoding"], row["encoded_message_definition"]
        found = {}
        for row in map(dict, self._database.execute("SELECT * FROM topics")):
            encoding, schema = definitions.get(row["type"]) or _known_schema(row["type"])
            qos: tuple[OfferedQos, ...] = ()
            with contextlib.suppress(ValueError):
                qos = qos_profiles(row.get("offered_qos_profiles") or "")
            found[row["id"]] = TopicDescription(
                row["name"],
                row["type"],
                schema,
                row.get("type_description_hash") or "",
                qos,
                encoding,
                row["serialization_format"],
            )
        return found


def _size_in(head: bytes) -> int:
    """Return the size (bytes) that the head of a file says it has; 65536 is written as 1."""
    page = int.from_bytes(head[16:18], "big")
    return (65536 if page == 1 else page) * int.from_bytes(head[28:32], "big")


def _known_schema(kind: str) -> tuple[str, str]:
    """Return encoding and text of a definition that ``rosbags`` knows, empty ones if not."""
    with contextlib.suppress(ImportError, KeyError):
        from rosbags.typesys import Stores, get_typestore

        return "ros2msg", get_typestore(Stores.LATEST).generate_msgdef(kind, ros_version=2)[0]
    return "", ""
