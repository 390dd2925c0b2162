# SPDX-License-Identifier: Apache-2.0
"""Launch files; nodes without a home, with few descriptors, with a clock that is set."""

import runpy
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock
from xml.etree import ElementTree

import pytest
import yaml
from child import run
from lifecycle_msgs.msg import TransitionEvent
from live import Ros, Start
from std_msgs.msg import Int32

from stickslip_ros.recordings import open_bag
from stickslip_ros.ros.client import AxisClient, CommandRefused

ROOT = Path(__file__).resolve().parent.parent.parent
# The launch system is not among the ROS wheels.
LAUNCH = ("", ".actions", ".substitutions", ".event_handlers", ".parameter_descriptions")
MODULES = [f"{root}{part}" for root in ("launch", "launch_ros") for part in LAUNCH]
POSITION_JOINT = "{http://www.ros.org/wiki/xacro}position_joint"
ARGUMENTS = {
    **dict.fromkeys(("axes", "namespace", "config"), ""),
    **dict.fromkeys(("record", "ros2_control", "rviz", "square", "use_sim_time"), "false"),
}

Nodes = dict[str, dict[str, Any]]


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[Nodes, list[str]]]:
    """Give a function that brings up what arguments ask for.

    It returns executable -> arguments of its node, in order, and those that wait for the axis.
    """

    def read(**arguments: str) -> tuple[Nodes, list[str]]:
        for module in MODULES:
            monkeypatch.setitem(sys.modules, module, MagicMock())
        share = "ament_index_python.packages.get_package_share_directory"
        monkeypatch.setattr(share, lambda _: ROOT)
        actions: Any = sys.modules["launch_ros.actions"]
        actions.Node = actions.LifecycleNode = lambda **options: options
        substitutions: Any = sys.modules["launch.substitutions"]
        given = {**ARGUMENTS, **arguments}
        substitutions.LaunchConfiguration = lambda name: MagicMock(perform=lambda _: given[name])
        file = runpy.run_path(str(ROOT / "launch" / "bringup.launch.py"))
        assert set(file["ARGUMENTS"]) == set(ARGUMENTS)
        file["generate_launch_description"]()
        nodes = [one for one in file["bring_up"](None) if isinstance(one, dict)]
        calls = sys.modules["launch_ros.event_handlers"].OnStateTransition.call_args_list
        waiting = [node for call in calls for node in call.kwargs["entities"]]
        if waiting:
            assert calls[0].kwargs["target_lifecycle_node"] is nodes[-1]
            assert calls[0].kwargs["goal_state"] == "active"
            assert calls[0].kwargs["handle_once"], "an axis says it again to whoever comes late"
        names = [node["executable"] for node in waiting]
        return {node["executable"]: node for node in (*nodes, *waiting)}, names

    return read


Launched = Callable[..., tuple[Nodes, list[str]]]


def test_ros2_launch_finds_each_launch_file_once(launched: Launched) -> None:
    """By package and name: it looks through all of the share folder, and two are an error."""
    folders = ("config", "examples", "launch", "urdf")
    found = [path.name for one in folders for path in (ROOT / one).rglob("*.launch.*")]
    assert sorted(found) == ["axis.launch.py", "bringup.launch.py"]
    launched()  # the first is an older name of the second
    runpy.run_path(str(ROOT / "launch" / "axis.launch.py"))["generate_launch_description"]()
    (included,) = sys.modules["launch.actions"].IncludeLaunchDescription.call_args.args
    assert included == str(ROOT / "launch" / "bringup.launch.py")


def test_controllers_start_when_the_axis_is_ready(launched: Launched) -> None:
    nodes, waiting = launched(ros2_control="true", namespace="/left")
    assert waiting == ["spawner"]
    assert next(iter(nodes)) == "robot_state_publisher", "what may be missing comes first"
    assert nodes["axis_node"]["parameters"] == [{"frequency": 1000.0, "publish_rate": 500.0}]
    model = sys.modules["launch.substitutions"].Command.call_args.args[0]
    assert model[-2:] == [" node:=", "/left/stickslip_axis"]
    (control,) = nodes["ros2_control_node"]["parameters"]
    assert Path(control).is_file()
    assert launched()[1] == []


