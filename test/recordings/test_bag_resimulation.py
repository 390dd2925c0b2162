# SPDX-License-Identifier: Apache-2.0
"""Runs in bags, run once more: bit for bit, with other parameters, and out of hostile bags."""

import json
import math
import random
import re
import shutil
import struct
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import EVENTS, JOINTS, SECOND, START, event, foreign, header, int32, serialized, topic
from rosbags.highlevel import AnyReader
from table_1 import TABLE_1

from stickslip_ros.axis import Axis
from stickslip_ros.axis.events import Event, NotRepeatable, event_texts, is_set_point
from stickslip_ros.axis.joints import JointReport
from stickslip_ros.axis.resimulation import model_changes
from stickslip_ros.base.errors import StickslipError
from stickslip_ros.cli.main import main
from stickslip_ros.physics.model import versions
from stickslip_ros.physics.model.arithmetic import arithmetic
from stickslip_ros.physics.model.versions import MODEL_VERSION, ModelChange
from stickslip_ros.physics.parameters import PARAMETERS, read_yaml
from stickslip_ros.recordings import BagWriter, open_bag, resimulate
from stickslip_ros.recordings.resimulation import Difference

AXIS_EVENTS = topic("/stickslip_axis/events", EVENTS.type)
PRESET = Path(__file__).parents[2] / "config" / "edeler_2011_everything.yaml"
SET_POINTS = topic("/stickslip_axis/set_points", EVENTS.type)
CONTACT = topic("/stickslip_axis/contact", JOINTS.type)
TRUTH = topic("/stickslip_axis/truth", JOINTS.type)

Texts = dict[str, str]


def state(ns: int, **joints: Sequence[float | None]) -> bytes:
    columns = np.array(list(joints.values()), dtype=np.float64).reshape(-1, 3).T
    position, velocity, effort = (np.ascontiguousarray(column) for column in columns)
    return serialized(
        JOINTS.type,
        header=header(ns),
        name=list(joints),
        position=position,
        velocity=velocity,
        effort=effort,
    )


def record_axis(
    folder: Path,
    change: Callable[[int, Texts], Texts] = lambda number, texts: texts,
    joints: Callable[[int, bytes], bytes] = lambda number, data: data,
    lose: tuple[int, ...] = (),
    silent_from: int = 60,
    **values: Any,
) -> None:
    """Write what an axis and a recorder write: steps, a new amplitude, jogging, a load, targets.

    change: may change the texts of each event by its number, as a stranger would.
    joints: may change each message of joint states.
    lose: numbers of events that are not written.
    silent_from: number of the round from which on no state is written.
    values: parameters of the axis.
    """
    axis = Axis({**TABLE_1, "sensor_noise": 1e-9, "preload": 0.5, **values})
    written, report = 0, JointReport()
    with BagWriter(folder) as bag:
        for one in (JOINTS, TRUTH, CONTACT, AXIS_EVENTS, SET_POINTS):
            bag.add_topic(one)
        for number in range(60):
            ns = START + number * SECOND // 1000
            for told in axis.take_events():
                texts = change(written, event_texts(told))
                written += 1
                if written - 1 in lose:
                    continue
                at = START + round(told.time * SECOND)
                where = SET_POINTS if is_set_point(told) else AXIS_EVENTS
                bag.write(where.name, event(at, **texts), log_ns=ns, publish_ns=ns)
            axis.advance(number * 1_000_000 * 1e-9)
            s = axis.state
            silent = number >= silent_from
            rows: dict[str, Sequence[float | None]] = {
                f"axis{end}": numbers for end, *numbers in report.take(axis)
            }
            data = joints(number, state(ns, **rows))
            if not silent:
                bag.write(JOINTS.name, data, log_ns=ns, publish_ns=ns)
            rows = {"axis_slider": (s.x, s.v, -s.force), "axis_piezo": (s.u, s.rate, s.force)}
            if not silent:
                bag.write(TRUTH.name, state(ns, **rows), log_ns=ns, publish_ns=ns)
            each = (
                axis.simulation.deflections.tolist()
                if axis.parameters.friction.contacts > 1
                else []
            )
            parts = {f"axis_contact_{k}": (z, s.w, math.nan) for k, z in enumerate(each, 1)}
            contact = state(ns, axis_contact=(s.z, s.w, s.force), **parts)
            if not silent:
                bag.write(CONTACT.name, contact, log_ns=ns, publish_ns=ns)
            if number == 5:
                axis.command("frequency", 500.0)
                axis.command("steps", 10)
            elif number == 20:
                axis.command("amplitude", 200.0)
                axis.command("jog", -1000.0)
            elif number == 40:
                axis.command("load", 0.01)
            elif number == 45:
                axis.command("trajectory", ["axis_slider"], [(0.005, 2e-7), (0.01, 1e-7)])
            elif number == 57:
                axis.command("joint_command", "axis_slider", "velocity", 1e-5)


