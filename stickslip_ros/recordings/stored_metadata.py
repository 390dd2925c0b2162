# SPDX-License-Identifier: Apache-2.0
"""What the metadata of a bag says, whatever version of rosbag2 wrote it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from stickslip_ros.parameters.bounded_yaml import load_texts
from stickslip_ros.recordings.metadata import SERIALIZATION, TopicDescription
from stickslip_ros.recordings.stored_qos import profiles
from stickslip_ros.recordings.yaml_text import integer, mapping, sequence, text_of

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
        for told in self.topics:
            if told.name == topic.name:
                return replace(
                    topic,
                    type_hash=topic.type_hash or told.type_hash,
                    offered_qos=topic.offered_qos or told.offered_qos,
                )
        return topic


def metadata_file(text: str) -> StoredMetadata:
    """Return what a ``metadata.yaml`` says; ValueError names what is wrong with it."""
    outer = mapping(load_texts(text), "the file")
    if "rosbag2_bagfile_information" not in outer:
        raise ValueError("there is no rosbag2_bagfile_information in it")
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
