# SPDX-License-Identifier: Apache-2.0
"""The axis as a device: each motion is held against cycles put together by hand.

`Cycles` drives the solver cycle by cycle, so it says what a command has to do without
any of the axis' own bookkeeping. Equal means equal to the last bit.
"""

import math
import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from expected_motion import Cycles
from table_1 import TABLE_1, table_1

from stickslip_ros.axis import Axis, CommandRefused
from stickslip_ros.axis.events import Event, event_texts
from stickslip_ros.physics.model import Plant, drive_of
from stickslip_ros.physics.parameters import ParameterError
from stickslip_ros.physics.solver import State
from stickslip_ros.simulation.steps import run_steps

T = 0.01  # s, the period at the default 100 Hz


def names(axis: Axis) -> list[str]:
    """What happened since the last call, but for the start."""
    told = [f"{event.name} {event.outcome}" for event in axis.take_events()]
    return [one for one in told if one != "start applied"]


# -- moves


@pytest.mark.parametrize("steps", [1, -1, 7, -30])
def test_a_move_is_that_many_cycles_and_rest(steps: int) -> None:
    """The runner rings down freely afterwards and the actuator is back where it was."""
    axis = Axis(TABLE_1)
    axis.advance(0.123)
    axis.command("steps", steps)
    axis.advance(2.0)
    assert axis.state == Cycles(0.123).run(steps).rest(2.0)
    assert axis.state.u == pytest.approx(0.0, abs=1e-20)
    assert not axis.moving
    status = axis.status
    assert (status.state, status.steps_done, status.steps_left) == ("stopped", steps, 0)
    _, applied, finished = axis.take_events()
    assert (applied.time, applied.name, applied.details) == (0.123, "steps", {"value": steps})
    assert (finished.name, finished.outcome) == ("move", "finished")
    assert finished.time == pytest.approx(0.123 + abs(steps) * T, abs=1e-12)
    expected = run_steps(table_1(), steps).position[-1]
    assert finished.details == {"steps": steps, "position": expected}
    assert axis.take_events() == []


@pytest.mark.parametrize("second", [5, -4])
def test_a_new_command_replaces_what_is_left(second: int) -> None:
    """Given in the third of ten cycles: that one is finished, then only the new ones run."""
    axis = Axis(TABLE_1)
    axis.command("steps", 10)
    axis.advance(2.4 * T)
    axis.command("steps", second)
    assert axis.status.steps_left == second
    axis.advance(2.9 * T)
    assert axis.status.steps_done == 2
    axis.advance(3.5 * T)
    assert axis.status.steps_left == second
    assert axis.status.steps_done == 0
    axis.advance(1.0)
    assert axis.state == Cycles().run(3).run(second).rest(1.0)
    assert axis.status.steps_done == second


def test_the_last_of_several_commands_in_a_cycle_counts() -> None:
    axis = Axis(TABLE_1)
    axis.command("steps", 10)
    axis.advance(0.5 * T)
    for steps in (3, 0, -2):
        axis.command("steps", steps)
    axis.advance(1.0)
    assert axis.state == Cycles().run(1).run(-2).rest(1.0)


def test_zero_finishes_the_cycle_and_stops() -> None:
    axis = Axis(TABLE_1)
    axis.command("steps", 10)
    axis.advance(3.2 * T)
    axis.command("steps", 0)
    assert axis.moving
    axis.advance(3.9 * T)
    assert axis.moving
    axis.advance(1.0)
    assert axis.state == Cycles().run(4).rest(1.0)
    assert names(axis) == ["steps applied", "steps applied", "move finished"]
    assert axis.status.steps_done == 4


# -- drive and parameters


@pytest.mark.parametrize("change", [{"amplitude": 150.0}, {"frequency": 437.0}])
def test_the_drive_changes_with_the_next_cycle(change: dict[str, float]) -> None:
    """The running cycle keeps its shape, the steps that are left take the new one."""
    axis = Axis(TABLE_1)
    axis.command("steps", 10)
    axis.advance(2.4 * T)
    for name, value in change.items():
        axis.command(name, value)
        assert getattr(axis.status, name) == value
    axis.advance(2.99 * T)
    assert axis.state == _part_of(Cycles().run(2), 0.99 * T)
    axis.advance(1.0)
    assert axis.state == Cycles().run(3).run(7, **change).rest(1.0)
    assert axis.status.steps_done == 10


def _part_of(cycles: Cycles, t: float) -> State:
    cycles.sim.start(drive_of(cycles.p), 1)
    return cycles.rest(2.0 * T + t)


