# SPDX-License-Identifier: Apache-2.0
"""Layouts of plots and the policy for SROS 2 name what there is; the example of a test passes."""

import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from child import python
from diagnostic_msgs.msg import DiagnosticArray
from live import MakeAxis, Ros, Start
from rclpy.parameter import Parameter as RosParameter
from rosbags.highlevel import AnyReader
from std_msgs.msg import Int32
from std_srvs.srv import Trigger

from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.ros.client import AxisClient
from stickslip_ros.ros.nodes.axis_host import axis_or_host
from stickslip_ros.ros.nodes.axis_node import AxisNode
from stickslip_ros.ros.nodes.recorder_node import RecorderNode
from stickslip_ros.ros.nodes.twin_node import TwinNode

DOCS = Path(__file__).resolve().parent.parent.parent / "docs"


@pytest.mark.long
def test_the_example_for_users_passes(start_module: Start, tmp_path: Path) -> None:
    page = (DOCS / "testing.md").read_text(encoding="utf-8")
    example, _ = re.findall(r"^```python\n(.*?)^```$", page, re.DOTALL | re.MULTILINE)
    (tmp_path / "test_stage.py").write_text(example)
    options = ("-q", "-p", "stickslip_ros.testing", "-p", "no:cacheprovider")
    run = start_module("pytest", *options, "test_stage.py")
    run.wait_for("2 passed", timeout=60.0)
    assert run.wait() == 0


CONFIG = Path(__file__).resolve().parents[2] / "config"


