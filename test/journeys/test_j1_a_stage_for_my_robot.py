# SPDX-License-Identifier: Apache-2.0
"""J1: three axes for my robot: commands, a trajectory, set points, and my own node when one fails.

The axes are a process of their own. Nothing of the package speaks to them here: plain messages do.
How far steps have gone is said by a general integrator of the whole system.
"""

import json
import math
import os
import time
from pathlib import Path
from typing import Any

import pytest
from child import REPOSITORY, python, stickslip
from live import Ros, Start

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Int32
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from stickslip_ros.physics.parameters import Parameters
from validation.whole_system import positions

pytestmark = pytest.mark.flaky(reruns=1)

#: y is heavier and has more preload; time goes as fast as the machine's.
AXES: dict[str, dict[str, Any]] = {"x": {}, "y": {"preload": 0.7, "payload": 2e-3}, "z": {}}
HOST = {"axes": [*AXES], "frequency": 1000.0, "sensor_noise": 0.0, "allow_faults": True}
JOINTS = [f"{name}_slider" for name in AXES]

ROBOT = '''
"""My node: it sends three axes off, and stops them all when one does not move for a second."""

import contextlib

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from std_srvs.srv import Trigger


class Robot(Node):
    def __init__(self, **options):
        super().__init__("robot", **options)
        self.jogs = [self.create_publisher(Float64, f"/{a}/command/jog", 10) for a in "xyz"]
        self.stops = [self.create_client(Trigger, f"/{a}/stop") for a in "xyz"]
        self.create_subscription(JointState, "/joint_states", self.on_state, 100)
        self.create_service(Trigger, "~/go", self.on_go)
        self.going, self.moved, self.stuck = False, {}, ""

    def on_go(self, _, answer):
        ready = all(one.get_subscription_count() for one in self.jogs)
        answer.success = ready and all(one.service_is_ready() for one in self.stops)
        if answer.success:
            self.going, self.moved = True, {}
            for jog in self.jogs:
                jog.publish(Float64(data=500.0))
        return answer

    def on_state(self, message):
        now = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        for name, x in zip(message.name, message.position):
            if not self.going or not name.endswith("_slider"):
                continue
            since, before = self.moved.setdefault(name, (now, x))
            if abs(x - before) > 1e-6:
                self.moved[name] = now, x
            elif now - since > 1.0:
                self.going, self.stuck = False, name
                for stop in self.stops:
                    stop.call_async(Trigger.Request())
                self.get_logger().info(f"{name} does not move: stopped all")


if __name__ == "__main__":
    rclpy.init()
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(Robot())
'''

ITS_TEST = """
import socket

import pytest
from rclpy.parameter import Parameter
from robot import Robot
from std_srvs.srv import Trigger


pytestmark = pytest.mark.stickslip(axes=["x", "y", "z"], own_time=True, publish_rate=20.0)


@pytest.mark.parametrize("failing", ["x", "z"])
def test_all_stop_when_one_fails(stickslip_world, failing):
    world = stickslip_world
    sim_time = Parameter("use_sim_time", value=True)
    robot = world.add(Robot(context=world.context, parameter_overrides=[sim_time]))
    go = world.node("me").create_client(Trigger, "/robot/go")
    world.wait_until(lambda: go.service_is_ready(), what="my node")
    world.wait_until(lambda: go.call(Trigger.Request()).success, what="it goes")
    world.run(1.5)
    assert not robot.stuck
    with world.fault("axis_stuck", failing):
        world.wait_until(lambda: robot.stuck, 3.0, "it notices")
    assert robot.stuck == failing + "_slider"
    for client in world.clients.values():
        client.wait_for_state("stopped", 1.0)


@pytest.mark.stickslip(preload=1.0, frequency=1000.0)
class TestHeavy:
    @pytest.mark.stickslip(axes=["x", "y"], x={"preload": 0.7}, emulate="mcs")
    def test_the_nearest_marker_wins_behind_a_controller_too(self, stickslip_world):
        x, y = stickslip_world.clients.values()
        assert (x.parameters["preload"], y.parameters["preload"]) == ("0.7", "1.0")
        with socket.create_connection(("127.0.0.1", stickslip_world.port)) as client:
            client.sendall(b":GNC\\n")
            assert client.recv(100) == b":N2\\n"
        assert x.send("steps", 10).wait().steps_done == y.send("steps", -5).wait().steps_done + 15
"""


def outcomes(heard: list[Any], event: str, outcome: str) -> list[dict[str, str]]:
    """Return the values of the events of a kind that were heard."""
    said = [status for one in list(heard) for status in one.status]
    events = [{pair.key: pair.value for pair in status.values} for status in said]
    return [e for e in events if (e["event"], e["outcome"]) == (event, outcome)]


@pytest.fixture
def robot_is_up(start_node: Start, tmp_path: Path) -> Any:
    """Start the host of the three axes with my parameter file."""
    sections = {"stickslip_axis": HOST, **AXES}
    text = json.dumps({name: {"ros__parameters": own} for name, own in sections.items() if own})
    (tmp_path / "robot.yaml").write_text(text)
    host = start_node("axis_node", "--params-file", "robot.yaml")
    for name in AXES:
        host.wait_for(f"axis {name} ready")
    return host


