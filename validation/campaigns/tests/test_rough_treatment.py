# SPDX-License-Identifier: Apache-2.0
"""Floods of commands, peers that die, two commanders at once: what docs/node.md says of them.

``STICKSLIP_FLOOD_S`` sets how long the flood takes, 1 s by default.
"""

import os
import time
from pathlib import Path

import pytest
from live import Process, Ros, Start
from std_msgs.msg import Float64

from stickslip_ros.ros.client import AxisClient, CommandRefused

pytestmark = pytest.mark.long
FLOOD = float(os.environ.get("STICKSLIP_FLOOD_S", "1"))  # s
RATE = 5_000  # valid commands a second, and as many invalid ones
JOGS = """
import time
from stickslip_ros.ros.client import AxisClient
client = AxisClient()
client.send("jog", 1000.0)
time.sleep(600)
"""


@pytest.fixture
def axis(start_node: Start) -> Process:
    process = start_node("axis_node", frequency=1000.0)
    process.wait_for("ready")
    return process


def test_a_flood_of_commands_leaves_the_last_valid_one_in_force(ros: Ros, axis: Process) -> None:
    """Every second one is invalid; the axis is alive, has counted, and answers as before."""
    user = ros.node("user")
    client = AxisClient(node=user)
    client.send("steps", 10**6)
    commands = ros.publisher(user, Float64, "/stickslip_axis/command/amplitude")
    begin, sent, last = time.monotonic(), 0, 0.0
    while sent < FLOOD * RATE:
        due = min(int((time.monotonic() - begin) * RATE), int(FLOOD * RATE))
        for number in range(sent, due):
            last = 100.0 + number % 997 * 0.1
            commands.publish(Float64(data=last))
            commands.publish(Float64(data=-last))
        sent = max(sent, due)
        time.sleep(1e-3)
    ended = time.monotonic()
    ros.wait_until(lambda: client.status["amplitude (V)"] == repr(last), "the last valid one")
    settled = time.monotonic() - ended
    asked = time.monotonic()
    client.send("frequency", 500.0)
    answered = time.monotonic() - asked
    refused = int(client.report()["axis"]["refused commands"])
    took = ended - begin
    print(
        f"{2 * sent} commands in {took:.2f} s: {refused} refused, the last in force after "
        f"{1e3 * settled:.1f} ms, the next one answered within {1e3 * answered:.1f} ms"
    )
    assert refused > 0
    assert client.state == "stepping"
    assert axis.interrupt() == 0


def test_the_axis_goes_on_when_its_commander_is_killed(
    ros: Ros, axis: Process, start_module: Start, tmp_path: Path
) -> None:
    """As a controller does; the next commander takes over."""
    program = tmp_path / "commander_that_jogs.py"
    program.write_text(JOGS)
    peer = start_module("commander_that_jogs")
    client = AxisClient(node=ros.node("user"))
    client.wait_for_state("jogging")
    peer.kill()
    before = client.position
    ros.wait_until(lambda: client.position > before + 1e-6, "further steps")
    assert client.send("steps", 10).wait().steps_done == 10
    assert axis.interrupt() == 0


def test_a_client_finds_the_axis_again_that_was_killed(ros: Ros, start_node: Start) -> None:
    """It begins anew, at 0; a client that was there before commands it as the first one."""
    first = start_node("axis_node", frequency=1000.0)
    first.wait_for("ready")
    client = AxisClient(node=ros.node("user"))
    client.send("steps", 100).wait()
    known = _listeners(client)
    first.kill()
    second = start_node("axis_node", frequency=500.0)
    second.wait_for("ready")
    ros.wait_until(lambda: client.status["frequency (Hz)"] == "500.0", "the second one")
    # The first one counts as a listener until DDS misses it, 20 s later.
    ros.wait_until(lambda: _listeners(client) - known, "the listener of the second one")
    ros.wait_until(lambda: client.connected(len(_listeners(client))), "the second one hears")
    assert client.send("steps", 10).wait().steps_done == 10
    assert client.position < 2e-6


def _listeners(client: AxisClient) -> set[bytes]:
    """Return who listens to the topic that steps are sent on."""
    found = client.node.get_subscriptions_info_by_topic(f"{client.axis}/command/steps")
    return {bytes(info.endpoint_gid) for info in found}


def test_the_last_of_two_commanders_has_its_way(ros: Ros, axis: Process) -> None:
    """Both hear everything; a refusal is raised to the one who asked for it."""
    one, two = AxisClient(node=ros.node("one")), AxisClient(node=ros.node("two"))
    one.send("jog", 1000.0)
    two.send("steps", 1000)
    one.wait_for_state("stepping")
    assert two.wait().steps_done == 1000
    one.send("steps", 100_000)
    with pytest.raises(CommandRefused, match="amplitude is 999 V"):
        two.send("amplitude", 999.0)
    assert "999 V" in one.last_error or one.report()["axis"]["refused commands"] == "1"
    assert one.state == "stepping"
    two.send("stop").wait()
    one.wait_for_state("stopped")
    # Both may still have states of the motion on their way; at rest they agree.
    rest = pytest.approx(0.0, abs=1e-8)  # each has a reading of its own
    ros.wait_until(lambda: one.position - two.position == rest, "the same position")
    assert axis.interrupt() == 0


def test_a_second_axis_of_the_name_is_warned_of(start_node: Start) -> None:
    """Both would obey, and their states would mix."""
    first = start_node("axis_node")
    first.wait_for("ready")
    second = start_node("axis_node")
    for process in (first, second):
        process.wait_for("somebody else publishes as /stickslip_axis: a second axis")
