# SPDX-License-Identifier: Apache-2.0
"""The ``metadata.yaml`` of a rosbag2 folder: written in version 9, read in every version."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypedDict

import yaml

from stickslip_ros.files import write_text
from stickslip_ros.parameters.bounded_yaml import load_texts
from stickslip_ros.recordings.qos import OfferedQos, QosDict, profiles
from stickslip_ros.recordings.yaml_values import integer, mapping, sequence, text_of

METADATA_FILE = "metadata.yaml"
METADATA_VERSION = 9
SERIALIZATION = "cdr"


class Nanoseconds(TypedDict):
    """A length of time in nanoseconds."""

    nanoseconds: int


class StartingTime(TypedDict):
    """A moment, in nanoseconds since the Unix epoch."""

    nanoseconds_since_epoch: int


class TopicMetadata(TypedDict):
    """What is known of a topic."""

    name: str
    type: str
    serialization_format: str
    offered_qos_profiles: list[QosDict]
    type_description_hash: str


class TopicWithCount(TypedDict):
    """A topic and the number of its messages in the bag."""

    topic_metadata: TopicMetadata
    message_count: int


class FileMetadata(TypedDict):
    """One storage file of the bag."""

    path: str
    starting_time: StartingTime
    duration: Nanoseconds
    message_count: int


class BagMetadata(TypedDict):
    """Everything under ``rosbag2_bagfile_information``; rosbag2 needs every key."""

    version: int
    storage_identifier: str
    duration: Nanoseconds
    starting_time: StartingTime
    message_count: int
    topics_with_message_count: list[TopicWithCount]
    compression_format: str
    compression_mode: str
    relative_file_paths: list[str]
    files: list[FileMetadata]
    custom_data: dict[str, str]
    ros_distro: str


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
    encoding: str = SERIALIZATION


@dataclass(frozen=True)
class FileSummary:
    """Name of a storage file, count of its messages, first and last log time in ns (0 if none)."""

    name: str
    message_count: int
    start_ns: int
    end_ns: int

    def as_dict(self) -> FileMetadata:
        """Return the entry for the list of files."""
        return {
            "path": self.name,
            "starting_time": {"nanoseconds_since_epoch": self.start_ns},
            "duration": {"nanoseconds": self.end_ns - self.start_ns},
            "message_count": self.message_count,
        }


def bag_metadata(
    files: Sequence[FileSummary],
    topics: Sequence[tuple[TopicDescription, int]],
    ros_distro: str,
    custom_data: Mapping[str, str],
) -> BagMetadata:
    """Return the metadata of a bag of MCAP files.

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
        "topics_with_message_count": [_topic_with_count(*topic) for topic in topics],
        # These two are about rosbag2 packing whole files or messages, not about MCAP chunks.
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.name for file in files],
        "files": [file.as_dict() for file in files],
        "custom_data": dict(custom_data),
        "ros_distro": ros_distro,
    }


def metadata_yaml(metadata: BagMetadata) -> str:
    """Return the metadata as YAML text, without the outer key of the file."""
    return str(yaml.safe_dump(metadata, sort_keys=False))


def write_metadata(folder: Path, metadata: BagMetadata) -> None:
    """Write ``metadata.yaml`` so that a reader sees either the whole file or none.

    :raises WriteError: the folder cannot be written.
    """
    text = yaml.safe_dump({"rosbag2_bagfile_information": metadata}, sort_keys=False)
    write_text(folder / METADATA_FILE, text)


def _topic_with_count(topic: TopicDescription, count: int) -> TopicWithCount:
    return {
        "topic_metadata": {
            "name": topic.name,
            "type": topic.type,
            "serialization_format": topic.encoding,
            "offered_qos_profiles": [profile.as_dict() for profile in topic.offered_qos],
            "type_description_hash": topic.type_hash,
        },
        "message_count": count,
    }


NEWEST_VERSION = 9
METADATA_BYTES = 4 * 1024 * 1024
"""No more of a ``metadata.yaml`` needs to be read; what is longer is refused."""


@dataclass(frozen=True)
class StoredMetadata:
    """The part of the metadata that the files of the bag do not say themselves.

    :ivar files: names of the storage files.
    :ivar topics: without schemas, which stand in the files.
    :ivar message_count: in all files, None if it is not said.
    :ivar compression_mode: "", "file" or "message": rosbag2's own, around or inside the files.
    """

    version: int = NEWEST_VERSION
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


def metadata_file(text: str) -> StoredMetadata:
    """Return what a ``metadata.yaml`` says; ValueError names what is wrong with it."""
    outer = mapping(load_texts(text), "the file")
    if "rosbag2_bagfile_information" not in outer:
        raise ValueError("it has no rosbag2_bagfile_information")
    return _metadata(outer["rosbag2_bagfile_information"])


def metadata_record(text: str) -> StoredMetadata:
    """Return what the metadata inside a storage file says; ValueError if it is broken."""
    return _metadata(load_texts(text))


def _metadata(value: Any) -> StoredMetadata:
    found = mapping(value, "rosbag2_bagfile_information")
    return StoredMetadata(
        version=integer(found.get("version", "0"), "version"),
        storage=text_of(found.get("storage_identifier", ""), "storage_identifier"),
        files=tuple(
            text_of(name, "an entry of relative_file_paths")
            for name in sequence(found.get("relative_file_paths", ""), "relative_file_paths")
        ),
        topics=tuple(
            _topic(mapping(one, "an entry of topics_with_message_count"))
            for one in sequence(
                found.get("topics_with_message_count", ""), "topics_with_message_count"
            )
        ),
        compression_format=text_of(found.get("compression_format", ""), "compression_format"),
        compression_mode=text_of(found.get("compression_mode", ""), "compression_mode").lower(),
        ros_distro=text_of(found.get("ros_distro", ""), "ros_distro"),
        custom_data={
            key: text_of(text, f"custom_data {key}")
            for key, text in mapping(found.get("custom_data", ""), "custom_data").items()
        },
        message_count=(
            integer(found["message_count"], "message_count") if "message_count" in found else None
        ),
    )


def _topic(entry: dict[str, Any]) -> TopicDescription:
    found = mapping(entry.get("topic_metadata"), "topic_metadata")
    return TopicDescription(
        name=text_of(found.get("name"), "the name of a topic"),
        type=text_of(found.get("type"), "the type of a topic"),
        schema="",
        type_hash=text_of(found.get("type_description_hash", ""), "type_description_hash"),
        offered_qos=profiles(found.get("offered_qos_profiles", "")),
        encoding=text_of(found.get("serialization_format", SERIALIZATION), "serialization_format"),
    )
