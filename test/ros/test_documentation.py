# SPDX-License-Identifier: Apache-2.0
"""Pages and layouts of plots name what there is; the example of docs/testing.md runs."""

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

from stickslip_ros.ros.topics import OUTPUTS

DOCS = Path(__file__).resolve().parent.parent.parent / "docs"


@pytest.mark.long
def test_the_example_for_users_passes(start_module: Start, tmp_path: Path) -> None:
    page = (DOCS / "testing.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"^```python\n(.*?)^```$", page, re.DOTALL | re.MULTILINE)
    (tmp_path / "test_stage.py").write_text(example)
    run = start_module(
        "pytest",
        "-q",
        "-p",
        "stickslip_ros.testing.plugin",
        "-p",
        "no:cacheprovider",
        "test_stage.py",
    )
    run.wait_for("2 passed", timeout=60.0)
    assert run.wait() == 0


def test_the_page_on_the_node_names_what_there_is() -> None:
    """The parameters of the node stand in docs/node.md; its topics are written there."""
    page = (DOCS / "node.md").read_text(encoding="utf-8")
    assert [topic for topic in OUTPUTS if f"\n| `{topic}` |" not in page] == []
    for name in ("axes", "publish_rate", "real_time_factor", "real_time_priority", "publish_clock"):
        assert f"`{name}`" in page


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
