# SPDX-License-Identifier: Apache-2.0
"""Every fault on demand over ROS: injected, seen by a client, ended, repeated bit for bit."""

import math
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

import pytest
from heard import Heard
from live import MakeAxis, Ros

from stickslip_ros.axis.faults import FAULTS
from stickslip_ros.ros.client import AxisClient, AxisFault, CommandRefused


def measured(client: AxisClient) -> float:
    """Return the reading of the sensor as the next report has it, m."""
    return float(client.report()["axis"]["measured position (m)"])


def sees(client: AxisClient, name: str) -> bool:
    """Return whether a client notices what a fault does."""
    before = client.position
    if name == "sensor_freeze":
        reading = measured(client)
        moved = client.step(30).wait().position - before
        return moved > 1e-6 and abs(measured(client) - reading) < 1e-9
    if name == "sensor_dropout":
        with pytest.raises(AxisFault, match="the sensor gives no reading"):
            client.move_to(2e-6).wait()
        client.reset()
        return math.isnan(measured(client))
    if name in ("sensor_drift 1e-5", "sensor_zero"):
        return abs(measured(client) - client.position) > 1e-6
    if name == "sensor_spike 10nm":  # one in a hundred readings: a report may miss it
        return "sensor_spike" in client.report()["axis"]["injected faults"]
    if name == "dirt 10um":
        return client.step(300).wait().position <= 1e-5
    if name in ("axis_stuck", "axis_stall 3"):
        client.step(200).wait()
        return client.steps_done == 200 and client.position - before < 1e-6
    if name == "preload_loss":
        client.step(1).wait()
        return "preload_loss" in client.status["injected faults"]
    if name == "refuse":
        with pytest.raises(CommandRefused, match="injected fault refuse"):
            client.step(1)
        return True
    begin = time.monotonic()
    client.stop()
    return time.monotonic() - begin > 0.3


def test_every_fault_is_seen_and_ends(ros: Ros, make_axis: MakeAxis) -> None:
    make_axis(frequency=1000.0, allow_faults=True)
    heard = Heard(ros)
    client = AxisClient(node=ros.node("user"))
    values = {
        **dict.fromkeys(FAULTS, ""),
        **{"sensor_drift": " 1e-5", "sensor_spike": " 10nm", "axis_stall": " 3", "dirt": " 10um"},
        "late": " 0.3",
    }
    for fault, value in values.items():
        if fault == "vanish":
            continue
        with client.fault(f"{fault}{value}"):
            name = f"{fault}{value}"
            assert sees(client, "late" if fault == "late" else name), fault
        assert client.status["injected faults"] == ""
    client.step(5).wait()
    assert heard.compare_with_rerun() > 20


def test_an_axis_that_vanishes_says_and_answers_nothing_and_comes_back(
    ros: Ros, make_axis: MakeAxis
) -> None:
    make_axis(frequency=1000.0, allow_faults=True)
    heard = Heard(ros)
    client = AxisClient(node=ros.node("user"), timeout=4.0)
    client.step(10).wait()
    with client.fault("vanish"):
        seen = len(heard.joints)
        for send in (lambda: client.step(1), client.stop):
            with pytest.raises(TimeoutError, match="does not answer"):
                send()
        assert len(heard.joints) <= seen + 1
    client = AxisClient(node=ros.node("user_again"))
    client.step(5).wait()
    assert client.steps_done == 5
    heard.event("injected fault", "ended")
    assert heard.compare_with_rerun() > 5


def test_faults_have_to_be_allowed(ros: Ros, make_axis: MakeAxis) -> None:
    make_axis()
    client = AxisClient(node=ros.node("user"))
    with pytest.raises(CommandRefused, match="start the axis with allow_faults"):
        client.inject("axis_stuck")


@pytest.mark.stickslip(frequency=1000.0)
def test_the_fixture_injects(
    stickslip_axis: AxisClient,
    stickslip_fault: Callable[..., AbstractContextManager[Any]],
) -> None:
    with stickslip_fault("axis_stuck"):
        assert stickslip_axis.step(50).wait().position < 1e-8
    assert stickslip_axis.step(50).wait().position > 1e-6
