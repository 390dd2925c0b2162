# SPDX-License-Identifier: Apache-2.0
"""Rows of many messages at once are those of the library, message by message."""

import random
from typing import Any

import numpy as np
import pytest
from bags import JOINTS, START, STORE, joint_state, serialized, topic

from stickslip_ros.recordings import decoder_for
from stickslip_ros.recordings.cdr import fields_of
from stickslip_ros.recordings.layouts import LONGEST_ARRAY, Layouts, Times

KINDS = ["sensor_msgs/msg/JointState", "geometry_msgs/msg/PoseWithCovarianceStamped"]
KINDS += ["std_msgs/msg/Bool", "std_msgs/msg/String", "std_msgs/msg/Char"]
KINDS += ["sensor_msgs/msg/Imu", "sensor_msgs/msg/PointCloud2", "nav_msgs/msg/Path"]
KINDS += ["trajectory_msgs/msg/JointTrajectory", "std_msgs/msg/Float64MultiArray"]
KINDS += [
    "sensor_msgs/msg/JoyFeedback",
    "std_msgs/msg/UInt8MultiArray",
    "tf2_msgs/msg/TFMessage",
]
TIMES = Times(range(1000), 0)


def at_random(type_name: str, dice: random.Random) -> Any:
    """Return a message of a type, with lists of a few lengths."""
    fields = {}
    for name, (node, description) in STORE.fielddefs[type_name][1]:
        fields[name] = _value(int(node), description, dice)
    return STORE.types[type_name](**fields)


def _value(node: int, description: Any, dice: random.Random) -> Any:
    if node == 1:
        kind = description[0]
        if kind == "string":
            return dice.choice(["", "a", "b\0", "longer \u00e9"])
        if kind == "bool":
            return dice.random() < 0.5
        return dice.choice([0, 1, 100]) if "float" not in kind else dice.uniform(-1e9, 1e9)
    if node == 2:
        return at_random(description, dice)
    (inner, what), length = description
    count = length if node == 3 else dice.choice([0, 2, 2, 70 if inner == 1 else 1])
    values = [_value(int(inner), what, dice) for _ in range(count)]
    numbers = inner == 1 and what[0] != "string"
    return np.array(values, np.dtype(what[0])) if numbers else values


@pytest.mark.parametrize("type_name", KINDS)
def test_rows_are_those_of_the_library(type_name: str) -> None:
    dice = random.Random(type_name)
    data = [serialized_of(at_random(type_name, dice), type_name) for _ in range(400)]
    description = topic("/x", type_name)
    decode = decoder_for(description)
    made, left = Layouts(type_name, description.schema, decode).rows(dict(enumerate(data)), TIMES)
    found = {
        number: (rows.columns, values)
        for rows in made
        for number, values in zip(rows.numbers, rows.values, strict=True)
    }
    assert sorted([*found, *left]) == list(range(400))
    assert len(found) > 40  # the others are of sizes that few have
    for number, (columns, values) in found.items():
        read = dict(fields_of(decode(data[number]), type_name, LONGEST_ARRAY))
        assert (columns[2:], repr(tuple(values[2:]))) == (tuple(read), repr(tuple(read.values())))


def serialized_of(message: Any, type_name: str) -> bytes:
    return bytes(STORE.serialize_cdr(message, type_name))


def test_the_library_reads_one_message_of_a_layout(monkeypatch: pytest.MonkeyPatch) -> None:
    """A million joint states took 95 s when it read each; it reads two for each layout now."""
    decode, read = decoder_for(JOINTS), []

    def counted(data: bytes) -> Any:
        read.append(data)
        return decode(data)

    layouts = Layouts(JOINTS.type, JOINTS.schema, counted)
    for block in range(5):
        data = {k: joint_state(START + k, 1e-9 * k) for k in range(block, 1000)}
        made, left = layouts.rows(data, TIMES)
        assert left == [] and sum(len(rows.numbers) for rows in made) == len(data)
    assert len(read) == 2


def test_the_other_order_of_bytes_is_left_to_the_library() -> None:
    """With zeros alone, both orders give the same."""
    data = bytearray(serialized("std_msgs/msg/Int32", data=0))
    data[1] = 0
    description = topic("/x", "std_msgs/msg/Int32")
    layouts = Layouts(description.type, description.schema, decoder_for(description))
    assert layouts.rows({k: bytes(data) for k in range(20)}, TIMES) == ([], list(range(20)))


def test_times_of_a_damaged_bag_may_be_beyond_all_clocks() -> None:
    """A stamp as far ahead as the clock of a damaged start lies beyond the integers of NumPy."""
    (since, recorded) = Times([5], 0, ((0,), (2**64,))).columns([0], [0])
    assert since == pytest.approx([1e-9 * 2**64])
    assert recorded == [5]
