# SPDX-License-Identifier: Apache-2.0
"""Limits that a comparison is held against; loads nothing that computes, for help texts."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from stickslip_ros.base.reporting import format_si
from stickslip_ros.measurement.metric_rows import METRICS

if TYPE_CHECKING:
    from stickslip_ros.measurement.comparison import Comparison
    from stickslip_ros.measurement.metrics import ComparisonMetric, RunPair


class Limit(NamedTuple):
    """Something that must not be larger than asked for."""

    unit: str  #: SI
    what: str
    of: Callable[[Comparison], float] | str  #: or the metric whose difference it is


#: All limits by name.
LIMITS: Mapping[str, Limit] = {
    "rmse": Limit("m", "root mean square difference", lambda c: c.rmse),
    "step-rmse": Limit("m", "RMSE that adds up from step to step", lambda c: c.step_rmse),
    "shape-rmse": Limit("m", "RMSE within the cycles", lambda c: c.shape_rmse),
    "error": Limit("m", "largest difference", lambda c: c.largest),
    "normalised-error": Limit("", "RMSE as part of the range", lambda c: c.normalised),
    **{
        row.limit: Limit(row.unit, f"difference in {row.name}", row.name)
        for row in METRICS
        if row.limit
    },
    "offset": Limit("s", "clock offset", lambda c: abs(c.alignment.offset)),
}


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


def judge(comparison: Comparison, allowed: Mapping[str, float]) -> list[Judgement]:
    """Judge a comparison by limits, given by name; a metric has to be known in all runs."""
    judgements = []
    for name, (unit, what, of) in LIMITS.items():
        if name not in allowed:
            continue
        why = ""
        if isinstance(of, str):
            same = [(run, one) for run in comparison.pairs for one in run.metrics if one.name == of]
            found = max(abs(one.difference) for _, one in same)
            unknown = [why for run, one in same if (why := _unknown(run, one, allowed[name]))]
            if unknown:
                found, why = math.nan, unknown[0]
        else:
            found = of(comparison)
        judgements.append(Judgement(what, unit, found, allowed[name], why))
    return judgements


def _unknown(run: RunPair, metric: ComparisonMetric, allowed: float) -> str:
    """Return why it cannot be said whether a metric of a run keeps a limit; empty if it can."""
    if math.isnan(metric.difference):
        return metric.verdict
    if run.measured is not None and run.measured.doubts:
        return f"{run.name}, is not determined: {'; '.join(run.measured.doubts)}"
    if not metric.tolerance <= allowed and not abs(metric.difference) > allowed:
        return f"its tolerance is {format_si(metric.tolerance, metric.unit, 3)}"
    return ""
