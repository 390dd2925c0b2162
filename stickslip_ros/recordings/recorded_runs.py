# SPDX-License-Identifier: Apache-2.0
"""The runs of axes that a bag holds: their events, and the states that were recorded of them."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from stickslip_ros.axis import Event
from stickslip_ros.axis.events import event_of
from stickslip_ros.axis.resimulation import START, NotRepeatable
from stickslip_ros.recordings import STATUS_TYPE, BagReader, decoder_for, nanoseconds, statuses


class Sample(NamedTuple):
    """One recorded message about the state of an axis."""

    time_ns: int  #: of simulation, since the start of the axis
    topic: str
    message: Any  #: sensor_msgs/JointState
    log_ns: int  #: when it was recorded
    publish_ns: int  #: when it was published
    sequence: int


@dataclass
class RecordedRun:
    """One axis from its start on."""

    node: str  #: full name
    start_ns: int  #: stamp of the simulation time 0
    events: list[Event] = field(default_factory=list)

    @property
    def axis_name(self) -> str:
        """Name of the axis, which its joints begin with."""
        return str(self.events[0].details.get("axis_name", "axis"))

    @property
    def joints_topic(self) -> str:
        """Topic with runner and actuator."""
        return f"{self.node.rpartition('/')[0]}/joint_states"

    @property
    def contact_topic(self) -> str:
        """Topic with the contact."""
        return f"{self.node}/contact"


def recorded_runs(bag: BagReader) -> list[RecordedRun]:
    """Return every run in the bag that has events; NotRepeatable if there is none."""
    runs: list[RecordedRun] = []
    for topic in bag.topics.values():
        if topic.name.endswith("/events") and topic.type == STATUS_TYPE:
            runs += _runs_of(bag, topic.name)
    if not runs:
        raise NotRepeatable(
            f"{bag.path} holds no events of an axis; record the topic <axis node>/events as well"
        )
    return runs


def _runs_of(bag: BagReader, topic: str) -> list[RecordedRun]:
    runs: list[RecordedRun] = []
    seen: set[tuple[int, tuple[str, ...]]] = set()
    for status in statuses(bag, topic):
        known = (status.stamp_ns, tuple(status.values.values()))
        if known in seen:  # a late joiner hears again what was latched
            continue
        seen.add(known)
        event = _event(bag, status.values)
        if event is None:
            continue
        if event.name == START or not runs:
            runs.append(RecordedRun(topic.removesuffix("/events"), status.stamp_ns))
        runs[-1].events.append(event)
    return runs


def _event(bag: BagReader, texts: dict[str, str]) -> Event | None:
    try:
        return event_of(texts)
    except ValueError as error:
        raise NotRepeatable(f"an event in {bag.path} cannot be understood: {error}") from None


def samples_of(bag: BagReader, run: RecordedRun, end_ns: int | None = None) -> Iterator[Sample]:
    """Yield what was recorded of the state of an axis, in order of simulation time.

    end_ns: stamp of the start of the next run of the same node, if there is one.
    """
    streams = [
        _stream(bag, topic, run, end_ns)
        for topic in (run.joints_topic, run.contact_topic)
        if bag.counts.get(topic)
    ]
    return heapq.merge(*streams, key=lambda sample: sample.time_ns)


def _stream(bag: BagReader, topic: str, run: RecordedRun, end_ns: int | None) -> Iterator[Sample]:
    decode = decoder_for(bag.topics[topic])
    joint = run.axis_name + ("_contact" if topic == run.contact_topic else "_slider")
    last = -1
    for message in bag.messages([topic]):
        state = decode(message.data)
        stamp = nanoseconds(state.header.stamp)
        if joint not in state.name or stamp < run.start_ns or (end_ns and stamp >= end_ns):
            continue
        if stamp - run.start_ns < last:
            raise NotRepeatable(
                f"the stamps of {topic} run back: it holds more than one run at a time"
            )
        last = stamp - run.start_ns
        yield Sample(last, topic, state, message.log_ns, message.publish_ns, message.sequence)


@dataclass
class Difference:
    """How far a quantity that was run again lies from what was recorded."""

    values: int = 0  #: compared
    unequal: int = 0  #: not the same to the last bit
    largest: float = 0.0  #: in the unit of the quantity
    at: float = float("nan")  #: s of simulation at which it is largest

    def note(self, recorded: float, again: float, time_ns: int) -> None:
        """Take one pair."""
        self.values += 1
        if recorded == again:
            return
        self.unequal += 1
        if not abs(again - recorded) <= self.largest:
            self.largest, self.at = abs(again - recorded), time_ns * 1e-9
