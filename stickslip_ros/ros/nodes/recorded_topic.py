# SPDX-License-Identifier: Apache-2.0
"""One topic under recording: its raw subscription, its publishers' QoS, its lost messages."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import chain
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from stickslip_ros.recordings import OfferedQos, TopicDescription
from stickslip_ros.recordings.message_types import schema_text
from stickslip_ros.ros.nodes.messages import message_class, message_definition

# At 1 kHz, ten seconds of messages may wait for us while the machine has no time; those of one
# second are taken at once, before others are heard. Fast DDS makes room as it needs it.
QUEUE_DEPTH, AT_ONCE = 10_000, 1000

Taken = tuple[bytes, dict[str, Any]]
"""A serialized message, and the information of the middleware about it."""


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
        self.lost = 0
        self.before_joining = 0
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
            offered_qos=tuple(_offered(qos) for qos in self._offered_now() or self._offers),
        )

    def close(self) -> None:
        """Hand over the waiting messages and unsubscribe; closing twice does no harm."""
        if self._subscription is None:
            return
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


def _offered(qos: QoSProfile) -> OfferedQos:
    return OfferedQos(
        reliability=qos.reliability.name.lower(),
        durability=qos.durability.name.lower(),
        history=qos.history.name.lower(),
        depth=qos.depth,
        deadline_ns=qos.deadline.nanoseconds,
        lifespan_ns=qos.lifespan.nanoseconds,
        liveliness=qos.liveliness.name.lower(),
        liveliness_lease_ns=qos.liveliness_lease_duration.nanoseconds,
        avoid_ros_namespace_conventions=qos.avoid_ros_namespace_conventions,
    )
