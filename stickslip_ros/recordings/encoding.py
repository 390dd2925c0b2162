# SPDX-License-Identifier: Apache-2.0
"""The serialized form (CDR, little-endian) of the two types of messages that a copy of a bag holds.

Numbers lie at multiples of their size, counted from behind the four bytes that name the encoding;
arrays and strings begin with their length, strings end with a zero that counts (OMG, formal/02-06).
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from stickslip_ros.recordings.errors import BagError
from stickslip_ros.recordings.message_types import JOINT_STATE_TYPE, STATUS_TYPE
from stickslip_ros.recordings.metadata import TopicDescription

_HEAD = b"\0\1\0\0"


class _Cdr:
    """The data of a message, as far as they are written."""

    def __init__(self) -> None:
        self.data = bytearray(_HEAD)

    def put(self, kind: str, *values: Any) -> None:
        """Write numbers of one kind, a letter of `struct`, at a place that suits them."""
        size = struct.calcsize(kind)
        if values:
            self.data += bytes(-(len(self.data) - len(_HEAD)) % size)
            self.data += struct.pack(f"<{len(values)}{kind}", *values)

    def put_text(self, text: str) -> None:
        """Write a string."""
        encoded = text.encode() + b"\0"
        self.put("I", len(encoded))
        self.data += encoded

    def put_header(self, header: Any) -> None:
        """Write a std_msgs/Header."""
        self.put("i", header.stamp.sec)
        self.put("I", header.stamp.nanosec)
        self.put_text(header.frame_id)

    def put_texts(self, texts: Iterable[str]) -> None:
        """Write an array of strings."""
        texts = list(texts)
        self.put("I", len(texts))
        for text in texts:
            self.put_text(text)


def joint_state_data(message: Any) -> bytes:
    """Return a sensor_msgs/JointState, an object with its fields, in serialized form."""
    cdr = _Cdr()
    cdr.put_header(message.header)
    cdr.put_texts(message.name)
    for values in (message.position, message.velocity, message.effort):
        cdr.put("I", len(values))
        cdr.put("d", *values)
    return bytes(cdr.data)


def diagnostics_data(message: Any) -> bytes:
    """Return a diagnostic_msgs/DiagnosticArray, an object with its fields, in serialized form."""
    cdr = _Cdr()
    cdr.put_header(message.header)
    cdr.put("I", len(message.status))
    for status in message.status:
        cdr.put("B", status.level)
        for text in (status.name, status.message, status.hardware_id):
            cdr.put_text(text)
        cdr.put("I", len(status.values))
        for pair in status.values:
            cdr.put_text(pair.key)
            cdr.put_text(pair.value)
    return bytes(cdr.data)


_ENCODERS: Mapping[str, Callable[[Any], bytes]] = {
    JOINT_STATE_TYPE: joint_state_data,
    STATUS_TYPE: diagnostics_data,
}


def encoder_for(topic: TopicDescription) -> Callable[[Any], bytes]:
    """Return a function that makes the data of a message of an object like a decoded one.

    Raises BagError: the messages of the topic are neither joint states nor diagnostics.
    """
    try:
        return _ENCODERS[topic.type]
    except KeyError:
        raise BagError(
            f"topic {topic.name} ({topic.type}) cannot be encoded: only {' and '.join(_ENCODERS)} "
            "can; copy its messages as they are"
        ) from None
