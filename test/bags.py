# SPDX-License-Identifier: Apache-2.0
"""Bags for tests: messages serialized by ``rosbags``, written by us or, otherwise, by ``mcap``."""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from stickslip_ros.recordings import BagWriter, OfferedQos, TopicDescription, open_bag

STORE = get_typestore(Stores.ROS2_JAZZY)
SECOND = 1_000_000_000
START = 1_700_000_003 * SECOND


def topic(name: str, type_name: str, *qos: OfferedQos) -> TopicDescription:
    """Return a topic of a type that ``rosbags`` knows."""
    return TopicDescription(
        name=name,
        type=type_name,
        schema=STORE.generate_msgdef(type_name, ros_version=2)[0],
        type_hash=STORE.hash_rihs01(type_name),
        offered_qos=qos or (OfferedQos(),),
    )


STEPS = topic("/axis/command/steps", "std_msgs/msg/Int32")
JOINTS = topic("/joint_states", "sensor_msgs/msg/JointState", OfferedQos(depth=10))
EVENTS = topic(
    "/axis/events",
    "diagnostic_msgs/msg/DiagnosticArray",
    OfferedQos(durability="transient_local", history="keep_last", depth=1000),
    OfferedQos(reliability="best_effort"),
)
SILENT = topic("/axis/command/jog", "std_msgs/msg/Float64")
TOPICS = (STEPS, JOINTS, EVENTS, SILENT)

Sample = tuple[TopicDescription, int, bytes]


def int32(value: int) -> bytes:
    """Return a serialized Int32."""
    return b"\x00\x01\x00\x00" + struct.pack("<i", value)


def serialized(type_name: str, **fields: Any) -> bytes:
    return bytes(STORE.serialize_cdr(STORE.types[type_name](**fields), type_name))


def header(ns: int) -> Any:
    """Return a header with a time."""
    time = STORE.types["builtin_interfaces/msg/Time"](ns // SECOND, ns % SECOND)
    return STORE.types["std_msgs/msg/Header"](time, "base")


def joint_state(ns: int, x: float) -> bytes:
    """Return the joint states of an axis whose runner is at x (m)."""
    return serialized(
        JOINTS.type,
        header=header(ns),
        name=["a_slider", "a_piezo"],
        position=np.array([x, x / 2]),
        velocity=np.array([0.0, 1e-6]),
        effort=np.array([0.1]),
    )


def event(ns: int, **values: str) -> bytes:
    """Return an event of an axis."""
    pair = STORE.types["diagnostic_msgs/msg/KeyValue"]
    status = STORE.types["diagnostic_msgs/msg/DiagnosticStatus"](
        level=0,
        name="/axis: event",
        message=values.get("event", ""),
        hardware_id="a",
        values=[pair(key=key, value=text) for key, text in values.items()],
    )
    return serialized(EVENTS.type, header=header(ns), status=[status])


def samples(count: int) -> Iterator[Sample]:
    """Yield messages of three topics, one each millisecond."""
    for i in range(count):
        ns = START + i * SECOND // 1000
        if i % 20 == 0:
            kind = "start" if i == 0 else "steps"
            values = {"time (s)": repr(i * 1e-3), "event": kind, "outcome": "applied"}
            details = {"model": "ceim", "preload": "1.0"} if i == 0 else {"count": "3"}
            yield EVENTS, ns, event(ns, **values, **details)
        elif i % 20 == 7:
            yield STEPS, ns, int32(i)
        else:
            yield JOINTS, ns, joint_state(ns, i * 1e-9)


def record(folder: Path, count: int = 1000, flush_every: int = 250, **options: Any) -> list[Sample]:
    """Write a bag of ours; return what is in it."""
    written = list(samples(count))
    with BagWriter(folder, custom_data={"seed": "7"}, **options) as bag:
        for one in TOPICS:
            bag.add_topic(one)
        for number, (one, ns, data) in enumerate(written, 1):
            bag.write(one.name, data, log_ns=ns, publish_ns=ns - 5, sequence=number)
            if number % flush_every == 0:
                bag.flush()
    return written


def expected(written: list[Sample]) -> list[tuple[str, int, bytes]]:
    """Return topic, time (ns) and data of what was written."""
    return [(one.name, ns, data) for one, ns, data in written]


def contents(bag_path: Path) -> list[tuple[str, int, bytes]]:
    """Return topic, time (ns) and data of what is in a bag, in its order."""
    with open_bag(bag_path) as bag:
        return [(message.topic, message.log_ns, message.data) for message in bag.messages()]


def records_of(data: bytes | bytearray, kind: Opcode) -> list[int]:
    """Return where the records of a kind begin in an MCAP file."""
    at, found = 8, []
    while at < len(data) - 8:
        if data[at] == kind:
            found.append(at)
        at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")
    return found


def by_rosbags(writer: Writer2, count: int = 500) -> list[Sample]:
    """Write a bag of rosbag2 with the library of ``rosbags``; return what is in it."""
    written = list(samples(count))
    writer.set_custom_data("seed", "7")
    with writer:
        connections = {
            one.name: writer.add_connection(one.name, one.type, typestore=STORE) for one in TOPICS
        }
        for one, ns, data in written:
            writer.write(connections[one.name], ns, data)
    return written


def foreign(file: Path, written: list[Sample], **options: Any) -> None:
    """Write a single MCAP file with the library of ``mcap``, without anything of rosbag2."""
    options = {"compression": CompressionType.NONE, **options}
    with file.open("wb") as stream:
        writer = Writer(stream, **options)
        writer.start("ros2", "another")
        channels: dict[str, int] = {}
        for one, ns, data in written:
            if one.name not in channels:
                schema = writer.register_schema(one.type, "ros2msg", one.schema.encode())
                channels[one.name] = writer.register_channel(one.name, "cdr", schema)
            writer.add_message(channels[one.name], ns, data, ns)
        writer.finish()
