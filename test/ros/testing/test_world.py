# SPDX-License-Identifier: Apache-2.0
"""One world for tests: several axes, faults of one of them, time of its own."""

from typing import Any

import pytest

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from stickslip_ros.ros.client import AxisClient
from stickslip_ros.ros.testing.in_process import InProcess
from stickslip_ros.ros.testing.offline import OfflineAxis


class Watch(Node):
    """A node under test: it notes where x is, by the simulated time, and stops it at 5 um.

    The first that it hears is what was kept for it.
    """

    def __init__(self, **options: Any) -> None:
        """Listen; options are those of a node."""
        super().__init__("watch", **options)
        self.seen: list[tuple[int, float]] = []
        self.stopped_at = 0.0
        self._stop = self.create_client(Trigger, "/x/stop")
        self.create_subscription(JointState, "/x/joint_states", self._on_state, 10)
        kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.heard_at: list[int] = []  # ns
        self.create_subscription(DiagnosticArray, "/x/status", self._on_status, kept)

    def _on_status(self, _: DiagnosticArray) -> None:
        self.heard_at.append(self.get_clock().now().nanoseconds)

    def _on_state(self, message: JointState) -> None:
        now = self.get_clock().now().nanoseconds
        self.seen.append((now, message.position[0]))
        if message.position[0] > 5e-6 and not self.stopped_at:
            self.stopped_at = message.position[0]
            self._stop.call_async(Trigger.Request())


@pytest.mark.stickslip(axes=["x", "y"], frequency=1000.0)
def test_the_fixtures_share_one_world(
    stickslip_world: InProcess, stickslip_axis: AxisClient, stickslip_fault: Any
) -> None:
    """They had made two worlds in one domain, and none of several axes."""
    x, y = stickslip_world.clients.values()
    assert stickslip_axis is x
    with stickslip_fault("axis_stuck", axis="y"):
        y.send("steps", 30).wait()
        x.send("steps", 30).wait()
        assert abs(y.position) < 1e-8 < 1e-6 < x.position
        assert (x.status["injected faults"], y.status["injected faults"]) == ("", "axis_stuck")
    assert y.send("steps", 30).wait().position > 1e-6
    with pytest.raises(ValueError, match="no axis 'z'; there are x, y"), stickslip_fault("", "z"):
        pass


def story(world: InProcess) -> tuple[list[tuple[int, float]], float, list[str], float]:
    """Return what a node saw of a jog of x, where it stopped it, and whom another heard, and when.

    The last is a difference of floats, as nodes compute.
    """
    heard: list[JointState] = []
    world.node("ears").create_subscription(JointState, "/joint_states", heard.append, 100)
    use_sim_time = Parameter("use_sim_time", value=True)
    watch = Watch(context=world.context, parameter_overrides=[use_sim_time])
    begin, first = world.now, world.add(watch).get_clock().now().nanoseconds
    assert watch.heard_at == [first], "the status, which is kept"
    x = world.clients["x"]
    x.send("jog", 1000.0)
    with world.fault("sensor_drift 1um/s", "y"):
        world.wait_until(lambda: watch.stopped_at, 5.0, "the node stops x")
    assert x.wait_for_state("stopped").position < 7e-6
    world.run(0.1)
    assert world.now - begin < 1.0
    seen = [(ns - first, position) for ns, position in watch.seen if ns > first]
    assert seen[-1][0] * 1e-9 == pytest.approx(world.now - begin, abs=0.011)
    ends = [one.header.stamp.sec + 1e-9 * one.header.stamp.nanosec for one in heard[::9]]
    return seen, watch.stopped_at, [one.name[0] for one in heard], ends[-1] - ends[0]


RUNS: list[Any] = []


@pytest.mark.parametrize("number", range(3))
@pytest.mark.stickslip(axes=["x", "y"], own_time=True, frequency=1000.0)
def test_time_of_its_own_comes_out_alike(stickslip_world: InProcess, number: int) -> None:
    """With /clock for the node under test, which reacts before time goes on.

    Which of several axes was heard first depended on how long the start took.
    """
    RUNS.append(story(stickslip_world))
    assert RUNS[-1] == RUNS[0]


@pytest.mark.long
@pytest.mark.stickslip(own_time=True, frequency=1000.0)
def test_waits_are_in_simulated_time(stickslip_world: InProcess) -> None:
    axis = stickslip_world.axis
    axis.send("steps", 2000).wait()  # two seconds
    assert axis.position == pytest.approx(2000 * 122.5e-9, rel=0.01)
    assert 1.99 < stickslip_world.now < 2.2
    with pytest.raises(TimeoutError, match="not within 3 s of simulated time: nothing"):
        stickslip_world.wait_until(lambda: False, 3.0, "nothing")
    assert 5.0 < stickslip_world.now < 5.3
    axis.send("jog", 10.0)
    with pytest.raises(TimeoutError, match=r"waited 2 s"):
        axis.wait_for_state("holding", 2.0)


@pytest.mark.stickslip(axes=["x", "y"], real_time_factor=0.0)
def test_each_axis_has_its_turn_where_time_goes_as_fast_as_it_can(
    stickslip_world: InProcess,
) -> None:
    """Of a full queue, one reader took 644 messages of x and none of y."""
    heard: list[str] = []
    node = stickslip_world.node("slow")

    def hear(message: JointState) -> None:
        heard.append(message.name[0])

    node.create_subscription(JointState, "/joint_states", hear, 10)
    stickslip_world.wait_until(lambda: len(heard) > 100, 1e6, "a hundred states")
    counts = [heard.count(f"{name}_slider") for name in "xy"]
    assert min(counts) > 0.2 * len(heard), counts


def test_a_duration_and_a_time_have_two_names(offline_axis: OfflineAxis) -> None:
    """With the cure where the name of one is used for the other."""
    offline_axis.command("steps", 3)
    offline_axis.run(0.5)
    offline_axis.run(0.5)
    assert offline_axis.state.t == 1.0
    offline_axis.axis.advance(1.5)
    assert offline_axis.state.t == 1.5 and offline_axis.status.step_count == 3
    with pytest.raises(AttributeError, match=r"run\(seconds\), or axis.advance\(t\) to a time"):
        offline_axis.advance(0.5)
