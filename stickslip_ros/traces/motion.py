# SPDX-License-Identifier: Apache-2.0
"""The motion of a runner over time: simulated, recorded or measured."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.traces.trace import Trace


@dataclass(frozen=True)
class Motion:
    """Position over strictly increasing time; every array has the shape (samples,)."""

    source: str  #: where it comes from, for people
    t: NDArray[np.float64]  #: time, s
    x: NDArray[np.float64]  #: runner position, m
    v: NDArray[np.float64] | None = None  #: runner velocity, m/s, where it is known exactly
    u: NDArray[np.float64] | None = None  #: actuator deflection, m
    notes: tuple[str, ...] = ()  #: what reading it left out or took up, for people

    @classmethod
    def of_trace(cls, trace: Trace, source: str) -> Motion:
        """Take over what the runner and the actuator do in a trace."""
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
        v = None if self.v is None else self.v[kept]
        u = None if self.u is None else self.u[kept]
        return Motion(self.source, self.t[kept], self.x[kept], v, u, self.notes)
