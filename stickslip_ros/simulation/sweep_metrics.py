# SPDX-License-Identifier: Apache-2.0
"""The metrics that a sweep can compute at each point.

A new metric is a line in `METRICS`. Help texts read their names, so this file loads
what computes only when it is asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING, Any

from stickslip_ros.physics.parameters import Parameters

if TYPE_CHECKING:
    from stickslip_ros.base.arrays import Array

_POINTS = f"{__package__}.operating_points"


@dataclass(frozen=True)
class Points:
    """Operating points as columns, and the steps to judge each by (sign: direction).

    None: as many as settle, forward.
    """

    p: Parameters
    count: int
    steps: int | None
    _runs: list[tuple[Array, Array]] = field(default_factory=list)

    @property
    def settled(self) -> tuple[Array, Array]:
        """Step size and backstep (m), each (points,); several metrics share the run.

        Kept by hand: up to Python 3.11 a cached_property holds a lock over all instances, which
        lets threads run one after the other.
        """
        if not self._runs:
            self._runs.append(self.solve("steps_of"))
        return self._runs[0]

    def solve(self, function: str) -> Any:
        """Return what a function of `operating_points` makes of the points."""
        return getattr(import_module(_POINTS), function)(self.p, self.count, self.steps)


@dataclass(frozen=True)
class SweepMetric:
    """One number for each operating point."""

    unit: str
    evaluate: Callable[[Points], Array]  #: returns (points,), nan for no value
    runs: int  #: runs of steps that a point takes, about
    empty: str | Callable[[Parameters, int | None], str]  #: why a possible point may have no value

    def why_empty(self, p: Parameters, steps: int | None) -> str:
        """Return why a possible point has no value, judged by that many steps."""
        return self.empty if isinstance(self.empty, str) else self.empty(p, steps)


def _why_no_zero_amplitude(p: Parameters, steps: int | None) -> str:
    return import_module(_POINTS).why_no_zero_amplitude(p, steps)


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
        "N",
        lambda points: points.solve("generated_forces"),
        20,
        "the runner still gains on the spring at the end",
    ),
    "zero_amplitude": SweepMetric(
        "m", lambda points: points.solve("zero_amplitudes"), 16, _why_no_zero_amplitude
    ),
    "zero_amplitude_intersection": SweepMetric(
        "m",
        lambda points: points.solve("intersections"),
        6,
        "fewer than three of the amplitudes give clear steps",
    ),
    "blocking_preload": SweepMetric(
        "N",
        lambda points: points.solve("blocking_preloads"),
        30,
        "no preload blocks the axis, or none lets it step",
    ),
}
