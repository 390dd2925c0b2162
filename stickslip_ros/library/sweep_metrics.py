# SPDX-License-Identifier: Apache-2.0
"""The metrics that a sweep can compute at each point.

A new metric is a line in `METRICS`, and its name in ``cli/sweep.py``, whose help loads nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.library.operating_points import blocking_preloads, generated_forces, steps_of
from stickslip_ros.library.zero_amplitude import (
    intersections,
    why_no_zero_amplitude,
    zero_amplitudes,
)
from stickslip_ros.parameters import Parameters


@dataclass(frozen=True)
class Points:
    """Operating points as columns, and the steps (sign: direction) to judge each by."""

    p: Parameters
    count: int
    steps: int
    _runs: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = field(default_factory=list)

    @property
    def settled(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Step size and backstep (m), each (points,); several metrics share the run.

        Kept by hand: up to Python 3.11 a cached_property holds a lock over all instances, which
        lets threads run one after the other.
        """
        if not self._runs:
            self._runs.append(steps_of(self.p, self.count, self.steps))
        return self._runs[0]


@dataclass(frozen=True)
class SweepMetric:
    """One number for each operating point."""

    unit: str
    evaluate: Callable[[Points], NDArray[np.float64]]  #: returns (points,), nan for no value
    runs: int  #: runs of steps that a point takes, about
    empty: str | Callable[[Parameters, int], str]  #: why a possible point may have no value

    def why_empty(self, p: Parameters, steps: int) -> str:
        """Return why a possible point has no value, judged by that many steps."""
        return self.empty if isinstance(self.empty, str) else self.empty(p, steps)


def _search(
    function: Callable[[Parameters, int, int], NDArray[np.float64]],
) -> Callable[[Points], NDArray[np.float64]]:
    return lambda points: function(points.p, points.count, points.steps)


#: By name.
METRICS: Mapping[str, SweepMetric] = {
    "step_size": SweepMetric("m", lambda points: points.settled[0], 1, "the run did not end"),
    "backstep": SweepMetric(
        "m", lambda points: points.settled[1], 1, "the runner never turns back"
    ),
    "mean_speed": SweepMetric(
        "m/s",
        lambda points: points.settled[0] * points.p.drive.frequency,
        1,
        "the run did not end",
    ),
    "generated_force": SweepMetric(
        "N", _search(generated_forces), 20, "the runner still gains on the spring at the end"
    ),
    "zero_amplitude": SweepMetric("m", _search(zero_amplitudes), 16, why_no_zero_amplitude),
    "zero_amplitude_intersection": SweepMetric(
        "m", _search(intersections), 6, "fewer than three of the amplitudes give clear steps"
    ),
    "blocking_preload": SweepMetric(
        "N", _search(blocking_preloads), 30, "no preload blocks the axis, or none lets it step"
    ),
}
