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

from stickslip_ros.ros.client import AxisClient, AxisFault, CommandRefused


def test_faults_are_seen_over_ros_and_end(ros: Ros, make_axis: MakeAxis) -> None:
    """One of each way to see them: in status and report, refused, in a fault, too late."""
    make_axis(frequency=1000.0, allow_faults=True)
    heard = Heard(ros)
    client = AxisClient(node=ros.node("user"))
    with client.fault("axis_stall 3"):
        assert client.step(200).wait().steps_done == 200
        assert client.position < 1e-6
        assert "axis_stall" in client.status["injected faults"]
    with client.fault("sensor_dropout"):
        with pytest.raises(AxisFault, match="the sensor gives no reading"):
            client.move_to(2e-6).wait()
        client.reset()
        assert math.isnan(float(client.report()["axis"]["measured position (m)"]))
    with (
        client.fault("refuse"),
        pytest.raises(CommandRefused, match="injected fault refuse"),
    ):
        client.step(1)
    with client.fault("late 0.3"):
        begin = time.monotonic()
        client.stop()
        assert time.monotonic() - begin > 0.3
    assert client.status["injected faults"] == ""
    client.step(5).wait()
    assert heard.compare_with_rerun() > 20


def test_an_axis_that_vanishes_says_and_answers_nothing_and_comes_back(
    ros: Ros, make_axis: MakeAxis
) -> None:
    make_axis(frequency=1000.0, allow_faults=True)
    heard = Heard(ros)
    client = AxisClient(node=ros.node("user"))
    client.step(10).wait()
    client.timeout = 1.0
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
