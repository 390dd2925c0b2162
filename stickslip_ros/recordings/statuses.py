# SPDX-License-Identifier: Apache-2.0
"""Diagnostic statuses in a bag: diagnostics, and events, which are published in the same form."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from stickslip_ros.recordings.cdr import decoder_for, nanoseconds
from stickslip_ros.recordings.errors import BagError
from stickslip_ros.recordings.reader import BagReader

STATUS_TYPE = "diagnostic_msgs/msg/DiagnosticArray"


class Status(NamedTuple):
    """One status of a DiagnosticArray; times in ns since the Unix epoch.

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
    """Yield every diagnostic status on a topic in order of time, reading as it goes.

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
        yield from _statuses_in(bag, decode(found.data), topic_name, found.log_ns)


def _statuses_in(bag: BagReader, message: Any, topic_name: str, log_ns: int) -> list[Status]:
    try:
        stamp_ns = nanoseconds(message.header.stamp)
        return [
            Status(
                log_ns,
                stamp_ns,
                status.name,
                status.level,
                status.message,
                {pair.key: pair.value for pair in status.values},
            )
            for status in message.status
        ]
    except (AttributeError, TypeError) as error:  # the schema in a bag can be anybody's
        raise not_of_type(bag, topic_name, STATUS_TYPE, error) from None


def not_of_type(bag: BagReader, topic: str, kind: str, error: Exception) -> BagError:
    """Return the error for a topic whose messages lack fields that its type has."""
    return BagError(
        f"the messages on {topic} of {bag.path} are not of the type {kind} that they are said to "
        f"be ({error}); record the topic anew or leave it out"
    )
