# SPDX-License-Identifier: Apache-2.0
"""Commands as pieces of drive cycles: the rules of the axis, checked against the axis itself."""

import math

import numpy as np
import pytest

from stickslip_ros.axis import Axis
from stickslip_ros.measurement.twin.timeline import Timeline, TwinCommand
from stickslip_ros.physics.parameters import Parameters


def _done(timeline: Timeline, t: float) -> float:
    """Cycles of all pieces up to a time, with their direction."""
    return sum(
        piece.drive.direction * (piece.cycles_at(end) - piece.cycles_at(begin))
        for piece, begin, end in timeline.between(-1.0, t)
        if piece.drive
    )


def test_cycles_are_those_of_the_axis() -> None:
    """Random steps, stopped, replaced and at other frequencies, counted at each rest."""
    random = np.random.default_rng(4)
    axis, timeline = Axis(Parameters.of(frequency=200.0)), Timeline(300.0, 200.0)
    t = 0.0
    names = ("steps", "frequency", "jog", "stop", "amplitude")
    for name in random.choice(names, 60):
        t += float(random.uniform(0.01, 0.1))
        axis.advance(t)
        value = {
            "steps": float(random.integers(-20, 20)), "jog": float(random.integers(-3, 3) * 100),
            "frequency": float(random.integers(1, 9) * 100), "stop": 0.0,
            "amplitude": float(random.integers(150, 300)),
        }[name]  # fmt: skip
        axis.command(name, *(() if name == "stop" else (int(value) if name == "steps" else value,)))
        timeline.add(TwinCommand(t, name, value))
    t += 0.02
    axis.command("stop")
    timeline.add(TwinCommand(axis.state.t, "stop"))
    axis.advance(t + 1.0)
    assert _done(timeline, t + 1.0) == pytest.approx(axis.status.step_count, abs=1e-6)


def test_unknown_cycles_make_blind() -> None:
    timeline = Timeline(300.0, 100.0)
    timeline.add(TwinCommand(1.0, "position", 1e-6))
    assert timeline.blind_between(1.5, 2.0)
    timeline.add(TwinCommand(3.0, "steps", 10.0))
    assert timeline.blind_between(2.5, 3.1)
    assert not timeline.blind_between(3.05, 4.0)
    assert not timeline.blind_between(0.0, 0.9)


def test_what_is_past_is_forgotten() -> None:
    timeline = Timeline(300.0, 100.0)
    for k in range(1000):
        timeline.add(TwinCommand(0.2 * k, "steps", 10.0))
        timeline.forget(0.2 * k)
    assert len(timeline.pieces) < 4
    assert math.isfinite(timeline.pieces[-1].end)
