# SPDX-License-Identifier: Apache-2.0
"""Diagnostic statuses in a bag: diagnostics, and events, which are published in the same form."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from stickslip_ros.recordings.cdr import decoder_for, nanoseconds
from stickslip_ros.recordings.errors import BagError
from stickslip_ros.recordings.reader import BagReader

STATUS_TYPE = "diagnostic_msgs/msg/DiagnosticArray"


class Status(NamedTuple):
    """One status; times in ns since the Unix epoch.

    :ivar log_ns: when the message with it was recorded.
    :ivar stamp_ns: the time in its header.
    :ivar level: 0 OK, 1 WARN, 2 ERROR, 3 STALE.
    :ivar values: what it says, by key.
    """

    log_ns: int
    stamp_ns: int
    name: str
    level: int
    message: str
    values: dict[str, str]


def statuses(bag: BagReader, topic_name: str) -> Iterator[Status]:
    """Yield every status on a topic in order of time, reading as it goes.

    :raises BagError: the topic is not in the bag or not one of diagnostics; while reading: a
        message is damaged.
    """
    topic = bag.topics.get(topic_name)
    if topic is None or topic.type != STATUS_TYPE:
        have = topic.type if topic else "not there"
        raise BagError(f"topic {topic_name} of {bag.path} is {have}; it has to be {STATUS_TYPE}")
    if not bag.counts[topic_name]:
        return
    decode = decoder_for(topic)
    for found in bag.messages([topic_name]):
        message = decode(found.data)
        for status in message.status:
            yield Status(
                found.log_ns,
                nanoseconds(message.header.stamp),
                status.name,
                status.level,
                status.message,
                {pair.key: pair.value for pair in status.values},
            )