def test_what_is_no_command_is_said_and_programs_of_before_run_on() -> None:
    axis: Any = Axis(TABLE_1)
    for words, said in {
        ("stepz", 3): "no command 'stepz'; there are",
        ("steps",): "steps takes value, not nothing",
        ("steps", 1.5): "steps takes a whole number from -2147483648 to 2147483647, not 1.5",
        ("steps", True): "from -2147483648 to 2147483647, not True",
        ("jog", "x"): "jog takes a number, not 'x'",
        ("load", "1mN"): "load takes a number, not '1mN'",
        ("enable", "no"): "enable takes True or False, not 'no'",
        ("stop", 1): "stop takes no value, not 1",
        ("parameters", 3): "parameters takes a mapping, not 3",
        ("trajectory", "x", 3): "trajectory takes a list of joints and one of points",
        ("trajectory", ("axis_slider",), ((0.1, 1e-6, 5.0),)): "each a time and a position, not",
        ("joint_command", "axis_slider", "effort", 1.0): 'takes a joint, "position" or "velocity"',
    }.items():
        with pytest.raises(ParameterError, match=said):
            axis.command(*words)
    axis.command_steps(np.int64(3))
    axis.command("jog", np.float64(3.0))
    axis.command("trajectory", ["axis_slider"], np.array([[0.1, 1e-6]]))
    axis.set_load(0.0)
    with pytest.raises(AttributeError, match="an axis has no 'comand_steps'"):
        axis.comand_steps(3)
    events = [Event.of(event_texts(event)) for event in axis.take_events()]  # as a bag has them
    assert [e and (e.name, e.details) for e in events[1:]] == [
        ("steps", {"value": 3}),
        ("jog", {"value": 3.0}),
        ("trajectory", {"joints": ["axis_slider"], "points": [[0.1, 1e-6]], "begin": 0.0}),
        ("load", {"value": 0.0}),
    ]


def test_all_that_waits_for_a_cycle_begins_together() -> None:
    axis = Axis(TABLE_1)
    axis.command("steps", 10)
    axis.advance(1.5 * T)
    axis.command("steps", -6)
    axis.command("frequency", 500.0)
    axis.command("parameters", {"preload": 1.0, "mass": 0.006})
    axis.advance(1.0)
    new = {"frequency": 500.0, "preload": 1.0, "mass": 0.006}
    assert axis.state == Cycles().run(2).run(-6, **new).rest(1.0)


def test_what_is_set_at_rest_holds_at_once() -> None:
    axis = Axis(TABLE_1)
    axis.advance(0.5)
    axis.command("steps", 0)
    axis.command("amplitude", 200.0)
    axis.command("frequency", 1000.0)
    axis.command("parameters", {"preload": 2.0})
    assert axis.simulation.plant == Plant.of(table_1(preload=2.0))
    assert names(axis) == [
        f"{what} applied" for what in ("steps", "amplitude", "frequency", "parameters")
    ]
    axis.command("steps", 4)
    axis.advance(1.0)
    changed = {"amplitude": 200.0, "frequency": 1000.0, "preload": 2.0}
    assert axis.state == Cycles(0.5).run(4, **changed).rest(1.0)


def test_what_a_move_achieved_stays_when_parameters_change_afterwards() -> None:
    """Set just after the end, while the runner rings by tens of nanometres."""
    axis = Axis(TABLE_1)
    axis.command("steps", 10)
    axis.advance(4.5 * T)
    assert axis.status.mean_step == pytest.approx(run_steps(table_1(), 4).position[-1] / 4)
    axis.advance(10 * T + 1e-4)
    before = axis.status
    axis.command("parameters", {"mass": 0.005})
    np.testing.assert_equal(asdict(axis.status), asdict(before))  # with nan
    assert before.mean_step == pytest.approx(run_steps(table_1(), 10).position[-1] / 10)


@pytest.mark.parametrize("moves", [(1, 5), (5, 1), (3, -3)])
def test_the_mean_step_is_that_of_the_present_move(moves: Sequence[int]) -> None:
    axis, expected, t = Axis(TABLE_1), Cycles(), 0.0
    assert math.isnan(axis.status.mean_step)
    for steps in moves:
        start = expected.rest(t).x
        expected.run(steps)
        axis.command("steps", steps)
        t += 0.5
        axis.advance(t)
        mean = (expected.sim.state.x - start) / abs(steps)
        assert axis.status.mean_step == pytest.approx(mean, rel=1e-12)


# -- refusals

SLOW = {"slewrate": 1.0}  # V/us: the slip of 300 V takes 300 us
NEAR = {"soft_low": -1e-6, "soft_high": 2e-6}