def test_two_robots_share_neither_frames_nor_names(launched: Launched) -> None:
    nodes, _ = launched(ros2_control="true", rviz="true", namespace="/left")
    (described,) = nodes["robot_state_publisher"]["parameters"]
    assert described["frame_prefix"] == "left/"
    assert nodes["rviz2"]["arguments"][-2:] == ["-f", "left/base"]
    (described,) = launched(ros2_control="true")[0]["robot_state_publisher"]["parameters"]
    assert "frame_prefix" not in described
    nodes, _ = launched(axes="x,y,z", square="true", namespace="/left")
    assert nodes["square"]["namespace"] == "left"


@pytest.mark.parametrize("name", ["controllers.yaml", "nanorobot_controllers.yaml"])
def test_controllers_find_their_parameters_in_any_namespace(name: str) -> None:
    content = yaml.safe_load((ROOT / "examples" / "ros2_control" / name).read_text())
    nodes = ("controller_manager", "axis_controller", "joint_state_broadcaster")
    assert set(content) == {f"/**/{one}" for one in nodes}
    kinds = content["/**/controller_manager"]["ros__parameters"]
    assert kinds["axis_controller"]["type"].endswith("/JointTrajectoryController")


def test_one_controller_drives_the_axes_of_the_nanorobot(launched: Launched) -> None:
    """By one component, of which the host of the axes is the hardware."""
    nodes, waiting = launched(ros2_control="true", axes="x,y,z")
    assert waiting == ["spawner"]
    words = sys.modules["launch.substitutions"].Command.call_args.args[0]
    assert words[1].endswith("nanorobot.urdf.xacro") and "/stickslip_axis" in words
    (control,) = nodes["ros2_control_node"]["parameters"]
    about = yaml.safe_load(Path(control).read_text())["/**/axis_controller"]["ros__parameters"]
    joints = about["joints"]
    assert joints == ["x_slider", "y_slider", "z_slider"] and {*joints} < {*about["constraints"]}
    model = ElementTree.parse(words[1]).getroot()
    topics = {one.get("name"): one.text for one in model.iter("param")}
    assert topics["joint_states_topic"] == "$(arg node)/joint_states"
    assert [one.get("name") for one in model.iter(POSITION_JOINT)] == joints


def test_the_model_of_one_axis_can_be_seen() -> None:
    model = ElementTree.parse(ROOT / "examples" / "ros2_control" / "axis.urdf.xacro").getroot()
    assert [link.find("visual") is not None for link in model.findall("link")] == [True, True]


def test_all_nodes_follow_the_clock_where_one_is_wanted(launched: Launched) -> None:
    for more in ({"ros2_control": "true"}, {"axes": "x,y,z", "rviz": "true"}):
        nodes, _ = launched(record="true", use_sim_time="true", **more)
        told = {
            name
            for name, node in nodes.items()
            if "use_sim_time:=true" in node.get("ros_arguments", [])
        }
        assert told == {*nodes} - {"spawner"}
    nodes, _ = launched(record="true", axes="x")
    assert not any("use_sim_time" in str(node) for node in nodes.values())


def test_peers_on_other_machines_are_not_met_unless_wanted(launched: Launched) -> None:
    launched()
    variable = "ROS_AUTOMATIC_DISCOVERY_RANGE"
    inherited = sys.modules["launch.substitutions"].EnvironmentVariable
    inherited.assert_called_once_with(variable, default_value="LOCALHOST")
    action = sys.modules["launch.actions"].SetEnvironmentVariable
    action.assert_called_once_with(variable, inherited.return_value)


def test_the_recorder_is_told_the_axes_beside_it(start_node: Start, launched: Launched) -> None:
    for namespace, axes, said in (("", "x, y", "/x, "), ("/left", "", "/left/stickslip_axis")):
        node = launched(record="true", namespace=namespace, axes=axes)[0]["recorder_node"]
        assert node["namespace"] == namespace.strip("/")
        words = [*node["ros_arguments"], "-r", f"__ns:={namespace or '/'}"]
        process = start_node("recorder_node", *words, output=f"bag{len(axes)}")
        process.wait_for(f"recording all topics of {said}")


