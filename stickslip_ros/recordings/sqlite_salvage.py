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
from stickslip_ros.recordings.mcap_reader import BagMessage
from stickslip_ros.recordings.mcap_records import reading
from stickslip_ros.recordings.mcap_scanner import Damage
from stickslip_ros.recordings.metadata import TopicDescription
from stickslip_ros.recordings.qos import profiles_in_yaml

#: Beside a file: what was written and has not been taken over into it yet, or is to be undone
_LOGS = ("-wal", "-journal")


class DamagedSqlite:
    """One pass over a file; what it says of the file is complete when :meth:`messages` has ended.

    :ivar damage: what is wrong with the file; nothing in it has a checksum.
    """

    metadata_text = ""  # rosbag2 leaves none in these files

    def __init__(self, path: Path, on_bytes: Callable[[int], object]) -> None:
        """Open the file, or with a log beside it a copy of both: SQLite puts the log into the file.

        :param on_bytes: called with the bytes gone through since it was called last.
        :raises BagError: the operating system does not let us read it.
        """
        self.damage = Damage(path.name)
        self._on_bytes = on_bytes
        self._stack = contextlib.ExitStack()
        with reading(path):
            open_regular(path).close()
            self._allowance = Allowance(path)
            logs = [log for end in _LOGS if (log := path.with_name(path.name + end)).is_file()]
            if logs:
                self.damage.find("was not closed: what its log holds is taken as well")
                folder = self._stack.enter_context(tempfile.TemporaryDirectory())
                for file in (path, *logs):
                    shutil.copyfile(file, Path(folder, file.name))
                path = Path(folder, path.name)
            database = sqlite3.connect(f"{path.as_uri()}{'' if logs else '?immutable=1'}", uri=True)
            self._database = self._stack.enter_context(contextlib.closing(database))
            self._database.row_factory = sqlite3.Row

    def close(self) -> None:
        """Close the file."""
        self._stack.close()

    def first_compression(self) -> str:
        """Return "", for such files have none."""
        return ""

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
        with contextlib.suppress(sqlite3.OperationalError):  # older distributions have no table
            for row in self._database.execute("SELECT * FROM message_definitions"):
                definitions[row["topic_type"]] = row["encoding"], row["encoded_message_definition"]
        found = {}
        for row in map(dict, self._database.execute("SELECT * FROM topics")):
            encoding, schema = definitions.get(row["type"]) or _known_schema(row["type"])
            qos = ()
            with contextlib.suppress(ValueError):
                qos = profiles_in_yaml(row.get("offered_qos_profiles") or "")
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


def _known_schema(kind: str) -> tuple[str, str]:
    """Return encoding and text of a definition that ``rosbags`` knows, empty ones if not."""
    with contextlib.suppress(ImportError, KeyError):
        from rosbags.typesys import Stores, get_typestore

        return "ros2msg", get_typestore(Stores.LATEST).generate_msgdef(kind, ros_version=2)[0]
    return "", ""
