# SPDX-License-Identifier: Apache-2.0
"""The motion in a file, whatever kind it is: a trace, a table or a bag.

Bags, ours and those of others (rosbag2 with SQLite or MCAP, ROS 1): each number is a column.

A column is named by topic and field, such as ``/laser/range``; those of joint states by the joint,
``/joint_states/axis_slider/position``. Times are those of the headers' stamps, or of the recorder
where messages have no header, and count from the first message of their topic.
"""

from __future__ import annotations

import contextlib
import io
import math
import re
from array import array
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stickslip_ros.axis.events import START, NotRepeatable
from stickslip_ros.measurement.reading import MeasurementError, Reading, read_measurement
from stickslip_ros.measurement.reading.choice import MOTION, choose
from stickslip_ros.measurement.reading.formats import naming
from stickslip_ros.measurement.reading.motion import motion_of
from stickslip_ros.measurement.reading.table import Column, Loaded, Table
from stickslip_ros.measurement.steps.drive import Drive
from stickslip_ros.physics.parameters import PARAMETERS, Value
from stickslip_ros.physics.parameters.groups import PIEZO, SLIDER
from stickslip_ros.recordings import BagError, BagReader, open_bag, recorded_axes
from stickslip_ros.recordings.clocks import bulk_of
from stickslip_ros.recordings.messages import decode_messages, fields_of
from stickslip_ros.recordings.runs import recorded_runs
from stickslip_ros.recordings.schemas import JOINT_STATE_TYPE, stamp_of
from stickslip_ros.simulation.motion import Motion


class LoadedMotion(NamedTuple):
    """A motion and the information in its file."""

    motion: Motion
    #: the time (ns since the Unix epoch) that its times count from, of a bag
    origin_ns: int | None = None
    #: of the axis when it started, if the file holds them
    parameters: dict[str, Value] | None = None
    version: str | None = None  #: of this package that the axis ran with, likewise
    joint: str | None = None  #: whose motion it is, of a bag
    drive: Drive | None = None  #: how its axis was driven, where the events of a bag tell all of it
    node: str | None = None  #: of that axis


def is_parameter_file(path: Path) -> bool:
    """Return whether a path is that of a parameter file."""
    return path.suffix.lower() in (".yaml", ".yml")


def load_motion(
    path: Path,
    how: Reading | None = None,
    joint: str | None = None,
    origin_ns: int | None = None,
) -> LoadedMotion:
    """Read a motion from a bag, a trace that we wrote, or a measurement of any format.

    how: properties that the file does not state, such as the columns of time and position.
    joint: in a bag; None: the only one whose name ends in ``_slider``, or the only one.
    origin_ns: time that the stamps of a bag count from; None: its first message.
    Raises MeasurementError: a table cannot be read, or has no such joint, or several to ask for.
    Raises BagError: a bag cannot be read.
    """
    how = how or Reading()
    if not is_bag(path):
        return LoadedMotion(read_measurement(path, how))
    with naming(path):
        table, origins = read_bag(path)
        if not how.columns:
            how = replace(how, columns=joint_columns(table, joint))
        position = choose(table, MOTION, how)[0]["x"]
        motion = motion_of(table, path.name, how)
    # Whole nanoseconds, so that two compared bags use the same times.
    stamps = origins[position.number - 1] + np.rint(1e9 * motion.t).astype(np.int64)
    origin = int(stamps[0]) if origin_ns is None else origin_ns
    motion = replace(motion, t=np.asarray(1e-9 * (stamps - origin), np.float64))
    topic, name, _ = position.name.rsplit("/", 2)
    near = topic.rpartition("/")[0]
    if len(all_of := _sliders(joints := joints_in(table))) > 1:
        label = f"{near}/{name}".lstrip("/")
        note = f"the motion is that of {position.name}; the sliders are: {', '.join(all_of)}"
        source = f"{path.name} ({label if label in joints else name})"
        motion = replace(motion, source=source, notes=(*motion.notes, note))
    with open_bag(path) as bag:
        axes = {
            events: texts  # of the event that an axis starts with
            for events, texts in recorded_axes(bag).items()
            if f"{texts.get('axis_name')}{SLIDER}" == name
        }
        for events in sorted(axes, key=lambda events: not events.startswith(f"{near}/"))[:1]:
            texts = axes[events]
            known = {name: text for name, text in texts.items() if name in PARAMETERS}
            parameters = {name: PARAMETERS[name].parse(text) for name, text in known.items()}
            version, node = texts.get("version"), events.removesuffix("/events")
            drive = _drive_in(bag, node, origin)
            return LoadedMotion(motion, origin, parameters, version, name, drive, node)
    return LoadedMotion(motion, origin, joint=name)


