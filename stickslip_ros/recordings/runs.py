# SPDX-License-Identifier: Apache-2.0
"""The content of a bag: the runs of axes, their events and states, and a description."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

from stickslip_ros.axis.events import (
    KEYS,
    NUMBER,
    START,
    Event,
    NotRepeatable,
    is_set_point,
    unpack_set_points,
)
from stickslip_ros.axis.joints import SOURCE, Joints, contact_joints, joints_of
from stickslip_ros.physics.parameters import PARAMETERS, ParameterError
from stickslip_ros.physics.parameters.groups import CONTACT_SUFFIX, SLIDER
from stickslip_ros.recordings.errors import BagError
from stickslip_ros.recordings.mcap_files import BagMessage
from stickslip_ros.recordings.messages import decode_messages, decoder_for, not_of_type, statuses
from stickslip_ros.recordings.metadata import TopicDescription
from stickslip_ros.recordings.reader import BagReader
from stickslip_ros.recordings.schemas import STATUS_TYPE, nanoseconds

if TYPE_CHECKING:
    from stickslip_ros.axis import Axis


class Sample(NamedTuple):
    """One recorded message about the state of an axis."""

    time_ns: int  #: of simulation, since the start of the axis
    message: Any  #: sensor_msgs/JointState, with as many values of each kind as names, or none
    recorded: BagMessage


@dataclass
class RecordedRun:
    """One axis from its start on."""

    node: str  #: full name of the axis node
    start_ns: int  #: stamp of the simulation time 0
    events: list[Event] = field(default_factory=list)
    #: stamp at which the next run of the same node starts, None if there is none
    end_ns: int | None = None

    @property
    def axis_name(self) -> str:
        """Name of the axis, which its joints begin with."""
        return str(self.events[0].details.get("axis_name", "axis"))

    @property
    def missing_events(self) -> str:
        """Which events were lost and when, by their running numbers; empty: none."""
        numbered = [event for event in self.events if event.number]
        lost = [
            f"{a.number + 1} to {b.number - 1} between {a.time:.6g} s and {b.time:.6g} s"
            for a, b in pairwise(numbered)
            if b.number > a.number + 1
        ]
        return "; ".join(lost)

    @property
    def reports_readings(self) -> bool:
        """Whether its joint_states are a `JointReport`; before 2.0.0 they were the truth."""
        return SOURCE in self.events[0].details

    @property
    def state_topics(self) -> dict[str, tuple[str, Callable[[Axis], Joints]]]:
        """The topics with what a driver would say of it, with the model's own state, and with the
        contact: the joint that each is about, and what computes all of the truth.

        That of readings takes a `JointReport`, see :attr:`reports_readings`.
        """
        return {
            f"{self.node.rpartition('/')[0]}/joint_states": (SLIDER, joints_of),
            f"{self.node}/truth": (SLIDER, joints_of),
            f"{self.node}/contact": (CONTACT_SUFFIX, contact_joints),
        }


#: Topics below the node of an axis with set points, which are events as well
SET_POINT_TOPICS = ("set_points", "set_point_log")


def _event_topics(bag: BagReader) -> list[str]:
    """Return the topics on which axes published their events."""
    return [
        name
        for name, topic in bag.topics.items()
        if topic.type == STATUS_TYPE and name.endswith("/events")
    ]


def recorded_axes(bag: BagReader) -> dict[str, dict[str, str]]:
    """Return the parameters of every recorded axis as texts, by the name of its events topic.

    They stand in the event "start", with which the events of an axis begin.

    Raises BagError: a start event is damaged.
    """
    found = {}
    for topic in _event_topics(bag):
        first = next(statuses(bag, topic), None)
        if first and first.values.get("event") == START:
            about = (*KEYS, NUMBER)
            found[topic] = {key: text for key, text in first.values.items() if key not in about}
    return found


def recorded_runs(bag: BagReader) -> list[RecordedRun]:
    """Return every run in the bag that has events; NotRepeatable if there is none."""
    runs = [run for topic in _event_topics(bag) for run in _runs_on(bag, topic)]
    if not runs:
        raise NotRepeatable(
            f"{bag.path} holds no events of an axis; record the topic <axis node>/events as well"
        )
    return runs


def _runs_on(bag: BagReader, topic: str) -> list[RecordedRun]:
    runs: list[RecordedRun] = []
    seen: set[tuple[int, tuple[str, ...]]] = set()
    for status in statuses(bag, topic):
        known = (status.stamp_ns, tuple(status.values.values()))
        if known in seen:  # a late joiner hears again what was latched
            continue
        seen.add(known)
        for event in _events(bag, status.values):
            if event.name == START or not runs:
                runs.append(RecordedRun(topic.removesuffix("/events"), status.stamp_ns))
            runs[-1].events.append(event)
    for before, after in pairwise(runs):
        before.end_ns = after.start_ns
    for name in SET_POINT_TOPICS:
        _add_set_points(bag, f"{topic.removesuffix('/events')}/{name}", runs)
    return runs


def _add_set_points(bag: BagReader, topic: str, runs: list[RecordedRun]) -> None:
    """Add the set points of a topic to their runs, in order of time; no two are of one time."""
    if topic not in bag.topics:
        return
    found: dict[int, list[Event]] = {}
    for status in statuses(bag, topic):
        if before := [k for k, run in enumerate(runs) if run.start_ns <= status.stamp_ns]:
            found.setdefault(before[-1], []).extend(_events(bag, status.values))
    for number, events in found.items():
        known = {event.time for event in runs[number].events if is_set_point(event)}
        new = {event.time: event for event in events if event.time not in known}
        # The start stays first, and so does the order of the others: their times never run back.
        runs[number].events[1:] = heapq.merge(
            runs[number].events[1:],
            [new[time] for time in sorted(new)],
            key=lambda event: event.time,
        )


def _events(bag: BagReader, texts: dict[str, str]) -> list[Event]:
    """Return the events that a status holds, many if they are set points, none if it is another."""
    try:
        event = Event.of(texts)
        return unpack_set_points(event) if event else []
    except (LookupError, TypeError, ValueError) as error:
        raise NotRepeatable(
            f"an event in {bag.path} cannot be understood: {type(error).__name__}: {error}"
        ) from None


def recorded_states(bag: BagReader, run: RecordedRun) -> Iterator[Sample]:
    """Yield the recorded states of an axis, in order of simulation time.

    Raises NotRepeatable: the stamps of a topic run back. Raises BagError: a message is damaged, or
    not what its type says.
    """
    streams = [_states_on(bag, topic, run) for topic in run.state_topics if bag.counts.get(topic)]
    return heapq.merge(*streams, key=lambda sample: sample.time_ns)


def _states_on(bag: BagReader, topic: str, run: RecordedRun) -> Iterator[Sample]:
    joint = run.axis_name + run.state_topics[topic][0]
    last = -1
    for message, state in decode_messages(bag, [topic]):
        try:
            stamp = nanoseconds(state.header.stamp)
            short = any(
                len(values) not in (0, len(state.name))
                for values in (state.position, state.velocity, state.effort)
            )
            elsewhere = joint not in state.name
        except (AttributeError, TypeError) as error:
            raise not_of_type(bag, topic, error) from None
        if elsewhere or stamp < run.start_ns or (run.end_ns and stamp >= run.end_ns):
            continue
        if short:
            raise BagError(
                f"a message on {topic} of {bag.path} names {len(state.name)} joints but has "
                "another number of values; record it anew"
            )
        if stamp - run.start_ns < last:
            raise NotRepeatable(
                f"the stamps of {topic} run back: it holds more than one run at a time"
            )
        last = stamp - run.start_ns
        yield Sample(last, state, message)


def describe(bag: BagReader) -> dict[str, Any]:
    """Describe the content of a bag, SI units; times since the Unix epoch are whole ns.

    Raises BagError: a start event is damaged.
    """
    return {
        "bag": str(bag.path),
        "size": sum(file.size for file in bag.files),
        "start_ns": bag.start_ns,
        "end_ns": bag.end_ns,
        "duration": 1e-9 * (bag.end_ns - bag.start_ns),
        "messages": bag.message_count,
        "files": [asdict(file) for file in bag.files],
        "compression": bag.compressions,
        "packed": bag.metadata.compression_mode,
        "topics": [
            {
                "name": topic.name,
                "type": topic.type,
                "messages": bag.counts[topic.name],
                "type_hash": topic.type_hash,
                "encoding": topic.encoding,
                "undecodable": _why_undecodable(topic) if bag.counts[topic.name] else None,
                "offered_qos": [profile.as_json() for profile in topic.offered_qos],
            }
            for topic in bag.topics.values()
        ],
        "ros_distro": bag.metadata.ros_distro,
        "metadata_version": bag.metadata.version,
        "written_by": bag.libraries,
        "custom_data": bag.custom_data,
        "warnings": [*bag.warnings, *([bag.bulk.told] if bag.bulk.apart else [])],
        "axes": {
            topic: {name: _value(name, text) for name, text in texts.items()}
            for topic, texts in recorded_axes(bag).items()
        },
    }


def _value(name: str, text: str) -> Any:
    """Return the value of a parameter; the text as it is of what is none."""
    if name.endswith("_version") and text.isdecimal():
        return int(text[:20])
    try:
        value = PARAMETERS[name].parse(text)
    except (KeyError, ParameterError):
        return text
    return text if isinstance(value, float) and not math.isfinite(value) else value


def _why_undecodable(topic: TopicDescription) -> str | None:
    """Return why messages of a topic cannot be decoded, as far as its description tells."""
    try:
        decoder_for(topic)
    except BagError as error:
        return str(error)
    return None
