# SPDX-License-Identifier: Apache-2.0
"""The axis node over DDS: commands, state, events, diagnostics, parameters, ends."""

import math
import re
import threading
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import yaml
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from heard import Heard, stamp, values
from live import MakeAxis, Ros
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Int32
from table_1 import table_1

from stickslip_ros.axis import Axis
from stickslip_ros.axis.joints import contact_joints
from stickslip_ros.physics.laws import LAWS
from stickslip_ros.physics.parameters import PARAMETERS, ParameterError
from stickslip_ros.physics.parameters.parameters import read_yaml
from stickslip_ros.ros.client import AxisClient, CommandRefused
from stickslip_ros.ros.nodes import diagnostics
from stickslip_ros.ros.nodes.axis_host import main
from stickslip_ros.ros.nodes.messages import fill_joints
from stickslip_ros.simulation.steps import run_steps


def connect(ros: Ros, axis: str = "/stickslip_axis") -> tuple[AxisClient, Heard]:
    """Return who commands an axis, and who hears it."""
    name = axis.strip("/").replace("/", "_")
    return AxisClient(axis, node=ros.node(f"user_of_{name}")), Heard(ros, axis, f"at_{name}")


# -- what it publishes


def test_the_state_is_whole_and_its_stamps_rise(ros: Ros, make_axis: MakeAxis) -> None:
    """Names, lengths, and the laws that bind the numbers, in motion and at rest."""
    make_axis(axis_name="lens", publish_rate=200.0)
    client, heard = connect(ros)
    client.send("steps", 30).wait()
    ros.wait_until(
        lambda: min(len(heard.joints), len(heard.truth), len(heard.contact)) > 50, "states of all"
    )
    joints, contact = list(heard.truth), {stamp(m): m for m in list(heard.contact)}
    for message in [*joints, *list(heard.joints)]:
        assert message.name == ["lens_slider", "lens_piezo"]
        lengths = len(message.position), len(message.velocity), len(message.effort)
        assert lengths == (2, 2, 2)
        assert message.effort[0] == -message.effort[1]
        assert 0.0 <= message.position[1] <= 160.001e-9
    assert all(stamp(a) < stamp(b) for a, b in pairwise(joints))
    pairs = [(m, contact[stamp(m)]) for m in joints if stamp(m) in contact]
    assert len(pairs) > 20
    for joint, touch in pairs:
        assert touch.name == ["lens_contact"]
        assert touch.effort[0] == joint.effort[1]
        assert touch.velocity[0] == joint.velocity[0] - joint.velocity[1]
    assert max(m.position[0] for m in joints) > 3e-6
    for before, now in pairwise(list(heard.joints)):  # the mean since the last
        assert stamp(before) < stamp(now)
        way, dt = now.position[0] - before.position[0], 1e-9 * (stamp(now) - stamp(before))
        assert now.velocity[0] == pytest.approx(way / dt, rel=1e-6, abs=1e-12)


def test_each_of_several_contacts_has_its_deflection() -> None:
    axis = Axis({"contacts": 2, "contact_spread": 0.1, "frequency": 1000.0})
    axis.command("steps", 4)
    axis.advance(2.3e-3)
    first, *each = contact_joints(axis)
    message = fill_joints(JointState(), Time(), "lens", [first, *each])
    assert message.name == ["lens_contact", "lens_contact_1", "lens_contact_2"]
    assert message.position[0] == axis.state.z and message.position[1] != message.position[2]
    assert list(message.velocity) == [axis.state.w] * 3
    assert message.effort[0] == axis.state.force and math.isnan(message.effort[2])


NUMBER_KEYS = {
    "axis": ["measured position (m)", "zero offset (m)", "velocity (m/s)", "steps commanded",
             "steps done", "steps left", "amplitude (V)", "frequency (Hz)", "scan level (V)",
             "load (N)", "limits hit", "refused commands"],
    "friction": ["preload (N)", "z_ba (m)", "z_ss (m)", "stiffness (N/m)", "deflection (m)",
                 "friction force (N)", "last step size (m)", "backstep (m)", "mean step size (m)",
                 "0-amplitude (m)", "ringing frequency (Hz)", "energy lost per cycle (J)"],
    "timing": ["real-time factor", "time dropped (s)", "missed deadlines", "lag (s)",
               "worst lag (s)", "block execution time, mean (s)",
               "block execution time, worst (s)"],
}  # fmt: skip
# Target and following error are numbers in closed loop only.
TEXT_KEYS = {
    "axis": ["state", "moving", "paused", "injected faults", "target reached", "target (m)",
             "following error (m)", "begins (s)", "held at", "last error", "overload"],
    "friction": ["model", "regime", "phase"],
    "timing": ["real-time priority"],
}  # fmt: skip


