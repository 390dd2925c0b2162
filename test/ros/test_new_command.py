# SPDX-License-Identifier: Apache-2.0
"""A new command is one entry in the registry: all that deals with commands knows it from there."""

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from heard import Heard
from live import Ros
from rclpy.qos import DurabilityPolicy, QoSProfile
from table_1 import TABLE_1

from stickslip_ros.axis import Axis, CommandRefused, Event
from stickslip_ros.axis.command import FLOAT64, Command
from stickslip_ros.axis.commands import COMMANDS, state_table
from stickslip_ros.axis.resimulation import Rerun
from stickslip_ros.axis.state_machine import SCANNING, row
from stickslip_ros.axis.tasks import ScanTask
from stickslip_ros.ros.axis_node import AxisNode
from stickslip_ros.ros.client import AxisClient
from stickslip_ros.ros.recording import axis_topics

#: Moves the level of the actuator by a share of the highest voltage.
SHARE = Command(
    "share",
    "command/share",
    FLOAT64,
    "level as a share of the highest voltage",
    row(SCANNING),
    check=lambda axis, share: axis.config.check_level(share * axis.parameters.actuator.max_voltage),
    task=lambda axis, share: ScanTask(
        share * axis.parameters.actuator.max_voltage, axis.note_limit
    ),
    limits=lambda p: (0.0, 1.0),
)


@pytest.fixture(autouse=True)
def registered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(COMMANDS, SHARE.name, SHARE)


def test_an_axis_carries_it_out_and_refuses_it() -> None:
    axis = Axis(TABLE_1)
    axis.command("share", 0.5)
    assert axis.mode == "scanning"
    axis.advance(1.0)
    assert axis.status.scan_level == pytest.approx(150.0)
    with pytest.raises(CommandRefused, match="330 V"):
        axis.command("share", 1.1)
    axis.enable(False)
    with pytest.raises(CommandRefused, match="enable it first"):
        axis.command("share", 0.5)
    assert state_table()["share"]["fault"] == "refused"


def test_node_client_recorder_and_resimulation_know_it(ros: Ros) -> None:
    node = AxisNode(context=ros.context, given=TABLE_1)
    ros.add(node)
    heard = Heard(ros)
    client = AxisClient(node=ros.node("user"))
    client.send("share", 0.25).wait()
    assert client.status["scan level (V)"] == repr(75.0)
    with pytest.raises(CommandRefused, match="share refused: "):
        client.send("share", 2.0)
    ros.wait_until(lambda: len(heard.events) == 4, "start, applied, finished, refused")

    assert axis_topics("/stickslip_axis")["/stickslip_axis/command/share"] == FLOAT64
    events = [Event.of(values) for _, values in heard.events]
    start, applied, finished, _ = filter(None, events)
    again = Rerun([start, applied]).advance(finished.time + 1e-9)
    assert again.take_events() == [start, applied, finished]
    described: dict[str, str] = {}

    def hear(message: DiagnosticArray) -> None:
        described.update({status.name: status.message for status in message.status})

    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    heard.node.create_subscription(DiagnosticArray, "/stickslip_axis/description", hear, latched)
    ros.wait_until(lambda: described, "the description")
    assert described["stickslip_axis: command share"] == SHARE.meaning
