# SPDX-License-Identifier: Apache-2.0
"""The policy for SROS 2 names what the nodes have; where security is missing, no node starts."""

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from child import python
from live import Ros

from stickslip_ros.ros.axis_node import AxisNode
from stickslip_ros.ros.client import AxisClient
from stickslip_ros.ros.recorder_node import RecorderNode
from stickslip_ros.ros.twin_node import TwinNode

pytestmark = pytest.mark.slow

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
def test_without_security_no_node_starts_unprotected(tmp_path: Path, strategy: str) -> None:
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
    }
    words = ("--ros-args", "--enclave", "/stickslip")
    done = python("-c", code, *words, cwd=tmp_path, **secured)
    # With security these keys are refused, without it everything is.
    assert done.returncode == 2
    assert "recorder_node: the node cannot be made: " in done.stderr
    assert "Traceback" not in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["enclaves"]
