# SPDX-License-Identifier: Apache-2.0
"""What a robot's node reads on `joint_states` is what the sensor says; `~/truth` is the model's.

Written as a test of your own node would be: a node that listens, an axis with a bad sensor.
"""

import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

from stickslip_ros.recordings import open_bag, resimulate
from stickslip_ros.ros.nodes.recorder_node import RecorderNode
from stickslip_ros.ros.testing.in_process import InProcess

NOISE, LATENCY = 20e-9, 0.02  # m, s


class Robot(Node):
    """A node that knows of the axis what the topics say: position (m) and velocity (m/s) by s."""

    def __init__(self, **options: Any) -> None:
        """Listen to an axis; options are those of a node."""
        super().__init__("robot", **options)
        self.read: dict[float, tuple[float, float]] = {}
        self.true: dict[float, tuple[float, float]] = {}
        hear = self.create_subscription
        hear(JointState, "/joint_states", lambda m: self._take(self.read, m), 1000)
        hear(JointState, "/stickslip_axis/truth", lambda m: self._take(self.true, m), 1000)

    def _take(self, into: dict[float, tuple[float, float]], message: JointState) -> None:
        k, at = message.name.index("axis_slider"), message.header.stamp
        into[at.sec + 1e-9 * at.nanosec] = message.position[k], message.velocity[k]

    def forget(self) -> None:
        """Forget what was read."""
        self.read.clear()
        self.true.clear()

    def error(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Return reading less truth, m, at the times of both."""
        read, true = dict(self.read), dict(self.true)  # they grow meanwhile
        return np.array([read[t][0] - true[t][0] for t in read if t in true])


@pytest.fixture
def robot(stickslip_world: InProcess) -> Robot:
    robot = Robot(context=stickslip_world.context)
    stickslip_world.add(robot)
    return robot


def waiting(world: InProcess) -> Callable[[Callable[[], object], str], None]:
    """Return what waits for a condition, ten seconds of simulated time at most."""
    return lambda condition, what: world.wait_until(condition, 10.0, what)


@pytest.mark.long
@pytest.mark.stickslip(
    sensor_noise=NOISE,
    sensor_latency=LATENCY,
    sensor_resolution=0.0,
    publish_rate=200.0,
    frequency=1000.0,
    own_time=True,
)
def test_a_node_sees_a_noisy_delayed_and_failing_sensor(
    stickslip_world: InProcess, robot: Robot
) -> None:
    axis, wait = stickslip_world.axis, waiting(stickslip_world)

    # At rest it reads noise, where the runner does not move at all.
    wait(lambda: len(robot.error()) > 200, "200 states")
    assert robot.error().std() == pytest.approx(NOISE, rel=0.25)
    assert {x for x, _ in robot.true.values()} == {0.0}
    # The velocity is the mean since the last state, so noise it is.
    (t0, (x0, _)), (t1, (x1, v)) = list(robot.read.items())[-2:]
    assert v == pytest.approx((x1 - x0) / (t1 - t0), rel=1e-3)

    # In motion it is late by the latency, and one reading at most.
    axis.send("jog", 1000.0)
    robot.forget()
    wait(lambda: len(robot.error()) > 100, "100 states of a jog")
    late = list(robot.error())[20:]  # those of before the jog are out by then
    (t0, (x0, _)), (t1, (x1, _)) = min(robot.true.items()), max(robot.true.items())
    speed = (x1 - x0) / (t1 - t0)
    assert LATENCY - 1e-3 < -np.mean(late) / speed < LATENCY + 2e-3
    mean = np.mean([v for _, v in list(robot.read.values())[20:]])
    assert mean == pytest.approx(speed, rel=0.1)

    # It freezes: the runner goes on, and the node cannot know.
    with axis.fault("sensor_freeze"):
        robot.forget()
        wait(lambda: len(robot.error()) > 20, "20 states of a frozen sensor")
        assert len({x for x, _ in robot.read.values()}) == 1
        xs = [x for x, _ in robot.true.values()]
        assert all(a < b for a, b in pairwise(xs[::5]))

    # It gives no reading: nothing comes, and the diagnostics say why.
    with axis.fault("sensor_dropout"):
        robot.forget()
        report = axis.report()
        wait(lambda: len(robot.true) > 20, "20 true states")
        assert not robot.read and math.isnan(axis.position)
        assert "the sensor gives no reading: joint_states stays away" in axis._message
        assert report["axis"]["measured position (m)"] == "nan"
        axis.send("stop").wait()  # which waits for no reading
    robot.forget()
    wait(lambda: robot.read, "a reading again")


@pytest.mark.stickslip(frequency=1000.0, sensor_latency=0.0, sensor_noise=0.0, own_time=True)
def test_both_topics_have_a_zero_of_their_own(stickslip_world: InProcess, robot: Robot) -> None:
    axis, wait = stickslip_world.axis, waiting(stickslip_world)
    axis.send("steps", 50).wait()
    there = axis.position
    assert there > 4e-6
    axis.send("zero")
    robot.forget()
    wait(lambda: len(robot.error()) > 5, "states")
    assert axis.position == pytest.approx(0.0, abs=2e-9)
    assert robot.true[max(robot.true)][0] == pytest.approx(there, abs=2e-9)
    assert all(abs(v) < 1e-9 for _, v in robot.read.values())  # a zero moves nothing
    axis.set_parameters(joint_state_source="truth")
    axis.send("jog", 1000.0)
    robot.forget()
    wait(lambda: len(robot.error()) > 20, "states of a jog")
    both = [t for t in robot.read if t in robot.true]
    for t in both:
        assert robot.read[t][0] == pytest.approx(robot.true[t][0] - there, abs=2e-9)
        assert robot.read[t][1] == robot.true[t][1]  # at that instant


@pytest.mark.stickslip(frequency=1000.0, allow_faults=True, sensor_latency=5e-3)
def test_both_topics_come_out_of_a_bag_again_bit_for_bit(
    stickslip_world: InProcess, tmp_path: Path
) -> None:
    """By a recorder that came late, with failures of the sensor, and with another source."""
    axis, wait = stickslip_world.axis, waiting(stickslip_world)
    axis.send("steps", 20).wait()
    output = Parameter("output", value=str(tmp_path / "bag"))
    recorder = RecorderNode(context=stickslip_world.context, parameter_overrides=[output])
    stickslip_world.add(recorder)
    wait(lambda: axis.connected(2), "the recorder")
    axis.send("steps", 100).wait()
    with axis.fault("sensor_dropout"):
        axis.send("steps", -30).wait()
    axis.send("zero")
    axis.set_parameters(sensor_latency=0.05, joint_state_source="truth")
    axis.send("position", 1e-6).wait()
    axis.set_parameters(joint_state_source="sensor")
    axis.send("steps", 10).wait()
    recorder.close()
    with open_bag(tmp_path / "bag") as bag:
        states, truths = (bag.counts[f"{n}"] for n in ("/joint_states", "/stickslip_axis/truth"))
        (again,) = resimulate(bag)
        (other,) = resimulate(bag, {"preload": 0.5})
    assert 20 < states < truths
    assert again.bit_for_bit and again.unknown_velocities == 1
    assert again.differences["axis_slider velocity"].values == states - 1
    assert again.differences["true axis_slider velocity"].values == truths
    assert not other.bit_for_bit
