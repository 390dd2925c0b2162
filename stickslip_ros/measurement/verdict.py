# SPDX-License-Identifier: Apache-2.0
"""Limits that a comparison is held against."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from stickslip_ros.reporting import format_si

if TYPE_CHECKING:  # help texts show the limits, and load nothing that computes
    from stickslip_ros.measurement.comparison import Comparison


@dataclass(frozen=True)
class Judgement:
    """A limit and the value found."""

    what: str
    unit: str
    found: float  #: nan where it cannot be determined
    allowed: float
    why_missing: str = ""

    @property
    def kept(self) -> bool:
        """Whether the value is within the limit; an unknown value is not."""
        return self.found <= self.allowed

    def __str__(self) -> str:
        """Say it in a line."""
        found = f"is {format_si(self.found, self.unit)}"
        if math.isnan(self.found):
            found = "cannot be determined" + (f" ({self.why_missing})" if self.why_missing else "")
        return f"{self.what} {found}, allowed {format_si(self.allowed, self.unit)}"


@dataclass(frozen=True)
class Limit:
    """Something that must not be larger than asked for."""

    name: str
    unit: str  #: SI
    what: str
    of: Callable[[Comparison], float] | str  #: or the metric whose difference it is

    def judge(self, comparison: Comparison, allowed: float) -> Judgement:
        """Judge a comparison by this limit; for a metric, in all runs of steps."""
        if not isinstance(self.of, str):
            return Judgement(self.what, self.unit, self.of(comparison), allowed)
        metrics = [one for run in comparison.pairs for one in run.metrics if one.name == self.of]
        missing = [one for one in metrics if math.isnan(one.difference)]
        found = math.nan if missing else max(abs(one.difference) for one in metrics)
        why = missing[0].why_missing if missing else ""
        return Judgement(self.what, self.unit, found, allowed, why)


_TABLE = (
    Limit("rmse", "m", "root mean square difference", lambda c: c.rmse),
    Limit("step-rmse", "m", "RMSE that adds up from step to step", lambda c: c.step_rmse),
    Limit("shape-rmse", "m", "RMSE within the cycles", lambda c: c.shape_rmse),
    Limit("error", "m", "largest difference", lambda c: c.largest),
    Limit("normalised-error", "", "RMSE as part of the range", lambda c: c.normalised),
    Limit("step-error", "m", "difference in step size", "step size"),
    Limit("backstep-error", "m", "difference in backstep", "backstep"),
    Limit("zero-amplitude-error", "m", "difference in 0-amplitude", "0-amplitude"),
    Limit("frequency-error", "Hz", "difference in ringing frequency", "ringing frequency"),
    Limit("damping-error", "", "difference in damping ratio", "damping ratio"),
    Limit("offset", "s", "clock offset", lambda c: abs(c.alignment.offset)),
)

#: All limits by name.
LIMITS: Mapping[str, Limit] = {limit.name: limit for limit in _TABLE}


def judge(comparison: Comparison, allowed: Mapping[str, float]) -> list[Judgement]:
    """Judge a comparison by limits, given by name, in the order of the table."""
    return [
        limit.judge(comparison, allowed[name]) for name, limit in LIMITS.items() if name in allowed
    ]
