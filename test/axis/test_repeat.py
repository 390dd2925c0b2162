# SPDX-License-Identifier: Apache-2.0
"""A run repeated from its events is the same, to the last bit, however often it is looked at."""

import random
from collections.abc import Callable
from contextlib import suppress
from functools import cache

import pytest
from table_1 import TABLE_1, table_1

from stickslip_ros.axis import Axis, CommandRefused, Event
from stickslip_ros.axis.events import event_texts
from stickslip_ros.axis.joints import JointReport
from stickslip_ros.axis.resimulation import Rerun
from stickslip_ros.physics.model.arithmetic import arithmetic
from stickslip_ros.physics.model.versions import MODEL_VERSION
from stickslip_ros.physics.solver import State
from stickslip_ros.version import __version__

PARAMETERS = {
    "frequency": 1000.0,
    "soft_high": 2e-5,
    "travel_low": -1.5e-5,
    "max_velocity": 8e-4,
    "max_following_error": 1e-6,
    "inclination": 0.3,
}
SEEDS = 3
END = 4.0  # s
LOOKS = 0.0123  # s between looks at the second run


def _kinds(rng: random.Random) -> list[Callable[[Axis], None]]:
    """Return one command of every kind, some of them bad."""

    def trajectory(axis: Axis) -> None:
        times = sorted(rng.uniform(0.0, 0.5) for _ in range(3))
        points = [(t, rng.uniform(-1e-5, 2.1e-5)) for t in times]
        axis.command("trajectory", ["axis_slider"], points)

    return [
        lambda axis: axis.command("steps", rng.randrange(-200, 200)),
        lambda axis: axis.command("jog", rng.uniform(-3000.0, 8000.0)),
        lambda axis: axis.command("jog", 0.0),
        lambda axis: axis.command("scan", rng.uniform(-20.0, 320.0)),
        lambda axis: axis.command("position", rng.uniform(-1e-5, 2.5e-5)),
        lambda axis: axis.command("position", rng.uniform(-1e-5, 1e-5)),
        trajectory,
        lambda axis: axis.command("amplitude", rng.uniform(50.0, 310.0)),
        lambda axis: axis.command("frequency", rng.uniform(100.0, 3000.0)),
        lambda axis: axis.command("parameters", {"preload": rng.uniform(0.2, 1.0)}),
        lambda axis: axis.command("parameters", {"sensor_noise": rng.uniform(0.0, 3e-9)}),
        lambda axis: axis.command("parameters", {"sensor_bandwidth": rng.choice((0.0, 50.0))}),
        lambda axis: axis.command("parameters", {"actuator": rng.choice(("linear", "hysteresis"))}),
        lambda axis: axis.command("load", rng.uniform(-0.01, 0.01)),
        lambda axis: axis.command("stop"),
        lambda axis: axis.command("reset"),
        lambda axis: axis.command("zero"),
        lambda axis: axis.command("enable", rng.random() < 0.8),
    ]


@cache
def _run(seed: int, count: int) -> tuple[list[Event], list[State], str]:
    """Run random commands at random times; return events, sampled states and the last status."""
    rng = random.Random(seed)
    axis, states, events = Axis({**TABLE_1, **PARAMETERS}), [], []
    commands = _kinds(rng)
    for t in sorted(rng.uniform(0.0, END - 1.0) for _ in range(count)):
        axis.advance(t)
        states.append(axis.state)
        with suppress(CommandRefused):
            if axis.mode in ("fault", "disabled") and rng.random() < 0.7:
                axis.command("reset")
                axis.command("enable", True)
            rng.choice(commands)(axis)
        events += axis.take_events()
    axis.advance(END)
    return events + axis.take_events(), [*states, axis.state], repr(axis.status)


@pytest.mark.parametrize("seed", range(SEEDS))
def test_a_run_repeated_from_its_events_is_the_same_to_the_last_bit(seed: int) -> None:
    """50 commands in all modes, sent through texts as a recording does, looked at differently."""
    events, states, status = _run(seed, 50)
    back = [Event.of(event_texts(event)) for event in events]
    assert None not in back
    rerun, again = Rerun([event for event in back if event]), []
    for state in states:
        while rerun.axis.state.t + LOOKS < state.t:
            rerun.advance(rerun.axis.state.t + LOOKS)
        again.append(rerun.advance(state.t).state)
    assert again == states
    assert len({state.x for state in states}) > 20
    kept = [event for event in events if event.outcome != "refused"]
    assert rerun.axis.take_events() == kept
    assert repr(rerun.axis.status).split("refused=")[0] == status.split("refused=")[0]


def test_random_runs_go_through_every_state_and_ending() -> None:
    """Or else the test above would show little."""
    seen = set()
    for seed in range(SEEDS):
        for event in _run(seed, 50)[0]:
            seen.add(f"{event.name} {event.outcome}")
    assert {
        *(f"{name} applied" for name in ("steps", "jog", "scan", "position", "trajectory", "load")),
        *(f"{name} applied" for name in ("stop", "reset", "zero", "enable", "parameters")),
        *(f"{name} finished" for name in ("move", "scan", "target")),
        *("limit hit", "fault fault", "position refused", "scan refused"),
    } <= seen


def test_the_first_event_tells_all_that_the_axis_was_made_of() -> None:
    start = Axis({**TABLE_1, **PARAMETERS}).take_events()[0]
    assert (start.time, start.name, start.outcome) == (0.0, "start", "applied")
    versions: dict[str, object] = {"version": __version__, "model_version": MODEL_VERSION}
    versions["arithmetic"] = arithmetic()
    assert start.details == {**table_1(**PARAMETERS).flat(), **versions}


@pytest.mark.parametrize(
    "effects",
    [{}, {"sensor_latency": 0.03}, {"inclination": 0.3}, {"actuator_resonance": 3e4}],
    ids=lambda effects: "".join(effects) or "plain",
)
def test_an_axis_that_stands_goes_on_as_if_nobody_had_looked(effects: dict[str, float]) -> None:
    """Where nothing moves, time goes by without the solver: reports and motion are the same."""
    seen, stood = [], 0
    for looks in (1, 137):
        axis, report, now = Axis({**TABLE_1, **effects}), JointReport(), []
        for end, command in ((1.0, 200.0), (1.5, 0.0), (4.5, -300.0), (4.9, 0.0), (8.0, 100.0)):
            start = axis.state.t
            for part in range(1, looks + 1):
                axis.advance(start + (end - start) * part / looks)
                stood += axis.actuation.stands
            axis.advance(end)
            report.take(axis)
            now += [axis.state, axis.status, axis.arrived, axis.take_events()]
            axis.command("jog", command)
        seen.append(repr(now))
    assert seen[0] == seen[1]
    assert stood > 100