#: Parameters of the axis, command, values, and what the refusal of each says
BAD_COMMANDS: list[tuple[dict[str, Any], str, Sequence[float], Sequence[str]]] = [
    ({}, "amplitude", (math.nan, math.inf, -math.inf), ["finite"]),
    ({}, "amplitude", (-5.0, 0.0, 300.1), ["amplitude is", "between", "300 V"]),
    ({"max_voltage": 320.0}, "amplitude", (321.0,), ["321 V", "320 V"]),
    ({}, "frequency", (math.nan, math.inf), ["finite"]),
    ({}, "frequency", (0.0, -100.0, 1e9), ["frequency is", "100000 Hz"]),
    (SLOW, "frequency", (4000.0,), ["4000 Hz", "250 us", "300 us", "3333.33 Hz", "slewrate"]),
    ({}, "jog", (math.nan, math.inf, 2e5, 1e-9), ["frequency is"]),
    ({}, "scan", (math.nan, math.inf), ["scan level", "finite"]),
    ({}, "scan", (300.1,), ["scan level", "more than max_voltage, 300 V"]),
    ({}, "scan", (-0.1,), ["scan level", "below min_voltage, 0 V, below which the actuator depol"]),
    ({}, "load", (math.nan, 1e9), ["load is"]),
    ({}, "position", (math.nan, math.inf, 0.011, -0.5), ["travel and soft limits allow -0.01 to"]),
    (NEAR, "position", (2.1e-6, -1.1e-6), ["soft limits allow -1e-06 to 2e-06 m"]),
]


@pytest.mark.parametrize(("parameters", "name", "bad", "words"), BAD_COMMANDS)
@pytest.mark.parametrize("running", [True, False])
def test_a_bad_command_is_refused_and_changes_nothing(
    parameters: dict[str, Any], name: str, bad: Sequence[float], words: Sequence[str], running: bool
) -> None:
    """Value and limit are named, the refusal is counted and told; the motion stays as it was."""
    given = {**TABLE_1, "travel_low": -0.01, "travel_high": 0.01, **parameters}
    axis, untouched = Axis(given), Axis(given)
    for one in (axis, untouched):
        if running:
            one.command("steps", 6)
        one.advance(2.5 * T)
    axis.take_events()
    for count, value in enumerate(bad, 1):
        with pytest.raises(CommandRefused) as refusal:
            axis.command(name, value)
        reason = str(refusal.value)
        assert all(word in reason for word in words), reason
        assert name in ("jog", "position") or f"{value:g}" in reason
        (event,) = axis.take_events()
        assert (event.time, event.name, event.outcome) == (2.5 * T, name, "refused")
        assert event.details["reason"] == reason
        assert event.details["value"] is value
        assert (axis.status.refused, axis.status.last_error) == (count, reason)
    status = replace(axis.status, refused=0, last_error="")
    assert repr(status) == repr(untouched.status)  # nan equals nan in text only
    for one in (axis, untouched):
        one.advance(6.5 * T)
        one.command("steps", -2)
        one.advance(1.0)
    assert axis.state == untouched.state


BAD_PARAMETERS: list[tuple[dict[str, Any], str]] = [
    ({"preload": math.nan}, "preload is nan"),
    ({"preload": 1.0, "mass": -1.0}, "mass is -1 kg; it has to lie between"),
    ({"preload": 1.0, "masss": 1.0}, "no parameter 'masss'; did you mean mass"),
    ({"name": 1.0, "reason": 2.0}, "no parameter 'name'"),
    (
        {"preload": 1.0, "amplitude": 100.0},
        "start only: later send amplitude, on ~/command/amplitude",
    ),
    ({"preload": 1.0, "z_ba": 5e-8, "z_ss": 4e-8}, "z_ss has to be larger"),
    ({"preload": 1.0, "model": "none"}, "model is 'none'; known: ceim"),
    ({"preload": 1.0, "max_voltage": 299.0}, "amplitude is 300 V"),
    ({"preload": 1.0, "max_frequency": 99.0}, "frequency is 100 Hz"),
    ({"preload": 1.0, "slewrate": 0.02}, "leaves 10000 us a cycle"),
    ({"preload": 1.0, "mass": "heavy"}, "mass is 'heavy'; it has to be a number"),
]


