# SPDX-License-Identifier: Apache-2.0
"""My node under test, in the process of pytest: `pytest test_my_node.py`."""

import pytest
from my_node import Guard
from rclpy.parameter import Parameter

pytestmark = pytest.mark.stickslip(frequency=1000.0, own_time=True)


@pytest.fixture
def guard(stickslip_world):
    farthest = Parameter("farthest", value=3e-6)
    return stickslip_world.add(
        Guard(context=stickslip_world.context, parameter_overrides=[farthest])
    )


def test_the_axis_is_stopped_where_it_may_not_go(stickslip_world, guard):
    axis = stickslip_world.clients["stickslip_axis"]
    axis.send("jog", 1000.0)
    axis.wait_for_state("stopped")
    assert guard.stopped
    assert 3e-6 < axis.position < 8e-6


def test_the_axis_is_left_alone_elsewhere(stickslip_world, guard):
    axis = stickslip_world.clients["stickslip_axis"]
    assert axis.send("position", 2e-6).wait().position == pytest.approx(2e-6, abs=5e-9)
    assert not guard.stopped
