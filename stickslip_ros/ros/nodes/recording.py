# SPDX-License-Identifier: Apache-2.0
"""One recording: its topics with their QoS and their losses, and its bag."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

from rclpy.clock import Clock
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from stickslip_ros.axis.commands import COMMANDS
from stickslip_ros.base.clocks import UnsetClock
from stickslip_ros.base.files import reason_and_cure
from stickslip_ros.recordings import BagError, BagWriter, OfferedQos, TopicDescription
from stickslip_ros.recordings.schemas import schema_text
from stickslip_ros.ros.nodes.messages import UnknownTypeError, message_class, message_definition
from stickslip_ros.ros.nodes.topics import OUTPUTS, axes_in


def axis_topics(axis: str) -> dict[str, str]:
    """Return the topics of an axis node and their types, known before the node exists.

    axis: full name of the node, such as ``/stickslip_axis``.
    """
    topics = {
        topic.full_name(axis): topic.type for topic in OUTPUTS.values() if not topic.of_process
    }
    for command in COMMANDS.values():
        if not command.is_service:
            topics[f"{axis}/{command.interface}"] = command.type
    return topics


@dataclass(frozen=True)
class Choice:
    """Which topics to record: those named, those that match, or all of some axes."""

    names: frozenset[str]
    pattern: re.Pattern[str] | None
    axes: tuple[str, ...]
    every: bool = False  #: every axis that is found, too

    def with_axes(self, found: Iterable[str]) -> Choice:
        """Return the choice with axes that were found, where it takes every axis."""
        new = [axis for axis in found if axis not in self.axes] if self.every else []
        return replace(self, axes=(*self.axes, *new)) if new else self

    def takes(self, name: str) -> bool:
        """Return whether a new topic is recorded."""
        if name in self.names or (self.pattern is not None and self.pattern.fullmatch(name)):
            return True
        if self.names or self.pattern is not None:
            return False
        return any(
            name in axis_topics(axis) or name.startswith(f"{axis}/command/") for axis in self.axes
        )

    def __str__(self) -> str:
        """Name the recorded topics."""
        parts = [*sorted(self.names)]
        if self.pattern is not None:
            parts.append(f"topics that match {self.pattern.pattern}")
        return ", ".join(parts) or f"all topics of {', '.join(self.axes)}"


# At 1 kHz, ten seconds of messages may wait for us while the machine has no time; those of one
# second are taken at once, before others are heard. Fast DDS makes room as it needs it.
QUEUE_DEPTH, AT_ONCE = 10_000, 1000

Taken = tuple[bytes, dict[str, Any]]  #: a serialized message, what the middleware says of it


def request_qos(offers: Sequence[QoSProfile], expect_latched: bool = False) -> QoSProfile:
    """Return the strictest QoS to request that every publisher offers.

    Without a publisher, it is reliable, and latched if that is expected.
    """
    reliable = all(o.reliability == ReliabilityPolicy.RELIABLE for o in offers)
    latched = all(o.durability == DurabilityPolicy.TRANSIENT_LOCAL for o in offers)
    if not offers:
        latched = expect_latched
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=QUEUE_DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


class LossCount:
    """Counts the gaps in the numbers of the messages of one publisher.

    A message does not say who sent it, so with several publishers on a topic nothing is counted.
    """

    def __init__(self) -> None:
        """Start with nothing received."""
        self.lost = self.before_joining = 0
        self._publishers: frozenset[bytes] = frozenset()
        self._last: int | None = None

    def note(self, number: int | None, publishers: Callable[[], frozenset[bytes]]) -> None:
        """Take the number of a message; publishers are asked for only if it is out of turn.

        number: counted by the publisher from 1, None if the middleware does not say. publishers:
        gives the ids of those on the topic now.
        """
        if number is None:
            return
        if self._last is None or number != self._last + 1:
            now = publishers()
            if len(now) == 1 and now == self._publishers and self._last is not None:
                self.lost += max(0, number - self._last - 1)
            elif len(now) == 1:
                self.before_joining += number - 1
            self._publishers = now
        self._last = number


class RecordedTopic:
    """A topic being recorded, from its opening to :meth:`close`."""

    def __init__(
        self,
        node: Node,
        name: str,
        type_name: str,
        on_messages: Callable[[RecordedTopic, Iterator[Taken]], None],
        expect_latched: bool = False,
    ) -> None:
        """Subscribe.

        name: full name of the topic.
        type_name: such as ``std_msgs/msg/Int32``.
        on_messages: called with the messages that have arrived; it must take them all.
        expect_latched: request earlier messages while no publisher is known.
        If requested later, they would arrive after newer messages.
        Raises UnknownTypeError: the type is not installed.
        Raises OSError: its definition cannot be read.
        """
        self.name = name
        self.type_name = type_name
        self.received = False
        self._known = False  # somebody else has subscribed
        self.losses = LossCount()
        self._node = node
        self._class = message_class(type_name)
        self._schema = schema_text(type_name, message_definition)
        self._on_messages = on_messages
        self._ids = frozenset[bytes]()  # of publishers, at the last look
        self._offers = self._offered_now()
        self._qos = request_qos(self._offers, expect_latched)
        self._subscription: Subscription | None = None
        self._subscribe()
        self._type_hash = ""
        for info in node.get_subscriptions_info_by_topic(name):
            if info.topic_type == type_name and info.topic_type_hash.version > 0:
                self._type_hash = str(info.topic_type_hash)

    def waiting_messages(self, most: int = QUEUE_DEPTH) -> Iterator[Taken]:
        """Yield the messages that wait in the middleware, at most one full queue."""
        if self._subscription is None:
            return
        handle = self._subscription.handle
        with handle:
            for _ in range(most):
                taken = handle.take_message(self._class, True)
                if taken is None:
                    return
                yield taken

    def follow_publishers(self) -> None:
        """Subscribe anew if a publisher cannot be heard with the request we made before."""
        offers = self._offered_now()
        self.was_there()
        if not offers:
            return
        self._offers = offers
        wanted = request_qos(offers)
        too_reliable = wanted.reliability != self._qos.reliability == ReliabilityPolicy.RELIABLE
        too_durable = wanted.durability != self._qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
        latched_before_us = not self.received and wanted.durability != self._qos.durability
        if too_reliable or too_durable or latched_before_us:
            self.close()
            self._qos = wanted
            self._subscribe()

    def was_there(self) -> bool:
        """Return whether anybody else has been on the topic so far."""
        self._known = self._known or self._node.count_subscribers(self.name) > 1
        return self._known or bool(self._offers)

    def publishers(self) -> frozenset[bytes]:
        """Return the ids of those who publish; of several, which count nothing, as looked up last.

        To look with each message would take most of our time; `follow_publishers` does it soon.
        """
        if len(self._ids) < 2:
            self._offered_now()
        return self._ids

    def description(self) -> TopicDescription:
        """Return the description of the topic for a bag, with the QoS that publishers offer now."""
        return TopicDescription(
            name=self.name,
            type=self.type_name,
            schema=self._schema,
            type_hash=self._type_hash,
            offered_qos=tuple(_as_offered(qos) for qos in self._offered_now() or self._offers),
        )

    def close(self) -> None:
        """Hand over the waiting messages and unsubscribe; closing twice does no harm."""
        self._on_messages(self, self.waiting_messages())
        self.abandon()

    def abandon(self) -> None:
        """Unsubscribe, whatever may have arrived; twice does no harm."""
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None

    def _subscribe(self) -> None:
        self._subscription = self._node.create_subscription(
            self._class,
            self.name,
            self._on_message,  # type: ignore[arg-type]  # rclpy's hints leave out the second one
            self._qos,
            raw=True,
        )

    def _on_message(self, data: bytes, info: dict[str, Any]) -> None:
        # One message wakes the executor; taking the others along costs far less than a round each.
        self._on_messages(self, chain([(data, info)], self.waiting_messages(AT_ONCE)))

    def _offered_now(self) -> tuple[QoSProfile, ...]:
        infos = self._node.get_publishers_info_by_topic(self.name)
        self._ids = frozenset(bytes(info.endpoint_gid) for info in infos)
        return tuple(info.qos_profile for info in infos)


def _as_offered(qos: QoSProfile) -> OfferedQos:
    names = ("reliability", "durability", "history", "liveliness")
    return OfferedQos(
        **{name: getattr(qos, name).name.lower() for name in names},
        depth=qos.depth,
        deadline_ns=qos.deadline.nanoseconds,
        lifespan_ns=qos.lifespan.nanoseconds,
        liveliness_lease_duration_ns=qos.liveliness_lease_duration.nanoseconds,
        avoid_ros_namespace_conventions=qos.avoid_ros_namespace_conventions,
    )


class Recording:
    """Takes messages from its beginning to :meth:`close`."""

    def __init__(self, node: Node, bag: BagWriter, choice: Choice) -> None:
        """Subscribe to the topics that are known; from here on, this object closes the bag."""
        self.bag = bag
        self._node = node
        self._choice = choice = choice.with_axes(axes_in(node))
        self.topics: dict[str, RecordedTopic] = {}  #: that are recorded, by name
        self._refused: set[str] = set()
        self._clock = UnsetClock()
        self.rate = 0.0  #: messages per second, between the last two counts
        self._counted = 0, time.monotonic_ns(), 0  # messages, and when (ns), and lost ones
        try:
            for axis in choice.axes:  # whose topics are known before anybody publishes
                kept = {topic.full_name(axis) for topic in OUTPUTS.values() if topic.kept}
                for name, type_name in axis_topics(axis).items():
                    if name not in self.topics and choice.takes(name):
                        self._open(name, type_name, name in kept)
            self._add_new_topics()
        except BaseException:
            bag.discard()
            raise
        node.get_logger().info(f"recording {choice} to {bag.folder}")

    @property
    def lost(self) -> tuple[int, int]:
        """Messages that were published but never came, and those from before we heard of them."""
        losses = [topic.losses for topic in self.topics.values()]
        return sum(one.lost for one in losses), sum(one.before_joining for one in losses)

    def count_anew(self) -> int:
        """Count messages for the rate; return those that were lost since the last count."""
        before = self._counted
        self._counted = self.bag.message_count, time.monotonic_ns(), self.lost[0]
        count, ns, lost = (now - then for now, then in zip(self._counted, before, strict=True))
        self.rate = 1e9 * count / max(ns, 1)
        return lost

    def follow_graph(self) -> None:
        """Look for new axes and topics, and for publishers that want another QoS."""
        choice = self._choice.with_axes(axes_in(self._node))
        if choice is not self._choice:
            new = ", ".join(choice.axes[len(self._choice.axes) :])
            self._node.get_logger().info(f"found {new}, and records all topics of it")
            self._choice = choice
        for topic in self.topics.values():
            topic.follow_publishers()
        for name in self._add_new_topics():
            kind = self.topics[name].type_name
            self._node.get_logger().info(f"recording {name} ({kind}) as well")

    def close(self) -> None:
        """Record the waiting messages, close the bag, log its content; closing twice does no harm.

        Raises BagError: writing fails.
        """
        bag = self.bag
        if bag.closed:
            return
        try:
            for topic in self.topics.values():
                topic.close()
                # Of an axis that nobody named, most topics never were there.
                if not topic.received and (topic.was_there() or not self._choice.every):
                    bag.add_topic(topic.description())
            lost, before_joining = self.lost
            bag.custom_data["lost_messages"] = str(lost)
            bag.custom_data["messages_before_joining"] = str(before_joining)
        finally:
            for topic in self.topics.values():
                topic.abandon()
            bag.close()
        counts = ", ".join(f"{name} {n}" for name, n in sorted(bag.counts.items()) if n)
        self._node.get_logger().info(
            f"recorded {bag.message_count} messages to {bag.folder}"
            f"{f' ({counts})' if counts else ''}, "
            f"lost {lost}, sent before joining {before_joining}"
        )

    def _add_new_topics(self) -> list[str]:
        return [
            name
            for name, type_names in self._node.get_topic_names_and_types()
            if name not in self.topics
            and self._choice.takes(name)
            and self._open(name, type_names[0])
        ]

    def _open(self, name: str, type_name: str, expect_latched: bool = False) -> bool:
        if name in self._refused:
            return False
        try:
            topic = RecordedTopic(self._node, name, type_name, self._record, expect_latched)
            self.topics[name] = topic
        except UnknownTypeError as error:
            self._refused.add(name)
            self._node.get_logger().warning(f"not recording {name}: {error}")
            return False
        except OSError as error:
            said = reason_and_cure(error)
            raise BagError(f"cannot read the definition of {type_name}: {said}") from error
        return True

    def _record(self, topic: RecordedTopic, messages: Iterable[Taken]) -> None:
        for data, info in messages:
            if not topic.received:
                topic.received = True
                self.bag.add_topic(topic.description())
                self._node.get_logger().info(f"first message of {topic.name}")
            number = info["publication_sequence_number"]
            topic.losses.note(number, topic.publishers)
            before = self._clock.set_by
            received = info["received_timestamp"] or Clock().now().nanoseconds
            received = self._clock.time_of(received)
            if by := self._clock.set_by - before:
                self._node.get_logger().warning(
                    f"the clock of the machine was set by {1e-9 * by:+.3f} s; the times of "
                    "reception in the bag go on without that"
                )
            self.bag.write(
                topic.name,
                data,
                log_ns=received,
                publish_ns=info["source_timestamp"] or received,
                sequence=(number or 0) & 0xFFFFFFFF,  # MCAP has room for 32 bits of it
            )