def _stamps(folder: Path) -> list[int]:
    """Return the times (ns) in the headers of the events, as another reader takes them."""
    with AnyReader([folder]) as reader:
        found: list[Any] = [
            reader.deserialize(data, connection.msgtype)
            for connection, _, data in reader.messages()
            if connection.topic == AXIS_EVENTS.name
        ]
    stamps = [message.header.stamp for message in found]
    assert stamps and all(0 <= stamp.nanosec < SECOND for stamp in stamps)
    return [stamp.sec * SECOND + stamp.nanosec for stamp in stamps]


def test_a_run_comes_out_again_and_again_from_its_copy(tmp_path: Path) -> None:
    record_axis(tmp_path / "run")
    seen: list[None] = []
    with open_bag(tmp_path / "run") as bag:
        counts = bag.counts
        (again,) = resimulate(bag, {}, tmp_path / "copy", lambda: seen.append(None))
    assert (again.axis, again.states, again.commands, len(seen)) == ("/stickslip_axis", 180, 7, 180)
    assert again.bit_for_bit and len(again.differences) == 15
    assert _stamps(tmp_path / "copy") == _stamps(tmp_path / "run")
    with open_bag(tmp_path / "copy") as copy:
        assert copy.counts == counts and counts[SET_POINTS.name] == 1
        assert [each.bit_for_bit for each in resimulate(copy)] == [True]
        (other,) = resimulate(copy, {"mass": 0.006})
    assert not other.bit_for_bit
    assert other.differences["axis_slider position"].largest > 1e-9


def test_commands_after_the_last_state_are_carried_out_too(tmp_path: Path) -> None:
    """A sensor that gives no reading any more ends the states, not the run."""
    record_axis(tmp_path / "run", silent_from=10)
    with open_bag(tmp_path / "run") as bag:
        resimulate(bag, {}, tmp_path / "copy")
    assert _stamps(tmp_path / "copy") == _stamps(tmp_path / "run")


def test_a_run_with_every_effect_on_comes_out_bit_for_bit(tmp_path: Path) -> None:
    preset = read_yaml(PRESET).flat()
    different = {name: value for name, value in preset.items() if value != PARAMETERS[name].default}
    record_axis(tmp_path / "run", **different)
    with open_bag(tmp_path / "run") as bag:
        (again,) = resimulate(bag)
        (other,) = resimulate(bag, {"surface_seed": 2})
    assert again.bit_for_bit
    assert "axis_contact_2 position" in again.differences
    assert not other.bit_for_bit


def test_a_lost_event_is_named(tmp_path: Path) -> None:
    """A table of differences was all that was said of it."""
    record_axis(tmp_path / "run", lose=(3, 4))
    with open_bag(tmp_path / "run") as bag, pytest.raises(NotRepeatable) as refused:
        resimulate(bag)
    assert re.search(r"number 4 to 5 between 0\.0\d+ s and 0\.0\d+ s: ", str(refused.value))


def test_a_state_that_was_tampered_with_is_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """By one bit; the command says what it computes, and needs the start of the axis."""

    def one_bit(number: int, data: bytes) -> bytes:
        return data if number != 30 else data[:-8] + bytes([data[-8] ^ 1]) + data[-7:]

    monkeypatch.setattr("stickslip_ros.base.reporting.terminal._PATIENCE", 0.0)
    record_axis(tmp_path / "run", joints=one_bit)
    assert main(["bag", "resimulate", str(tmp_path / "run")]) == 1
    said = capsys.readouterr()
    assert "largest difference to what was recorded" in said.out
    assert "computing 0 s of motion" in said.err
    foreign(tmp_path / "run.mcap", [(JOINTS, START, state(START, a=(0.0, 0.0, 0.0)))])
    assert main(["bag", "resimulate", str(tmp_path / "run.mcap")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "holds no events of an axis; record the topic" in line


@pytest.mark.parametrize(
    ("digest", "off", "code"),
    [("other", 1e-13, 0), (None, 1e-13, 0), ("other", 1e-9, 1), ("this", 1e-13, 1)],
)
def test_rounding_passes_for_that_of_another_processor_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], digest: str | None, off: float, code: int
) -> None:
    def change(number: int, texts: Texts) -> Texts:
        if digest == "this" or number:
            return texts
        kept = {key: text for key, text in texts.items() if key != "arithmetic"}
        return {**kept, **({"arithmetic": digest} if digest else {})}

    def joints(number: int, data: bytes) -> bytes:
        (force,) = struct.unpack("<d", data[-8:])
        return data[:-8] + struct.pack("<d", force * (1.0 + off))

    record_axis(tmp_path / "run", change, joints)
    assert main(["bag", "resimulate", str(tmp_path / "run"), "--json"]) == code
    (run,) = json.loads(capsys.readouterr().out)["runs"]
    assert run["this_arithmetic"] == arithmetic() and not run["bit_for_bit"]
    assert run["arithmetic"] == {"this": arithmetic(), "other": "other", None: ""}[digest]
    assert run["same_up_to_rounding"] == (code == 0)
    main(["bag", "resimulate", str(tmp_path / "run")])
    said = capsys.readouterr().out
    assert ("same up to rounding" in said) == (code == 0)
    assert ("arithmetic of the recording" in said) == (digest != "this")


