# SPDX-License-Identifier: Apache-2.0
"""The ``metadata.yaml`` of a rosbag2 folder, version 9: its shape, its making, its writing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

import yaml

from stickslip_ros.files import write_text
from stickslip_ros.recordings.qos import OfferedQos, QosDict

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