#: Applied events that make no steps; those of them that change the drive as well.
_WITHOUT_STEPS = ("amplitude", "load", "zero", "pause")
_OF_THE_DRIVE = (START, "frequency", "parameters")


def _drive_in(bag: BagReader, node: str, origin_ns: int) -> Drive | None:
    """Return frequencies, numbers and begins of the steps that an axis was sent, by its events.

    The begins count from a time (ns). None where the events do not tell: some are missing, a
    command makes steps without a number, or one comes or ends before the steps of another are done.
    """
    sent: list[tuple[float, int, float]] = []
    with contextlib.suppress(NotRepeatable, KeyError, TypeError, ValueError):
        for run in recorded_runs(bag):
            if run.node != node:
                continue
            if run.missing_events or run.events[0].name != START:
                return None
            frequency, moves = math.nan, False
            for event in run.events:
                told, begun = event.details, event.outcome == "applied"
                if begun and event.name in _OF_THE_DRIVE and not moves:
                    key = "value" if event.name == "frequency" else "frequency"
                    frequency = float(told.get(key, frequency))
                elif begun and event.name == "steps" and not moves:
                    begin = event.time + 1e-9 * (run.start_ns - origin_ns)
                    sent.append((frequency, int(told["value"]), begin))
                    moves = sent[-1][1] != 0
                elif moves and event.name == "move" and told["steps"] == sent[-1][1]:
                    moves = False
                elif event.outcome != "refused" and event.name not in _WITHOUT_STEPS:
                    return None
        sent = [one for one in sent if one[2]]
        if sent:
            frequencies, steps, begins = zip(*sent, strict=True)
            return Drive(frequencies, steps, begins)
    return None


#: Fields whose unit the definition of a message states.
_UNITS = {
    ("sensor_msgs/msg/Range", "range"): "m",
    **{("geometry_msgs/msg/PointStamped", f"point.{axis}"): "m" for axis in "xyz"},
    **{("geometry_msgs/msg/PoseStamped", f"pose.position.{axis}"): "m" for axis in "xyz"},
    **{("nav_msgs/msg/Odometry", f"pose.pose.position.{axis}"): "m" for axis in "xyz"},
}
#: Name of the column of times that each topic has.
_TIME = "time"
#: Longer arrays are no columns.
_LONGEST_ARRAY = 16
_NO_COLUMN = re.compile(r"\]\.|(^|\.)header\.")
#: Messages of a topic that its columns are taken from: joints may come one by one.
_LOOKED_AT = 50


def is_bag(path: Path) -> bool:
    """Return whether a path is that of a recording."""
    return path.is_dir() or path.suffix.lower() in (".mcap", ".db3", ".bag")


def read_bag(path: Path) -> tuple[Table, list[int]]:
    """Return the columns of a bag and the time (ns) that each counts from, if it is one of times.

    Raises MeasurementError and BagError.
    """
    columns: list[Column] = []
    sources: list[tuple[str, str, int]] = []  # topic, field and origin of each column
    with open_bag(path) as bag:
        for topic, about in bag.topics.items():
            looked: list[tuple[int, int, dict[str, float]]] = []
            # The parser of types prints types that it refuses; one that nobody knows is left out.
            with contextlib.suppress(BagError), contextlib.redirect_stderr(io.StringIO()):
                messages = _messages(bag, topic) if bag.counts[topic] else iter(())
                looked += [one for one in islice(messages, _LOOKED_AT) if one[2]]
            names = [name for one in looked for name in (_TIME, *one[2])]
            origin = bulk_of(_stamps([one[:2] for one in looked])).start_ns
            for field in dict.fromkeys(names):
                unit = "s" if field == _TIME else _UNITS.get((about.type, field))
                if about.type == JOINT_STATE_TYPE and field.endswith("/position"):
                    unit = "m"
                sources.append((topic, field, origin))
                length, number = bag.counts[topic], len(sources)
                columns.append(Column(f"{topic}/{field}", unit, number=number, length=length))
    if not columns:
        raise MeasurementError("it holds no messages with numbers")

    def load(wanted: Sequence[Column]) -> Loaded:
        topics, fields, origins = zip(*(sources[one.number - 1] for one in wanted), strict=True)
        if len(set(topics)) > 1:
            raise MeasurementError("the columns have to be of one topic")
        with open_bag(path) as bag:
            notes = [bag.bulk.told] if bag.bulk.apart else []
            times, values = list[tuple[int, int]](), array("d")
            for stamp, log_ns, numbers in _messages(bag, topics[0]):
                if not numbers.keys().isdisjoint({*fields} - {_TIME}):  # joints may come one by one
                    times.append((stamp, log_ns))
                    values.extend(numbers.get(field, math.nan) for field in fields)
        stamps = _stamps(times)
        bulk = bulk_of(stamps)
        notes += [f"{topics[0]}: {bulk.told}"] if bulk.apart else []
        table = np.array(values, dtype=np.float64).reshape(len(times), len(fields))
        for k in [k for k, field in enumerate(fields) if field == _TIME]:
            table[:, k] = [1e-9 * (stamp - origins[0]) for stamp in stamps]
        table = table[[bulk.holds(stamp) for stamp in stamps]]
        if _TIME in fields:  # a message may come late, or twice
            table = table[np.unique(table[:, fields.index(_TIME)], return_index=True)[1]]
        return Loaded([np.ascontiguousarray(one) for one in table.T], notes=tuple(notes))

    return Table(columns, load), [origin for _, _, origin in sources]


