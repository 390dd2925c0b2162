# SPDX-License-Identifier: Apache-2.0
"""What a peer can send must not bring a node down, stop it for long or make it grow."""

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from cpu_time import computes_at_most
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from heard import Heard
from live import MakeAxis, Ros, Start
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.node import Node
from rclpy.parameter import Parameter as RclParameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Int32
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from stickslip_ros.axis.commands import COMMANDS
from stickslip_ros.axis.trajectory import MOST_POINTS
from stickslip_ros.physics.parameters import PARAMETERS
from stickslip_ros.ros.client import AxisClient, CommandRefused
from stickslip_ros.ros.nodes import topics
from stickslip_ros.ros.nodes.axis_node import AxisNode
from stickslip_ros.ros.nodes.guarded_node import MOST_PARAMETERS, GuardedNode
from stickslip_ros.ros.nodes.messages import MalformedCommand, read_command
from stickslip_ros.ros.nodes.recorder_node import RecorderNode

#: What a client hears of an axis
HEARD = (
    topics.JOINTS,
    topics.STATUS,
    topics.EVENTS,
    topics.SET_POINTS,
    topics.DESCRIPTION,
    topics.DIAGNOSTICS,
)


@pytest.fixture
def node(make_axis: MakeAxis) -> AxisNode:
    return make_axis()


@pytest.fixture
def client(ros: Ros, node: AxisNode) -> AxisClient:
    return AxisClient(node=ros.node("user"))


def _trajectory(points: int, **stamp: int) -> JointTrajectory:
    message = JointTrajectory(joint_names=["axis_slider"])
    for k in range(points):
        at = JointTrajectoryPoint(positions=[1e-9 * k])
        at.time_from_start.sec, at.time_from_start.nanosec = divmod(k * 1_000_000, 10**9)
        message.points.append(at)
    for name, value in stamp.items():
        setattr(message.header.stamp, name, value)
    return message


def test_a_trajectory_waits_for_its_stamp() -> None:
    for stamp, wait in (({}, 0.0), ({"sec": 3}, 0.0), ({"sec": 5, "nanosec": 500_000_000}, 2.5)):
        read = read_command(
            COMMANDS["trajectory"], _trajectory(2, **stamp), 3 * 10**9, "axis_slider"
        )
        assert read and read[2] == pytest.approx(wait)


def test_a_joint_with_several_set_points_is_refused_whole() -> None:
    """The first was obeyed."""
    command = COMMANDS["joint_command"]
    for names, message in (
        (["axis_slider"] * 2, JointState(position=[1e-6, 2e-6])),
        (["axis_slider", "y", "y"], JointState(velocity=[1e-6, 0.0, 0.0])),
        (["axis_slider"], JointState(position=[1e-6, 2e-6])),
    ):
        message.name = names
        with pytest.raises(MalformedCommand, match=r"give (it once|one for each)"):
            read_command(command, message, 0, "axis_slider")
        assert read_command(command, message, 0, "z_slider") is None


def _send(ros: Ros, client: AxisClient, message: Any, topic: str = "joint_trajectory") -> None:
    publisher = ros.publisher(client.node, type(message), f"/stickslip_axis/{topic}")
    publisher.publish(message)


def _refused(ros: Ros, client: AxisClient, count: int = 1) -> str:
    """Wait for a refusal; return its reason. The axis has to do what it is told afterwards."""
    ros.wait_until(lambda: client.status["refused commands"] == str(count), "the refusal")
    reason = client.last_error
    assert client.send("steps", 1).wait().steps_done == 1
    return reason