def test_the_nanorobot_has_its_axes_and_its_model(start_node: Start, launched: Launched) -> None:
    nodes, waiting = launched(axes="x,y,z", rviz="true", square="true")
    (model,) = nodes["robot_state_publisher"]["parameters"]
    # It may not be installed, and what had started before would be left behind.
    assert next(iter(nodes)) == "robot_state_publisher"
    assert model["robot_description"] == (ROOT / "urdf" / "nanorobot.urdf").read_text()
    assert Path(nodes["rviz2"]["arguments"][1]).is_file()
    assert waiting == ["square"]
    (parameters,) = nodes["axis_node"]["parameters"]
    words = [*nodes["axis_node"]["ros_arguments"], "-r", "__node:=robot"]
    process = start_node("axis_node", *words, **parameters, preload=0.3)
    for name in "xyz":
        process.wait_for(f"[{name}]: axis {name} ready: ceim, preload 0.3 N")
    with AxisClient("/y") as y:
        assert y.parameters["preload"] == "0.3"
        with pytest.raises(CommandRefused, match=r"position refused: .*1 m"):
            y.send("position", 1.0)
    assert process.interrupt() == 0


def test_what_cannot_be_brought_up_is_said_before_anything_starts(launched: Launched) -> None:
    """launch itself passes over a missing file, and the axis would start with the defaults."""
    for arguments, complaint in (
        ({"config": "nope.yaml"}, r"there is no file .*config/nope.yaml"),
        ({"ros2_control": "true", "axes": "x"}, "needs axes:=x,y,z, or one axis"),
        ({"square": "true", "axes": "x"}, "square:=true needs axes:=x,y,z"),
        ({"rviz": "true", "axes": "left"}, "rviz:=true needs axes:=x,y,z"),
    ):
        with pytest.raises((FileNotFoundError, RuntimeError), match=complaint):
            launched(**arguments)
    nodes, _ = launched(config="table1_vibration.yaml")
    (file,) = nodes["axis_node"]["parameters"]
    assert file == str(ROOT / "config" / "table1_vibration.yaml")


def test_readiness_reaches_those_who_come_late_with_any_durability(
    ros: Ros, make_axis: Callable[..., Any]
) -> None:
    """launch asks for nothing that is kept, so it would never hear of an axis that was quicker."""
    make_axis()
    topic = "/stickslip_axis/transition_event"
    heard = [ros.hear(TransitionEvent, topic, qos) for qos in (ros.latched(1), 10)]
    ros.wait_until(lambda: all(heard), "both hear that the axis is ready")
    assert {one.goal_state.label for each in heard for one in each} == {"active"}


def test_without_a_home_it_says_where_the_log_can_go(
    start_node: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", "/proc/nowhere")
    monkeypatch.delenv("ROS_LOG_DIR")
    recorder = start_node("recorder_node", output="run")
    assert recorder.wait() == 2
    assert "; set ROS_LOG_DIR to a folder that you may write to" in recorder.output


@pytest.mark.usefixtures("ros_domain")
def test_descriptors_that_run_out_are_told(tmp_path: Path) -> None:
    recorder = [sys.executable, "-m", "stickslip_ros.executables", "recorder_node"]
    done = run("sh", "-c", 'ulimit -n "$0"; exec "$@"', "8", *recorder, cwd=tmp_path)
    assert done.returncode == 2
    assert "Too many open files; close other files or raise the limit" in done.stderr
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.glob("stickslip_*"))


def test_of_two_recorders_on_one_output_one_is_refused(
    ros: Ros, start_node: Start, tmp_path: Path
) -> None:
    recorders = [start_node("recorder_node", output="run", topics="[/n]") for _ in range(2)]
    ros.wait_until(lambda: not all(one.running for one in recorders), "the end of one")
    kept, refused = sorted(recorders, key=lambda one: not one.running)
    assert refused.wait() == 2
    assert "run exists already; name another one" in refused.output
    kept.wait_for("recording /n")
    ros.send(ros.node().create_publisher(Int32, "/n", 10), Int32(data=7))
    assert kept.interrupt() == 0
    with open_bag(tmp_path / "run") as bag:
        assert bag.message_count == 1