def test_the_diagnostics_hold_what_they_should(ros: Ros, make_axis: MakeAxis) -> None:
    """Three statuses, units in the keys, bare numbers in the values, and the judgement is real."""
    node = make_axis(frequency=1000.0)
    first = diagnostics.Diagnostics("").statuses(node.axis, node.sim_loop, 0)[0]
    assert (first.level, first.message) == (DiagnosticStatus.OK, "stopped")
    client, heard = connect(ros)
    client.send("steps", 40).wait()
    found = heard.next_report()
    for kind, status in found.items():
        assert status.name == f"stickslip_axis: {kind}"
        assert status.hardware_id == "stickslip_axis"
        content = values(status)
        assert sorted(content) == sorted(NUMBER_KEYS[kind] + TEXT_KEYS[kind])
        for key in NUMBER_KEYS[kind]:
            assert math.isfinite(float(content[key])), key
    axis, friction = values(found["axis"]), values(found["friction"])
    assert (axis["state"], axis["steps done"], axis["steps left"]) == ("stopped", "40", "0")
    assert (axis["amplitude (V)"], axis["frequency (Hz)"]) == ("300.0", "1000.0")
    assert (friction["model"], friction["regime"], friction["phase"]) == ("ceim", "elastic", "rest")
    run = run_steps(table_1(frequency=1000.0), 40)
    assert float(friction["mean step size (m)"]) == pytest.approx(run.position[-1] / 40)
    last_step = run.position[-1] - run.position[-2]
    assert float(friction["last step size (m)"]) == pytest.approx(last_step, abs=1e-18)
    assert float(values(found["timing"])["real-time factor"]) == pytest.approx(1.0, abs=0.2)
    assert re.match(r"on time$|\d+ deadlines missed$|real-time factor ", found["timing"].message)
    assert found["axis"].level == found["friction"].level == DiagnosticStatus.OK

    client.send("amplitude", 20.0)  # below the 0-amplitude: true, but worth a warning
    with pytest.raises(CommandRefused):
        client.send("amplitude", -1.0)
    found = heard.next_report()
    assert found["friction"].level == DiagnosticStatus.WARN
    assert "no steps" in found["friction"].message
    assert found["axis"].level == DiagnosticStatus.WARN
    assert found["axis"].message == "1 commands refused"
    assert heard.next_report()["axis"].level == DiagnosticStatus.OK


def test_what_waits_for_a_slow_cycle_is_told_when_it_begins(ros: Ros, make_axis: MakeAxis) -> None:
    """With the way to end it now, by the event and the status: of a new task and of the drive."""
    make_axis(frequency=1e-3)
    client, heard = connect(ros)
    for command, value in (("steps", 0), ("frequency", 0.002)):
        assert client.send("steps", 5).status["begins (s)"] == "nan"
        begins = float(client.send(command, value).status["begins (s)"])
        assert begins > 999.0
        assert client._message.startswith("stepping: what was commanded begins at ")
        assert client._message.endswith("; stop breaks off the running cycle")
        event = heard.event(command, "applied", 2 if command == "steps" else 1)
        assert (float(event["begins"]), event["now"]) == (begins, client._message[-33:])
        assert client.send("stop").wait(2.0).status["begins (s)"] == "nan"


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"force": 1.0}, "the load moves the runner without the drive"),
        # By its gain alone the stroke would be above the 0-amplitude.
        (
            {"actuator": "hysteresis", "hysteresis": 0.3, "amplitude": 60.0},
            "the amplitude is not above the 0-amplitude: no steps",
        ),
    ],
)
def test_an_axis_that_makes_no_steps_is_a_warning(
    ros: Ros, make_axis: MakeAxis, parameters: dict[str, Any], message: str
) -> None:
    axis = make_axis(**parameters).axis
    friction = Heard(ros).next_report()["friction"]
    assert (friction.level, friction.message) == (DiagnosticStatus.WARN, message)
    zero = float(values(friction)["0-amplitude (m)"])
    volts, gain = axis.status.amplitude, axis.parameters.actuator.gain
    assert math.isnan(zero) if "force" in parameters else axis.status.stroke < zero < volts * gain