@pytest.mark.parametrize(("changes", "complaint"), BAD_PARAMETERS)
def test_bad_parameters_are_refused_as_a_whole(changes: dict[str, Any], complaint: str) -> None:
    """One bad value among good ones: none of them is taken, the running move goes on."""
    axis = Axis(TABLE_1)
    axis.command("steps", 5)
    axis.advance(1.5 * T)
    axis.take_events()
    with pytest.raises(CommandRefused) as refusal:
        axis.command("parameters", changes)
    assert complaint in str(refusal.value)
    assert axis.parameters == table_1()
    assert axis.status.refused == 1
    assert names(axis) == ["parameters refused"]
    axis.advance(1.0)
    assert axis.state == Cycles().run(5).rest(1.0)


def test_limits_are_those_of_the_commanded_drive() -> None:
    """What counts is the amplitude and frequency commanded, not the ones at the start."""
    axis = Axis({**TABLE_1, "slewrate": 1.0})
    axis.command("amplitude", 100.0)
    axis.command("frequency", 5000.0)
    with pytest.raises(CommandRefused, match="leaves 200 us a cycle"):
        axis.command("amplitude", 300.0)
    with pytest.raises(CommandRefused, match="leaves 200 us a cycle"):
        axis.command("parameters", {"slewrate": 0.4})
    axis.command("parameters", {"slewrate": 0.6})
    axis.command("frequency", 100.0)
    axis.command("amplitude", 300.0)
    assert axis.status.refused == 2


# -- time


def test_time_does_not_run_back() -> None:
    axis = Axis(TABLE_1)
    axis.advance(1.0)
    for t in (0.999, math.nan):
        with pytest.raises(ValueError, match="time cannot go back"):
            axis.advance(t)
    axis.advance(1.0)
    assert axis.state.t == 1.0


def test_a_move_is_the_same_whenever_it_begins_and_however_it_is_watched() -> None:
    """At 2 kHz, watched as a node does, in blocks of all lengths: the end is that of one go."""
    p = table_1(amplitude=240.0, frequency=2000.0)
    expected = run_steps(p, -60).position[-1]
    rng = random.Random(3)
    for _ in range(60):
        axis = Axis(p)
        axis.advance(rng.uniform(0.0, 2.0))
        axis.command("steps", -60)
        while axis.moving:
            axis.advance(axis.state.t + rng.uniform(0.0, 0.011))
        assert axis.take_events()[-1].details["position"] == expected


def _just_before(t: float) -> float:
    return float(np.nextafter(t, 0.0))


def _moves_of_odd_length(count: int) -> Iterator[tuple[Axis, int, Callable[[float], float]]]:
    """Yield an axis in a move from an odd time on, its steps, and when so many cycles have gone."""
    rng = random.Random(1)
    for _ in range(count):
        drive = {"frequency": rng.uniform(50.0, 90e3), "slewrate": rng.uniform(90.0, 400.0)}
        steps, start = rng.randrange(1, 40), rng.uniform(0.0, 1e-3)
        axis = Axis(drive)
        axis.advance(start)
        axis.command("steps", steps)
        yield axis, steps, partial(_time_of, start, axis.simulation.drive_cycle.period)


many_moves = pytest.mark.parametrize("count", [150, pytest.param(1000, marks=pytest.mark.long)])


def _time_of(start: float, period: float, cycles: float) -> float:
    return start + cycles * period


@many_moves
def test_a_look_a_hair_before_the_end_of_a_cycle_does_not_put_off_a_command(count: int) -> None:
    """The nearest time below an end may be rounded to it: one in about a hundred is."""
    for axis, steps, time_of in _moves_of_odd_length(count):
        axis.command("steps", steps + 9)
        axis.advance(time_of(0.5))
        axis.command("steps", -2)
        axis.advance(_just_before(time_of(1)))
        axis.advance(time_of(1.5))
        assert axis.status.steps_left == -2, axis.parameters
        assert axis.status.steps_done == 0, axis.parameters


@many_moves
def test_a_command_a_hair_before_the_end_of_a_move_is_carried_out(count: int) -> None:
    """Whether it counts as given in the last cycle or after it: the new move runs, in full."""
    for axis, steps, time_of in _moves_of_odd_length(count):
        axis.advance(_just_before(time_of(steps)))
        axis.command("steps", -2)
        axis.advance(time_of(steps + 3.5))
        assert axis.status.steps_done == -2, axis.parameters
        assert not axis.moving, axis.parameters


def test_a_change_in_the_last_step_counts_no_step_twice() -> None:
    """Three steps were told as six, each half as long."""
    axis, same = Axis({"frequency": 1000.0}), Axis({"frequency": 1000.0})
    for one in (axis, same):
        one.command("steps", 3)
        one.advance(2.5e-3)
    axis.command("parameters", {"hold_time": 0.1})
    for one in (axis, same):
        one.advance(0.01)
    assert axis.status.step_count == 3
    assert axis.status.mean_step == same.status.mean_step
