# SPDX-License-Identifier: Apache-2.0
"""Several axes in one process: names, parameters of each, one time for all; the nanorobot."""

import statistics
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from heard import Heard, stamp
from live import Ros
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from stickslip_ros.base.errors import StickslipError
from stickslip_ros.base.shared_files import example
from stickslip_ros.ros.client import AxisClient, CommandRefused
from stickslip_ros.ros.nodes.axis_host import AxisHost, axis_or_host, without_name
from stickslip_ros.ros.nodes.axis_node import AxisNode
from stickslip_ros.ros.nodes.node_parameters import unused_files

SQUARE, JOINTS = example("square"), "/joint_states"
URDF = Path(__file__).resolve().parent.parent.parent / "urdf" / "nanorobot.urdf"


@pytest.fixture
def host(ros: Ros, tmp_path: Path) -> Iterator[AxisHost]:
    """Axes x, y, z; y has parameters of its own."""
    file = tmp_path / "robot.yaml"
    (tmp_path / "slip.csv").touch()
    file.write_text(
        'stickslip_axis:\n  ros__parameters:\n    axes: [x, "y", z]\n    preload: 0.5\n'
        "    frequency: 1000.0\n    publish_rate: 100.0\n    travel_low: -0.01\n"
        "    travel_high: 0.01\n    waveform_table: slip.csv\n"
        "y:\n  ros__parameters:\n    preload: 0.7\n    publish_rate: 20.0\n"
        "    hysteresis_file: slip.csv\n"
    )
    arguments = ["--ros-args", "--params-file", str(file)]
    found = axis_or_host(arguments=arguments, context=ros.context, cli_args=arguments)
    assert isinstance(found, AxisHost)
    for node in found.nodes:
        ros.add(node)
    yield found


def test_each_axis_is_a_node_with_its_own_parameters(ros: Ros, host: AxisHost) -> None:
    """Those of the host hold for all, what concerns the process is the host's.

    They report one after the other: all at once, fifty of them took 60 ms. The joints that they
    publish are those of the robot.
    """
    reports, states = ros.hear(DiagnosticArray, "/diagnostics"), ros.hear(JointState, JOINTS)
    found = {node.get_name(): node.axis.parameters for node in host.axes}
    assert {name: p.friction.preload for name, p in found.items()} == {"x": 0.5, "y": 0.7, "z": 0.5}
    assert {p.node.publish_rate for p in found.values()} == {100.0}
    assert [p.node.axis_name for p in found.values()] == ["x", "y", "z"]
    assert host.get_parameter("axes").value == ["x", "y", "z"]
    assert host.axes[1].get_parameter("publish_rate").value == 100.0
    for file in (found["x"].drive.waveform_table, found["y"].actuator.hysteresis_file):
        assert file and Path(file).is_absolute()  # beside the file of the arguments
    ros.wait_until(lambda: len(reports) > 9, "diagnostics of all")
    times = [1e-9 * stamp(one) for one in reports]
    assert statistics.median(late - early for early, late in pairwise(times)) > 0.2
    robot = ET.parse(URDF).getroot()
    joints = {j.get("name"): j for j in robot.findall("joint") if j.get("type") == "prismatic"}
    named = {name for state in states for name in state.name}
    assert set(joints) == {name for name in named if name.endswith("_slider")}
    links = {link.get("name") for link in robot.findall("link")}
    ends = {kind: [end.get("link") for end in robot.iter(kind)] for kind in ("parent", "child")}
    assert {*ends["parent"], *ends["child"]} == links
    assert links - {*ends["child"]} == {"base"}, "one tree"
    limits = found["x"].limits
    for joint in joints.values():
        limit = joint.find("limit")
        assert limit is not None
        assert float(limit.get("lower", "nan")) == limits.travel_low
        assert float(limit.get("upper", "nan")) == limits.travel_high


def test_a_command_moves_its_axis_and_all_share_one_time(ros: Ros, host: AxisHost) -> None:
    heard = ros.hear(JointState, JOINTS)
    with AxisClient("/y") as y:
        y.send("steps", 10).wait()
    assert host.axes[1].axis.state.x > 1e-6
    assert host.axes[0].axis.state.x == host.axes[2].axis.state.x == 0.0
    ros.wait_until(lambda: len(heard) > 60)
    stamps: dict[int, set[str]] = {}
    for message in list(heard)[3:-3]:
        stamps.setdefault(stamp(message), set()).update(message.name)
    # But for the one that moved, whose state came out of turn as well.
    alone = {"y_slider", "y_piezo"}
    blocks = [names for names in list(stamps.values())[1:-1] if names != alone]
    assert len(blocks) > 5
    assert all(len(names) == 6 for names in blocks)


