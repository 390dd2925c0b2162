# SPDX-License-Identifier: Apache-2.0
"""Who commands an axis: the last command wins, so two nodes at once are worth a word."""

from __future__ import annotations

from rclpy.node import Node

#: Reports after which a commander that sends nothing more is no longer counted
_FORGOTTEN = 10


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
