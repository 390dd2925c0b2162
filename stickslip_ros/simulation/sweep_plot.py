# SPDX-License-Identifier: Apache-2.0
"""Picture of a sweep: lines over one varied parameter, maps over two."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stickslip_ros.arrays import Array
from stickslip_ros.parameters import parameter
from stickslip_ros.reporting.picture import COLUMN, LOOKS
from stickslip_ros.simulation.sweep_metrics import METRICS
from stickslip_ros.simulation.sweep_plan import Sweep, SweepAxis

#: Units as they are read easily: factor and name.
_READABLE = {"m": (1e9, "nm"), "m/s": (1e6, "µm/s"), "kg": (1e3, "g")}
_LINE, _NO_VALUE = "#1f4e9c", "#d9d9d9"
#: Points of a line that are marked one by one.
_MARKED = 100


def readable(unit: str) -> tuple[float, str]:
    """Return the factor to, and the name of, the unit that a quantity is shown in."""
    return _READABLE.get(unit, (1.0, unit))


def picture_of_sweep(sweep: Sweep, values: Array) -> Figure:
    """Return a picture with a panel for each metric; values has shape (points, metrics)."""
    count = len(sweep.metrics)
    with rc_context(LOOKS):
        figure = Figure(figsize=(COLUMN, 0.3 + 0.75 * COLUMN * count), layout="constrained")
        for k, name in enumerate(sweep.metrics):
            axes = figure.add_subplot(count, 1, k + 1)
            draw_metric(axes, sweep, name, values[:, k])
        figure.suptitle(_title(sweep), fontsize=LOOKS["font.size"])
    return figure


def draw_metric(axes: Axes, sweep: Sweep, name: str, values: Array) -> None:
    """Draw a metric of all points, (points,): a line over one parameter, a map over two."""
    drawn = [axis for axis in sweep.axes if axis.count > 1] or [sweep.axes[0]]
    factor, unit = readable(METRICS[name].unit)
    shown = (factor * values).reshape([axis.count for axis in drawn])
    if len(drawn) == 1:
        _line(axes, drawn[0], shown)
        axes.set_ylabel(_label(name, unit))
    else:
        _map(axes, drawn[0], drawn[1], shown, _label(name, unit))


def _line(axes: Axes, axis: SweepAxis, values: Array) -> None:
    x = _scaled(axis)
    axes.plot(x, values, ".-" if len(x) <= _MARKED else "-", color=_LINE, markersize=4)
    axes.set_xlabel(_axis_label(axis))
    if axis.log:
        axes.set_xscale("log")
    if len(x) > 1:
        axes.set_xlim(x[0], x[-1])  # the whole range, where the ends have no value too
    axes.grid(alpha=0.3)


def _map(axes: Axes, slow: SweepAxis, fast: SweepAxis, values: Array, label: str) -> None:
    axes.set_facecolor(_NO_VALUE)
    axes.grid(False)
    mesh = axes.pcolormesh(
        _scaled(fast), _scaled(slow), np.ma.masked_invalid(values), shading="nearest"
    )
    axes.set(xlabel=_axis_label(fast), ylabel=_axis_label(slow))
    if fast.log:
        axes.set_xscale("log")
    if slow.log:
        axes.set_yscale("log")
    bar: Any = axes.figure.colorbar(mesh, ax=axes)
    empty = "" if np.isfinite(values).all() else "\ngrey: no value"
    bar.set_label(label + empty)


def _scaled(axis: SweepAxis) -> Array:
    return readable(axis.unit)[0] * axis.values(np.arange(axis.count))


def _axis_label(axis: SweepAxis) -> str:
    return _label(axis.name, readable(axis.unit)[1])


def _label(name: str, unit: str) -> str:
    words = name.replace("_", " ").replace("zero amplitude", "0-amplitude")
    return f"{words} ({unit})" if unit else words


def _title(sweep: Sweep) -> str:
    varied = {axis.name for axis in sweep.axes}
    p = sweep.base.flat()
    parts = [sweep.base.friction.model.upper()]
    for name in ("preload", "mass", "amplitude", "frequency", "slewrate"):
        if name not in varied:
            parts.append(_quantity(name, p[name]))
    return ", ".join(parts)


def _quantity(name: str, value: float) -> str:
    factor, unit = readable(parameter(name).unit)
    return f"{factor * value:g} {unit}"
