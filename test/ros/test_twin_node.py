# SPDX-License-Identifier: Apache-2.0
"""The twin as a process beside an axis, over DDS."""

from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped
from heard import values
from live import MakeAxis, Ros, Start
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Int32
from test_config_files import every_series_is_in
from trajectory_msgs.msg import JointTrajectory

from stickslip_ros.axis import Axis
from stickslip_ros.base.errors import UsageError
from stickslip_ros.base.reporting import CONFIDENCE
from stickslip_ros.cli.main import main
from stickslip_ros.measurement.twin import Twin, TwinCommand
from stickslip_ros.measurement.twin.recording import read_log
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.recordings.schemas import nanoseconds
from stickslip_ros.ros.nodes.messages import diagnostic_array, event_status, stamp
from stickslip_ros.ros.nodes.twin_listener import TwinListener
from stickslip_ros.ros.nodes.twin_node import TwinNode

TWIN, JOINTS, REPORTS = "/stickslip_twin", "/joint_states", "/diagnostics"


@pytest.mark.long
def test_a_twin_beside_an_axis(ros: Ros, make_axis: MakeAxis, start_node: Start) -> None:
    """It knows the step and where a move ends, and tells steps that it was not told of."""
    make_axis(frequency=100.0)
    user = ros.node("user")
    own, positions = ros.hear(JointState, f"{TWIN}/joint_states"), ros.hear(JointState, JOINTS)
    residual, reports = ros.hear(Float64, f"{TWIN}/residual"), ros.hear(DiagnosticArray, REPORTS)
    predictions = ros.hear(JointTrajectory, f"{TWIN}/prediction")
    estimates = ros.hear(DiagnosticArray, f"{TWIN}/estimates")
    twin = start_node("twin_node", "-r", "measured:=/joint_states")
    follower = TwinListener("/stickslip_twin")
    steps = ros.publisher(user, Int32, "/stickslip_axis/command/steps")
    ask = ros.publisher(user, Int32, "/stickslip_twin/predict/steps")
    ros.wait_until(lambda: residual, "readings heard by the twin")
    ros.send(steps, Int32(data=150))
    sizes = ros.hear(Float64, f"{TWIN}/step_size", ros.latched(1))
    ros.wait_until(lambda: sizes and abs(sizes[-1].data - 133.8e-9) < 1e-9, "the step size")

    def rests_beyond(x: float) -> bool:
        last = [one.position[0] for one in positions[-20:]]
        return last[0] > x and max(last) - min(last) < 1e-8  # the noise of its readings

    ros.wait_until(lambda: rests_beyond(19e-6), "the end of the steps")
    count = len(residual)
    ros.wait_until(lambda: len(residual) > count + 50, "readings at rest")
    ros.send(ask, Int32(data=50))
    ros.wait_until(lambda: predictions, "a prediction")
    (found,) = predictions
    assert found.joint_names == ["axis_slider"]
    ros.send(steps, Int32(data=50))
    end = found.points[-1].positions[0]
    ros.wait_until(lambda: rests_beyond(end - 1e-6), "the next end")
    assert abs(positions[-1].position[0] - end) < 60e-9
    assert own[-1].name[0] == "axis_slider" and own[-1].effort[0] > 0.0
    names = {one.name for message in reports for one in message.status}
    assert {"stickslip_twin: twin", "stickslip_twin: prediction"} <= names
    assert "stickslip_twin: preload" in {one.name for m in estimates for one in m.status}
    with closing(follower) as heard_by_page:
        story = heard_by_page.story
        assert story.level == "ok" and story.stepping > 1.0
        assert not story.troubles  # each reading counts from when the sensor took it
        _, measured, predicted, deviation = story.readings[-1]
        assert abs(measured - predicted) < 5.0 * deviation < 1e-7
        (size,) = (one for one in story.history[-1][1] if one.name == "step size")
        assert size.unit == "m" and size.low < 133.8e-9 < size.high
    assert twin.interrupt() == 0


