# SPDX-License-Identifier: Apache-2.0
"""One quantity of run and measurement, side by side."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class ComparisonMetric:
    """One quantity of both; nan where it cannot be determined."""

    name: str
    unit: str  #: SI
    run: float
    measured: float
    tolerance: float
    why_missing: str = ""

    @property
    def difference(self) -> float:
        """Measured minus run."""
        return self.measured - self.run

    @property
    def differs(self) -> bool | None:
        """Whether the two differ; None where that cannot be determined."""
        if not math.isfinite(self.difference) or not math.isfinite(self.tolerance):
            return None
        return bool(abs(self.difference) > self.tolerance)

    @property
    def verdict(self) -> str:
        """The same in a word, or why it cannot be determined."""
        if self.differs is None:
            return self.why_missing or "not determined"
        return "differs" if self.differs else "agrees"

    def as_json(self) -> dict[str, Any]:
        """Return it by name, without the name."""
        names = ("unit", "run", "measured", "difference", "tolerance", "differs")
        found = {name: getattr(self, name) for name in names}
        return {**found, "why_missing": self.why_missing or None}

    @classmethod
    def missing(cls, name: str, unit: str, why: str) -> ComparisonMetric:
        """Return a metric that cannot be determined."""
        return cls(name, unit, math.nan, math.nan, math.nan, why)


def most_different(runs: Sequence[Sequence[ComparisonMetric]]) -> list[ComparisonMetric]:
    """Return of each metric that of the run in which it is worst, in the order of the first run.

    A metric that differs is worse than one that is missing, and that is worse than one that agrees.
    """

    def badness(one: ComparisonMetric) -> tuple[int, float]:
        if one.differs is None:
            return 1, 0.0
        return 2 * one.differs, abs(one.difference) / max(one.tolerance, 1e-300)

    return [max(same, key=badness) for same in zip(*runs, strict=True)]
