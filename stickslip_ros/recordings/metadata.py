# SPDX-License-Identifier: Apache-2.0
"""The folder of a bag: its ``metadata.yaml``, and which storage files there are.

Metadata are written in version 9 and read in every version.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from stickslip_ros.base.opening import open_regular
from stickslip_ros.physics.parameters.bounded_files import load_texts
from stickslip_ros.recordings.errors import BagError, reading, short
from stickslip_ros.recordings.qos import OfferedQos, YamlFields, qos_profiles

METADATA_FILE = "metadata.yaml"
METADATA_VERSION = 9
"""The version that is written, and the newest that is read."""

CDR = "cdr"
"""The format of the messages of ROS 2."""

OUTER_KEY = "rosbag2_bagfile_information"
"""The key of ``metadata.yaml`` that holds the metadata of a bag."""

# As much YAML as is read anywhere. That of 1500 topics is longer, but can be done without.
_METADATA_BYTES = 1024 * 1024
#: Ends of the names of storage files, by the word of ``metadata.yaml`` for their kind
_ENDS = {"mcap": (".mcap", ".mcap.zstd"), "sqlite3": (".db3",)}
_STARTS = {b"\x89MCAP0": "mcap", b"SQLite format 3\0": "sqlite3", b"#ROSBAG V": "ros1"}


@dataclass(frozen=True)
class TopicDescription:
    """A topic as a bag keeps it."""

    name: str
    type: str  #: such as ``sensor_msgs/msg/JointState``
    schema: str  #: the ``ros2msg`` text of the type with everything inside it
    type_hash: str = ""  #: ``RIHS01_...``, empty when not known
    offered_qos: tuple[OfferedQos, ...] = ()  #: one entry a publisher
    schema_encoding: str = "ros2msg"  #: the language of the schema
    encoding: str = CDR  #: the format of the messages


@dataclass(frozen=True)
class FileSummary:
    """Name of a storage file, its size on the disk (bytes), how many messages it has, from when to
    when (log times in ns, 0 without messages)."""

    name: str
    size: int = 0
    messages: int = 0
    start_ns: int = 0
    end_ns: int = 0


def bag_metadata(
    files: Sequence[FileSummary],
    topics: Sequence[tuple[TopicDescription, int]],
    ros_distro: str,
    custom_data: Mapping[str, str],
) -> dict[str, Any]:
    """Return the metadata of a bag of MCAP files; rosbag2 needs every key.

    files: every storage file, in order of time.
    topics: every topic with the count of its messages.
    custom_data: free text by key, kept as it is.
    """
    filled = [file for file in files if file.messages]
    start = min((file.start_ns for file in filled), default=0)
    end = max((file.end_ns for file in filled), default=0)
    return {
        "version": METADATA_VERSION,
        "storage_identifier": "mcap",
        "duration": {"nanoseconds": end - start},
        "starting_time": {"nanoseconds_since_epoch": start},
        "message_count": sum(file.messages for file in files),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type,
                    "serialization_format": topic.encoding,
                    "offered_qos_profiles": [profile.as_json() for profile in topic.offered_qos],
                    "type_description_hash": topic.type_hash,
                },
                "message_count": count,
            }
            for topic, count in topics
        ],
        # These two are about rosbag2 packing whole files or messages, not about MCAP chunks.
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.name for file in files],
        "files": [
            {
                "path": file.name,
                "starting_time": {"nanoseconds_since_epoch": file.start_ns},
                "duration": {"nanoseconds": file.end_ns - file.start_ns},
                "message_count": file.messages,
            }
            for file in files
        ],
        "custom_data": dict(custom_data),
        "ros_distro": ros_distro,
    }


@dataclass(frozen=True)
class StoredMetadata:
    """The part of the metadata that the files of the bag do not contain."""

    version: int = METADATA_VERSION
    storage: str = "mcap"
    files: tuple[str, ...] = ()  #: names of the storage files
    topics: tuple[TopicDescription, ...] = ()  #: without schemas, which stand in the files
    compression_format: str = ""
    #: "", "file" or "message": rosbag2's own, around or inside the files
    compression_mode: str = ""
    ros_distro: str = ""
    custom_data: dict[str, str] = field(default_factory=dict)
    message_count: int | None = None  #: in all files, None if it is not said

    def completed(self, topic: TopicDescription) -> TopicDescription:
        """Return a topic with the hash and the QoS given here if its file does not give any."""
        stored = self._by_name.get(topic.name, topic)
        return replace(
            topic,
            type_hash=topic.type_hash or stored.type_hash,
            offered_qos=topic.offered_qos or stored.offered_qos,
        )

    @cached_property
    def _by_name(self) -> dict[str, TopicDescription]:
        return {topic.name: topic for topic in self.topics}


def parse_metadata(text: str) -> StoredMetadata:
    """Parse a ``metadata.yaml``, or its copy inside a storage file.

    Raises ValueError: the text names what is wrong with it.
    """
    found = YamlFields(load_texts(text), "the file")
    if OUTER_KEY in found.values:
        found = found.inside(OUTER_KEY)
    elif "version" not in found.values:
        raise ValueError(f"it has no {OUTER_KEY}")
    files = found.each("relative_file_paths")
    if not all(isinstance(name, str) for name in files):
        raise ValueError("an entry of relative_file_paths has to be a single value")
    custom_data = found.inside("custom_data")
    return StoredMetadata(
        version=found.integer("version"),
        storage=found.text("storage_identifier"),
        files=tuple(files),
        topics=tuple(_topic(one) for one in found.each("topics_with_message_count")),
        compression_format=found.text("compression_format"),
        compression_mode=found.text("compression_mode").lower(),
        ros_distro=found.text("ros_distro"),
        custom_data={key: custom_data.text(key) for key in custom_data.values},
        message_count=found.integer("message_count") if "message_count" in found.values else None,
    )


def _topic(entry: Any) -> TopicDescription:
    found = YamlFields(entry, "an entry of topics_with_message_count").inside("topic_metadata")
    return TopicDescription(
        name=found.text("name"),
        type=found.text("type"),
        schema="",
        type_hash=found.text("type_description_hash"),
        offered_qos=qos_profiles(found.values.get("offered_qos_profiles", "")),
        encoding=found.text("serialization_format", CDR),
    )


def stored_metadata(path: Path) -> StoredMetadata | None:
    """Read the ``metadata.yaml`` of a bag, None if there is none, or one too long to be read.

    Raises BagError: it cannot be read or is broken.
    """
    file = path / METADATA_FILE
    if not path.is_dir() or not file.exists():
        return None
    with reading(file), open_regular(file) as stream:
        content = stream.read(_METADATA_BYTES + 1)
    if len(content) > _METADATA_BYTES:
        return None
    try:
        return parse_metadata(content.decode())
    except ValueError as error:
        raise BagError(
            f"{file} is not what rosbag2 writes: {short(error)}; repair it, or move it away: "
            "the bag can be read without it"
        ) from error


def storage_files(path: Path, stored: StoredMetadata | None = None) -> list[Path]:
    """Return the storage files of a bag, all of one kind, in the order of their numbers.

    path: a folder, or one file; stored: what ``metadata.yaml`` says, which names the kind. Raises
    BagError: there is none.
    """
    if not path.exists():
        raise BagError(f"there is no bag {path}; check the name")
    if not path.is_dir():
        return [path]
    with reading(path):
        files = sorted(path.iterdir(), key=_numbered)
    by_kind = {
        kind: [file for file in files if file.name.endswith(ends)] for kind, ends in _ENDS.items()
    }
    wanted = by_kind.get(stored.storage if stored else "")  # what is said may be wrong
    if found := wanted or by_kind["mcap"] or by_kind["sqlite3"]:
        return found
    if stored and stored.storage not in _ENDS:
        raise BagError(
            f"{path} is stored as {stored.storage}, of which it has no file that can be read; make "
            f"an MCAP bag of it with `ros2 bag convert -i {path} -o OPTIONS.yaml`, where "
            "OPTIONS.yaml says output_bags: [{uri: NEW, storage_id: mcap, all_topics: true}]"
        )
    raise BagError(
        f"there is no .mcap or .db3 file in {path}; name the folder of a bag, or tables "
        f"by their files ({path}/*.csv)"
    )


def storage_of(file: Path) -> str:
    """Return what a storage file is, as ``metadata.yaml`` calls it, or "ros1"; by its first bytes.

    One that begins as none of them is what its name says, mcap without a word of it.

    Raises ReadError, OSError: it cannot be read.
    """
    with open_regular(file) as stream:
        start = stream.read(16)
    by_start = next((kind for mark, kind in _STARTS.items() if start.startswith(mark)), "")
    return by_start or {".db3": "sqlite3", ".bag": "ros1"}.get(file.suffix, "mcap")


def _numbered(path: Path) -> list[tuple[int, str]]:
    """Sort bag_2 before bag_10."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part[:300]), "") if part.isdecimal() else (-1, part) for part in parts]
