# SPDX-License-Identifier: Apache-2.0
"""A run comes out again from its events, whatever was commanded and whenever it was looked at."""

from __future__ import annotations

import contextlib
import random
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
from table_1 import TABLE_1

from stickslip_ros.axis import Axis, CommandRefused, Event
from stickslip_ros.axis.events import event_texts
from stickslip_ros.axis.resimulation import NotRepeatable, Rerun, start_of
from stickslip_ros.parameters import ParameterError
from stickslip_ros.solver import State

pytestmark = pytest.mark.usefixtures("compiled_solver")

COMMANDS = (
    lambda axis, r: axis.command_steps(r.randint(-40, 40)),
    lambda axis, r: axis.command_amplitude(r.uniform(50.0, 300.0)),
    lambda axis, r: axis.command_frequency(r.uniform(50.0, 2000.0)),
    lambda axis, r: axis.command_jog(r.uniform(-1000.0, 1000.0)),
    lambda axis, r: axis.command_scan(r.uniform(0.0, 300.0)),
    lambda axis, r: axis.command_position(r.uniform(-2e-6, 2e-6)),
    lambda axis, r: axis.set_load(r.uniform(-0.02, 0.02)),
    lambda axis, r: axis.set_parameters({"preload": r.uniform(0.3, 1.0)}),
    lambda axis, r: axis.set_parameters({"actuator": r.choice(("linear", "hysteresis"))}),
    lambda axis, r: axis.stop(),
    lambda axis, r: axis.command_amplitude(-1.0),
)


def recorded(seed: int, commands: int) -> tuple[list[Event], list[State]]:
    """Return the events of a run, as they come back from texts, and states 10 ms apart."""
    r = random.Random(seed)
    axis = Axis({**TABLE_1, "sensor_seed": seed})
    events: list[Event] = []
    states: list[State] = []
    at = sorted(r.uniform(0.0, 3.0) for _ in range(commands))
    for k in range(1, 331):
        t = (k * 10_000_000) * 1e-9
        while at and at[0] <= t:
            axis.advance(at.pop(0))
            with contextlib.suppress(CommandRefused):
                r.choice(COMMANDS)(axis, r)
        axis.advance(t)
        states.append(axis.state)
        events += axis.take_events()
    back = [Event.of(event_texts(event)) for event in events]
    assert None not in back
    return [event for event in back if event], states


@pytest.mark.parametrize("seed", range(4))
def test_every_state_comes_out_again_to_the_last_bit(seed: int) -> None:
    events, states = recorded(seed, 30)
    rerun = Rerun(events)
    assert [rerun.advance(state.t).state for state in states] == states
    assert len({state.x for state in states}) > 100
    sparse = Rerun(events)
    assert [sparse.advance(state.t).state for state in states[::7]] == states[::7]


def test_every_number_of_steps_that_a_message_holds_repeats() -> None:
    axis = Axis(TABLE_1)
    for steps in (2**31 - 1, -(2**31)):
        axis.command_steps(steps)
        axis.advance(axis.state.t + 0.1)
    Rerun(axis.take_events()).advance(0.2)


def test_other_parameters_make_another_run() -> None:
    events, states = recorded(1, 25)
    rerun = Rerun(events, {"mass": 5e-3})
    again = [rerun.advance(state.t).state for state in states]
    assert again[0].t == states[0].t
    assert again[-1].x != states[-1].x
    assert rerun.axis.parameters.runner.mass == 5e-3


def test_a_change_holds_against_later_ones_of_the_run() -> None:
    events, states = recorded(1, 40)
    assert any("preload" in event.details for event in events[1:])
    rerun = Rerun(events, {"preload": 0.8})
    rerun.advance(states[-1].t)
    assert rerun.axis.parameters.friction.preload == 0.8


def test_commands_that_another_axis_refuses_are_left_out() -> None:
    axis = Axis(TABLE_1)
    axis.command_amplitude(250.0)
    axis.advance(0.1)
    events = axis.take_events()
    rerun = Rerun(events, {"max_voltage": 200.0, "amplitude": 100.0})
    rerun.advance(1.0)
    (text,) = rerun.left_out
    assert "amplitude" in text and "250 V" in text


@pytest.mark.parametrize(
    ("events", "complaint"),
    [
        ([], "start of the axis is not among its events, there are none: record"),
        ([Event(1.0, "steps", "applied", {"value": 3})], "they begin with 'steps': record"),
        ([Event(0.0, "start", "applied", {"preload": -1.0})], "refuses the parameters"),
    ],
)
def test_what_cannot_be_repeated_is_said(events: list[Event], complaint: str) -> None:
    with pytest.raises(NotRepeatable, match=complaint):
        Rerun(events)


def test_a_bad_change_is_the_users() -> None:
    with pytest.raises(ParameterError, match="preload is -1"):
        Rerun(Axis(TABLE_1).take_events(), {"preload": -1.0})


def test_the_start_tells_parameters_and_version() -> None:
    given: dict[str, Any] = {"preload": 0.7, "axis_name": "z"}
    values, version = start_of(Axis(given).take_events())
    assert {name: values[name] for name in given} == given
    assert version


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
    axis.command_scan(100.0)
    axis.advance(0.1)
    axis.set_parameters({"waveform": "table"})
    axis.command_steps(5)
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


def test_a_run_with_files_comes_out_again(files: dict[str, str]) -> None:
    events, state = _with_files(files)
    assert Rerun(events).advance(0.3).state == state


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
