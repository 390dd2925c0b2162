# SPDX-License-Identifier: Apache-2.0
"""Metrics over one or two parameters, as arrays, a table and a plot."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.compiled import report_compilation
from stickslip_ros.base.reporting import axes_or_new, format_si, html_table, to_json
from stickslip_ros.base.reporting.tables import csv_text, frame
from stickslip_ros.base.reporting.terminal import format_rows
from stickslip_ros.physics.parameters import Parameters, ParameterSource, parameter
from stickslip_ros.simulation.parallel import in_order, threads, workers_of
from stickslip_ros.simulation.sweep_metrics import METRICS
from stickslip_ros.simulation.sweep_plan import Sweep, SweepAxis, SweepError, parts_of
from stickslip_ros.version import __version__

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Start of the first line of every table, in all versions
TITLE = "# stickslip sweep, version "


def sweep(
    parameters: ParameterSource = None,
    /,
    *,
    metric: str | Sequence[str] = "step_size",
    steps: int | None = None,
    executor: Executor | None = None,
    **values: Any,
) -> SweepResult:
    """Compute metrics at every value of one parameter, or of two.

    Parameters
    ----------
    parameters : Parameters, mapping, path or None
        As in `simulate`.
    metric : str or sequence of str
        Names of metrics; `stickslip sweep --help` lists them.
    steps : int, optional
        How many steps from rest judge a point; the sign is the direction. Default: as many as
        it takes a point to settle, forward.
    executor : Executor, optional
        What computes the points: any of `concurrent.futures`, such as ``client.get_executor()`` of
        a Dask cluster. Default: a thread for each processor.
    **values
        Parameters by name. One or two are sequences: these vary, in the order given.

    Returns
    -------
    SweepResult
        Each metric, SI units, of shape (values,) or (values, values); nan where a point is
        impossible.

    Raises
    ------
    SweepError
        Nothing varies, too much does, or no point is possible.
    ParameterError
        A value is out of range, or unknown.

    Examples
    --------
    >>> import stickslip_ros as ss
    >>> found = ss.sweep("table1_typical", preload=[0.1, 1.0, 6.0])
    >>> (1e9 * found["step_size"]).round(2)
    array([144.7 , 113.2 ,   0.63])
    >>> ss.sweep(preload=[0.1, 1.0], mass=[0.003, 0.004, 0.005])["step_size"].shape
    (2, 3)
    """
    varied = {
        name: value
        for name, value in values.items()
        if isinstance(value, Sequence | np.ndarray) and not isinstance(value, str)
    }
    p = Parameters.of(parameters, **{name: v for name, v in values.items() if name not in varied})
    axes = tuple(SweepAxis.of(name, value) for name, value in varied.items())
    if not axes:
        raise SweepError(
            "nothing varies; give a parameter a list of values, such as preload=[0.5, 1.0, 2.0]"
        )
    names = (metric,) if isinstance(metric, str) else tuple(metric)
    plan = Sweep(p, axes, names, steps)
    plan.refuse_if_impossible()
    with report_compilation():
        if executor is None:
            plan.evaluate(0, 1)  # so that no thread has to compile
        with threads() if executor is None else nullcontext(executor) as pool:
            found = compute(plan, pool)
    if found.done < plan.points:
        raise KeyboardInterrupt
    return found


def compute(
    plan: Sweep, executor: Executor, on_points: Callable[[int], object] = lambda points: None
) -> SweepResult:
    """Return the result of a plan; on_points is told of points that are done.

    After Ctrl-C the points that are left have no value, and `SweepResult.done` says how many do.
    """
    values, done = np.full((plan.points, len(plan.metrics)), math.nan), 0
    parts = parts_of(plan, workers_of(executor))
    try:
        for found in in_order(executor, plan.evaluate_part, parts):
            values[done : done + len(found)] = found
            done += len(found)
            on_points(len(found))
    except KeyboardInterrupt:
        pass
    columns = {n: v.reshape(plan.shape) for n, v in zip(plan.metrics, values.T, strict=True)}
    return SweepResult(plan, columns, done)


@dataclass(frozen=True)
class SweepResult:
    """Metrics over a grid; made by `sweep`.

    >>> import stickslip_ros as ss
    >>> found = ss.sweep(preload=[0.5, 1.0, 2.0])
    >>> found
    SweepResult(step_size over preload (3 values))
    >>> found.values["preload"]
    array([0.5, 1. , 2. ])
    """

    plan: Sweep
    metrics: Mapping[str, Array]  #: by name, SI units, the shape of the grid
    done: int  #: points that were computed, all but after Ctrl-C

    @property
    def parameters(self) -> Parameters:
        """The parameters of every point; some of them vary."""
        return self.plan.base

    @property
    def left_out(self) -> tuple[str, ...]:
        """Effects of the parameters that the settled cycle of a sweep is without."""
        return self.plan.left_out

    @property
    def values(self) -> dict[str, Array]:
        """The values of each parameter that varies, in its unit; each of shape (values,)."""
        return {axis.name: axis.values for axis in self.plan.axes}

    def __getitem__(self, metric: str) -> Array:
        """Return a metric, SI unit, the shape of the grid; nan where a point has no value."""
        try:
            return self.metrics[metric]
        except KeyError:
            raise KeyError(f"no metric {metric!r}; there are {', '.join(self.metrics)}") from None

    def to_frame(self) -> pandas.DataFrame:
        """Return a table with one row for each point; needs pandas.

        >>> import stickslip_ros as ss
        >>> ss.sweep(preload=[0.5, 1.0]).to_frame().columns.tolist()
        ['preload (N)', 'step_size (m)']
        """
        return frame(dict(zip(*self.table(), strict=True)), "point")

    def table(self) -> tuple[list[str], list[Array]]:
        """Return the names of columns with their units, and the columns, each (points,)."""
        named = [(axis.name, axis.unit) for axis in self.plan.axes]
        named += [(name, METRICS[name].unit) for name in self.metrics]
        heading = [f"{name} ({unit})" if unit else name for name, unit in named]
        columns = self.plan.coordinates(0, self.plan.points)
        columns += [values.ravel() for values in self.metrics.values()]
        return heading, [column[: self.done] for column in columns]

    def csv(self) -> str:
        """Return the table as text; a field without a value is empty."""
        heading, columns = self.table()
        rows = zip(*(column.tolist() for column in columns), strict=True)
        return csv_text(heading, list(rows)).removesuffix("\n")

    def csv_file(self) -> str:
        """Return the content of a file: what defines the sweep as comments, then the table."""
        varied = {axis.name for axis in self.plan.axes}
        given = self.parameters.flat().items()
        lines = [
            f"{TITLE}{__version__}",
            *(f"# vary {axis}" for axis in self.plan.axes),
            f"# steps {self.plan.steps or 'until they settle'}",
            *(f"# set {name}={value}" for name, value in given if name not in varied),
        ]
        return "\n".join([*lines, self.csv(), ""])

    @property
    def empty(self) -> NDArray[np.intp]:
        """The numbers of the points that have no value in some metric, (empty points,)."""
        whole = np.all([np.isfinite(values).ravel() for values in self.metrics.values()], axis=0)
        return np.flatnonzero(~whole[: self.done])

    def complaint(self) -> str:
        """Return how many points have no value, and why the first has none; empty if all have."""
        if not len(self.empty):
            return ""
        return (
            f"{len(self.empty)} of {self.done} points have an empty value; the first, "
            f"{self.plan.why_empty(int(self.empty[0]))}"
        )

    def as_json(self) -> dict[str, Any]:
        """Return what JSON can hold; a metric has the shape of the grid, None for no value."""
        empty = self.empty
        found = {
            "vary": self.values,
            "metrics": self.metrics,
            "steps": self.plan.steps,
            "empty": len(empty),
            "why_empty": self.plan.why_empty(int(empty[0])) if len(empty) else None,
            "parameters": self.plan.base.flat(),
        }
        return dict(to_json(found))

    def plot(self, axes: Axes | str | None = None, metric: str | Axes | None = None) -> Axes:
        """Draw a metric (the first) into axes of Matplotlib, or new ones; return them.

        It is a line over one parameter, a map over two. Both arguments may change places.

        >>> import matplotlib
        >>> matplotlib.use("agg")
        >>> import stickslip_ros as ss
        >>> ss.sweep(preload=[0.5, 1.0]).plot().get_ylabel()
        'step size (nm)'
        """
        named = [one for one in (axes, metric) if isinstance(one, str)]
        given = [one for one in (axes, metric) if one is not None and not isinstance(one, str)]
        name = named[0] if named else self.plan.metrics[0]
        drawn = axes_or_new(given[0] if given else None)
        draw_metric(drawn, self.plan, name, self[name].ravel())
        return drawn

    def picture(self) -> Figure:
        """Return a picture with a panel for each metric."""
        from matplotlib import rc_context
        from matplotlib.figure import Figure

        from stickslip_ros.base.reporting.picture import COLUMN, LOOKS

        count = len(self.metrics)
        with rc_context(LOOKS):
            size = (COLUMN, 0.3 + 0.75 * COLUMN * count)
            figure = Figure(figsize=size, layout="constrained")
            for k, name in enumerate(self.metrics):
                self.plot(figure.add_subplot(count, 1, k + 1), name)
            figure.suptitle(_title(self.plan), fontsize=LOOKS["font.size"])
        return figure

    def __repr__(self) -> str:
        """Name the varied parameters and the metrics."""
        over = " and ".join(f"{axis.name} ({axis.count} values)" for axis in self.plan.axes)
        return f"SweepResult({', '.join(self.metrics)} over {over})"

    def report(self) -> str:
        """Return one line for each parameter and metric, with the span of its values."""
        return format_rows(self._rows(), 28)

    def _repr_html_(self) -> str:
        return html_table("sweep", self._rows())

    def _rows(self) -> list[tuple[str, str]]:
        rows = [
            (axis.name, f"{axis.count} values, {_span(axis)}".strip()) for axis in self.plan.axes
        ]
        for name, values in self.metrics.items():
            known = values[np.isfinite(values)]
            ends = (known.min(), known.max()) if known.size else ()
            spans = [format_si(float(end), METRICS[name].unit) for end in ends]
            rows.append((name, " to ".join(spans) or "no value"))
        return rows


def _span(axis: SweepAxis) -> str:
    v = axis.values
    return (
        ", ".join(map(str, v)) if v.dtype == object else f"{v.min():g} to {v.max():g} {axis.unit}"
    )


# -- pictures

#: Units as they are read easily: factor and name.
_READABLE = {"m": (1e9, "nm"), "m/s": (1e6, "µm/s"), "kg": (1e3, "g")}
_LINE, _NO_VALUE = "#1f4e9c", "#d9d9d9"
#: Points of a line that are marked one by one.
_MARKED = 100


def readable(unit: str) -> tuple[float, str]:
    """Return the factor to, and the name of, the unit that a quantity is shown in."""
    return _READABLE.get(unit, (1.0, unit))


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
    _name_places(axes.xaxis, axis)
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
    _name_places(axes.xaxis, fast)
    _name_places(axes.yaxis, slow)
    if fast.log:
        axes.set_xscale("log")
    if slow.log:
        axes.set_yscale("log")
    bar: Any = axes.figure.colorbar(mesh, ax=axes)
    empty = "" if np.isfinite(values).all() else "\ngrey: no value"
    bar.set_label(label + empty)


def _scaled(axis: SweepAxis) -> Array:
    if axis.values.dtype == object:  # each has a place of its own
        return np.arange(axis.count, dtype=np.float64)
    return readable(axis.unit)[0] * axis.values


def _name_places(drawn: Any, axis: SweepAxis) -> None:
    if axis.values.dtype == object:
        drawn.set_ticks(_scaled(axis), [str(value) for value in axis.values])


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
