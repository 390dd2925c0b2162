# SPDX-License-Identifier: Apache-2.0
"""The ``metadata.yaml`` of a rosbag2 folder: written in version 9, read in every version."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from stickslip_ros.parameters.bounded_yaml import load_texts
from stickslip_ros.recordings.qos import OfferedQos, YamlFields, qos_profiles

METADATA_FILE = "metadata.yaml"
METADATA_VERSION = 9
"""The version that is written, and the newest that is read."""

CDR = "cdr"
"""The format of the messages of ROS 2."""

_OUTER_KEY = "rosbag2_bagfile_information"


@dataclass(frozen=True)
class TopicDescription:
    """A topic as a bag keeps it.

    :ivar type: such as ``sensor_msgs/msg/JointState``.
    :ivar schema: the ``ros2msg`` text of the type with everything inside it.
    :ivar type_hash: ``RIHS01_...``, empty when not known.
    :ivar offered_qos: one entry a publisher.
    :ivar schema_encoding: the language of the schema.
    :ivar encoding: the format of the messages.
    """

    name: str
    type: str
    schema: str
    type_hash: str = ""
    offered_qos: tuple[OfferedQos, ...] = ()
    schema_encoding: str = "ros2msg"
    encoding: str = CDR


@dataclass(frozen=True)
class FileSummary:
    """Name of a storage file, count of its messages, first and last log time in ns (0 if none)."""

    name: str
    message_count: int = 0
    start_ns: int = 0
    end_ns: int = 0


def bag_metadata(
    files: Sequence[FileSummary],
    topics: Sequence[tuple[TopicDescription, int]],
    ros_distro: str,
    custom_data: Mapping[str, str],
) -> dict[str, Any]:
    """Return the metadata of a bag of MCAP files; rosbag2 needs every key.

    :param files: every storage file, in order of time.
    :param topics: every topic with the count of its messages.
    :param custom_data: free text by key, kept as it is.
    """
    filled = [file for file in files if file.message_count]
    start = min((file.start_ns for file in filled), default=0)
    end = max((file.end_ns for file in filled), default=0)
    return {
        "version": METADATA_VERSION,
        "storage_identifier": "mcap",
        "duration": {"nanoseconds": end - start},
        "starting_time": {"nanoseconds_since_epoch": start},
        "message_count": sum(file.message_count for file in files),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type,
                    "serialization_format": topic.encoding,
                    "offered_qos_profiles": [profile.as_dict() for profile in topic.offered_qos],
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
                "message_count": file.message_count,
            }
            for file in files
        ],
        "custom_data": dict(custom_data),
        "ros_distro": ros_distro,
    }


def in_file(metadata: dict[str, Any]) -> dict[str, Any]:
    """Return the content of ``metadata.yaml``."""
    return {_OUTER_KEY: metadata}


@dataclass(frozen=True)
class StoredMetadata:
    """The part of the metadata that the files of the bag do not contain.

    :ivar files: names of the storage files.
    :ivar topics: without schemas, which stand in the files.
    :ivar message_count: in all files, None if it is not said.
    :ivar compression_mode: "", "file" or "message": rosbag2's own, around or inside the files.
    """

    version: int = METADATA_VERSION
    storage: str = "mcap"
    files: tuple[str, ...] = ()
    topics: tuple[TopicDescription, ...] = ()
    compression_format: str = ""
    compression_mode: str = ""
    ros_distro: str = ""
    custom_data: dict[str, str] = field(default_factory=dict)
    message_count: int | None = None

    def completed(self, topic: TopicDescription) -> TopicDescription:
        """Return a topic with the hash and the QoS given here if its file does not give any."""
        for stored in self.topics:
            if stored.name == topic.name:
                return replace(
                    topic,
                    type_hash=topic.type_hash or stored.type_hash,
                    offered_qos=topic.offered_qos or stored.offered_qos,
                )
        return topic


def parse_metadata(text: str) -> StoredMetadata:
    """Parse a ``metadata.yaml``, or its copy inside a storage file.

    :raises ValueError: the text names what is wrong with it.
    """
    found = YamlFields(load_texts(text), "the file")
    if _OUTER_KEY in found.values:
        found = found.inside(_OUTER_KEY)
    elif "version" not in found.values:
        raise ValueError(f"it has no {_OUTER_KEY}")
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