def test_a_trajectory_of_negative_times_is_refused(ros: Ros, client: AxisClient) -> None:
    """Stamps before 1970 and a point before the beginning, which rclpy itself would not read."""
    stamps: tuple[dict[str, int], ...] = (
        {"sec": -1}, {"sec": -(2**31)}, {"sec": -1, "nanosec": 2**32 - 1}
    )  # fmt: skip
    for count, stamp in enumerate(stamps, 1):
        _send(ros, client, _trajectory(2, **stamp))
        assert "lie in the past" in _refused(ros, client, count)
    message = _trajectory(2)
    message.points[0].time_from_start.sec = -5
    _send(ros, client, message)
    assert "point 1 is at -5 s" in _refused(ros, client, 4)


def test_bytes_that_are_no_message_are_refused(ros: Ros, client: AxisClient) -> None:
    publisher = ros.publisher(client.node, Float64, "/stickslip_axis/command/position")
    publisher.publish(serialize_message(Float64(data=1e-6))[:6])
    assert "cannot be understood" in _refused(ros, client)


def _status_named(name: str, *values: KeyValue, axis: str = "") -> DiagnosticArray:
    status = DiagnosticStatus(name=name, hardware_id=axis, values=list(values))
    return DiagnosticArray(status=[status])


def test_bytes_that_are_no_message_leave_a_client_as_it_is(ros: Ros, node: AxisNode) -> None:
    """Cut messages, texts that are no UTF-8, lengths that lie: on every topic that it hears."""
    with AxisClient() as client:
        peer = ros.node("peer")
        for topic in HEARD:
            kind = JointState if topic is topics.JOINTS else DiagnosticArray
            text = JointState(name=["odd"]) if kind is JointState else _status_named("odd")
            no_utf8 = serialize_message(text).replace(b"odd", b"\xff\xfe\xfd")
            qos = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
            publisher = ros.publisher(peer, kind, topic.full_name("/stickslip_axis"), qos)
            # Messages that say less than they should, or lie before 1970
            short: list[Any] = [JointState(name=["axis_slider"]), JointState()]
            short[1].header.stamp.sec = -1
            if kind is DiagnosticArray:
                name, event = "stickslip_axis: description", KeyValue(key="event", value="steps")
                lacking = [_status_named(name, *one, axis=name[:14]) for one in ([], [event])]
                short = [DiagnosticArray(), *lacking]
            noise = (no_utf8, no_utf8[:-5], b"", b"\0\1\0\0" + b"\xff" * 40)
            ros.send(publisher, *short, *noise)
            assert client.send("steps", 1).wait().steps_done == 1
        stamp = client.stamp
        ros.wait_until(lambda: client.stamp > stamp, "another state")


def test_a_trajectory_that_is_too_long_costs_nothing(
    ros: Ros, node: AxisNode, client: AxisClient
) -> None:
    """Its size says so, before a Python object is made of each of its points."""
    publisher = ros.publisher(client.node, JointTrajectory, "/stickslip_axis/joint_trajectory")
    one_too_many = serialize_message(_trajectory(MOST_POINTS + 1))
    endless = serialize_message(_trajectory(1)) + bytes(40 * 300_000)
    for count, message in enumerate((one_too_many, endless), 1):
        started = time.process_time()
        publisher.publish(message)
        assert "is the limit" in _refused(ros, client, count)
        assert time.process_time() - started < 1.5


def test_what_is_refused_is_kept_in_short(ros: Ros, node: AxisNode, client: AxisClient) -> None:
    """Events are kept for those who join late: megabytes must not be."""
    heard, text = Heard(ros), "x" * 300_000
    _send(ros, client, JointTrajectory(joint_names=[text, text]))
    assert len(_refused(ros, client)) < 2000
    with pytest.raises(CommandRefused):
        client.set_parameters(model=text)
    with pytest.raises(CommandRefused):
        client.set_parameters(**{text: 1.0})
    heard.event("parameters", "refused", 2)
    assert max(sum(map(len, values.values())) for _, values in heard.events) < 10_000
    assert len(client.last_error) < 2000


def _odd(count: int = 1, name: str = "preload", number: int = 99) -> list[Parameter]:
    value = ParameterValue(type=number)
    return [Parameter(name=f"{name}{k or ''}", value=value) for k in range(count)]