def test_what_ros2_param_dump_writes_is_taken_by_every_command(
    ros: Ros, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """There was no parameter 'emulate'."""
    node = axis_or_host(context=ros.context, parameter_overrides=[RosParameter("mass", value=0.1)])
    (one,) = node.nodes
    names = one.list_parameters([], 0).names
    values = {name: one.get_parameter(name).value for name in names}
    assert {"emulate", "use_sim_time"} < set(values)
    file = tmp_path / "stickslip_axis.yaml"
    file.write_text(yaml.safe_dump({"/stickslip_axis": {"ros__parameters": values}}))
    for _ in range(2):
        assert Parameters.of(file).runner.mass == 0.1
    (said,) = (record.message for record in caplog.records)
    assert said.startswith(f"{file}: emulate, emulate_port are of nodes alone")
    ros.add(one)


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


def every_series_is_in(bag: Path, plotjuggler: str, foxglove: str) -> None:
    """Assert that a bag holds what layouts of plots name."""
    there, latest = set[str](), dict[str, Any]()
    with AnyReader([bag]) as reader:
        for connection, _, data in reader.messages():
            message = latest[connection.topic] = reader.deserialize(data, connection.msgtype)
            there |= plotjuggler_names(connection.topic, message)
    there |= {f"{topic}/data" for topic, message in latest.items() if hasattr(message, "data")}
    curves = {c.attrib["name"] for c in ET.parse(CONFIG / plotjuggler).iter("curve")}
    assert len(curves) > 10 and curves - there == set()
    layout = json.loads((CONFIG / foxglove).read_text(encoding="utf-8"))
    panels = layout["configById"]
    paths = [path["value"] for panel in panels.values() for path in panel.get("paths", ())]
    assert len(paths) >= 4
    for path in paths:
        found = re.fullmatch(r"([\w/]+)\.(\w+)(?:\[(\d+)\])?", path)
        assert found, path
        topic, field, index = found.groups()
        assert np.size(getattr(latest[topic], field)) > int(index or 0)
    for panel in panels.values():
        for key in ("topicPath", "topicToRender"):
            assert panel.get(key, "/diagnostics") in latest
    assert panels_of(layout["layout"]) == set(panels)


def panels_of(node: Any) -> set[str]:
    """Return the panels that a Foxglove layout arranges."""
    if isinstance(node, str):
        return {node}
    return panels_of(node["first"]) | panels_of(node["second"])


@pytest.mark.long
def test_every_series_is_in_a_bag(
    ros: Ros, make_axis: MakeAxis, start_node: Start, tmp_path: Path
) -> None:
    """Of a second of an axis that steps."""
    recorder = start_node("recorder_node", output="run")
    make_axis()
    reports = ros.hear(DiagnosticArray, "/diagnostics")
    node = ros.node()
    steps = ros.publisher(node, Int32, "/stickslip_axis/command/steps")
    recorder.wait_for("first message of /joint_states")
    ros.wait_until(lambda: steps.get_subscription_count() > 1, "axis and recorder listen")
    steps.publish(Int32(data=20))
    reports.clear()

    def of_friction() -> int:
        names = [status.name for one in list(reports) for status in one.status]
        return names.count("stickslip_axis: friction")

    ros.wait_until(lambda: of_friction() > 1, "two reports")
    assert ros.call(node, Trigger, "/stickslip_recorder/stop", Trigger.Request()).success
    every_series_is_in(tmp_path / "run", "plotjuggler.xml", "foxglove.json")


POLICY = Path(__file__).parents[2] / "config" / "sros2_policy.xml"
KEYS = ("identity_ca.cert", "cert", "key", "permissions_ca.cert")


def allowed(enclave: str, kind: str, how: str) -> set[str]:
    """Return the topics or services of an enclave, as (topics, publish) or (services, reply)."""
    found = ET.parse(POLICY).getroot().find(f".//enclave[@path='/stickslip/{enclave}']")
    assert found is not None
    return {name.text or "" for part in found.iter(kind) if part.get(how) for name in part}


def test_the_policy_allows_what_the_nodes_have_and_no_more(
    ros: Ros, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    axis = AxisNode(context=ros.context)
    ros.add(axis)
    client = AxisClient(node=ros.node("stickslip_client"))
    ros.add(TwinNode(cli_args=["--ros-args", "-r", "measured:=/joint_states"], context=ros.context))
    recorder = RecorderNode(context=ros.context)  # not spun, so that it can be closed from here
    try:
        for enclave, node in (
            ("axis", "stickslip_axis"),
            ("recorder", "stickslip_recorder"),
            ("commander", "stickslip_client"),
            ("twin", "stickslip_twin"),
        ):
            for kind, how, names in (
                ("topics", "publish", axis.get_publisher_names_and_types_by_node),
                ("topics", "subscribe", axis.get_subscriber_names_and_types_by_node),
                ("services", "reply", axis.get_service_names_and_types_by_node),
            ):
                needed = {name for name, _ in names(node, "/")}
                assert allowed(enclave, kind, how) - {"/clock"} == needed, (enclave, how)
        asked = {
            name for name, _ in axis.get_client_names_and_types_by_node(client.node.get_name(), "/")
        }
        assert asked <= allowed("commander", "services", "request")
    finally:
        recorder.close()
        recorder.destroy_node()


@pytest.mark.parametrize(
    "strategy", ["Permissive", pytest.param("Enforce", marks=pytest.mark.long)]
)
def test_without_security_no_node_starts_unprotected(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, strategy: str
) -> None:
    enclave = tmp_path / "enclaves" / "stickslip"
    enclave.mkdir(parents=True)
    for name in (*(f"{key}.pem" for key in KEYS), "governance.p7s", "permissions.p7s"):
        (enclave / name).touch()
    code = "import sys; from stickslip_ros.executables import recorder_node as r; sys.exit(r())"
    secured = {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_SECURITY_ENABLE": "true",
        "ROS_SECURITY_STRATEGY": strategy,
        "ROS_SECURITY_KEYSTORE": str(tmp_path),
        "ROS_LOG_DIR": str(tmp_path_factory.mktemp("log")),  # a home may be read-only
    }
    words = ("--ros-args", "--enclave", "/stickslip")
    done = python("-c", code, *words, cwd=tmp_path, **secured)
    # With security these keys are refused, without it everything is.
    assert done.returncode == 2
    assert "recorder_node: the node cannot be made: " in done.stderr
    assert "Traceback" not in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["enclaves"]
