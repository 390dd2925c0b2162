# SPDX-License-Identifier: Apache-2.0
"""Reads messages from their serialized form (CDR), by the schema in the bag, without ROS.

Also yields the fields of messages by name, and diagnostic statuses, the form of events.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from stickslip_ros.recordings.errors import BagError, UndecodableError, short
from stickslip_ros.recordings.mcap_records import BagMessage
from stickslip_ros.recordings.message_types import JOINT_STATE_TYPE, STATUS_TYPE, nanoseconds
from stickslip_ros.recordings.metadata import CDR, TopicDescription

if TYPE_CHECKING:
    from stickslip_ros.recordings.reader import BagReader

# Characters; the parser takes seconds for more. The largest of ROS itself have a third of it.
_LARGEST_SCHEMA = 64 * 1024


class _Bounded(bytes):
    """Bytes that raise an error when a slice goes beyond their end.

    A slice of ``bytes`` that goes on behind the end is just shorter; the decoder would take a
    string that was cut for a whole one, and fill memory for a sequence of nothing.
    """

    def __getitem__(self, key: Any) -> Any:
        if isinstance(key, slice) and key.stop > len(self):
            raise ValueError("it ends too early")
        return super().__getitem__(key)


def decoder_for(topic: TopicDescription) -> Callable[[bytes], Any]:
    """Return a function that makes a message object of the data of a message.

    The object has the fields of the message as attributes, lists for arrays. The function raises
    BagError for data that is not such a message.

    Raises BagError: the format of the topic is not known, or its schema is broken.
    """
    where = f"topic {topic.name} ({topic.type})"
    if topic.encoding != CDR or topic.schema_encoding != "ros2msg" or not topic.schema:
        schema_kind = topic.schema_encoding if topic.schema else "missing"
        found = f"{topic.encoding or 'of no format'}, schema {schema_kind}"
        raise UndecodableError(
            f"{where} cannot be decoded: its messages are {found}; record it with "
            "`stickslip bag record` or `ros2 bag record -s mcap`, which write cdr and ros2msg"
        )
    schema = Schema(id=1, data=topic.schema.encode(), encoding="ros2msg", name=topic.type)
    try:
        if len(topic.schema) > _LARGEST_SCHEMA:
            raise ValueError(
                f"it has {len(topic.schema)} characters; {_LARGEST_SCHEMA} is the limit"
            )
        with contextlib.redirect_stderr(io.StringIO()):  # where the parser prints the bad line
            decode = DecoderFactory().decoder_for(CDR, schema)
        if decode is None:
            raise ValueError("it has no definition")
    # The text is a stranger's and the parser has no error of its own for what is wrong with it.
    except Exception as error:
        raise UndecodableError(
            f"{where} cannot be decoded, its schema is broken: {short(error)}; "
            "record it anew or leave the topic out"
        ) from error

    def decoded(data: bytes) -> Any:
        try:
            return decode(_Bounded(data))
        except Exception as error:  # likewise
            raise UndecodableError(
                f"a message on {where} is not of that type: {short(error)}; "
                "the recording is damaged or has the wrong schema"
            ) from error

    return decoded


def not_of_type(bag: BagReader, topic: str, error: Exception) -> UndecodableError:
    """Return the error for a topic whose messages lack fields of its type."""
    return UndecodableError(
        f"the messages on {topic} of {bag.path} are not of the type {bag.topics[topic].type} that "
        f"they are said to be ({error}); record the topic anew or leave it out"
    )


def decode_messages(bag: BagReader, topics: Iterable[str]) -> Iterator[tuple[BagMessage, Any]]:
    """Yield the messages on some topics in order of time, each as recorded and as an object.

    Raises BagError: a topic is not in the bag or cannot be decoded, or a message is damaged.
    """
    decoders = {topic: decoder_for(bag.topics[topic]) for topic in topics}
    for found in bag.messages(decoders):
        yield found, decoders[found.topic](found.data)


def fields_of(
    message: Any, kind: str, longest_array: int, prefix: str = ""
) -> Iterator[tuple[str, Any]]:
    """Yield names and values of the fields of a message, without its header.

    kind: its type; the fields of joint states are named after their joints; longest_array: longer
    ones, images say, are passed over. A value may be a tuple that says where it is, see `layouts`.
    """
    if kind == JOINT_STATE_TYPE:
        for name in ("position", "velocity", "effort"):
            values = getattr(message, name)
            if len(values) == len(message.name):
                yield from ((f"{j}/{name}", v) for j, v in zip(message.name, values, strict=True))
        return
    for name in message.__slots__:
        value = getattr(message, name)
        if name == "header" and not prefix:
            continue
        each = {f"{prefix}{name}": value}
        if isinstance(value, list):
            short = value if len(value) <= longest_array else []
            each = {f"{prefix}{name}[{k}]": one for k, one in enumerate(short)}
        for label, one in each.items():
            if isinstance(one, bool | int | float | str | tuple):
                yield label, one
            elif hasattr(one, "__slots__"):
                yield from fields_of(one, "", longest_array, f"{label}.")


class Status(NamedTuple):
    """One status of a DiagnosticArray; times in ns since the Unix epoch."""

    log_ns: int  #: when the message with it was recorded
    stamp_ns: int  #: the time in its header
    name: str
    level: int  #: 0 OK, 1 WARN, 2 ERROR, 3 STALE
    message: str
    values: dict[str, str]  #: its values by key


def statuses(bag: BagReader, topic_name: str) -> Iterator[Status]:
    """Yield every diagnostic status on a topic in order of time, reading as it goes.

    Raises BagError: the topic is not in the bag or not one of diagnostics; while reading: a message
    is damaged.
    """
    topic = bag.topics.get(topic_name)
    if topic is None or topic.type != STATUS_TYPE:
        have = topic.type if topic else "not there"
        raise BagError(f"topic {topic_name} of {bag.path} is {have}; it has to be {STATUS_TYPE}")
    if not bag.counts[topic_name]:
        return
    for found, message in decode_messages(bag, [topic_name]):
        try:
            stamp_ns = nanoseconds(message.header.stamp)
            read = [
                (one.name, one.level, one.message, {pair.key: pair.value for pair in one.values})
                for one in message.status
            ]
        except (AttributeError, TypeError) as error:  # the schema in a bag can be anybody's
            raise not_of_type(bag, topic_name, error) from None
        for status in read:
            yield Status(found.log_ns, stamp_ns, *status)
