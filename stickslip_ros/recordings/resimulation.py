# SPDX-License-Identifier: Apache-2.0
"""Simulates recorded axes again: compares every state, or changes parameters.

The same version gives every recorded state again: to the last bit where the arithmetic is that of
the recording, see `model.arithmetic`, elsewhere up to rounding. With changed parameters it is
another run under the same commands.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from stickslip_ros.axis import Axis
from stickslip_ros.axis.events import START, Event, NotRepeatable, event_texts, is_set_point
from stickslip_ros.axis.joints import SOURCE, TRUTH, JointReport, said_force
from stickslip_ros.axis.resimulation import Rerun, model_changes, start_of
from stickslip_ros.base.files import whole_folder
from stickslip_ros.physics.model.arithmetic import arithmetic
from stickslip_ros.physics.model.versions import MODEL_VERSION, ModelChange
from stickslip_ros.recordings.mcap_files import BagMessage
from stickslip_ros.recordings.messages import encoder_for
from stickslip_ros.recordings.reader import BagReader
from stickslip_ros.recordings.runs import (
    SET_POINT_TOPICS,
    RecordedRun,
    Sample,
    recorded_runs,
    recorded_states,
)
from stickslip_ros.recordings.writer import BagWriter
from stickslip_ros.version import __version__

#: Differences within this fraction of the largest recorded value of a quantity are rounding
_ROUNDING = 1e-12

#: The fields of a JointState, and their units
_UNITS = {"position": "m", "velocity": "m/s", "effort": "N"}

#: Field, index in the message, value that came out
_Values = list[tuple[str, int, float]]


@dataclass
class Difference:
    """The difference of a resimulated quantity from the recorded one."""

    values: int = 0  #: compared
    unequal: int = 0  #: not the same to the last bit
    largest: float = 0.0  #: difference, in the unit of the quantity
    at: float = float("nan")  #: s of simulation at which it is largest, nan if there is none
    scale: float = 0.0  #: largest recorded value, in that unit

    def note(self, recorded: float, again: float, time_ns: int) -> None:
        """Add one pair of states."""
        self.values += 1
        if abs(recorded) > self.scale:
            self.scale = abs(recorded)
        if said_force(recorded) == said_force(again):
            return
        self.unequal += 1
        if not abs(again - recorded) <= self.largest:
            self.largest, self.at = abs(again - recorded), time_ns * 1e-9


@dataclass
class Resimulated:
    """Result of one resimulated run."""

    axis: str
    version: str  #: of this package that the axis ran with
    arithmetic: str  #: digest of the arithmetic of its machine; empty in bags before 2.0.0
    model_version: int  #: of the model that it ran with
    #: what this model computes otherwise of the run, none if all is the same
    model_changes: list[ModelChange]
    commands: int  #: carried out again
    left_out: list[str]  #: commands that were refused because of the changes, each with the reason
    states: int = 0  #: compared
    #: velocities that were not compared: the report that they count from is not in the bag
    unknown_velocities: int = 0
    duration: float = 0.0  #: s of simulation
    #: by joint and field, such as ``axis_slider position``; that of ~/truth is ``true ...``
    differences: dict[str, Difference] = field(default_factory=dict)

    @property
    def bit_for_bit(self) -> bool:
        """Whether every recorded state came out again."""
        return not any(difference.unequal for difference in self.differences.values())

    @property
    def same_up_to_rounding(self) -> bool:
        """Whether every state came out again, but for the rounding of another processor."""
        if self.arithmetic == arithmetic():
            return self.bit_for_bit
        return all(one.largest <= _ROUNDING * one.scale for one in self.differences.values())

    def as_json(self) -> dict[str, Any]:
        """Return it as plain values, SI units."""
        return {
            **asdict(self),
            "this_version": __version__,
            "this_model_version": MODEL_VERSION,
            "this_arithmetic": arithmetic(),
            "model_changes": [
                {"version": change.version, "what": change.what, "largest": change.largest}
                for change in self.model_changes
            ],
            "bit_for_bit": self.bit_for_bit,
            "same_up_to_rounding": self.same_up_to_rounding,
            "differences": {
                name: {
                    **asdict(difference),
                    "at": difference.at if difference.unequal else None,
                    "unit": _UNITS[name.rpartition(" ")[2]],
                }
                for name, difference in self.differences.items()
            },
        }


def resimulate(
    bag: BagReader,
    changes: Mapping[str, Any] | None = None,
    out: Path | None = None,
    on_state: Callable[[], object] = lambda: None,
) -> list[Resimulated]:
    """Run every axis in a bag once more.

    changes: parameters that are other ones from the start on.
    out: folder of a new bag with what came out, there when all went well.
    on_state: called after each state.
    Raises NotRepeatable: a run cannot be repeated from the bag.
    Raises ParameterError: the changes are not parameters of an axis.
    Raises BagError: the bag is damaged.
    Raises WriteError: the new bag cannot be written.
    """
    changes = dict(changes or {})
    runs = recorded_runs(bag)
    with contextlib.ExitStack() as stack:
        copy = None
        if out:
            origin = {"resimulated_from": str(bag.path), "changes": json.dumps(changes)}
            folder = stack.enter_context(whole_folder(out))
            copy = _Copy(bag, stack.enter_context(BagWriter(folder, custom_data=origin)))
        return [_resimulate_run(bag, run, changes, copy, on_state) for run in runs]


def _resimulate_run(
    bag: BagReader,
    run: RecordedRun,
    changes: Mapping[str, Any],
    copy: _Copy | None,
    on_state: Callable[[], object],
) -> Resimulated:
    rerun = Rerun(run.events, changes)
    if lost := run.missing_events:
        raise NotRepeatable(
            f"events of {run.node} are missing in {bag.path}, number {lost}: what they did to the "
            "axis is not known; record again, on a machine with less load, "
            f"or from {run.node}/events alone"
        )
    applied = sum(event.outcome == "applied" for event in run.events)
    _, version, digest = start_of(run.events)
    model = model_changes(run.events)
    found = Resimulated(run.node, version, digest, *model, applied - 1, rerun.left_out)
    said = _Said(run, found)
    for sample in recorded_states(bag, run):
        axis = rerun.advance(sample.time_ns * 1e-9)
        values = said.values(axis, sample)
        for name, index, again in values:
            recorded = getattr(sample.message, name)[index]
            true = "true " if sample.recorded.topic == f"{run.node}/truth" else ""
            what = f"{true}{sample.message.name[index]} {name}"
            difference = found.differences.setdefault(what, Difference())
            difference.note(recorded, again, sample.time_ns)
        events = axis.take_events()
        if copy:
            if values:  # with other faults, a sensor may give no reading
                copy.state(sample, values)
            for event in events:
                copy.event(run, event)
        found.states += 1
        found.duration = sample.time_ns * 1e-9
        on_state()
    if not found.states:
        topic = next(iter(run.state_topics))
        raise NotRepeatable(f"{bag.path} holds no state of {run.node}; record {topic} as well")
    later = rerun.advance(max(found.duration, run.events[-1].time))  # what came after the states
    for event in later.take_events():
        if copy:
            copy.event(run, event)
    return found


class _Said:
    """What the messages about an axis say, computed again."""

    def __init__(self, run: RecordedRun, found: Resimulated) -> None:
        self._run, self._found = run, found
        self._topics = run.state_topics
        self._report = JointReport()
        self._number: int | None = None  # of the last report

    def values(self, axis: Axis, sample: Sample) -> _Values:
        """Return field, index and value for all that a message says of the axis."""
        names, fields = list(sample.message.name), list(_UNITS)
        topic, number = sample.recorded.topic, sample.recorded.sequence
        joints = self._topics[topic][1](axis)
        if self._run.reports_readings and topic.endswith("/joint_states"):
            last, self._number = self._number, number
            if last is None or number not in (0, last + 1):  # 0: not numbered
                self._report = JointReport()
                if axis.parameters.node.joint_state_source != TRUTH:
                    self._found.unknown_velocities += 1
                    fields.remove("velocity")
            joints = self._report.take(axis)
        return [
            (name, names.index(joint), value)
            for end, *values in joints
            if (joint := f"{self._run.axis_name}{end}") in names
            for name, value in zip(_UNITS, values, strict=True)
            if name in fields and value is not None and len(getattr(sample.message, name))
        ]


class _Copy:
    """A new bag with the states and events of runs as they came out."""

    def __init__(self, bag: BagReader, writer: BagWriter) -> None:
        self._bag, self._writer = bag, writer
        self._encoders: dict[str, Any] = {}

    def state(self, sample: Sample, values: _Values) -> None:
        """Write a state message with the computed values in place of the recorded ones."""
        message = sample.message
        for name, index, value in values:
            getattr(message, name)[index] = value
        self._write(message, sample.recorded)

    def event(self, run: RecordedRun, event: Event) -> None:
        """Write an event as the node of the axis publishes it; set points have their own topic."""
        if event.name == START and not run.reports_readings:  # what the states are, stays said
            kept = {name: one for name, one in event.details.items() if name != SOURCE}
            event = replace(event, details=kept)
        ns = run.start_ns + round(event.time * 1e9)
        node = run.node.lstrip("/")
        status = SimpleNamespace(
            level=event.level,
            name=f"{node}: event",
            message=f"{event.name} {event.outcome}",
            hardware_id=node,
            values=[SimpleNamespace(key=k, value=v) for k, v in event_texts(event).items()],
        )
        stamp = SimpleNamespace(sec=ns // 10**9, nanosec=ns % 10**9)
        header = SimpleNamespace(stamp=stamp, frame_id="")
        message = SimpleNamespace(header=header, status=[status])
        names = SET_POINT_TOPICS if is_set_point(event) else ()
        topics = [f"{run.node}/{name}" for name in (*names, "events")]
        topic = next(topic for topic in topics if topic in self._bag.topics)
        self._write(message, BagMessage(topic, ns, ns, 0, b""))

    def _write(self, message: Any, at: BagMessage) -> None:
        if at.topic not in self._encoders:
            description = self._bag.topics[at.topic]
            self._encoders[at.topic] = encoder_for(description)
            self._writer.add_topic(description)
        data = self._encoders[at.topic](message)
        self._writer.write(
            at.topic, data, log_ns=at.log_ns, publish_ns=at.publish_ns, sequence=at.sequence
        )