DEEP = "[" * 100_000
HOSTILE: dict[str, Texts] = {
    "a method of the axis": {"event": "__init__"},
    "another one": {"event": "advance", "value": "1e9"},
    "no such command": {"event": "no such command"},
    "no value": {"event": "steps", "value": "null"},
    "a list": {"event": "steps", "value": "[1, 2]"},
    "a mapping": {"event": "frequency", "value": '{"a": 1}'},
    "a text": {"event": "jog", "value": "abc"},
    "too large": {"event": "steps", "value": "9" * 400},
    "too many digits": {"event": "steps", "value": "9" * 5000},
    "nan": {"event": "load", "value": "nan"},
    "nested": {"event": "steps", "value": DEEP},
    "points that are none": {"event": "trajectory", "joints": "7", "points": "[[1], {}]"},
    "parameters that are none": {"event": "parameters", "mass": "heavy"},
    "a parameter that is none": {"event": "parameters", "__class__": "1"},
    "time without end": {"time (s)": "inf"},
    "no time": {"time (s)": "nan"},
    "time before the start": {"time (s)": "-5.0"},
    "time that is none": {"time (s)": "soon"},
    "time of 400 digits": {"time (s)": "9" * 400},
}


@pytest.mark.parametrize("name", HOSTILE)
def test_an_event_that_no_axis_noted_is_refused(tmp_path: Path, name: str) -> None:
    record_axis(
        tmp_path / "run", lambda number, texts: {**texts, **HOSTILE[name]} if number == 2 else texts
    )
    with open_bag(tmp_path / "run") as bag, pytest.raises(NotRepeatable) as refused:
        resimulate(bag)
    assert "\n" not in str(refused.value) and len(str(refused.value)) < 1000


def test_events_of_strangers_end_in_one_error(tmp_path: Path) -> None:
    """Any text in place of another: the run comes out or is refused, and nothing else."""
    dice = random.Random(7)
    words = ["", "nan", "inf", "-1", "[]", "{}", "null", "true", "1e400", "start", "stop", "steps"]

    def change(_: int, texts: Texts) -> Texts:
        if dice.random() < 0.1:
            texts = {**texts, dice.choice(list(texts)): dice.choice(words)}
        return texts

    ended = []
    for number in range(15):
        record_axis(tmp_path / f"{number}", change)
        try:
            with open_bag(tmp_path / f"{number}") as bag:
                resimulate(bag)
            ended.append("run")
        except StickslipError as error:
            assert "\n" not in str(error)
            ended.append("refused")
    assert {"run", "refused"} == set(ended)


SHORT: dict[str, dict[str, Any]] = {
    "velocity": {"velocity": np.zeros(1)},
    "position": {"position": np.zeros(0)},
    "name": {"name": ["axis_slider"]},
}