def test_a_parameter_of_an_unknown_type_is_refused(
    ros: Ros, node: AxisNode, client: AxisClient
) -> None:
    name, good = f"{client.axis}/set_parameters", ParameterValue(type=3, double_value=0.005)
    for number in (0, *range(5, 12), 128, 255):  # what no number of the table is, known or not
        bad = Parameter(name="preload", value=ParameterValue(type=number))
        both = [bad, Parameter(name="mass", value=good)]
        request = SetParameters.Request(parameters=both)
        results = ros.call(client.node, SetParameters, name, request).results
        assert [result.successful for result in results] == [False, True], number
    atomically = SetParametersAtomically.Request(parameters=both)
    answer = ros.call(client.node, SetParametersAtomically, f"{name}_atomically", atomically)
    assert not answer.result.successful
    assert client.send("steps", 1).wait().steps_done == 1


def test_the_recorder_refuses_it_as_well(ros: Ros, tmp_path: Path) -> None:
    output = RclParameter("output", value=str(tmp_path / "run"))
    ros.add(RecorderNode(context=ros.context, parameter_overrides=[output]))
    user = ros.node("user")
    for kind in (SetParameters, SetParametersAtomically):
        name = "set_parameters" + ("_atomically" if kind is SetParametersAtomically else "")
        for number in (10, 99, 255):
            request = kind.Request(parameters=_odd(number=number))
            ros.call(user, kind, f"/stickslip_recorder/{name}", request)
    assert ros.call(user, Trigger, "/stickslip_recorder/stop", Trigger.Request()).success


def test_thousands_of_parameters_are_refused_and_not_read_at_once(
    ros: Ros, node: AxisNode, client: AxisClient
) -> None:
    """The answer to 3000 names, known or not, took 70 MB, and a thousand requests could wait."""
    assert max(service.qos_profile.depth for service in node.services) <= 250
    started = time.process_time()
    for count in (1000, MOST_PARAMETERS):
        request = SetParameters.Request(parameters=_odd(count, "nonsense"))
        name = f"{client.axis}/set_parameters"
        results = ros.call(client.node, SetParameters, name, request).results
        assert len(results) == count
        assert not any(result.successful for result in results)
    assert time.process_time() - started < 3.0
    names = list(PARAMETERS)
    asked: tuple[tuple[Any, str, str, Callable[[Any], Any]], ...] = (
        (GetParameters, "get_parameters", "names", lambda answer: answer.values),
        (GetParameterTypes, "get_parameter_types", "names", lambda answer: answer.types),
        (DescribeParameters, "describe_parameters", "names", lambda answer: answer.descriptors),
        (ListParameters, "list_parameters", "prefixes", lambda answer: answer.result.names),
    )
    for kind, name, what, found in asked:
        for count, answers in ((len(names), len(names)), (3000, 0)):
            request = kind.Request(**{what: (names * 3000)[:count]})
            response = ros.call(client.node, kind, f"{client.axis}/{name}", request)
            assert len(found(response)) == answers, name
    assert client.send("steps", 1).wait().steps_done == 1


def _name_file(ros: Ros, client: AxisClient, **values: Any) -> str:
    """Ask for parameters as a peer does; return why they are refused, empty if they are not."""
    started = time.process_time()
    try:
        client.set_parameters(**values)
        reason = ""
    except CommandRefused as refusal:
        reason = str(refusal)
    assert time.process_time() - started < 3.0
    assert client.send("steps", 1).wait().steps_done == 1
    return reason


