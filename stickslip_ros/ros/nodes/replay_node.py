# SPDX-License-Identifier: Apache-2.0
"""Node that plays a bag: every message as recorded, at its time, with the QoS it was offered with.

A thread keeps the time; the node itself answers to parameters and signals meanwhile. Deadlines are
absolute on the steady clock, so single delays do not add up, and late messages do not come in
bursts. After a stop of the whole process (a debugger, SIGSTOP, a suspended laptop), the rest is
played later by the duration of the stop. With ``use_sim_time`` the topic /clock keeps the time.

What is kept for late subscribers, such as the model of a robot, is sent first where playing starts
after it.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Sequence
from functools import partial
from typing import Any

from rclpy.duration import Duration
from rclpy.exceptions import NameValidationException
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock as ClockMessage

from stickslip_ros.base.clocks import Timetable, with_ticks
from stickslip_ros.base.errors import UsageError, printable
from stickslip_ros.recordings import OfferedQos, open_bag
from stickslip_ros.recordings.metadata import is_kept
from stickslip_ros.ros.nodes.guarded_node import CLOCK_TOPIC, GuardedNode
from stickslip_ros.ros.nodes.messages import UnknownTypeError, message_class, stamp
from stickslip_ros.ros.nodes.node_parameters import OwnParameter, full_name, read_own, run_node

NODE_NAME = "stickslip_replay"
_DEPTH = 1000
_MATCHING = 3.0  # s in which new publishers find listeners that are there already
_QUIET = 0.5  # s without anybody new, which means that all have
_ACKNOWLEDGED = 3.0  # s, the last messages may take to arrive

PARAMETERS = (
    OwnParameter("bag", "", "folder of the bag, or one of its files"),
    OwnParameter("rate", 1.0, "speed: 2 plays in half the time", "", 1e-3, 1e6),
    OwnParameter("loop", False, "play again and again"),
    OwnParameter("start", 0.0, "s after the beginning to start at", "s", 0.0, 1e9),
    OwnParameter("duration", 0.0, "s to play; 0 plays to the end", "s", 1e-6, 1e9, "all"),
    OwnParameter("topics", [""], "topics to play; none: all"),
    OwnParameter(
        "clock", 0.0, "Hz at which /clock is published; 0: never", "Hz", 0.01, 1e4, "never"
    ),
)


class ReplayNode(GuardedNode):
    """Plays until :attr:`finished` is done."""

    def __init__(self, **options: Any) -> None:
        """Read the parameters, open the bag, start to play.

        options are those of `rclpy.node.Node`. Raises UsageError for a bad parameter and BagError
        for a bad bag.
        """
        super().__init__(NODE_NAME, **options)
        self.played = 0  #: messages so far
        self._given = read_own(self, PARAMETERS)
        given, path = self._given, self._given["bag"]
        if not path:
            raise UsageError("parameter bag is empty; name the folder of a bag, -p bag:=FOLDER")
        self._bag = open_bag(path)
        if not self._bag.message_count:
            raise UsageError(f"{path} has no messages; name another bag")
        begin = self._bag.start_ns
        length = (self._bag.end_ns - begin) * 1e-9
        if given["start"] > length:
            raise UsageError(
                f"parameter start is {given['start']:g} s, "
                f"but the bag is {length:g} s long; start earlier"
            )
        self._first = begin + round(given["start"] * 1e9)
        lasts = round(given["duration"] * 1e9)
        self._past = self._first + lasts if lasts else self._bag.end_ns + 1  # ns, not to play
        self._outlets = self._make_publishers()
        self._clock_out: Publisher | None = None
        if given["clock"]:
            self._clock_out = self.create_publisher(ClockMessage, "/clock", 10)
        if self.followed and (self._clock_out or CLOCK_TOPIC in self._outlets):
            raise UsageError(
                "use_sim_time lets /clock lead the time, and this would publish it as well: leave "
                "out use_sim_time, or the parameter clock and, of the topics of the bag, /clock"
            )
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._play, name="player", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End playing, log how much that was; twice does no harm."""
        self._ended.set()
        self._thread.join()
        self._bag.close()
        if not self.finished.exception():  # which is said last
            self.get_logger().info(f"played {self.played} messages", once=True)

    def _make_publishers(self) -> dict[str, Publisher]:
        wanted = [full_name(self, "topics", name) for name in self._given["topics"] if name]
        known = self._bag.topics
        for name in wanted:
            if name not in known:
                raise UsageError(f"no topic {name} in the bag; it has {', '.join(known)}")
        publishers = {}
        for name in wanted or known:
            topic = known[name]
            if name == "/clock" and self._given["clock"]:
                continue  # this node publishes its own clock instead
            try:
                kind, qos = message_class(topic.type), offered_qos(topic.offered_qos)
                publishers[name] = self.create_publisher(kind, name, qos)
            except (UnknownTypeError, NameValidationException) as error:
                why = " ".join(str(error).split())
                self.get_logger().warning(printable(f"not playing {name}: {why}"))
        if not publishers:
            raise UsageError("nothing in the bag can be played")
        return publishers

    # -- playing, in its own thread

    def _play(self) -> None:
        try:
            self._wait_for_listeners()
            while self.followed and self.followed.missing() and not self._ended.wait(0.05):
                pass
            if self._bag.bulk.apart:
                self.get_logger().warning(self._bag.bulk.told)
            if self._given["start"] or self._bag.bulk.apart:
                self._send_kept()
            while self._play_once() and self._given["loop"] and not self._ended.is_set():
                pass
            for publisher in self._outlets.values():
                if not self._ended.is_set():
                    publisher.wait_for_all_acked(Duration(seconds=_ACKNOWLEDGED))
            self.finished.set_result(None)
        except Exception as error:  # handed over to the thread that waits for the end
            self.finished.set_exception(error)

    def _wait_for_listeners(self) -> None:
        """Wait until listeners that are there already are connected, or nobody turns up."""
        matched, since = -1, time.monotonic()
        deadline = since + _MATCHING
        while (now := time.monotonic()) < deadline and not self._ended.is_set():
            count = sum(p.get_subscription_count() for p in self._outlets.values())
            if count != matched:
                matched, since = count, now
            if now - since > _QUIET and count:
                break
            time.sleep(0.02)
        self.get_logger().info(
            f"playing {self._given['bag']} at {self._given['rate']:g} times, "
            f"{len(self._outlets)} topics"
        )

    def _send_kept(self) -> None:
        """Publish what late subscribers would have got at the start: messages from before it."""
        offers = {name: self._bag.topics[name].offered_qos for name in self._outlets}
        kept = {
            name: deque[bytes](maxlen=max(offer.depth for offer in offered) or _DEPTH)
            for name, offered in offers.items()
            if is_kept(offered)
        }
        if kept:
            for message in self._bag.messages(set(kept), 0, self._first):
                kept[message.topic].append(message.data)
        for name, messages in kept.items():
            for data in messages:
                self._outlets[name].publish(data)
                self.played += 1

    def _play_once(self) -> bool:
        """Play from start to end; return whether there was anything."""
        timetable = Timetable(self._given["rate"])
        if leader := self.followed:
            # A clock of few messages makes everything late, so lateness is no stop then.
            timetable = Timetable(self._given["rate"], lambda: 1e-9 * leader.reading(), math.inf)
        played = self.played
        clock = self._given["clock"]
        period = max(1, round(1e9 * self._given["rate"] / clock)) if clock else 0
        messages = self._bag.messages(set(self._outlets), self._first, self._past)
        timed = ((one.log_ns, one) for one in messages)
        for time_ns, message in with_ticks(timed, period):
            if not timetable.wait((time_ns - self._first) * 1e-9, self._ended.is_set):
                break
            if message is None:
                assert self._clock_out
                self._clock_out.publish(ClockMessage(clock=stamp(time_ns)))
            else:
                self._outlets[message.topic].publish(message.data)
                self.played += 1
        if timetable.moved:
            self.get_logger().warning(
                f"was suspended for {timetable.moved:.3f} s; playback continues from there"
            )
        return self.played > played


def offered_qos(offers: Sequence[OfferedQos]) -> QoSProfile:
    """Return the QoS of a publisher that replaces all recorded ones."""
    reliable = all(offer.reliability != "best_effort" for offer in offers)
    return QoSProfile(
        depth=_DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL
        if is_kept(offers)
        else DurabilityPolicy.VOLATILE,
    )


#: Plays a bag; returns 0 at its end or on request, 1 if it broke off, 2 on bad use
main = partial(run_node, "replay_node", ReplayNode, "Plays the messages of a bag.", PARAMETERS)
