# SPDX-License-Identifier: Apache-2.0
"""An axis that costs more than the machine has: it is slower, says so, and hears everybody."""

import re
import time
from statistics import median
from typing import Any

import pytest
from live import Ros, Start

from stickslip_ros.ros.client import AxisClient

HEARD = 0.2  # s, within which an axis answers, whatever it costs
CONTACTS = {"contacts": 16, "contact_spread": 0.2, "sensor_bandwidth": 3000.0}
FAST = {"slewrate": 50.0, "amplitude": 100.0, "max_frequency": 25000.0, "frequency": 1000.0}


def answers(client: AxisClient, count: int) -> list[float]:
    """Return how long a stop takes to be answered, s, each time."""
    took = []
    for _ in range(count):
        begin = time.monotonic()
        client.stop()
        took.append(time.monotonic() - begin)
    return took


@pytest.mark.parametrize(
    ("given", "changes", "jog"),
    [
        ({**CONTACTS, **FAST}, {}, 20000.0),
        pytest.param(
            {"sensor_rate": 100000.0},
            {"sensor_bandwidth": 3000.0},
            1000.0,
            marks=pytest.mark.long,
        ),
        pytest.param(
            {"publish_rate": 1000.0, "sensor_bandwidth": 3000.0, "creep": 0.02},
            {},
            1000.0,
            marks=pytest.mark.long,
        ),
    ],
    ids=["contacts", "sensor", "publish_rate"],
)
def test_stop_and_signals_are_heard_whatever_it_costs(
    ros: Ros, start_node: Start, given: dict[str, Any], changes: dict[str, Any], jog: float
) -> None:
    """Each was deaf for seconds to minutes when a block simulated the whole lag in one piece."""
    process = start_node("axis_node", **given)
    process.wait_for("ready", 300.0)  # several contacts are compiled when they are first used
    client = AxisClient(node=ros.node("user"))
    if changes:
        client.set_parameters(**changes)
    client.jog(jog)
    before = client.stamp
    ros.wait_until(lambda: client.stamp > before + 0.02, "motion")
    took = answers(client, 9)
    assert median(took) < HEARD, took
    client.jog(jog)
    begin = time.monotonic()
    assert process.terminate() == 0
    assert time.monotonic() - begin < 5.0  # most of it to close what DDS has open


def test_it_says_how_slow_it_is_and_why_and_faults_after_the_limit(
    ros: Ros, start_node: Start
) -> None:
    """The log says it once for all axes of the process."""
    process = start_node("axis_node", axes="[a, b]", **CONTACTS, **FAST, real_time_factor=50.0)
    process.wait_for("axis b ready", 300.0)  # several contacts are compiled at first
    client = AxisClient("/a", node=ros.node("user"))
    client.jog(20000.0)
    said = ros.wait_until(lambda: client.status["overload"], "overload in the status")
    assert "of 50: a second of motion takes " in said
    assert "contacts 16" in said
    assert "sensor_bandwidth 3000 Hz" in said
    timing = client.report()["timing"]
    assert float(timing["real-time factor"]) < 40.0
    assert float(timing["time dropped (s)"]) > 0.0
    client.set_parameters(overload_limit=1.5)
    ros.wait_until(lambda: client.state == "fault", "the fault")
    assert "overload_limit is 1.5 s" in client.status["last error"]
    process.wait_for("[stickslip_axis]: real-time factor ")
    assert not re.search(r"\[[ab]\]: real-time factor", process.output)
    assert process.interrupt() == 0