def test_a_peer_cannot_have_any_file_read(ros: Ros, make_axis: MakeAxis, tmp_path: Path) -> None:
    """A pipe would block, a device has no end, and nobody shall learn what stands in a file."""
    folder = tmp_path / "data"
    folder.mkdir()
    os.mkfifo(folder / "fifo")
    (folder / "link").symlink_to("/etc/shadow")
    (folder / "huge").write_bytes(b"1\n" * 1_000_000)
    make_axis(data_directory=str(folder))
    client = AxisClient(node=ros.node("user"))
    outside = f" is outside data_directory, {folder}"
    table, loop = (
        ("waveform_table", "waveform", "table"),
        ("hysteresis_file", "actuator", "hysteresis"),
    )
    for path, complaint in (
        (f"{folder}/fifo", "it is not a regular file"),
        (f"{folder}/huge", "has 2000000 bytes, 1000000 is the limit"),
        (f"{folder}/.", "it is not a regular file"),
        (f"{folder}/link", outside),
        ("/dev/zero", outside),
        ("/etc/shadow", outside),
    ):
        for name, kind, chosen in (table, loop):
            reason = _name_file(ros, client, **{name: path, kind: chosen})
            assert complaint in reason, path
            assert name in reason or complaint != outside, path
            assert "root:" not in reason


def test_files_in_the_data_directory_may_be_named(
    ros: Ros, make_axis: MakeAxis, tmp_path: Path
) -> None:
    (tmp_path / "wave.csv").write_text("0\n1\n0\n")
    wave = {"waveform": "table", "waveform_table": str(tmp_path / "wave.csv")}
    make_axis("/closed")
    opened = make_axis("/opened", data_directory=str(tmp_path))
    user = ros.node("user")
    with pytest.raises(CommandRefused, match="start it with data_directory"):
        AxisClient("/closed/stickslip_axis", node=user).set_parameters(**wave)
    AxisClient("/opened/stickslip_axis", node=user).set_parameters(**wave)
    assert opened.axis.parameters.drive.waveform == "table"


def test_no_callback_ends_a_node(ros: Ros) -> None:
    """Message, service, timer: each passes the guard; the executor of the user goes on."""
    node = GuardedNode("guarded", context=ros.context)
    ros.add(node)
    calls: list[str] = []

    def fail(source: str) -> None:
        calls.append(source)
        raise RuntimeError(f"{source} is broken")

    node.create_subscription(Int32, "~/number", lambda _: fail("message"), 10)
    node.create_service(Trigger, "~/call", lambda request, response: fail("service"))
    node.create_timer(0.05, lambda: fail("timer"))
    user: Node = ros.node("user")
    ros.publisher(user, Int32, "/guarded/number").publish(Int32(data=1))
    answer = ros.call(user, Trigger, "/guarded/call", Trigger.Request())
    assert (answer.success, answer.message) == (
        False,
        "~/call failed; the log of the node says why",
    )
    ros.wait_until(lambda: {"message", "service", "timer"} <= set(calls), "all three")
    ros.wait_until(lambda: node.failures >= 3, "the count")


HARD = {"sigma_1": 0.0, "sigma_0_offset": 1e12, "mass": 1e-6}


def test_parameters_that_the_solver_cannot_handle_stop_nothing_but_the_axis(
    ros: Ros, start_node: Start
) -> None:
    """States, services and parameters answer meanwhile, and SIGINT ends it in a second of work."""
    process = start_node("axis_node", frequency=1000.0)
    process.wait_for("ready")
    client = AxisClient(node=ros.node("user"))
    client.send("jog", 1000.0)
    client.set_parameters(**HARD)
    client.wait_for_state("fault")
    stamp = client.stamp
    ros.wait_until(lambda: client.stamp > stamp + 0.2, "states")
    assert "the solver cannot go on" in client.last_error
    client.set_parameters(sigma_1=5.0, sigma_0_offset=7e6, mass=0.004).send("reset")
    assert client.send("steps", 10).wait().steps_done == 10
    client.send("jog", 1000.0)
    client.set_parameters(**HARD)
    with computes_at_most(1.5, process.pid):
        assert process.interrupt() == 0
