# SPDX-License-Identifier: Apache-2.0
"""Bags that others recorded: rosbag2 with SQLite or MCAP, ROS 1; every number in them is a column.

A column is named by topic and field, such as ``/laser/range``; those of joint states by the joint,
``/joint_states/axis_slider/position``. Times are those of the headers' stamps, or of the recorder
where messages have no header, and count from the first message of the bag.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_ros.measurement.reading.table import (
    Column,
    Loaded,
    MeasurementError,
    Table,
    described,
)
from stickslip_ros.recordings import BagError, BagReader, decoder_for, open_bag

_JOINT_STATE = "sensor_msgs/msg/JointState"
#: Fields whose unit the definition of a message states.
_UNITS = {
    ("sensor_msgs/msg/Range", "range"): "m",
    **{("geometry_msgs/msg/PointStamped", f"point.{axis}"): "m" for axis in "xyz"},
    **{("geometry_msgs/msg/PoseStamped", f"pose.position.{axis}"): "m" for axis in "xyz"},
    **{("nav_msgs/msg/Odometry", f"pose.pose.position.{axis}"): "m" for axis in "xyz"},
}
#: Longer arrays are no columns.
_LONGEST_ARRAY = 16
#: Messages of a topic that its columns are taken from: joints may come one by one.
_LOOKED_AT = 50


def is_foreign_bag(path: Path) -> bool:
    """Return whether a path is that of a bag that our own reader does not take."""
    if path.is_dir():
        return any(path.glob("*.db3*"))
    return path.suffix.lower() in (".bag", ".db3")


def read_bag(path: Path) -> tuple[Table, int]:
    """Return the columns of a bag and the time (ns) that its times count from.

    Raises MeasurementError and BagError.
    """
    columns: list[Column] = []
    sources: list[tuple[str, str]] = []  # topic and field of each column
    with open_bag(path) as bag:
        origin = bag.start_ns
        for topic in bag.topics:
            fields = _fields(bag, topic)
            if not fields:
                continue
            for field, unit in [("time", "s"), *fields.items()]:
                sources.append((topic, field))
                name = f"{topic}/{field}"
                columns.append(Column(len(columns) + 1, name, unit, None, bag.counts[topic]))
    if not columns:
        raise MeasurementError("it holds no messages with numbers")

    def load(wanted: Sequence[Column]) -> Loaded:
        picked = [sources[column.number - 1] for column in wanted]
        if len({topic for topic, _ in picked}) > 1:
            raise MeasurementError("the columns have to be of one topic")
        rows = list(_rows(path, picked[0][0], [field for _, field in picked], origin))
        table = np.array(rows, dtype=np.float64).reshape(len(rows), len(picked))
        return Loaded([np.ascontiguousarray(column) for column in table.T])

    return Table(columns, load, described(columns)), origin


def _messages(bag: BagReader, topic: str) -> Iterator[tuple[int, Any]]:
    """Yield the recorder's time (ns) and the message."""
    decode = decoder_for(bag.topics[topic])
    for message in bag.messages([topic]):
        yield message.log_ns, decode(message.data)


def _fields(bag: BagReader, topic: str) -> dict[str, str | None]:
    """Return names and units of the numbers in the messages of a topic."""
    found: dict[str, str | None] = {}
    kind = bag.topics[topic].type
    messages = islice(_messages(bag, topic) if bag.counts[topic] else (), _LOOKED_AT)
    try:
        # The parser of types prints what it refuses.
        with contextlib.redirect_stderr(io.StringIO()):
            for _, message in messages:
                for name, _ in _numbers(message, kind):
                    found.setdefault(name, _unit(kind, name))
    except BagError:
        return found  # of a type that nobody knows
    return found


def _unit(kind: str, name: str) -> str | None:
    if kind == _JOINT_STATE:
        return "m" if name.endswith("/position") else None
    return _UNITS.get((kind, name))


def _numbers(message: Any, kind: str, prefix: str = "") -> Iterator[tuple[str, float]]:
    """Yield the numbers of a message with their names."""
    if kind == _JOINT_STATE:
        for key in ("position", "velocity", "effort"):
            values = getattr(message, key)
            if len(values) == len(message.name):
                for joint, value in zip(message.name, values, strict=True):
                    yield f"{joint}/{key}", float(value)
        return
    for name in message.__slots__:
        value = getattr(message, name)
        if name == "header":
            continue
        label = f"{prefix}{name}"
        if isinstance(value, bool | int | float):
            yield label, float(value)
        elif isinstance(value, list):
            if 0 < len(value) <= _LONGEST_ARRAY and isinstance(value[0], int | float):
                for k, one in enumerate(value):
                    yield f"{label}[{k}]", float(one)
        elif hasattr(value, "__slots__"):
            yield from _numbers(value, "", f"{label}.")


def _rows(path: Path, topic: str, fields: Sequence[str], origin: int) -> Iterator[list[float]]:
    with open_bag(path) as bag:
        kind = bag.topics[topic].type
        for time, message in _messages(bag, topic):
            numbers = dict(_numbers(message, kind))
            numbers["time"] = 1e-9 * (_stamp(message, time) - origin)
            yield [numbers.get(field, np.nan) for field in fields]


def _stamp(message: Any, recorded: int) -> int:
    """Return the time (ns) of a message: of its header, if that was set."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None or (stamp.sec == 0 and stamp.nanosec == 0):
        return recorded
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def joint_columns(table: Table, joint: str | None, ends: tuple[str, str]) -> dict[str, str]:
    """Return the columns of a joint: the one named, the first slider, or the only one.

    ends are those of the names of sliders and their actuators. Empty where the bag has no joints
    to choose from. Raises MeasurementError if the joint is not there.
    """
    names = [c.name for c in table.columns if c.unit == "m" and c.name.endswith("/position")]
    joints = {name.split("/")[-2]: name for name in reversed(names)}
    if joint is not None and joint not in joints:
        listed = ", ".join(sorted(joints)) or "none"
        raise MeasurementError(f"there is no joint {joint!r}; there are: {listed}")
    slider = next((one for one in reversed(joints) if one.endswith(ends[0])), None)
    chosen = joint or slider or (next(iter(joints)) if len(joints) == 1 else None)
    if chosen is None:
        return {}
    columns = {"x": joints[chosen]}
    actuator = chosen.removesuffix(ends[0]) + ends[1]
    if actuator in joints:
        columns["u"] = joints[actuator]
    return columns