def _messages(bag: BagReader, topic: str) -> Iterator[tuple[int, int, dict[str, float]]]:
    """Yield stamp, 0 if it has none, when it was recorded (ns), and numbers of each message.

    The numbers, by name, are without those of headers and lists.
    """
    kind = bag.topics[topic].type
    for recorded, message in decode_messages(bag, [topic], bulk=True):
        numbers = {
            name: float(value)
            for name, value in fields_of(message, kind, _LONGEST_ARRAY)
            if isinstance(value, bool | int | float) and not _NO_COLUMN.search(name)
        }
        yield stamp_of(message) or 0, recorded.log_ns, numbers


def _stamps(times: Sequence[tuple[int, int]]) -> list[int]:
    """Return the stamps of messages, or when they were recorded if none has a stamp, ns."""
    stamped = any(stamp for stamp, _ in times)
    return [stamp if stamped else log_ns for stamp, log_ns in times]


def joint_columns(table: Table, joint: str | None) -> dict[str, str]:
    """Return the columns of a joint: the one named, the only slider, or the only one.

    Empty where the bag has no joints to choose from. Raises MeasurementError if the joint is not
    there, or several sliders are and none is named.
    """
    joints = joints_in(table)
    sliders = _sliders(joints)
    listed = ", ".join(sorted(joints)) or "none"
    several = [one for one in joints if joint and one.endswith(f"/{joint}")]
    if joint is not None and joint not in joints and not several:
        raise MeasurementError(f"there is no joint {joint!r}; there are: {listed}")
    if (joint is None and len(sliders) > 1) or (joint not in joints and several):
        named = several or sliders
        raise MeasurementError(
            f"which joint? it has {', '.join(named)}; name one: --joint {named[0]} "
            f"(or its column: --columns x={joints[named[0]]})"
        )
    chosen = joint or next(iter(sliders or (joints if len(joints) == 1 else ())), None)
    if chosen is None:
        return {}
    topic, name, field = joints[chosen].rsplit("/", 2)
    actuator = f"{topic}/{name.removesuffix(SLIDER)}{PIEZO}/{field}"
    there = any(column.name == actuator for column in table.columns)
    return {"x": joints[chosen], **({"u": actuator} if there else {})}


def joints_in(table: Table) -> dict[str, str]:
    """Return the column with the position of each joint in a bag.

    A joint that topics of one name, in namespaces beside each other, tell of is several, named
    l1/p_slider, say.
    """
    # Commands may name the same joints: the topic that has most messages shows the motion. What no
    # sensor reads is no measurement.
    positions = sorted(
        (one for one in table.columns if one.unit == "m" and one.name.endswith("/position")),
        key=lambda one: ("/truth/" not in one.name, one.length or 0, -one.number),
    )
    of_joint: dict[str, list[str]] = {}
    for column in positions:
        of_joint.setdefault(column.name.split("/")[-2], []).append(column.name)
    joints: dict[str, str] = {}
    for joint, names in of_joint.items():
        topics = [name.rsplit("/", 2)[0] for name in names if "/truth/" not in name]
        ends = [topic.rpartition("/")[2] for topic in topics]
        alike = [topic for topic in topics if ends.count(topic.rpartition("/")[2]) > 1]
        places = {topic.rpartition("/")[0] for topic in alike}
        places = {p for p in places if not any(p.startswith(f"{q}/") for q in places - {p})}
        if len(places) < 2:
            joints[joint] = names[-1]
            continue
        for place in sorted(places):
            label = f"{place}/{joint}".lstrip("/")
            joints[label] = [name for name in names if name.startswith(f"{place}/")][-1]
    return joints


def _sliders(joints: Iterable[str]) -> list[str]:
    """Return the joints whose names end as those of sliders do, in order of the names."""
    return sorted(joint for joint in joints if joint.endswith(SLIDER))