def test_the_host_stops_all_axes_and_moves_several_together(ros: Ros, host: AxisHost) -> None:
    user = ros.node("user")
    with AxisClient("/x") as x, AxisClient("/z") as z:
        x.send("jog", 1000.0)
        z.send("scan", 100.0)
        answer = ros.call(user, Trigger, "/stickslip_axis/stop", Trigger.Request())
        assert (answer.success, answer.message) == (True, "")
        x.wait_for_state("stopped")
        z.wait_for_state("stopped")
        z.send("enable", False)
        answer = ros.call(user, Trigger, "/stickslip_axis/home", Trigger.Request())
        reason = "z: the axis is disabled: enable it first"
        assert (answer.success, answer.message) == (False, reason)
        x.wait_for_state("homing")
        assert x.wait_for_state("stopped").position == pytest.approx(0.0, abs=5e-9)
        point = JointTrajectoryPoint(positions=[1e-6, 1e-6])
        both = JointTrajectory(joint_names=["x_slider", "y_slider"], points=[point])
        ros.send(ros.publisher(user, JointTrajectory, "/x/joint_trajectory"), both)
        ros.wait_until(lambda: "joint_trajectory" in x.last_error, "the refusal")
        cure = "give x_slider only, or all of them to /stickslip_axis/joint_trajectory"
        assert x.last_error == f"trajectory for x_slider, y_slider; {cure}"


@pytest.mark.long
@pytest.mark.usefixtures("host")
def test_a_square_is_drawn_within_5_nm(capsys: pytest.CaptureFixture[str]) -> None:
    assert SQUARE.main(["square", "--size", "2.0e-6"]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines() if line.startswith("x")]
    reached = [(float(words[1]), float(words[4])) for words in lines]
    wanted = [(0.0, 0.0), (2000.0, 0.0), (2000.0, 2000.0), (0.0, 2000.0), (0.0, 0.0)]
    for (at_x, at_y), (to_x, to_y) in zip(reached, wanted, strict=True):
        assert at_x == pytest.approx(to_x, abs=5.0)
        assert at_y == pytest.approx(to_y, abs=5.0)


@pytest.mark.long
def test_a_trajectory_of_several_axes_is_taken_by_all_or_by_none(ros: Ros, host: AxisHost) -> None:
    with AxisClient("/x") as x, AxisClient("/y") as y, AxisClient("/z") as z:
        clients, goal = (x, y, z), (1e-6, 2e-6, -1e-6)
        heard = [Heard(ros, client.axis, f"listener_{k}") for k, client in enumerate(clients)]
        x.follow_with([y, z], [(0.2, (0.0, 1e-6, 0.0)), (0.4, goal)])
        for client, position in zip(clients, goal, strict=True):
            assert client.wait().position == pytest.approx(position, abs=3e-9)
        assert len({one.event("trajectory", "finished")["time (s)"] for one in heard}) == 1
        for points, complaint in (
            ([(0.1, (0.0, 0.0, 1.0))], "z_slider: point 1: target is 1 m"),
            ([(0.1, (0.0, 0.0))], "point 1 has 2 positions; give 3, one for each joint"),
            ([(1e10, goal)], "a message holds up to"),
        ):
            with pytest.raises(CommandRefused, match=complaint):
                x.follow_with([y, z], points)
        for one in heard:
            assert one.event("trajectory", "refused", 2)
        assert {client.state for client in clients} == {"holding"}
        with pytest.raises(TimeoutError, match="no host of axes listens on /nobody/joint_traj"):
            y.timeout = 0.2
            y.follow_with([], [(0.1, (0.0,))], "/nobody")
    assert host.failures == 0


@pytest.mark.parametrize(
    ("axes", "complaint"),
    [
        (["x", "y", "x"], "axes is [x, y, x]; give different names"),
        (["stickslip_axis"], "none of them stickslip_axis"),
        (["1st"], "axis_name is '1st'; it has to be a letter"),
        ("x", "parameter axes is 'x'; give a list of names, as [x, 'y']"),
    ],
)
def test_names_that_cannot_be_are_refused(ros: Ros, axes: object, complaint: str) -> None:
    with pytest.raises(StickslipError) as refusal:
        axis_or_host(context=ros.context, parameter_overrides=[Parameter("axes", value=axes)])
    assert complaint in str(refusal.value)


def test_no_names_make_one_axis(ros: Ros) -> None:
    for overrides in ([], [Parameter("axes", value=[""])]):
        node = axis_or_host(context=ros.context, parameter_overrides=overrides)
        assert isinstance(node, AxisNode)
        ros.add(node)


def test_only_the_name_is_taken_out_of_a_command_line() -> None:
    kept = ["a", "--ros-args", "-r", "__ns:=/lab", "-p", "preload:=1.0", "--remap", "x:=y"]
    assert without_name([*kept, "-r", "__node:=b", "--remap", "c:__name:=d"]) == kept


def test_the_square_says_what_is_wrong(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        SQUARE.main(["square", "--size", "-1"])
    assert end.value.code == 2
    assert "--size is -1 m; it has to be a positive number" in capsys.readouterr().err


def test_a_parameter_file_for_other_nodes_is_told(tmp_path: Path) -> None:
    """ROS passes over it in silence, and the axis runs with the defaults."""
    for pattern, fits in [
        ("/**", True),
        ("stickslip_axis", True),
        ("/left/stickslip_axis", False),
        ("stickslip_axes", False),
        ("/*/stickslip_axis", False),
        ("/**/stickslip_axis", True),
        ("/*", True),
    ]:
        file = tmp_path / "mine.yaml"
        file.write_text(f'"{pattern}":\n  ros__parameters: {{preload: 1.0}}\n')
        arguments = ["axis_node", "--ros-args", "--params-file", str(file)]
        named = f"/{pattern.strip('/')}"
        said = f"no parameters for /stickslip_axis in {file}; it names {named}"
        assert unused_files(arguments, ["/stickslip_axis"]) == ([] if fits else [said])
