# SPDX-License-Identifier: Apache-2.0
"""A metric of a comparison: what it is, its values in both motions, and what they tell.

Loads nothing that computes, for help texts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from stickslip_ros.base.reporting import format_si

#: Tolerances up to which two values agree: parts of the larger one and, of a length, of the step.
_OF_VALUE, _OF_STEP = 0.2, 0.02


@dataclass(frozen=True)
class ComparisonMetric:
    """One quantity of both motions; nan where it cannot be determined.

    It differs beyond its tolerance. It agrees only where that is small: at most a fifth of the
    larger value or, of a length, 2 % of the step. Otherwise it cannot be told.
    """

    name: str
    unit: str  #: SI
    run: float = math.nan
    measured: float = math.nan
    tolerance: float = math.nan
    why_missing: str = ""  #: why the values tell nothing
    step: float = 0.0  #: step of the run (m), of a length
    allowed: float = math.nan  #: largest difference that was asked for
    limit: str = ""  #: its option of `compare`, after ``--max-``; "": none
    meaning: str = ""  #: "" where it is a difference of the whole motions
    floor: float = 0.0  #: least tolerance: of a length in m, else as a part of the run's value
    unseen: str = ""  #: why a value may be nan

    @property
    def difference(self) -> float:
        """Measured minus run."""
        return self.measured - self.run

    @property
    def verdict(self) -> str:
        """Whether the two differ, in a word, or why that cannot be told."""
        if self.why_missing or not math.isfinite(self.difference + self.tolerance):
            return self.why_missing or self.unseen or "not determined"
        if abs(self.difference) > self.tolerance:
            return "differs"
        larger = max(abs(self.run), abs(self.measured))
        if self.tolerance <= max(_OF_VALUE * larger, _OF_STEP * self.step):
            return "agrees"
        beside = f" and {100.0 * _OF_STEP:g} % of the step" if self.step else ""
        return (
            f"cannot be told: the tolerance, {format_si(self.tolerance, self.unit, 3)}, is above "
            f"a fifth of the larger value{beside}"
        )

    @property
    def differs(self) -> bool | None:
        """Whether the two differ; None where that cannot be told."""
        return {"differs": True, "agrees": False}.get(self.verdict)

    @property
    def texts(self) -> tuple[str, ...]:
        """Run, measured, difference and tolerance with their unit; a dash for an unknown value."""
        size = max((abs(x) for x in (self.run, self.measured) if math.isfinite(x)), default=0.0)
        both = (format_si(x, self.unit, 5, size) for x in (self.run, self.measured))
        return *both, *(format_si(x, self.unit, 3) for x in (self.difference, self.tolerance))

    def as_json(self) -> dict[str, Any]:
        """Return it by name, without the name."""
        names = ("unit", "run", "measured", "difference", "tolerance", "differs")
        found = {name: getattr(self, name) for name in names}
        return {**found, "why_missing": self.verdict if self.differs is None else None}

    # -- beside the limit that was asked for

    @property
    def what(self) -> str:
        """What the limit is for."""
        return f"difference in {self.name}" if self.meaning else self.name

    @property
    def unknown(self) -> str:
        """Why it cannot be said whether the limit is kept; empty where it can."""
        if self.differs is None:
            return self.verdict
        if self.tolerance > self.allowed >= abs(self.difference):
            return f"its tolerance is {format_si(self.tolerance, self.unit, 3)}"
        return ""

    @property
    def found(self) -> float:
        """Size of the difference; nan where it cannot be said whether the limit is kept."""
        return math.nan if self.unknown else abs(self.difference)

    @property
    def kept(self) -> bool:
        """Whether the limit is kept; where that cannot be said, it is not."""
        return self.found <= self.allowed

    @property
    def judgement(self) -> str:
        """The same in a line."""
        found = f"is {format_si(self.found, self.unit)}"
        if self.unknown:
            found = f"cannot be determined ({self.unknown})"
        return f"{self.what} {found}, allowed {format_si(self.allowed, self.unit)}"


#: Differences of the whole motions, which are held against limits alone.
WHOLE = (
    ComparisonMetric("root mean square difference", "m", limit="rmse"),
    ComparisonMetric(
        "RMSE that adds up from step to step", "m", limit="step-rmse", unseen="no steps"),
    ComparisonMetric("RMSE within the cycles", "m", limit="shape-rmse", unseen="no steps"),
    ComparisonMetric("largest difference", "m", limit="error"),
    ComparisonMetric(
        "RMSE as part of the range", "", limit="normalised-error", unseen="the run does not move"),
    ComparisonMetric("clock offset", "s", limit="offset"),
)  # fmt: skip
#: All metrics of a run of steps. A tenth of a nanometre is ten times what the model is solved to;
#: the period has its last digits from floating-point times. The number of steps is exact.
METRICS = (
    ComparisonMetric(
        "period", "s", floor=1e-9,
        meaning="time from slip to slip; of a run that is simulated, that of its parameters"),
    ComparisonMetric(
        "step size", "m", limit="step-error", floor=1e-10,
        meaning="way from slip to slip", unseen="too few cycles"),
    ComparisonMetric(
        "backstep", "m", limit="backstep-error", floor=1e-10,
        meaning="fall after the slip", unseen="too few samples after the slips"),
    ComparisonMetric(
        "ringing frequency", "Hz", limit="frequency-error", floor=5e-3,
        meaning="of the ringing after the slips", unseen="no ringing seen"),
    ComparisonMetric(
        "damping ratio", "", limit="damping-error", floor=2e-2,
        meaning="of the same", unseen="no ringing seen"),
)  # fmt: skip
COUNT = ComparisonMetric("steps", "", meaning="how many the run has")
#: All that a limit may be asked for, by the name of its option.
LIMITS = {row.limit: row for row in (*WHOLE[:-1], *METRICS, *WHOLE[-1:]) if row.limit}


def most_different(runs: Sequence[Sequence[ComparisonMetric]]) -> list[ComparisonMetric]:
    """Return of each metric that of the run in which it is worst, in the order of the first run.

    One that differs is worse than one that cannot be told, and that is worse than one that agrees.
    """

    def badness(one: ComparisonMetric) -> tuple[int, float]:
        beyond = abs(one.difference) / max(one.tolerance, 1e-300)
        known = math.isfinite(beyond)
        return 1 if one.differs is None else 2 * one.differs, beyond if known else math.inf

    return [max(same, key=badness) for same in zip(*runs, strict=True)]
