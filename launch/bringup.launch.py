# SPDX-License-Identifier: Apache-2.0
"""The driver of simulated axes: one axis or several, recorder, ros2_control, RViz and square.

ros2 launch stickslip_ros bringup.launch.py axes:=x,y,z rviz:=true square:=true
ros2 launch stickslip_ros bringup.launch.py ros2_control:=true record:=true

What commands the axes begins when they are ready, which they say on ~/transition_event.
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    OpaqueFunction,
    RegisterEventHandler,
    SetEnvironmentVariable,
)
from launch.substitutions import Command, EnvironmentVariable, LaunchConfiguration
from launch_ros.actions import LifecycleNode, Node
from launch_ros.event_handlers import OnStateTransition
from launch_ros.parameter_descriptions import ParameterValue

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PACKAGE, AXIS = "stickslip_ros", "stickslip_axis"
ARGUMENTS = {
    "axes": ("", "their names, as x,y,z; empty: one axis, stickslip_axis"),
    "namespace": ("", "of all nodes: empty, or such as left"),
    "config": ("", "parameters: a path, or a file in the folder config; empty: of Table 1, at "
               "1 kHz with axes or ros2_control"),
    "record": ("false", "to a bag"),
    "ros2_control": ("false", "a controller of one axis, or one of the axes x, y, z"),
    "rviz": ("false", "a view of the axes x, y, z, or of one axis"),
    "square": ("false", "draw one with the axes x, y, z"),
    "use_sim_time": ("false", "all nodes follow /clock, which somebody else publishes"),
}  # fmt: skip


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(
        [
            # Nobody beyond this machine commands the axis, unless the user says so.
            SetEnvironmentVariable(RANGE, EnvironmentVariable(RANGE, default_value="LOCALHOST")),
            *(
                DeclareLaunchArgument(name, default_value=default, description=text)
                for name, (default, text) in ARGUMENTS.items()
            ),
            OpaqueFunction(function=bring_up),
        ]
    )


def bring_up(context: LaunchContext) -> list:
    """Return what the arguments ask for; RuntimeError where they do not fit together."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    wanted = {name for name, value in given.items() if value.lower() in ("true", "1")}
    names = [name.strip() for name in given["axes"].split(",") if name.strip()]
    if "ros2_control" in wanted and names and set(names) != set("xyz"):
        raise RuntimeError("ros2_control:=true needs axes:=x,y,z, or one axis: leave out axes")
    if "square" in wanted and set(names) != set("xyz"):
        raise RuntimeError("square:=true needs axes:=x,y,z")
    share = Path(get_package_share_directory(PACKAGE))
    namespace = given["namespace"].strip("/")
    # In quotes, and not among `parameters`: in YAML a bare y is a yes.
    quoted = ", ".join(f"'{name}'" for name in names or [AXIS])
    axes = ["-p", f"axes:=[{quoted}]"]
    clock = ["-p", "use_sim_time:=true"] if "use_sim_time" in wanted else []
    axis = LifecycleNode(
        package=PACKAGE,
        executable="axis_node",
        name=AXIS,
        namespace=namespace,
        ros_arguments=[*(axes if names else []), *clock],
        parameters=[parameters_of(given["config"], share, names, "ros2_control" in wanted)],
        output="screen",
    )
    # What may be missing on this machine comes first: then nothing else runs or is left behind.
    found, after = [], []
    if wanted & {"ros2_control", "rviz"}:
        node = f"/{namespace}/{AXIS}".replace("//", "/")
        model = model_of(share, names, node, "ros2_control" in wanted)
        # Of two robots, each has its own frames on /tf.
        prefix = {"frame_prefix": f"{namespace}/"} if namespace else {}
        described = [{"robot_description": model, **prefix}]
        found.append(node_of("robot_state_publisher", namespace, described, ros_arguments=clock))
    if "ros2_control" in wanted:
        file = "nanorobot_controllers.yaml" if names else "controllers.yaml"
        control = share / "examples" / "ros2_control" / file
        found.append(
            node_of(
                "controller_manager", namespace, [str(control)], "ros2_control_node",
                ros_arguments=clock,
            )
        )  # fmt: skip
        # Controllers that are active before the axis take NaN as the position to hold.
        started = ["joint_state_broadcaster", "axis_controller"]
        after.append(node_of("controller_manager", namespace, [], "spawner", arguments=started))
    if "rviz" in wanted:
        view = ["-d", str(share / "config" / "nanorobot.rviz")]
        view += ["-f", f"{namespace}/base"] if namespace else []
        found.append(node_of("rviz2", namespace, [], arguments=view, ros_arguments=clock))
    if "record" in wanted:
        # Relative names: the recorder takes them to be in its own namespace.
        # The host has topics as well; of one axis it is the axis.
        both = ", ".join(f"'{name}'" for name in (*names, AXIS))
        words = ["-p", f"axes:=[{both}]", *clock]
        found.append(node_of(PACKAGE, namespace, [], "recorder_node", ros_arguments=words))
    if "square" in wanted:
        words = [f"--namespace={namespace}"]
        after.append(node_of(PACKAGE, namespace, [], "square", arguments=words))
    ready = OnStateTransition(
        target_lifecycle_node=axis, goal_state="active", entities=after, handle_once=True
    )
    return [*found, *([RegisterEventHandler(ready)] if after else []), axis]


def node_of(
    package: str, namespace: str, parameters: list, executable: str = "", **options: list
) -> Node:
    """Return a node; without an executable that of the package's name."""
    return Node(
        package=package,
        executable=executable or package,
        namespace=namespace,
        parameters=parameters,
        output="screen",
        **options,
    )


def parameters_of(config: str, share: Path, names: list[str], controlled: bool) -> object:
    """Return the parameters of the axes; FileNotFoundError, for launch passes over such a file."""
    if controlled and not config:
        # At 500 Hz a state is 2 ms old at most when a controller reads it.
        return {"frequency": 1000.0, "publish_rate": 500.0}
    if names and not config:
        return {"frequency": 1000.0}
    file = share / "config" / (config or "table1_typical.yaml")  # a full path stays as it is
    if not file.is_file():
        raise FileNotFoundError(f"config: there is no file {file}; name one with config:=FILE")
    return str(file)


def model_of(share: Path, names: list[str], node: str, controlled: bool) -> object:
    """Return the URDF of the robot with axes x, y, z, or of one axis, for a node of that name."""
    if set(names) == set("xyz"):
        model = share / "urdf" / "nanorobot.urdf"
        if not controlled:
            return model.read_text(encoding="utf-8")
        file = share / "examples" / "ros2_control" / "nanorobot.urdf.xacro"
        words = ["xacro ", str(file), " node:=", node, " model:=", str(model)]
        return ParameterValue(Command(words), value_type=str)
    if names:
        raise RuntimeError("rviz:=true needs axes:=x,y,z, or one axis without a name")
    file = share / "examples" / "ros2_control" / "axis.urdf.xacro"
    return ParameterValue(Command(["xacro ", str(file), " node:=", node]), value_type=str)
