# SPDX-License-Identifier: Apache-2.0
"""The picture of a run marks in all its parts the same points."""

import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Annotation
from table_1 import table_1

from stickslip_ros.cli.pages.response import draw_closer, draw_cycles
from stickslip_ros.physics.model import Plant, drive_of
from stickslip_ros.simulation.phases import points
from stickslip_ros.simulation.sampling import trace_steps


def marked(axes: Axes) -> dict[str, float]:
    """Return the times at which points are marked."""
    return {t.get_text(): t.xy[0] for t in axes.texts if isinstance(t, Annotation)}


def drawn() -> tuple[Axes, Axes, float]:
    """An overview of three cycles, a closer look at the first slip, and when that begins (s)."""
    p = table_1()
    trace, drive_cycle = trace_steps(p, 4), drive_of(p, 1)
    cycles = [points(trace, drive_cycle, Plant.of(p).contact, k) for k in range(3)]
    whole, closer = Figure().subplots(2)
    draw_cycles(whole, trace, drive_cycle, cycles)
    slip = cycles[0]["C"]
    draw_closer(closer, trace, cycles[0], "CDEF", slip, (-20e-6, 400e-6), "ringing")
    return whole, closer, slip


def test_a_closer_look_shows_the_points_of_the_overview() -> None:
    whole, closer, slip = drawn()
    far, near = marked(whole), marked(closer)
    assert len(closer.lines) == 2 + len(near)  # runner and actuator; no deflection but in the slip
    assert far["A"] == 0.0
    for name in ("C", "E"):
        assert 1e3 * far[name] == pytest.approx(near[name] + 1e6 * slip)


def test_each_phase_is_named_once() -> None:
    """In the legend of the overview; not again in its later cycles and the closer looks."""
    whole, closer, _ = drawn()
    named, again = ([p.get_label() for p in a.patches if p.get_label()] for a in (whole, closer))
    assert len(named) == len(set(named)) == len(whole.patches) / 3
    assert again == []
