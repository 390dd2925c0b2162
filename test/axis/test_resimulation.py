# SPDX-License-Identifier: Apache-2.0
"""A run comes out again from its events, which go into texts and come back as they were."""

import math
from array import array
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from table_1 import TABLE_1, table_1

from stickslip_ros.axis import Axis, Event
from stickslip_ros.axis.events import NotRepeatable, event_texts, value_text
from stickslip_ros.axis.resimulation import Rerun
from stickslip_ros.physics.parameters import ParameterError
from stickslip_ros.physics.solver import State


def commanded(*commands: tuple[Any, ...]) -> list[Event]:
    """Return the events of an axis that gets commands a tenth of a second apart."""
    axis = Axis(TABLE_1)
    for k, (name, *arguments) in enumerate(commands, 1):
        axis.advance(0.1 * k)
        axis.command(name, *arguments)
    axis.advance(0.1 * (len(commands) + 1))
    return axis.take_events()


def test_every_number_of_steps_that_a_message_holds_repeats() -> None:
    Rerun(commanded(("steps", 2**31 - 1), ("steps", -(2**31)))).advance(0.4)


def test_other_parameters_make_another_run_and_hold_against_its_own() -> None:
    events = commanded(("steps", 10), ("parameters", {"preload": 0.5}), ("steps", -3))
    same = Rerun(events).advance(0.4)
    other = Rerun(events, {"preload": 0.8, "mass": 5e-3}).advance(0.4)
    assert (other.state.t, other.parameters.runner.mass) == (same.state.t, 5e-3)
    assert other.state.x != same.state.x
    assert (same.parameters.friction.preload, other.parameters.friction.preload) == (0.5, 0.8)


def test_commands_that_another_axis_refuses_are_left_out() -> None:
    events = commanded(("amplitude", 250.0))
    rerun = Rerun(events, {"max_voltage": 200.0, "amplitude": 100.0})
    rerun.advance(1.0)
    (text,) = rerun.left_out
    assert "amplitude" in text and "250 V" in text


def test_what_cannot_be_repeated_is_said() -> None:
    for events, complaint in [
        ([], "start of the axis is not among its events, there are none: record"),
        ([Event(1.0, "steps", "applied", {"value": 3})], "they begin with 'steps': record"),
        ([Event(0.0, "start", "applied", {"preload": -1.0})], "refuses the parameters"),
    ]:
        with pytest.raises(NotRepeatable, match=complaint):
            Rerun(events)


def test_a_bad_change_is_the_users() -> None:
    with pytest.raises(ParameterError, match="preload is -1"):
        Rerun(Axis(TABLE_1).take_events(), {"preload": -1.0})


# -- files that parameters name

TABLE = "0\n0.5\n1\n0\n"
LOOP = "elastic: 1.0\nthresholds: [50.0]\nweights: [0.5]\n"


@pytest.fixture
def files(tmp_path: Path) -> dict[str, str]:
    """Parameters that name two files."""
    table, loop = tmp_path / "table.csv", tmp_path / "loop.yaml"
    table.write_text(TABLE)
    loop.write_text(LOOP)
    return {"waveform_table": str(table), "hysteresis_file": str(loop)}


def _with_files(files: dict[str, str]) -> tuple[list[Event], State]:
    """Return a run that uses one file from the start and the other one later."""
    axis = Axis({**TABLE_1, **files, "actuator": "hysteresis"})
    axis.command("scan", 100.0)
    axis.advance(0.1)
    axis.command("parameters", {"waveform": "table"})
    axis.command("steps", 5)
    axis.advance(0.3)
    back = [Event.of(event_texts(event)) for event in axis.take_events()]
    return [event for event in back if event], axis.state


def test_events_hold_the_digests_of_the_files_in_use(files: dict[str, str]) -> None:
    events, _ = _with_files(files)
    digests = {name: sha256(Path(path).read_bytes()).hexdigest() for name, path in files.items()}
    first, later = (event for event in events if event.name in ("start", "parameters"))
    loop = digests["hysteresis_file"]
    assert first.details["hysteresis_file_sha256"] == loop
    assert "waveform_table_sha256" not in first.details
    assert later.details == {
        "waveform": "table",
        "hysteresis_file_sha256": loop,
        "waveform_table_sha256": digests["waveform_table"],
    }


@pytest.mark.parametrize("name", ["waveform_table", "hysteresis_file"])
def test_a_file_that_is_missing_or_another_is_told_before_anything_runs(
    files: dict[str, str], name: str
) -> None:
    """Unless another file is asked for."""
    events, state = _with_files(files)
    path = Path(files[name])
    text = path.read_text()
    path.write_text(text.replace("0.5", "0.6"))
    with pytest.raises(NotRepeatable, match=f"{name} {path} has changed since the run"):
        Rerun(events)
    again = Rerun(events, {name: str(path)})
    assert again.advance(0.3).state != state
    path.unlink()
    with pytest.raises(NotRepeatable, match=f"{name}: cannot read {path}"):
        Rerun(events)
    path.write_text(text)
    assert Rerun(events).advance(0.3).state == state


finite = st.floats(allow_nan=False, allow_infinity=False)


@given(time=finite, value=finite | st.integers(-(2**31), 2**31) | st.booleans())
def test_what_goes_in_comes_out(time: float, value: float | int | bool) -> None:
    event = Event(time, "steps", "applied", {"value": value})
    back = Event.of(event_texts(event))
    assert back == event
    assert type(back.details["value"]) is type(value)


def test_every_kind_of_detail_comes_back() -> None:
    for details in [
        {},
        {"joints": ["axis_slider"], "points": [[0.5, 1e-6], [1.0, -2.5e-7]]},
        {**table_1().flat(), "version": "1.2.3"},
        {"waveform_table": "7", "preload": 2.0},
    ]:
        event = Event(0.1, "start", "applied", details)
        assert Event.of(event_texts(event)) == event


def test_what_is_no_event_is_none() -> None:
    assert Event.of({"state": "stopped"}) is None


def test_values_are_written_in_full() -> None:
    assert value_text(0.1 + 0.2) == "0.30000000000000004"
    assert value_text(math.nan) == value_text(None) == "nan"
    assert value_text(True) == "True"
    assert value_text({"mass": array("d", [0.5])}) == '{"mass": [0.5]}'