def test_a_twin_of_another_program(ros: Ros, start_node: Start) -> None:
    """Commands and positions come over topics of any name, stamped or not, in any unit."""
    maps = ["command/steps:=/lab/steps", "measured_point:=/lab/stage", "measured_position:=/lab/um"]
    remaps = [one for each in maps for one in ("-r", each)]
    start_node("twin_node", *remaps, direction="[0, 2, 0]", unit=0.000001, joint="stage")
    user = ros.node("user")
    sizes = ros.hear(Float64, f"{TWIN}/step_size", ros.latched(1))
    expected = ros.hear(JointState, f"{TWIN}/joint_states")
    point = ros.publisher(user, PointStamped, "/lab/stage")
    number = ros.publisher(user, Float64, "/lab/um")
    steps = ros.publisher(user, Int32, "/lab/steps")
    ros.wait_until(lambda: steps.get_subscription_count(), "the twin hears the commands")

    def read_point() -> bool:
        message = PointStamped()
        message.header.stamp = user.get_clock().now().to_msg()
        message.point.x, message.point.y = 7.0, 2.0
        point.publish(message)
        return bool(expected)

    ros.wait_until(read_point, "a stamped reading")
    assert expected[-1].name == ["stage", "stage_measured"]
    assert abs(expected[-1].position[0] - 2e-6) < 1e-8
    expected.clear()

    def read_number() -> bool:
        number.publish(Float64(data=2.0))
        return bool(expected)

    ros.wait_until(read_number, "a reading without a stamp")
    ros.send(steps, Int32(data=100))
    ros.wait_until(lambda: read_number() and sizes, "the step that the model makes")


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [("direction", [0.0, 0.0, 0.0], "such as"), ("unit", 0.0, "other than 0")],
)
def test_bad_parameters(ros: Ros, name: str, value: Any, message: str) -> None:
    given = [Parameter(name, value=value)]
    with pytest.raises(UsageError, match=message):
        TwinNode(parameter_overrides=given, context=ros.context)


@pytest.mark.long
def test_a_recording_beside_a_twin_gives_the_same_bits(
    ros: Ros, start_node: Start, tmp_path: Path
) -> None:
    """Off line the readings and events of the bag, in which the twin's own topics are as well.

    Events count from when they happened: a busy axis publishes them some milliseconds late.
    """
    own = [f"/stickslip_twin/{o}" for o in ("joint_states", "estimates", "residual", "step_size")]
    topics = ["/stickslip_axis/events", "/joint_states", "/diagnostics", *own]
    recorder = start_node("recorder_node", output=str(tmp_path / "bag"), topics=str(topics))
    start_node("twin_node", "-r", "measured:=/joint_states", config="table1_typical.yaml")
    user, axis, origin = ros.node("user"), Axis(Parameters.of("table1_typical.yaml")), 10**18 + 7
    events = user.create_publisher(DiagnosticArray, "/stickslip_axis/events", ros.latched())
    measured = user.create_publisher(JointState, "/joint_states", 1000)
    expected, estimates = ros.hear(JointState, own[0]), ros.hear(DiagnosticArray, own[1])
    said = ros.hear(DiagnosticArray, "/diagnostics")
    ros.wait_until(
        lambda: (
            all(one.get_subscription_count() > 1 for one in (events, measured))
            and [user.count_subscribers(topic) for topic in own] == [2, 2, 1, 1]
        ),
        "twin and recorder hear, the recorder the twin as well",
    )
    random, told = np.random.default_rng(3), 0
    for k in range(300):
        if k == 20:
            axis.command("steps", 250)
        axis.advance(0.01 * k + 0.0023 * (k % 4))
        statuses = [event_status("axis", event) for event in axis.take_events()]
        now = stamp(origin + round(1e9 * axis.state.t))
        if statuses:
            late = stamp(origin + round(1e9 * axis.state.t) + 6_000_000 * (k > 0))
            events.publish(diagnostic_array(late, statuses))
        message = JointState(name=["axis_slider"], position=[axis.arrived + 2e-9 * random.normal()])
        message.header.stamp = now
        measured.publish(message)
        told += len(statuses)
    ros.wait_until(lambda: len(expected) > 270 and len(estimates) > 1, "what the twin says")

    def twin_says() -> dict[str, str]:
        found = [one for m in said for one in m.status if one.name == "stickslip_twin: twin"]
        return values(found[-1]) if found else {}

    ros.wait_until(lambda: float(twin_says().get("stepping (s)", 0.0)) > 2.0, "steps seen")
    assert twin_says()["changes"] == "0" and twin_says()["level"] == "ok"
    assert told and recorder.interrupt() == 0
    twin = Twin(Parameters.of("table1_typical.yaml"))
    again = {}
    for one in read_log(tmp_path / "bag"):
        if isinstance(one, TwinCommand):
            twin.command(one)
        elif update := twin.measure(*one):
            again[origin + round(1e9 * update.t)] = update
    for message in expected:
        update = again[nanoseconds(message.header.stamp)]
        assert [update.expected, update.measured] == list(message.position)
        assert CONFIDENCE * update.deviation == message.effort[0]
    assert main(["twin", str(tmp_path / "bag"), "--config", "table1_typical.yaml"]) == 0
    every_series_is_in(tmp_path / "bag", "twin_plotjuggler.xml", "twin_foxglove.json")
