# SPDX-License-Identifier: Apache-2.0
"""The topics of an MCAP file, learned from its schema and channel records."""

from __future__ import annotations

from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from stickslip_ros.recordings.mcap_records import parse
from stickslip_ros.recordings.metadata import TopicDescription
from stickslip_ros.recordings.qos import profiles_in_yaml

# Bytes of schemas and channels in one file; a thousand topics have a third of it.
_LARGEST = 8 * 1024 * 1024


class Channels:
    """Learns schemas and channels as they come along in a file."""

    def __init__(self) -> None:
        """Know none."""
        self.topics: dict[int, TopicDescription] = {}
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._size = 0

    def learn(self, opcode: int, body: bytes) -> None:
        """Take a schema or channel record; other records are passed over.

        :raises ValueError: it is broken, or another one had that number.
        """
        if opcode == Opcode.SCHEMA:
            schema = parse(Schema, body)
            if schema.id not in self._schemas:
                self._grow(body)
                self._schemas[schema.id] = schema
            elif self._schemas[schema.id] != schema:
                raise ValueError(f"two schemas have the number {schema.id}")
        elif opcode == Opcode.CHANNEL:
            channel = parse(Channel, body)
            if channel.id not in self._channels:
                self._grow(body)
                self._channels[channel.id] = channel
                self.topics[channel.id] = self._topic(channel)
            elif self._channels[channel.id] != channel:
                raise ValueError(f"two channels have the number {channel.id}")

    def _grow(self, body: bytes) -> None:
        self._size += len(body)
        if self._size > _LARGEST:
            raise ValueError(f"more than {_LARGEST} bytes of schemas and channels")

    def _topic(self, channel: Channel) -> TopicDescription:
        schema = self._schemas.get(channel.schema_id)
        if channel.schema_id and schema is None:
            raise ValueError(f"topic {channel.topic} names schema {channel.schema_id}; it has none")
        return TopicDescription(
            name=channel.topic,
            type=schema.name if schema else "",
            schema=schema.data.decode() if schema else "",
            type_hash=channel.metadata.get("topic_type_hash", ""),
            offered_qos=profiles_in_yaml(channel.metadata.get("offered_qos_profiles", "")),
            schema_encoding=schema.encoding if schema else "",
            encoding=channel.message_encoding,
        )