@pytest.mark.parametrize("what", SHORT)
def test_joint_states_with_too_few_values(
    tmp_path: Path, what: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """None at all means that they are not known, another number is refused."""

    def joints(number: int, data: bytes) -> bytes:
        fields: dict[str, Any] = {
            "name": ["axis_slider", "axis_piezo"],
            **{name: np.zeros(2) for name in ("position", "velocity", "effort")},
        }
        ns = START + number * SECOND // 1000
        return serialized(JOINTS.type, header=header(ns), **{**fields, **SHORT[what]})

    record_axis(tmp_path / "run", joints=joints)
    code = main(["bag", "resimulate", str(tmp_path / "run"), "--json"])
    said = capsys.readouterr()
    if what == "position":
        differences = json.loads(said.out)["runs"][0]["differences"]
        assert code == 1 and "axis_slider position" not in differences
    else:
        (line,) = said.err.splitlines()
        assert code == 2 and "has another number of values; record it anew" in line


@pytest.mark.parametrize("action", ["info", "resimulate"])
def test_events_without_a_header_are_refused(
    tmp_path: Path, action: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """The schema in a bag is anybody's."""
    odd = replace(AXIS_EVENTS, schema="string text\n")
    with BagWriter(tmp_path / "run") as bag:
        bag.add_topic(odd)
        bag.write(odd.name, b"\0\1\0\0\2\0\0\0a\0", log_ns=1, publish_ns=1)
    assert main(["bag", action, str(tmp_path / "run")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "are not of the type diagnostic_msgs/msg/DiagnosticArray" in line


def test_the_largest_difference_is_that_of_the_values_not_of_their_sizes() -> None:
    found = Difference()
    for ns, recorded, again in ((1, 5.0, 5.0), (2, 1.0, -1.0), (3, 100.0, 101.0), (4, 0.0, -1.5)):
        found.note(recorded, again, ns * 10**9)
    assert (found.values, found.unequal, found.largest, found.at) == (4, 3, 2.0, 2.0)
    found.note(math.nan, 1.0, 5 * 10**9)
    assert found.at == 5.0 and math.isnan(found.largest)


def test_the_programs_of_the_page_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As printed in docs/bags.md: written, read, run again, recovered."""
    page = (Path(__file__).parents[2] / "docs" / "bags.md").read_text(encoding="utf-8")
    programs = re.findall(
        r"^    from stickslip_ros.*?(?=^\S)", page + "#", re.DOTALL | re.MULTILINE
    )
    writes, reads, runs_again = (textwrap.dedent(one) for one in programs)
    record_axis(tmp_path / "run")
    shutil.copytree(tmp_path / "run", tmp_path / "broken")
    (file,) = (tmp_path / "broken").glob("*.mcap")
    file.write_bytes(file.read_bytes()[:-2000])
    monkeypatch.chdir(tmp_path)
    exec(reads, {})
    shown = capsys.readouterr().out.splitlines()
    assert "/joint_states" in shown[0]
    assert len(shown) > 50
    exec(runs_again, {})
    counts, again, findings = capsys.readouterr().out.splitlines()
    assert "/joint_states" in counts
    assert again.startswith("/stickslip_axis False ")  # another mass moves otherwise
    assert "run_0.mcap" in findings
    (tmp_path / "new").mkdir()
    monkeypatch.chdir(tmp_path / "new")
    exec(writes, {"data": int32(5), "now": START, "sent": START})
    with open_bag(tmp_path / "new" / "run") as bag:
        assert [message.data for message in bag.messages(["/steps"])] == [int32(5)]


def _of_model(version: str | None) -> Callable[[int, Texts], Texts]:
    """Give the start of a run another version of the model, or none as in old bags."""

    def change(number: int, texts: Texts) -> Texts:
        kept = {key: text for key, text in texts.items() if key != "model_version"}
        return {**kept, "model_version": version} if version and number == 0 else kept

    return change


def test_a_run_of_another_model_is_told_what_differs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Only where a later fix touches the drive."""
    creeping: dict[str, Any] = {"creep": 0.01}
    this = f"this is model {MODEL_VERSION}"
    touched = f"recorded with model 15, {this}: differs by at most the last digits"
    old, newer = f"{this}: what changed before", f"recorded with model 99, {this}: install a newer"
    cases: list[tuple[str | None, dict[str, Any], str | None]] = [
        (None, {}, old),
        ("14", {}, old),
        ("15", {}, None),
        (str(MODEL_VERSION), creeping, None),
        ("15", creeping, touched),
        ("99", {}, newer),
    ]
    for number, (version, values, said) in enumerate(cases):
        record_axis(tmp_path / f"{number}", _of_model(version), **values)
        assert main(["bag", "resimulate", str(tmp_path / f"{number}")]) == 0
        out = capsys.readouterr().out
        assert "bit for bit" in out
        assert bool(re.search(said or "model", out)) == (said is not None)
    assert main(["bag", "resimulate", str(tmp_path / "4"), "--json"]) == 0
    (run,) = json.loads(capsys.readouterr().out)["runs"]
    assert (run["model_version"], run["this_model_version"]) == (15, MODEL_VERSION)
    assert run["model_changes"][0]["largest"] == "the last digits"
    for version in ("-1", "none", "1.5"):
        record_axis(tmp_path / version, _of_model(version))
        with open_bag(tmp_path / version) as bag, pytest.raises(NotRepeatable, match="model"):
            resimulate(bag)


def test_a_change_of_parameters_counts_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    """The drive that a later fix touches may come in the middle of a run."""
    heavy = ModelChange(17, "heavy preloads", lambda p: p.value("preload") > 0.9, "5 nm")
    monkeypatch.setattr(versions, "CHANGES", (heavy,))
    axis = Axis({**TABLE_1, "preload": 0.5})
    axis.advance(0.01)
    axis.command("parameters", {"preload": 1.0})
    start, changed = [Event.of(event_texts(event)) for event in axis.take_events()]
    assert start and changed
    start.details["model_version"] = 15
    assert model_changes([start]) == (15, [])
    assert model_changes([start, changed]) == (15, [heavy])
