# SPDX-License-Identifier: Apache-2.0
"""Messages decoded by the schema in the bag, and schemas made for a bag."""

import contextlib
import re
import struct
import tracemalloc
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from bags import EVENTS, JOINTS, STEPS, STORE, event, int32, joint_state, serialized
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from stickslip_ros.recordings import BagError, TopicDescription, decoder_for, encoder_for
from stickslip_ros.recordings.schemas import schema_text


def test_empty_arrays_and_the_rest_of_a_buffer_are_no_harm() -> None:
    """What ``serialize_message`` of ROS leaves behind a message is not looked at."""
    empty = serialized(
        JOINTS.type,
        header=STORE.types["std_msgs/msg/Header"](
            STORE.types["builtin_interfaces/msg/Time"](1, 2), ""
        ),
        name=[],
        position=np.array([]),
        velocity=np.array([]),
        effort=np.array([]),
    )
    assert decoder_for(JOINTS)(empty + b"\xaa" * 7).effort == []


def test_a_message_longer_than_its_type_is_refused() -> None:
    """But for what DDS fills up: an Int64 on a topic of Int32 was read as its lower half."""
    assert decoder_for(STEPS)(int32(5) + bytes(3)).data == 5
    for described, data in ((STEPS, int32(5)), (JOINTS, joint_state(9, 1.0))):
        for more in (4, 8, 100, 1000):
            with pytest.raises(BagError, match="it is longer than its type"):
                decoder_for(described)(data + bytes(more))


@pytest.mark.parametrize("whole", [int32(5), joint_state(9, 1.0), event(9, event="start", a="b")])
def test_a_message_that_is_cut_is_refused(whole: bytes) -> None:
    described = {len(int32(5)): STEPS, len(joint_state(9, 1.0)): JOINTS}.get(len(whole), EVENTS)
    decode = decoder_for(described)
    decode(whole)
    for length in range(len(whole) - 1):  # the last byte may be the zero that ends a string
        with pytest.raises(BagError, match=rf"a message on topic {described.name} .* not of that"):
            decode(whole[:length])


@pytest.mark.parametrize("length", [2**16, 2**31, 2**32 - 1])
def test_a_length_that_lies_takes_no_memory(length: int) -> None:
    """At every place of the message, and for a type whose parts have no length of their own."""
    keys = TopicDescription(
        "/keys", "a/msg/Keys", f"a/Key[] keys\n{'=' * 80}\nMSG: a/Key\nbyte[16] id"
    )
    whole = b"\x00\x01\x00\x00" + struct.pack("<I", 2) + bytes(32)
    for described, data in (
        (EVENTS, event(9, event="start")),
        (JOINTS, joint_state(9, 1.0)),
        (keys, whole),
    ):
        decode = decoder_for(described)
        decode(data)
        tracemalloc.start()
        for at in range(4, len(data) - 3, 4):
            lying = data[:at] + struct.pack("<I", length) + data[at + 4 :]
            with contextlib.suppress(BagError):
                decode(lying)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert peak < 1_000_000


def test_a_schema_that_makes_no_sense_is_refused() -> None:
    for schema, problem in [
        ("", "schema missing|cdr"),
        ("int32\n", "broken"),
        ("other/Type x\n", "not of that type|broken"),
        ("steps/Steps again\n", "not of that type|broken"),
        ("float64[-1] x\n", "broken"),
        ("\x00\x01", "broken"),
        ("int32 x\n" * 10_000, "80000 characters; 65536 is the limit"),
    ]:
        with pytest.raises(BagError, match=problem):
            decoder_for(TopicDescription("/a", "steps/msg/Steps", schema))(bytes(100))


def test_other_encodings_are_refused() -> None:
    with pytest.raises(BagError, match="its messages are json, schema ros2msg; record it with"):
        decoder_for(replace(STEPS, encoding="json"))
    with pytest.raises(BagError, match="schema ros2idl"):
        decoder_for(replace(STEPS, schema_encoding="ros2idl"))


TYPES = [
    "std_msgs/msg/Int32",
    "std_msgs/msg/Float64",
    "std_msgs/msg/Empty",
    "sensor_msgs/msg/JointState",
    "diagnostic_msgs/msg/DiagnosticArray",
    "trajectory_msgs/msg/JointTrajectory",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
]


def _without_constants(schema: str, type_name: str) -> dict[str, Any]:
    return {name: fields for name, (_, fields) in get_types_from_msg(schema, type_name).items()}


