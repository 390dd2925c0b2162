# SPDX-License-Identifier: Apache-2.0
"""The topics of an MCAP file, learned from its schema and channel records."""

from __future__ import annotations

from typing import Any

from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from stickslip_ros.recordings.mcap_records import parse
from stickslip_ros.recordings.metadata import TopicDescription
from stickslip_ros.recordings.qos import qos_profiles

_LARGEST = 8 * 1024 * 1024  # bytes of schemas and channels; a thousand topics have a third of it


class Channels:
    """The topics of a file by their channel, learned from its schema and channel records."""

    def __init__(self) -> None:
        """Know none."""
        self.topics: dict[int, TopicDescription] = {}
        self._known: dict[tuple[type, int], Any] = {}
        self._size = 0

    def learn(self, opcode: int, body: bytes) -> None:
        """Take a schema or channel record; other records are passed over.

        :raises ValueError: it is broken, or another one had that number.
        """
        if opcode not in (Opcode.SCHEMA, Opcode.CHANNEL):
            return
        kind = Schema if opcode == Opcode.SCHEMA else Channel
        record = parse(kind, body)
        known = self._known.get((kind, record.id))
        if known is None:
            self._size += len(body)
            if self._size > _LARGEST:
                raise ValueError(f"more than {_LARGEST} bytes of schemas and channels")
            self._known[kind, record.id] = record
            if kind is Channel:
                self.topics[record.id] = self._topic(record)
        elif known != record:
            raise ValueError(f"two {kind.__name__.lower()}s have the number {record.id}")

    def _topic(self, channel: Channel) -> TopicDescription:
        schema = self._known.get((Schema, channel.schema_id))
        if channel.schema_id and schema is None:
            raise ValueError(f"topic {channel.topic} names schema {channel.schema_id}; it has none")
        return TopicDescription(
            name=channel.topic,
            type=schema.name if schema else "",
            schema=schema.data.decode() if schema else "",
            type_hash=channel.metadata.get("topic_type_hash", ""),
            offered_qos=qos_profiles(channel.metadata.get("offered_qos_profiles", "")),
            schema_encoding=schema.encoding if schema else "",
            encoding=channel.message_encoding,
        )
