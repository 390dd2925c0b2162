# SPDX-License-Identifier: Apache-2.0
"""The motion of a runner over time: simulated, recorded, measured, or as a sensor sees it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.base.reporting import SIMULATED, draw_lines, format_si, html_table
from stickslip_ros.base.reporting.tables import frame
from stickslip_ros.base.reporting.terminal import format_rows

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

    from stickslip_ros.simulation.trace import Trace


@dataclass(frozen=True, repr=False)
class Motion:
    """Position over strictly increasing time; every array has the shape (samples,)."""

    source: str  #: where it comes from, for people
    t: NDArray[np.float64]  #: time, s
    x: NDArray[np.float64]  #: runner position, m
    v: NDArray[np.float64] | None = None  #: runner velocity, m/s, where it is known exactly
    u: NDArray[np.float64] | None = None  #: actuator deflection, m
    notes: tuple[str, ...] = ()  #: remarks of the reader, for people
    #: voltage of the actuator in any unit, of which only the cycles are used
    voltage: NDArray[np.float64] | None = None

    @classmethod
    def of_trace(cls, trace: Trace, source: str) -> Motion:
        """Return the motion of runner and actuator in a trace."""
        return cls(source, trace.t, trace.x, trace.v, trace.u)

    @cached_property
    def spacing(self) -> float:
        """Median time (s) between samples."""
        return float(np.median(np.diff(self.t)))

    @property
    def duration(self) -> float:
        """Time (s) from the first sample to the last."""
        return float(self.t[-1] - self.t[0])

    def position_at(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the position (m) at times (s) between the first and the last sample.

        Straight lines between samples, cubic ones where the velocity is known too.
        """
        if self._spline is None:
            return np.interp(t, self.t, self.x)
        return np.asarray(self._spline(np.clip(t, self.t[0], self.t[-1])))

    def velocity_at(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the velocity (m/s) at times (s), from differences where it is not known."""
        return np.interp(t, self.t, self._velocity)

    def to_frame(self) -> pandas.DataFrame:
        """Return a table with one row for each sample, SI units; needs pandas."""
        columns = {"time (s)": self.t, "position (m)": self.x}
        if self.u is not None:
            columns["actuator (m)"] = self.u
        return frame(columns, "sample")

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw the position over time into axes of Matplotlib, or new ones; return them."""
        lines = [(self.t, self.x, "-", SIMULATED, "position")]
        return draw_lines(axes, lines, "time (s)", "position (m)", self.source)

    def __repr__(self) -> str:
        """Say the motion in one line."""
        return f"Motion({self.source}: {len(self.t)} samples over {format_si(self.duration, 's')})"

    def report(self) -> str:
        """Return one line for each of samples, duration, first and last position, and notes."""
        return format_rows(self._rows())

    def _repr_html_(self) -> str:
        return html_table(self.source, self._rows())

    def _rows(self) -> list[tuple[str, str]]:
        return [
            ("samples", f"{len(self.t)}"),
            ("duration", format_si(self.duration, "s")),
            (
                "from, to",
                f"{format_si(float(self.x[0]), 'm')}, {format_si(float(self.x[-1]), 'm')}",
            ),
            *(("note", note) for note in self.notes),
        ]

    @cached_property
    def _spline(self) -> scipy.interpolate.CubicHermiteSpline | None:
        return (
            None if self.v is None else scipy.interpolate.CubicHermiteSpline(self.t, self.x, self.v)
        )

    @cached_property
    def _velocity(self) -> NDArray[np.float64]:
        return np.gradient(self.x, self.t) if self.v is None else self.v

    def between(self, start: float, end: float) -> Motion:
        """Return the samples from start to end (s), both included."""
        kept = slice(*np.searchsorted(self.t, [start, np.nextafter(end, np.inf)]))
        names = ("t", "x", "v", "u", "voltage")
        held = {name: one for name in names if (one := getattr(self, name)) is not None}
        return replace(self, **{name: one[kept] for name, one in held.items()})
