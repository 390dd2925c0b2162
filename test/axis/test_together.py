# SPDX-License-Identifier: Apache-2.0
"""Trajectories of several axes: all or none, one end, the motion of each as if it were alone."""

from collections.abc import Sequence

import numpy as np
import pytest

from stickslip_ros.axis import Axis
from stickslip_ros.axis.axis import Together
from stickslip_ros.parameters import ParameterError

BLOCK = 0.01  # s, as of a node
HERTZ = 1000.0
NAMES = "xyz"
Points = list[tuple[float, list[float]]]


def three(seed: int = 0) -> list[Axis]:
    return [
        Axis({"axis_name": name, "frequency": HERTZ, "sensor_seed": seed + k, "soft_high": 1e-4})
        for k, name in enumerate(NAMES)
    ]


def parts(points: Points) -> dict[str, tuple[list[str], list[list[float]]]]:
    joints = [f"{name}_slider" for name in NAMES]
    return {j: ([j], [[t, x[k]] for t, x in points]) for k, j in enumerate(joints)}


def run(axes: Sequence[Axis], together: Together, t: float) -> None:
    """Let a time (s) pass, block by block."""
    start = axes[0].state.t
    for block in range(1, round(t / BLOCK) + 1):
        for axis in axes:
            axis.advance(start + block * BLOCK)
        together.end()


def finished(axis: Axis) -> list[tuple[float, float]]:
    """Return when (s) and where (m) trajectories of an axis have ended."""
    events = [event for event in axis.take_events() if event.outcome == "finished"]
    return [(event.time, axis.state.x) for event in events]


@pytest.mark.parametrize("count", [3, pytest.param(200, marks=pytest.mark.long)])
def test_axes_end_within_a_cycle_of_each_other_and_2_nm(count: int) -> None:
    lot = np.random.default_rng(count)
    for seed in range(count):
        axes = three(10 * seed)
        together = Together(axes)
        times = np.cumsum(lot.uniform(0.1, 0.4, lot.integers(1, 4))).tolist()
        points = [(t, lot.uniform(-8e-6, 8e-6, 3).tolist()) for t in times]
        together.follow(parts(points))
        run(axes, together, times[-1] + 0.4)
        (ends,) = zip(*map(finished, axes), strict=True)
        assert max(t for t, _ in ends) - min(t for t, _ in ends) <= 1.0 / HERTZ
        for (_, reached), wanted in zip(ends, points[-1][1], strict=True):
            assert reached == pytest.approx(wanted, abs=2e-9)


def test_each_moves_as_it_would_alone() -> None:
    """So its run repeats from its own events."""
    points: Points = [(0.2, [1e-6, 2e-6, -3e-6])]
    axes, alone = three(), three()
    together = Together(axes)
    together.follow(parts(points))
    for axis, part in zip(alone, parts(points).values(), strict=True):
        axis.command("trajectory", *part)
    run([*axes, *alone], Together([]), 0.4)
    assert {axis.status.state for axis in axes} == {"targeting"}
    assert {axis.status.state for axis in alone} == {"holding"}
    run([*axes, *alone], together, 0.2)
    assert {axis.status.state for axis in axes} == {"holding"}
    assert [axis.state for axis in axes] == [axis.state for axis in alone]


@pytest.mark.parametrize(
    ("changed", "complaint"),
    [
        ({"z_slider": (["z_slider"], [[0.1, 2e-4]])}, "z_slider: point 1: target is 0.0002 m"),
        ({"z_slider": (["z_slider"], [])}, "z_slider: trajectory without points"),
        ({"w_slider": (["w_slider"], [[0.1, 0.0]])}, "no joint 'w_slider' here; give x_slider"),
    ],
)
def test_one_bad_part_refuses_the_whole(changed: dict[str, tuple], complaint: str) -> None:
    axes = three()
    together = Together(axes)
    with pytest.raises(ParameterError) as refusal:
        together.follow({**parts([(0.1, [1e-6, 1e-6, 1e-6])]), **changed})
    assert complaint in str(refusal.value)
    assert {axis.status.state for axis in axes} == {"stopped"}
    for joints in ([], ["x_slider", "x_slider"]):
        with pytest.raises(ParameterError):
            together.named(joints)


def test_an_axis_in_fault_refuses_for_all() -> None:
    axes = three()
    axes[1].trip("a test")
    with pytest.raises(ParameterError, match="y_slider: the axis is in fault"):
        Together(axes).follow(parts([(0.1, [1e-6, 1e-6, 1e-6])]))
    assert axes[0].status.state == "stopped"


def test_those_that_one_has_left_end_alone() -> None:
    axes = three()
    together = Together(axes)
    together.follow(parts([(0.1, [1e-6, 1e-6, 1e-6])]))
    run(axes, together, 0.05)
    axes[2].stop()
    run(axes, together, 0.4)
    assert [axis.status.state for axis in axes] == ["holding", "holding", "stopped"]
    assert [len(finished(axis)) for axis in axes] == [1, 1, 0]
