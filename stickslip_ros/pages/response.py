# SPDX-License-Identifier: Apache-2.0
"""Picture of a run: what a bag holds of it, and cycles from rest with the points of Fig. 2."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stickslip_ros.model import Contact, DriveCycle
from stickslip_ros.traces.phases import points
from stickslip_ros.traces.trace import Trace

_NANO, _MICRO, _MILLI = 1e9, 1e6, 1e3
_RUNNER, _ACTUATOR, _DEFLECTION = "#1f4e9c", "#c46a1b", "#2f7d4f"
#: What happens between two points (Fig. 1, 2), with a tint for each.
_PHASES = (
    ("A", "B", "presliding 1", "#dfe8d3"),
    ("B", "C", "stick", "#eef3e6"),
    ("C", "D", "slowdown 1, presliding 2", "#f6e3b8"),
    ("D", "E", "slip with backstep", "#f3c9bd"),
    ("E", "F", "slowdown 2", "#dccfe8"),
)


def plot_response(
    path: Path,
    trace: Trace,
    drive_cycle: DriveCycle,
    contact: Contact,
    recorded: tuple[NDArray[np.float64], NDArray[np.float64]],
    title: str,
) -> None:
    """Write a PNG: the recorded run, the first three cycles of the trace, three looks closer.

    recorded holds time (s) and position (m) as they came out of a bag; the trace starts at rest
    and has four cycles or more.
    """
    figure = Figure(figsize=(11, 12), layout="constrained")
    grid = figure.add_gridspec(3, 3, height_ratios=(1, 1.7, 1.5))
    cycles = [points(trace, drive_cycle, contact, k) for k in range(3)]
    _recorded(figure.add_subplot(grid[0, :]), *recorded)
    overview = figure.add_subplot(grid[1, :])
    draw_cycles(overview, trace, drive_cycle, cycles)
    start, slip = cycles[0]["A"], cycles[0]["C"]
    slipping = drive_cycle.slip_duration
    for column, (names, origin, window, what) in enumerate(
        (
            ("AB", start, (-5e-6, 150e-6), "the start: presliding"),
            ("CD", slip, (-0.2 * slipping, slipping), "the slip of the actuator"),
            ("CDEF", slip, (-20e-6, 400e-6), "backstep and ringing"),
        )
    ):
        axes = figure.add_subplot(grid[2, column])
        draw_closer(axes, trace, cycles[0], names, origin, window, what)
    handles, labels = overview.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=9)
    figure.suptitle(title)
    figure.savefig(path, dpi=110, format="png")


def _recorded(axes: Axes, t: NDArray[np.float64], x: NDArray[np.float64]) -> None:
    axes.plot(t - t[0], _MICRO * x, ".-", color=_RUNNER, markersize=3, linewidth=1)
    axes.set(xlabel="time (s)", ylabel="runner (µm)", title="the run as recorded (joint_states)")
    axes.grid(alpha=0.3)


def draw_cycles(
    axes: Axes, trace: Trace, drive_cycle: DriveCycle, cycles: list[dict[str, float]]
) -> None:
    """Draw the first three cycles of a trace from rest, with the points found in each."""
    end = 3.0 * drive_cycle.period
    shown = trace.t <= end
    axes.plot([], [], color=_DEFLECTION, label="deflection z (in the slip of the actuator)")
    for k, found in enumerate(cycles):
        _tint(axes, found, _MILLI, 0.0, named=k == 0)
    axes.plot(_MILLI * trace.t[shown], _NANO * trace.u[shown], color=_ACTUATOR, label="actuator u")
    axes.plot(_MILLI * trace.t[shown], _NANO * trace.x[shown], color=_RUNNER, label="runner x")
    for name, offset in (("A", (3, 6)), ("C", (-14, 4)), ("E", (6, -10))):
        _mark(axes, name, cycles[0], trace, _MILLI, 0.0, offset)
    axes.set(xlabel="time (ms)", ylabel="displacement (nm)", title="three cycles from rest")
    axes.set_xlim(0.0, _MILLI * end)


def draw_closer(
    axes: Axes,
    trace: Trace,
    found: dict[str, float],
    names: str,
    origin: float,
    window: tuple[float, float],
    title: str,
) -> None:
    """Show some of the points of a cycle, times from origin, displacements from there."""
    shown = (trace.t >= origin + window[0]) & (trace.t <= origin + window[1])
    t = _MICRO * (trace.t[shown] - origin)
    _tint(axes, found, _MICRO, origin, named=False)
    u0 = float(np.interp(origin, trace.t, trace.u))
    x0 = float(np.interp(origin, trace.t, trace.x))
    axes.plot(t, _NANO * (trace.u[shown] - u0), color=_ACTUATOR)
    axes.plot(t, _NANO * (trace.x[shown] - x0), color=_RUNNER)
    if names == "CD":
        axes.plot(t, _NANO * trace.z[shown], color=_DEFLECTION)
        axes.set_ylim(-60, 40)
    for name in names:
        crowded = name == "C" and names != "CD"
        _mark(axes, name, found, trace, _MICRO, origin, (-12, -12) if crowded else (4, 5), x0)
    axes.set(xlabel=f"time after {names[0]} (µs)", ylabel="displacement (nm)", title=title)
    axes.set_xlim(_MICRO * window[0], _MICRO * window[1])


def _tint(axes: Axes, found: dict[str, float], unit: float, origin: float, named: bool) -> None:
    for start, end, name, tint in _PHASES:
        span = unit * (found[start] - origin), unit * (found[end] - origin)
        axes.axvspan(*span, color=tint, linewidth=0, label=name if named else None)


def _mark(
    axes: Axes,
    name: str,
    found: dict[str, float],
    trace: Trace,
    unit: float,
    origin: float,
    offset: tuple[int, int],
    x0: float = 0.0,
) -> None:
    t = unit * (found[name] - origin)
    x = _NANO * (float(np.interp(found[name], trace.t, trace.x)) - x0)
    axes.plot([t], [x], "o", color="black", markersize=4)
    axes.annotate(name, (t, x), xytext=offset, textcoords="offset points", weight="bold")
