# SPDX-License-Identifier: Apache-2.0
"""Every series that the layouts in config/ show stands in a bag of a real axis."""

import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from live import Ros, Start
from rosbags.highlevel import AnyReader
from std_msgs.msg import Int32
from std_srvs.srv import Trigger

CONFIG = Path(__file__).resolve().parents[2] / "config"


def plotjuggler_names(topic: str, message: Any) -> set[str]:
    """Return the names that PlotJuggler gives the numbers of a message."""
    if hasattr(message, "status"):
        return {
            f"{topic}/{status.hardware_id}/{status.name}/{pair.key}"
            for status in message.status
            for pair in status.values
            if is_number(pair.value)
        }
    return {
        f"{topic}/{joint}/{field}"
        for joint in getattr(message, "name", ())
        for field in ("position", "velocity", "effort")
    }


def is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


@pytest.fixture
def messages(
    ros: Ros, make_axis: Callable[..., Any], start_node: Start, tmp_path: Path
) -> list[tuple[str, Any]]:
    """Topic and content of all messages in a bag of a second of an axis that steps."""
    recorder = start_node("recorder_node", output="run")
    make_axis()
    node = ros.node()
    reports: list[str] = []

    def listen(message: Any) -> None:
        reports.extend(status.name for status in message.status)

    node.create_subscription(DiagnosticArray, "/diagnostics", listen, 10)
    steps = ros.publisher(node, Int32, "/stickslip_axis/command/steps")
    recorder.wait_for("first message of /joint_states")
    ros.wait_until(lambda: steps.get_subscription_count() > 1, "axis and recorder listen")
    steps.publish(Int32(data=20))
    reports.clear()
    ros.wait_until(lambda: reports.count("stickslip_axis: friction") > 1, "two reports")
    assert ros.call(node, Trigger, "/stickslip_recorder/stop", Trigger.Request()).success
    with AnyReader([tmp_path / "run"]) as reader:
        return [
            (connection.topic, reader.deserialize(data, connection.msgtype))
            for connection, _, data in reader.messages()
        ]


def test_every_series_is_in_a_bag(messages: list[tuple[str, Any]]) -> None:
    there = set().union(*(plotjuggler_names(*message) for message in messages))
    curves = {c.attrib["name"] for c in ET.parse(CONFIG / "plotjuggler.xml").iter("curve")}
    assert len(curves) > 10
    assert curves - there == set()

    layout = json.loads((CONFIG / "foxglove.json").read_text(encoding="utf-8"))
    panels = layout["configById"]
    latest = dict(messages)
    paths = [path["value"] for panel in panels.values() for path in panel.get("paths", ())]
    assert len(paths) >= 6
    for path in paths:
        found = re.fullmatch(r"(?P<topic>[\w/]+)\.(?P<field>\w+)\[(?P<index>\d+)\]", path)
        assert found, path
        assert getattr(latest[found["topic"]], found["field"])[int(found["index"])] is not None
    for panel in panels.values():
        for key in ("topicPath", "topicToRender"):
            assert panel.get(key, "/diagnostics") in latest
    assert panels_of(layout["layout"]) == set(panels)


def panels_of(node: Any) -> set[str]:
    """Return the panels that a Foxglove layout arranges."""
    if isinstance(node, str):
        return {node}
    return panels_of(node["first"]) | panels_of(node["second"])
