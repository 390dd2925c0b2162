# SPDX-License-Identifier: Apache-2.0
"""Messages out of their serialized form (CDR) and into it, by the schema in the bag, without ROS.

``mcap_ros2`` does both. Also yields the fields of messages by name, and diagnostic statuses, the
form of events.
"""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

from mcap.records import Schema
from mcap_ros2._dynamic import serialize_dynamic  # the way to its encoders without a file
from mcap_ros2.decoder import DecoderFactory

from stickslip_ros.recordings.errors import BagError, short
from stickslip_ros.recordings.mcap_files import BagMessage
from stickslip_ros.recordings.metadata import TopicDescription
from stickslip_ros.recordings.schemas import JOINT_STATE_TYPE, STATUS_TYPE, nanoseconds

if TYPE_CHECKING:
    from stickslip_ros.recordings.reader import BagReader

# Characters; the parser takes seconds for more. The largest of ROS itself have a third of it.
_LARGEST_SCHEMA = 64 * 1024
# A field behind the last one of a message, and what stands there: it shows where the library ends.
_END, _MARK = "stickslip_end", b"\x89end\r\n\x1a\n".ljust(256, b"\xff")


class _Bounded(bytes):
    """Bytes that raise an error when a slice goes beyond their end.

    A slice of ``bytes`` that goes on behind the end is just shorter; the decoder would fill memory
    for a sequence of nothing.
    """

    def __getitem__(self, key: Any) -> Any:
        if isinstance(key, slice) and key.stop > len(self):
            raise ValueError("it ends too early")
        return super().__getitem__(key)


def decoder_for(topic: TopicDescription) -> Callable[[bytes], Any]:
    """Return a function that makes a message object of the data of a message.

    The object has the fields of the message as attributes, lists for arrays. The function raises
    BagError for data that is not such a message, or is longer.

    Raises BagError: the format of the topic is not known, or its schema is broken.
    """
    where = f"topic {topic.name} ({topic.type})"
    # The last field of the first definition, which lines of = divide from the others.
    lines = "\n".join(topic.schema.splitlines())
    others = re.search("^={3,}$", lines, flags=re.MULTILINE)
    at = others.start() if others else len(lines)
    schema = f"{lines[:at]}\nuint8[{len(_MARK)}] {_END}\n{lines[at:]}"
    with _described(topic, where):
        decode = DecoderFactory().decoder_for(
            "cdr", Schema(id=1, data=schema.encode(), encoding="ros2msg", name=topic.type)
        )
        if decode is None:
            raise ValueError("it has no definition")

    def decoded(data: bytes) -> Any:
        try:
            message: Any = decode(_Bounded(data + _MARK))
            slots, end = message.__slots__, getattr(message, _END)
            if slots[-1] == _END:
                slots.pop()  # of the class that the library made for this decoder
            if end != _MARK:
                _check_end(message, end)
        except Exception as error:  # the library has no error of its own for what is wrong
            raise BagError(
                f"a message on {where} is not of that type: {short(error)}; "
                "the recording is damaged or has the wrong schema"
            ) from error
        return message

    return decoded


@contextlib.contextmanager
def _described(topic: TopicDescription, where: str) -> Iterator[None]:
    """Check that the library knows the format of a topic; name what is wrong with its schema."""
    if topic.encoding != "cdr" or topic.schema_encoding != "ros2msg" or not topic.schema:
        schema_kind = topic.schema_encoding if topic.schema else "missing"
        found = f"{topic.encoding or 'of no format'}, schema {schema_kind}"
        raise BagError(
            f"{where} cannot be decoded: its messages are {found}; record it with "
            "`stickslip bag record` or `ros2 bag record -s mcap`, which write cdr and ros2msg"
        )
    try:
        if len(topic.schema) > _LARGEST_SCHEMA:
            raise ValueError(
                f"it has {len(topic.schema)} characters; {_LARGEST_SCHEMA} is the limit"
            )
        with contextlib.redirect_stderr(io.StringIO()):  # where the parser prints the bad line
            yield
    # The text is a stranger's and the parser has no error of its own for what is wrong with it.
    except Exception as error:
        raise BagError(
            f"{where} cannot be decoded, its schema is broken: {short(error)}; "
            "record it anew or leave the topic out"
        ) from error


def _check_end(message: Any, end: bytes) -> None:
    """Raise ValueError if the library left more of a message than ROS leaves behind it.

    DDS fills messages up to a multiple of four, and Fast DDS counts four bytes more for each empty
    list. end: what stands behind the part that was read.
    """

    def lists(one: Any) -> int:
        if isinstance(one, list):
            return sum(map(lists, one)) if one else 1
        return sum(lists(getattr(one, name)) for name in getattr(one, "__slots__", ()))

    left = end.find(_MARK[:8])
    if left < 0 or left > 3 + 4 * lists(message):
        raise ValueError("it is longer than its type")


def encoder_for(topic: TopicDescription) -> Callable[[Any], bytes]:
    """Return a function that makes the data of a message of an object like a decoded one.

    Raises BagError: the schema of the topic is missing or broken.
    """
    with _described(topic, f"topic {topic.name} ({topic.type})"):
        encode: Callable[[Any], bytes] = serialize_dynamic(topic.type, topic.schema)[topic.type]
    return encode


def not_of_type(bag: BagReader, topic: str, error: Exception) -> BagError:
    """Return the error for a topic whose messages lack fields of its type."""
    return BagError(
        f"the messages on {topic} of {bag.path} are not of the type {bag.topics[topic].type} that "
        f"they are said to be ({error}); record the topic anew or leave it out"
    )


def decode_messages(
    bag: BagReader, topics: Iterable[str], bulk: bool = False
) -> Iterator[tuple[BagMessage, Any]]:
    """Yield the messages on some topics in order of time, each as recorded and as an object.

    bulk: leave out those that are hours from all others. Raises BagError: a topic is not in the bag
    or cannot be decoded, or a message is damaged.
    """
    decoders = {topic: decoder_for(bag.topics[topic]) for topic in topics}
    for found in bag.bulk_messages(decoders) if bulk else bag.messages(decoders):
        yield found, decoders[found.topic](found.data)


def fields_of(
    message: Any, kind: str, longest_array: int, prefix: str = ""
) -> Iterator[tuple[str, Any]]:
    """Yield names and values of the fields of a message, without its header.

    kind: its type; the fields of joint states are named after their joints; longest_array: longer
    ones, images say, are passed over.
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
            if isinstance(one, bool | int | float | str):
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
