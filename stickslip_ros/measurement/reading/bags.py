# SPDX-License-Identifier: Apache-2.0
"""Bags, ours and those of others (rosbag2 with SQLite or MCAP, ROS 1): each number is a column.

A column is named by topic and field, such as ``/laser/range``; those of joint states by the joint,
``/joint_states/axis_slider/position``. Times are those of the headers' stamps, or of the recorder
where messages have no header, and count from the first message of their topic.
"""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_ros.measurement.reading.table import Column, Loaded, MeasurementError, Table
from stickslip_ros.recordings import BagError, BagReader, open_bag
from stickslip_ros.recordings.cdr import (
    JOINT_STATE_TYPE,
    decoded_messages,
    fields_of,
    stamp_of,
)

#: Fields whose unit the definition of a message states.
_UNITS = {
    ("sensor_msgs/msg/Range", "range"): "m",
    **{("geometry_msgs/msg/PointStamped", f"point.{axis}"): "m" for axis in "xyz"},
    **{("geometry_msgs/msg/PoseStamped", f"pose.position.{axis}"): "m" for axis in "xyz"},
    **{("nav_msgs/msg/Odometry", f"pose.pose.position.{axis}"): "m" for axis in "xyz"},
}
#: Ends of the names of our joints.
SLIDER, _PIEZO = "_slider", "_piezo"
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
    sources: list[tuple[str, str]] = []  # topic and field of each column
    origins: list[int] = []
    with open_bag(path) as bag:
        for topic in bag.topics:
            fields, origin = _fields(bag, topic)
            for field, unit in fields.items():
                sources.append((topic, field))
                origins.append(origin)
                name = f"{topic}/{field}"
                columns.append(Column(len(columns) + 1, name, unit, None, bag.counts[topic]))
    if not columns:
        raise MeasurementError("it holds no messages with numbers")

    def load(wanted: Sequence[Column]) -> Loaded:
        picked = [sources[column.number - 1] for column in wanted]
        if len({topic for topic, _ in picked}) > 1:
            raise MeasurementError("the columns have to be of one topic")
        fields = [field for _, field in picked]
        rows = list(_rows(path, picked[0][0], fields, origins[wanted[0].number - 1]))
        table = np.array(rows, dtype=np.float64).reshape(len(rows), len(picked))
        if _TIME in fields:  # a message may come late, or twice
            table = table[np.unique(table[:, fields.index(_TIME)], return_index=True)[1]]
        return Loaded([np.ascontiguousarray(column) for column in table.T])

    return Table(columns, load), origins


def _fields(bag: BagReader, topic: str) -> tuple[dict[str, str | None], int]:
    """Return names and units of the numbers in a topic, and the time (ns) of the first message."""
    found: dict[str, str | None] = {}
    origin = 0
    kind = bag.topics[topic].type
    messages = islice(decoded_messages(bag, [topic]) if bag.counts[topic] else (), _LOOKED_AT)
    try:
        # The parser of types prints what it refuses.
        with contextlib.redirect_stderr(io.StringIO()):
            for recorded, message in messages:
                for name in _numbers(message, kind):
                    if not found:
                        found[_TIME], origin = "s", stamp_of(message, recorded.log_ns)
                    found.setdefault(name, _unit(kind, name))
    except BagError:
        pass  # of a type that nobody knows
    return found, origin


def _unit(kind: str, name: str) -> str | None:
    if kind == JOINT_STATE_TYPE:
        return "m" if name.endswith("/position") else None
    return _UNITS.get((kind, name))


def _numbers(message: Any, kind: str) -> dict[str, float]:
    """Return the numbers of a message by name, without those of headers and of lists of objects."""
    return {
        name: float(value)
        for name, value in fields_of(message, kind, _LONGEST_ARRAY)
        if isinstance(value, bool | int | float) and not _NO_COLUMN.search(name)
    }


def _rows(path: Path, topic: str, fields: Sequence[str], origin: int) -> Iterator[list[float]]:
    """Yield the fields of the messages that have one of them beside the time."""
    wanted = set(fields) - {_TIME}
    with open_bag(path) as bag:
        kind = bag.topics[topic].type
        for recorded, message in decoded_messages(bag, [topic]):
            numbers = _numbers(message, kind)
            if wanted.isdisjoint(numbers):
                continue
            numbers[_TIME] = 1e-9 * (stamp_of(message, recorded.log_ns) - origin)
            yield [numbers.get(field, np.nan) for field in fields]


def joint_columns(table: Table, joint: str | None) -> dict[str, str]:
    """Return the columns of a joint: the one named, the first slider, or the only one.

    Empty where the bag has no joints to choose from. Raises MeasurementError if the joint is not
    there.
    """
    positions = [c for c in table.columns if c.unit == "m" and c.name.endswith("/position")]
    # Commands may name the same joints: the topic that has most messages shows the motion.
    positions.sort(key=lambda column: (column.length or 0, -column.number))
    joints = {column.name.split("/")[-2]: column.name for column in positions}
    if joint is not None and joint not in joints:
        listed = ", ".join(sorted(joints)) or "none"
        raise MeasurementError(f"there is no joint {joint!r}; there are: {listed}")
    sliders = [one for one in reversed(joints) if one.endswith(SLIDER)]
    chosen = joint or next(iter(sliders or (joints if len(joints) == 1 else ())), None)
    if chosen is None:
        return {}
    actuator = joints.get(chosen.removesuffix(SLIDER) + _PIEZO)
    return {"x": joints[chosen], **({"u": actuator} if actuator else {})}
