# SPDX-License-Identifier: Apache-2.0
"""Limits that a comparison is held against."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from stickslip_ros.reporting import shown

if TYPE_CHECKING:  # help texts show the limits, and load nothing that computes
    from stickslip_ros.measurement.comparison import Comparison


@dataclass(frozen=True)
class Limit:
    """Something that must not be larger than asked for."""

    name: str
    unit: str  #: SI
    what: str
    of: Callable[[Comparison], float]


@dataclass(frozen=True)
class Judgement:
    """A limit and what was found."""

    what: str
    unit: str
    found: float  #: nan where it cannot be determined
    allowed: float

    @property
    def kept(self) -> bool:
        """Whether the limit is kept; what cannot be determined is not kept."""
        return self.found <= self.allowed

    def __str__(self) -> str:
        """Say it in a line."""
        found = (
            "cannot be determined"
            if math.isnan(self.found)
            else f"is {shown(self.found, self.unit)}"
        )
        return f"{self.what} {found}, allowed {shown(self.allowed, self.unit)}"


def _of_metric(name: str) -> Callable[[Comparison], float]:
    """Return the largest difference over all runs of steps; nan if one of them does not show it."""

    def difference(comparison: Comparison) -> float:
        metrics = (metric for run in comparison.pairs for metric in run.metrics)
        found = [abs(metric.difference) for metric in metrics if metric.name == name]
        return math.nan if not found or any(map(math.isnan, found)) else max(found)

    return difference


_TABLE = (
    Limit("rmse", "m", "root mean square difference", lambda c: c.rmse),
    Limit("step-rmse", "m", "RMSE that adds up from step to step", lambda c: c.step_rmse),
    Limit("shape-rmse", "m", "RMSE within the cycles", lambda c: c.shape_rmse),
    Limit("error", "m", "largest difference", lambda c: c.largest),
    Limit("normalised-error", "", "RMSE as part of the range", lambda c: c.normalised),
    Limit("step-error", "m", "difference in step size", _of_metric("step size")),
    Limit("backstep-error", "m", "difference in backstep", _of_metric("backstep")),
    Limit("zero-amplitude-error", "m", "difference in 0-amplitude", _of_metric("0-amplitude")),
    Limit(
        "frequency-error", "Hz", "difference in ringing frequency", _of_metric("ringing frequency")
    ),
    Limit("damping-error", "", "difference in damping ratio", _of_metric("damping ratio")),
    Limit("offset", "s", "clock offset", lambda c: abs(c.alignment.offset)),
)

#: All limits by name.
LIMITS: Mapping[str, Limit] = {limit.name: limit for limit in _TABLE}


def judge(comparison: Comparison, allowed: Mapping[str, float]) -> list[Judgement]:
    """Return how a comparison stands against limits by name, in the order of the table."""
    return [
        Judgement(limit.what, limit.unit, limit.of(comparison), allowed[name])
        for name, limit in LIMITS.items()
        if name in allowed
    ]