def test_a_0_amplitude_that_takes_long_keeps_nobody_waiting(
    ros: Ros, make_axis: MakeAxis, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where ringing lasted for hundreds of cycles, an axis was deaf for a minute."""
    go_on = threading.Event()
    monkeypatch.setattr(diagnostics, "zero_amplitude", lambda p: go_on.wait(60.0) and 1e-8)
    make_axis()
    client, heard = connect(ros)
    assert client.send("steps", 1).wait().steps_done == 1
    friction = heard.next_report()["friction"]
    assert (friction.level, friction.message) == (DiagnosticStatus.OK, diagnostics.LATER)
    assert math.isnan(float(values(friction)["0-amplitude (m)"]))
    go_on.set()
    heard.next_report()  # may be on its way
    assert values(heard.next_report()["friction"])["0-amplitude (m)"] == "1e-08"


def test_axes_in_one_context_are_told_apart_by_their_namespaces(
    ros: Ros, make_axis: MakeAxis
) -> None:
    """A command to one moves that one only; each has its own joints, events and diagnostics."""
    make_axis("/left", axis_name="left")
    make_axis("/right", axis_name="right", frequency=500.0)
    _, left = connect(ros, "/left/stickslip_axis")
    client, right = connect(ros, "/right/stickslip_axis")
    client.send("steps", 10)
    assert right.event("move", "finished")["steps"] == "10"
    seen = len(left.joints)
    ros.wait_until(lambda: len(left.joints) > seen + 2)
    assert {name for m in left.joints for name in m.name} == {"left_slider", "left_piezo"}
    assert {m.position[0] for m in left.truth} == {0.0}
    assert [event["event"] for _, event in left.events] == ["start"]
    assert right.joints[-1].position[0] > 1e-6
    found = left.next_report()
    assert found["axis"].name == "left/stickslip_axis: axis"
    assert values(found["axis"])["steps done"] == "0"


# -- parameters


def test_parameters_set_while_it_runs_hold_or_are_refused_whole(
    ros: Ros, make_axis: MakeAxis
) -> None:
    """Mutable ones with the next cycle; read-only, contradicting and unknown ones not at all."""
    node = make_axis(frequency=1000.0)
    client, heard = connect(ros)
    client.send("steps", 10_000)
    # As `ros2 param set` does; a whole number will do.
    wanted = SetParameters.Request(parameters=[Parameter("preload", value=1).to_parameter_msg()])
    (result,) = ros.call(heard.node, SetParameters, f"{client.axis}/set_parameters", wanted).results
    assert result.successful
    assert heard.event("parameters", "applied")["preload"] == "1.0"
    refused: tuple[tuple[dict[str, Any], str], ...] = (
        ({"amplitude": 100.0}, "amplitude can be set at the start only"),
        ({"mass": 0.005, "preload": math.nan}, "preload is nan; it has to be a finite number"),
        ({"mass": [0.005]}, "mass is "),
        ({"mass": None}, "mass is None; "),
        ({"masss": 0.005}, "no parameter 'masss'; did you mean mass"),
    )
    for parameters, reason in refused:
        with pytest.raises(CommandRefused) as refusal:
            client.set_parameters(**parameters)
        assert reason in str(refusal.value)
        assert node.get_parameter("mass").value == 0.004
    client.send("steps", 0)
    assert int(heard.event("move", "finished")["steps"]) < 10_000
    report = heard.next_report()
    # Those count too that rclpy itself refuses.
    assert values(report["axis"])["refused commands"] == str(len(refused))
    friction = values(report["friction"])
    assert (friction["preload (N)"], friction["z_ba (m)"]) == ("1.0", repr(2e-8 * 1.0 + 1e-8))
    # The last step is one at 1 N, settled: the new preload is in force.
    settled = run_steps(table_1(frequency=1000.0, preload=1.0), 50).step_size
    assert float(friction["last step size (m)"]) == pytest.approx(settled, abs=1e-10)


def test_the_descriptors_are_the_table(make_axis: MakeAxis) -> None:
    node = make_axis(preload=0.7, mass=0.005)
    for name, row in PARAMETERS.items():
        descriptor = node.describe_parameter(name)
        assert descriptor.read_only is not row.mutable
        assert row.description in descriptor.description
        assert row.unit in descriptor.description
        if isinstance(row.default, float):
            (limits,) = descriptor.floating_point_range
            assert (limits.from_value, limits.to_value) == (row.low, row.high)
    assert node.describe_parameter("model").additional_constraints == f"one of: {', '.join(LAWS)}"
    source = node.describe_parameter("joint_state_source")
    assert source.additional_constraints == "one of: sensor, truth"
    assert node.get_parameter("preload").value == 0.7
    assert node.get_parameter("mu").value == PARAMETERS["mu"].default


def test_a_dump_can_be_loaded_again(ros: Ros, make_axis: MakeAxis) -> None:
    """As `ros2 param load` does; every value of the start was refused and counted.

    It reads each value as YAML from its text, so that "1e-06" is a text.
    """
    node, user = make_axis(), ros.node("user")
    names = [*PARAMETERS, "use_sim_time"]
    for first in range(0, len(names), 50):
        dump = []
        for name in names[first : first + 50]:
            value = node.get_parameter(name).value
            read = yaml.safe_load(str(value)) if isinstance(value, float) else value
            dump.append(Parameter(name, value=read).to_parameter_msg())
        answer = ros.call(
            user,
            SetParameters,
            "/stickslip_axis/set_parameters",
            SetParameters.Request(parameters=dump),
        )
        assert [one.reason for one in answer.results if not one.successful] == []
    assert node.axis.status.refused == 0
    other = Parameter("publish_rate", value=50.0).to_parameter_msg()
    answer = ros.call(
        user,
        SetParameters,
        "/stickslip_axis/set_parameters",
        SetParameters.Request(parameters=[other]),
    )
    assert "publish_rate can be set at the start only" in answer.results[0].reason


def test_numbers_that_yaml_takes_for_texts_are_numbers(make_axis: MakeAxis) -> None:
    """YAML 1.1 knows 1.0e-9 and takes 1e-9 for a text."""
    node = make_axis()
    set_now = node.set_parameters_atomically  # as the services do
    assert set_now([Parameter("sensor_noise", value="3e-9")]).successful
    assert node.axis.parameters.sensor.sensor_noise == 3e-9
    result = set_now([Parameter("sensor_noise", value="much")])
    assert "sensor_noise is 'much'; it has to be a number" in result.reason
    result = set_now([Parameter("sensor_seed", value=1.5)])
    assert "sensor_seed is 1.5; it has to be a whole number" in result.reason


def test_two_who_command_one_axis_are_named(ros: Ros, make_axis: MakeAxis) -> None:
    make_axis(frequency=1000.0)
    heard = Heard(ros)
    topic, out = "/stickslip_axis/command/steps", {}
    for name in ("left_hand", "right_hand"):
        out[name] = ros.publisher(ros.node(name), Int32, topic)
    for k in range(3):
        ros.send(out["left_hand"], Int32(data=k))
    assert "commanded by" not in heard.next_report()["axis"].message, "one of them only listens"

    def said() -> str:
        for one in out.values():
            ros.send(one, Int32(data=3))
        return heard.next_report()["axis"].message

    ros.wait_until(lambda: "commanded by /left_hand and /right_hand" in said(), "both names")


def test_two_axes_of_one_name_say_so(ros: Ros, make_axis: MakeAxis) -> None:
    make_axis()
    make_axis()
    reports = ros.hear(DiagnosticArray, "/diagnostics")

    def told() -> int:
        texts = [status.message for message in list(reports) for status in message.status]
        return sum("1 others publish as this axis" in text for text in texts)

    ros.wait_until(lambda: told() >= 2, "both")


@pytest.mark.usefixtures("ros_domain")
def test_a_bad_file_is_refused_in_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "own.yaml"
    for text, complaint in (
        ("preload: 1.0\n    preload: 2.0", "'preload' stands there twice, again in line 4"),
        ("mass: 0.004\n    preload:", f"{file}, line 4: preload is None; it has to be a number"),
        ("preload: 1.0\n\tmass: 0.004", "line 4, column 1"),
        ("preloda: 1.0", "no parameter 'preloda'; did you mean preload"),
        ("slewrate: 0.02", "leaves 10000 us a cycle"),
    ):
        file.write_text(f"/**:\n  ros__parameters:\n    {text}\n")
        assert main(["axis_node", "--ros-args", "--params-file", str(file)]) == 2
        (line,) = capfd.readouterr().err.splitlines()
        assert line.startswith("axis_node: ")
        assert complaint in line
        said = line.removeprefix("axis_node: ").removeprefix(f"{file}: ")
        if "slewrate" not in text:  # that is refused by what drives
            with pytest.raises(ParameterError) as refusal:
                read_yaml(file)
            assert said == str(refusal.value).removeprefix(f"{file}: ")


def test_a_joint_that_another_publishes_is_warned_of(
    ros: Ros, make_axis: MakeAxis, capfd: pytest.CaptureFixture[str]
) -> None:
    """And it rests again afterwards, though that takes a subscription for a while."""
    node = make_axis()
    other = ros.node("y_stage").create_publisher(JointState, "/joint_states", 10)
    said = ""

    def is_told() -> bool:
        nonlocal said
        other.publish(JointState(name=["axis_slider"], position=[0.0]))
        said += capfd.readouterr().err
        return "start this axis with another axis_name" in said

    ros.wait_until(is_told, "the warning")
    assert "somebody else publishes the joint axis_slider on /joint_states" in said
    ros.wait_until(lambda: not node.is_read, "the end of listening")
