# SPDX-License-Identifier: Apache-2.0
"""One recording: its topics, its bag, its losses."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

from rclpy.clock import Clock
from rclpy.node import Node

from stickslip_ros.axis.commands import COMMANDS
from stickslip_ros.base.files import reason_and_cure
from stickslip_ros.recordings import BagError, BagWriter
from stickslip_ros.ros.nodes.messages import UnknownTypeError
from stickslip_ros.ros.nodes.recorded_topic import RecordedTopic, Taken
from stickslip_ros.ros.nodes.topics import OUTPUTS, axes_in

_STEP = 1_000_000_000  # ns by which a clock that is set differs at least from one that is trimmed


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

    def known(self) -> dict[str, str]:
        """Return topics and their types that can be subscribed before anybody publishes."""
        everything = {name: kind for axis in self.axes for name, kind in axis_topics(axis).items()}
        return {name: kind for name, kind in everything.items() if self.takes(name)}

    def latched(self) -> set[str]:
        """Return the topics among the known ones that an axis keeps for late joiners."""
        return {
            topic.full_name(axis) for axis in self.axes for topic in OUTPUTS.values() if topic.kept
        }

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


class UnsetClock:
    """The clock of the machine without steps, because bags are read in the order of times.

    Corrections of the clock by less than a second are followed.
    """

    def __init__(
        self,
        wall: Callable[[], int] = time.time_ns,
        steady: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """Begin with the clocks (ns) as they are."""
        self._wall, self._steady = wall, steady
        self._offset = wall() - steady()
        self.set_by = self._before = 0  #: ns since the beginning

    def time_of(self, ns: int) -> int:
        """Convert a recent time of the machine's clock (ns) to the clock without steps."""
        wall = self._wall()
        set_by = wall - self._steady() - self._offset
        if abs(set_by - self.set_by) >= _STEP:
            self._before, self.set_by = self.set_by, set_by
        # What was read off just before it was set is nearer to the present without that.
        now = wall - self.set_by
        return min(ns - self.set_by, ns - self._before, key=lambda one: abs(one - now))


class Recording:
    """Takes messages from its beginning to :meth:`close`."""

    def __init__(self, node: Node, bag: BagWriter, choice: Choice) -> None:
        """Subscribe to the topics that are known; from here on, this object closes the bag."""
        self.bag = bag
        self._node = node
        self._choice = choice = choice.with_axes(axes_in(node))
        self._topics: dict[str, RecordedTopic] = {}
        self._refused: set[str] = set()
        self._clock = UnsetClock()
        try:
            latched = choice.latched()
            for name, type_name in choice.known().items():
                self._open(name, type_name, name in latched)
            self._add_new_topics()
        except BaseException:
            bag.discard()
            raise
        node.get_logger().info(f"recording {choice} to {bag.folder}")

    @property
    def lost(self) -> int:
        """Messages that were published but never came."""
        return sum(topic.losses.lost for topic in self._topics.values())

    @property
    def before_joining(self) -> int:
        """Messages that publishers had sent before we heard them."""
        return sum(topic.losses.before_joining for topic in self._topics.values())

    def losses(self) -> Iterator[tuple[str, int]]:
        """Yield every topic that lost messages, and how many."""
        for name, topic in self._topics.items():
            if topic.losses.lost:
                yield name, topic.losses.lost

    def follow_graph(self) -> None:
        """Look for new axes and topics, and for publishers that want another QoS."""
        choice = self._choice.with_axes(axes_in(self._node))
        if choice is not self._choice:
            new = ", ".join(choice.axes[len(self._choice.axes) :])
            self._node.get_logger().info(f"found {new}, and records all topics of it")
            self._choice = choice
        for topic in self._topics.values():
            topic.follow_publishers()
        for name in self._add_new_topics():
            kind = self._topics[name].type_name
            self._node.get_logger().info(f"recording {name} ({kind}) as well")

    def close(self) -> None:
        """Record the waiting messages, close the bag, log its content; closing twice does no harm.

        Raises BagError: writing fails.
        """
        bag = self.bag
        if bag.closed:
            return
        try:
            for topic in self._topics.values():
                topic.close()
                # Of an axis that nobody named, most topics never were there.
                if not topic.received and (topic.was_there() or not self._choice.every):
                    bag.add_topic(topic.description())
            bag.custom_data["lost_messages"] = str(self.lost)
            bag.custom_data["messages_before_joining"] = str(self.before_joining)
        finally:
            for topic in self._topics.values():
                topic.abandon()
            bag.close()
        counts = ", ".join(f"{name} {n}" for name, n in sorted(bag.counts.items()) if n)
        self._node.get_logger().info(
            f"recorded {bag.message_count} messages to {bag.folder}"
            f"{f' ({counts})' if counts else ''}, "
            f"lost {self.lost}, sent before joining {self.before_joining}"
        )

    def _add_new_topics(self) -> list[str]:
        return [
            name
            for name, type_names in self._node.get_topic_names_and_types()
            if name not in self._topics
            and self._choice.takes(name)
            and self._open(name, type_names[0])
        ]

    def _open(self, name: str, type_name: str, expect_latched: bool = False) -> bool:
        if name in self._refused:
            return False
        try:
            self._topics[name] = RecordedTopic(
                self._node, name, type_name, self._record, expect_latched
            )
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