@pytest.mark.parametrize("type_name", TYPES)
@pytest.mark.parametrize("source", ["installed text", "fields"])
def test_schema_means_what_rosbags_knows_of_the_type(type_name: str, source: str) -> None:
    pytest.importorskip("rclpy")
    from stickslip_ros.ros.nodes.messages import (
        definition_from_fields,
        message_class,
        message_definition,
    )

    def from_fields(name: str) -> str:
        return definition_from_fields(message_class(name).get_fields_and_field_types())

    schema = schema_text(type_name, from_fields if source == "fields" else message_definition)
    store = get_typestore(Stores.ROS2_JAZZY)
    read = _without_constants(schema, type_name)
    if type_name == "std_msgs/msg/Empty":
        assert read[type_name] in ([], store.fielddefs[type_name][1])
        return
    assert read == {name: store.fielddefs[name][1] for name in read}
    assert store.generate_msgdef(type_name, ros_version=2)[0].count("MSG:") == len(read) - 1
    other = get_typestore(Stores.EMPTY)
    other.register(get_types_from_msg(schema, type_name))
    assert other.hash_rihs01(type_name) == store.hash_rihs01(type_name)


def test_each_inner_type_stands_once_and_is_named_as_rosbag2_does() -> None:
    texts = {
        "a/msg/Top": "Inner one  # Comment about b/Nothing\nb/Other[] two\nstring<=5 s\n",
        "a/msg/Inner": "uint8 K=3\nb/Other other\n\n# float64 no\n",
        "b/msg/Other": "float64[3] xyz",
    }
    line = "=" * 80
    assert schema_text("a/msg/Top", texts.__getitem__) == (
        texts["a/msg/Top"]
        + f"{line}\nMSG: a/Inner\nuint8 K=3\nb/Other other\n\n# float64 no\n"
        + f"{line}\nMSG: b/Other\nfloat64[3] xyz\n"
    )


def test_an_unknown_inner_type_is_the_callers_error() -> None:
    with pytest.raises(KeyError, match="b/msg/Gone"):
        schema_text("a/msg/Top", {"a/msg/Top": "b/Gone x"}.__getitem__)


def test_fields_become_a_definition() -> None:
    pytest.importorskip("rclpy")
    from stickslip_ros.ros.nodes.messages import definition_from_fields

    fields = {
        "level": "octet",
        "on": "boolean",
        "name": "string<7>",
        "x": "double[3]",
        "v": "sequence<float>",
        "few": "sequence<geometry_msgs/Point, 4>",
        "words": "sequence<wstring<2>, 9>",
    }
    assert definition_from_fields(fields) == (
        "byte level\nbool on\nstring<=7 name\nfloat64[3] x\nfloat32[] v\n"
        "geometry_msgs/Point[<=4] few\nwstring<=2[<=9] words\n"
    )
    known = {"a/msg/Top": definition_from_fields(fields), "geometry_msgs/msg/Point": "float64 x"}
    text = schema_text("a/msg/Top", known.__getitem__)
    assert re.findall("MSG: .*", text) == ["MSG: geometry_msgs/Point"]


@pytest.mark.parametrize("frame", ["", "a", "µm"])
@pytest.mark.parametrize("joints", [0, 1, 3])
def test_what_we_encode_is_what_rosbags_reads(frame: str, joints: int) -> None:
    stamp = SimpleNamespace(sec=-3, nanosec=4)
    header = SimpleNamespace(stamp=stamp, frame_id=frame)
    names = [f"joint{'x' * k}" for k in range(joints)]
    state = SimpleNamespace(
        header=header, name=names, position=[1e-9 * k for k in range(joints)],
        velocity=[0.5] * joints, effort=[],
    )  # fmt: skip
    read: Any = STORE.deserialize_cdr(encoder_for(JOINTS)(state), JOINTS.type)
    assert (read.header.stamp.sec, read.header.stamp.nanosec) == (-3, 4)
    assert (read.header.frame_id, read.name) == (frame, names)
    assert [read.position.tolist(), read.velocity.tolist()] == [state.position, state.velocity]
    assert not len(read.effort)
    pairs = [SimpleNamespace(key=name, value=frame) for name in names]
    one = SimpleNamespace(level=2, name="/axis: event", message="é", hardware_id="", values=pairs)
    array = SimpleNamespace(header=header, status=[one, one])
    found: Any = STORE.deserialize_cdr(encoder_for(EVENTS)(array), EVENTS.type)
    for status in found.status:
        assert (status.level, status.name, status.message) == (2, "/axis: event", "é")
        assert [(pair.key, pair.value) for pair in status.values] == [(n, frame) for n in names]
    with pytest.raises(BagError, match=STEPS.name):
        encoder_for(replace(STEPS, schema=""))
