# SPDX-License-Identifier: Apache-2.0
"""Schema text: what ``rosbags`` reads from it is what ``rosbags`` knows of the type itself."""

import re
from typing import Any

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from stickslip_ros.recordings import definition_from_fields, schema_text

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
    from stickslip_ros.ros.messages import message_class, message_definition

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
