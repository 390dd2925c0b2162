# SPDX-License-Identifier: Apache-2.0
"""Metrics over one or two parameters, as arrays, a table and a plot."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from stickslip_ros.arrays import Array
from stickslip_ros.compiled import report_compilation
from stickslip_ros.parameters import Parameters, ParameterSource
from stickslip_ros.reporting import axes_or_new, format_si, html_table, to_json
from stickslip_ros.reporting.tables import frame
from stickslip_ros.reporting.terminal import format_rows
from stickslip_ros.simulation.left_out import left_out
from stickslip_ros.simulation.sweep_metrics import METRICS
from stickslip_ros.simulation.sweep_output import heading
from stickslip_ros.simulation.sweep_plan import ListedAxis, Sweep, SweepError, results, threads

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes


def sweep(
    parameters: ParameterSource = None,
    /,
    *,
    metric: str | Sequence[str] = "step_size",
    steps: int | None = None,
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
    **values
        Parameters by name. One or two are sequences of numbers: these vary, in the order given.

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
    axes = tuple(
        ListedAxis(name, tuple(map(float, np.ravel(value)))) for name, value in varied.items()
    )
    if not axes:
        raise SweepError(
            "nothing varies; give a parameter a list of values, such as preload=[0.5, 1.0, 2.0]"
        )
    names = (metric,) if isinstance(metric, str) else tuple(metric)
    plan = Sweep(p, axes, names, steps)
    plan.refuse_if_impossible()
    return SweepResult.of(plan, _evaluate(plan))


def _evaluate(plan: Sweep) -> Array:
    """Return the metrics of all points, (points, metrics)."""
    with report_compilation():
        plan.evaluate(0, 1)  # so that no thread has to compile
    workers = os.cpu_count() or 1
    with threads(workers) as pool:
        return np.concatenate([part for _, part in results(plan, pool, workers)])


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

    @classmethod
    def of(cls, plan: Sweep, values: Array) -> SweepResult:
        """Return the result of all points of a plan, values of shape (points, outputs)."""
        names = (name for name, _ in plan.outputs)
        return cls(plan, {n: v.reshape(plan.shape) for n, v in zip(names, values.T, strict=True)})

    @property
    def parameters(self) -> Parameters:
        """The parameters of every point; some of them vary."""
        return self.plan.base

    @property
    def left_out(self) -> tuple[str, ...]:
        """Effects of the parameters that the settled cycle of a sweep is without."""
        return left_out(self.parameters)

    @property
    def values(self) -> dict[str, Array]:
        """The values of each parameter that varies, in its unit; each of shape (values,)."""
        return {axis.name: axis.values(np.arange(axis.count)) for axis in self.plan.axes}

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
        columns = self.plan.coordinates(0, self.plan.points)
        return heading(self.plan), columns + [values.ravel() for values in self.metrics.values()]

    def as_json(self) -> dict[str, Any]:
        """Return what JSON can hold; a metric has the shape of the grid, None for no value."""
        whole = np.all([np.isfinite(values).ravel() for values in self.metrics.values()], axis=0)
        empty = np.flatnonzero(~whole)
        found = {
            "vary": self.values,
            "metrics": self.metrics,
            "steps": self.plan.steps,
            "empty": len(empty),
            "why_empty": self.plan.why_empty(int(empty[0])) if len(empty) else None,
            "parameters": self.plan.base.flat(),
        }
        return dict(to_json(found))

    def plot(self, metric: str | None = None, axes: Axes | None = None) -> Axes:
        """Draw a metric (the first): a line over one parameter, a map over two.

        >>> import matplotlib
        >>> matplotlib.use("agg")
        >>> import stickslip_ros as ss
        >>> ss.sweep(preload=[0.5, 1.0]).plot().get_ylabel()
        'step size (nm)'
        """
        from stickslip_ros.simulation.sweep_plot import draw_metric

        name = metric or self.plan.metrics[0]
        drawn = axes_or_new(axes)
        draw_metric(drawn, self.plan, name, self[name].ravel())
        return drawn

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
            (axis.name, f"{axis.count} values, {min(v):g} to {max(v):g} {axis.unit}")
            for axis, v in zip(self.plan.axes, self.values.values(), strict=True)
        ]
        for name, values in self.metrics.items():
            known = values[np.isfinite(values)]
            ends = (known.min(), known.max()) if known.size else ()
            spans = [format_si(float(end), METRICS[name].unit) for end in ends]
            rows.append((name, " to ".join(spans) or "no value"))
        return rows
