# SPDX-License-Identifier: Apache-2.0
"""Messages without ROS: what ``rosbags`` serialized is decoded, what is broken is refused."""

import contextlib
import random
import struct
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from bags import EVENTS, JOINTS, STEPS, STORE, event, int32, joint_state, serialized, topic

from stickslip_ros.recordings import BagError, TopicDescription, decoder_for


def test_the_messages_of_an_axis_are_decoded() -> None:
    assert decoder_for(STEPS)(int32(-7)).data == -7
    volts = topic("/volts", "std_msgs/msg/Float64")
    assert decoder_for(volts)(serialized(volts.type, data=0.1)).data == 0.1
    joints = decoder_for(JOINTS)(joint_state(3_000_000_004, 1e-9))
    assert (joints.header.stamp.sec, joints.header.stamp.nanosec) == (3, 4)
    assert (joints.name, joints.position) == (["a_slider", "a_piezo"], [1e-9, 0.5e-9])
    found = decoder_for(EVENTS)(event(5, event="start", note="µm")).status[0]
    assert (found.name, found.level) == ("/axis: event", 0)
    assert [(pair.key, pair.value) for pair in found.values] == [("event", "start"), ("note", "µm")]


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


def test_noise_is_refused_or_decoded() -> None:
    dice = random.Random(3)
    decode = decoder_for(EVENTS)
    refused = 0
    for _ in range(2000):
        data = bytearray(event(9, event="start", a="b"))
        for _ in range(dice.randrange(1, 6)):
            data[dice.randrange(len(data))] = dice.randrange(256)
        try:
            decode(bytes(data))
        except BagError:
            refused += 1
    assert 200 < refused < 2000


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
