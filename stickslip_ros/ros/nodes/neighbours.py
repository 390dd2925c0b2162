# SPDX-License-Identifier: Apache-2.0
"""Who else is there: nodes that command an axis, and those that publish its joints."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence

from builtin_interfaces.msg import Time
from rclpy.node import Node
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState

_FORGOTTEN = 10  # looks after which a commander that sends nothing more is no longer counted
_LISTENED = 3  # looks for which new publishers of joints are listened to


class Commanders:
    """Tells the nodes that command an axis, as far as the graph and the numbers of messages do.

    A message does not say who sent it. Where one node alone publishes on a topic, it did; where
    several do, numbers that are out of turn show that more than one of them sends. Where there are
    no numbers, all of them count.
    """

    def __init__(self) -> None:
        """Start without having heard of anybody."""
        self._last: dict[str, int | None] = {}  # number of the last message on each topic
        self._mixed: dict[str, bool] = {}  # topics with messages since the last look: out of turn
        self._heard: dict[str, int] = {}  # looks since a node has sent something

    def note(self, topic: str, number: int | None) -> None:
        """Take the number that the publisher gave a message; None: the middleware tells none."""
        before = self._last.get(topic)
        self._last[topic] = number
        out_of_turn = number is None or (before is not None and number != before + 1)
        self._mixed[topic] = self._mixed.get(topic, False) or out_of_turn

    def look(self, node: Node) -> list[str]:
        """Return the full names of those that command the axis, if there are several."""
        self._heard = {name: n + 1 for name, n in self._heard.items() if n < _FORGOTTEN}
        present: set[str] = set()
        for topic in self._last:
            infos = node.get_publishers_info_by_topic(topic)
            names = {f"{one.node_namespace.rstrip('/')}/{one.node_name}" for one in infos}
            present |= names
            if topic in self._mixed and (len(infos) == 1 or self._mixed[topic]):
                self._heard |= dict.fromkeys(names, 0)
        self._mixed = {}
        found = sorted(name for name in self._heard if name in present)
        return found if len(found) > 1 else []


class JointSpeakers:
    """Finds joints of this process that somebody else publishes on the same topic.

    Only the messages tell, and with a subscription no axis would rest: so it lasts for a few looks,
    after there was a publisher more than before. A message is somebody else's where its stamp is
    none of the states that were published here.
    """

    def __init__(self, node: Node) -> None:
        """Take the node that listens."""
        self.joints: set[str] = set()  #: those that others publish
        self._node = node
        self._others: dict[str, int] = {}  # publishers of other processes on each topic
        self._ears: dict[str, tuple[Subscription, int]] = {}  # and the looks that are left
        self._stamps = deque[Time](maxlen=1000)  # more than may be on their way

    def said(self, time: Time) -> None:
        """Note the stamp of states that are published here."""
        if not self._stamps or self._stamps[-1] != time:
            self._stamps.append(time)

    def look(self, topics: Sequence[str]) -> None:
        """Listen to those who are new; topics: that on which each axis publishes its joints."""
        for topic, own in Counter(topics).items():
            others = self._node.count_publishers(topic) - own
            ear, left = self._ears.pop(topic, (None, 0))
            if others > self._others.get(topic, 0):
                left = _LISTENED
                ear = ear or self._node.create_subscription(JointState, topic, self._hear, 10)
            if ear and left:
                self._ears[topic] = ear, left - 1
            elif ear:
                self._node.destroy_subscription(ear)
            if others <= 0:
                self.joints.clear()
            self._others[topic] = others

    def _hear(self, message: JointState) -> None:
        if message.header.stamp not in self._stamps:
            self.joints.update(message.name)
