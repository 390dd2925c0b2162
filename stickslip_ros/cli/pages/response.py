# SPDX-License-Identifier: Apache-2.0
"""Cycles from rest with the points of Fig. 2, as a whole and closer."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from stickslip_ros.base.reporting import ACTUATOR, SIMULATED
from stickslip_ros.physics.model import DriveCycle
from stickslip_ros.simulation.trace import Trace

_NANO, _MICRO, _MILLI = 1e9, 1e6, 1e3
_DEFLECTION = "#2f7d4f"
#: The phases between two points (Fig. 1, 2), with a tint for each.
_PHASES = (
    ("A", "B", "presliding 1", "#dfe8d3"),
    ("B", "C", "stick", "#eef3e6"),
    ("C", "D", "slowdown 1, presliding 2", "#f6e3b8"),
    ("D", "E", "slip with backstep", "#f3c9bd"),
    ("E", "F", "slowdown 2", "#dccfe8"),
)


def draw_cycles(
    axes: Axes, trace: Trace, drive_cycle: DriveCycle, cycles: list[dict[str, float]]
) -> None:
    """Draw the first three cycles of a trace from rest, with the points found in each."""
    end = 3.0 * drive_cycle.period
    shown = trace.t <= end
    axes.plot([], [], color=_DEFLECTION, label="deflection z (in the slip of the actuator)")
    for k, found in enumerate(cycles):
        _tint(axes, found, _MILLI, 0.0, named=k == 0)
    axes.plot(_MILLI * trace.t[shown], _NANO * trace.u[shown], color=ACTUATOR, label="actuator u")
    axes.plot(_MILLI * trace.t[shown], _NANO * trace.x[shown], color=SIMULATED, label="runner x")
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
    axes.plot(t, _NANO * (trace.u[shown] - u0), color=ACTUATOR)
    axes.plot(t, _NANO * (trace.x[shown] - x0), color=SIMULATED)
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