def test_three_axes_for_my_robot(
    robot_is_up: Any, ros: Ros, start_module: Start, tmp_path: Path
) -> None:
    me = ros.node("me")
    events = {a: ros.hear(DiagnosticArray, f"/{a}/events", ros.latched(1000)) for a in AXES}
    joints: dict[str, list[Any]] = {a: ros.hear(JointState, f"/{a}/joint_states") for a in AXES}

    def send(kind: type[Any], topic: str, *messages: Any) -> None:
        ros.send(ros.publisher(me, kind, topic), *messages)

    def ended(event: str, outcome: str = "finished") -> list[float]:
        """Wait for that event of every axis; return its times (s)."""
        ros.wait_until(lambda: all(outcomes(e, event, outcome) for e in events.values()), event)
        return [float(outcomes(e, event, outcome)[-1]["time (s)"]) for e in events.values()]

    def at(goals: list[float], off: float) -> None:
        """Wait until the joints are there (m), as their readings say."""
        ros.wait_until(
            lambda: (
                all(joints.values())
                and [joints[a][-1].position[0] for a in AXES] == pytest.approx(goals, abs=off)
            ),
            f"the joints at {goals}",
        )

    # Steps of each, with a drive of its own, as far as another integrator says.
    send(Float64, "/x/command/amplitude", Float64(data=250.0))
    send(Float64, "/z/command/frequency", Float64(data=500.0))
    counts = {"x": 40, "y": -25, "z": 12}
    for axis, count in counts.items():
        send(Int32, f"/{axis}/command/steps", Int32(data=count))
    ended("move")
    drives = {"x": {"amplitude": 250.0}, "y": AXES["y"], "z": {"frequency": 500.0}}
    goals = []
    for axis, count in counts.items():
        p = Parameters.of({"frequency": 1000.0, **drives[axis]})
        goals.append(math.copysign(positions(p, abs(count), rest=0.2)[-1], count))
    at(goals, 0.6e-9)  # of which 0.5 nm are the sensor's resolution

    # One trajectory of all three, taken by all at the same time.
    points = [(0.2, [0.0, 1e-6, 0.0]), (0.4, [1e-6, 2e-6, -1e-6])]
    path = JointTrajectory(joint_names=JOINTS)
    for after, goal in points:
        point = JointTrajectoryPoint(positions=goal)
        point.time_from_start.nanosec = round(1e9 * after)
        path.points.append(point)
    send(JointTrajectory, "/stickslip_axis/joint_trajectory", path)
    assert len(set(ended("trajectory"))) == 1
    at(points[-1][1], 3e-9)

    # Set points as ros2_control writes them: of all joints, a hundred times a second.
    out = ros.publisher(me, JointState, "/stickslip_axis/joint_commands", 1)
    begin, goals = points[-1][1], [2e-6, 3e-6, -4e-6]
    for k in range(1, 81):
        way = [a + (b - a) * k / 80 for a, b in zip(begin, goals, strict=True)]
        out.publish(JointState(name=JOINTS, position=way))
        time.sleep(0.01)
    at(goals, 1e-8)

    # Home, all of them: where the model's positions begin.
    assert ros.call(me, Trigger, "/stickslip_axis/home", Trigger.Request()).success
    ended("home")
    at([0.0, 0.0, 0.0], 5e-9)

    # My node, in a process of its own, stops all of them when y is stuck.
    (tmp_path / "robot.py").write_text(ROBOT)
    robot = start_module("robot")
    ros.wait_until(lambda: ros.call(me, Trigger, "/robot/go", Trigger.Request()).success, "it goes")
    ros.wait_until(lambda: all(abs(joints[a][-1].position[0]) > 8e-6 for a in AXES), "all move")
    assert "stopped all" not in robot.output
    set_fault("axis_stuck", "/y")
    robot.wait_for("y_slider does not move: stopped all")
    ended("stop", "applied")
    set_fault("", "/y")
    before = joints["y"][-1].position[0]
    send(Int32, "/y/command/steps", Int32(data=100))
    ros.wait_until(lambda: joints["y"][-1].position[0] > before + 5e-6, "y moves again")
    assert robot.interrupt() == 0
    assert robot_is_up.interrupt() == 0
    assert "Traceback" not in robot_is_up.output


def set_fault(text: str, axis: str) -> None:
    stickslip("send", "parameters", f"fault={text}", "--axis", axis, "--timeout", "60")


def test_my_node_and_the_example_in_pytest(tmp_path: Path) -> None:
    """Without launch, in a project of mine, in simulated time: alike however busy a machine is."""
    (tmp_path / "robot.py").write_text(ROBOT)
    (tmp_path / "test_robot.py").write_text(ITS_TEST)
    for file in (REPOSITORY / "examples" / "my_node").glob("*my_node.py"):
        (tmp_path / file.name).write_text(file.read_text())
    own = {name: "" for name in os.environ if name.startswith("PYTEST_")}
    options = ("-p", "stickslip_ros.testing", "-p", "no:cacheprovider", "--strict-markers")
    done = python("-m", "pytest", *options, cwd=tmp_path, **own)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "5 passed" in done.stdout
