# SPDX-License-Identifier: Apache-2.0
"""A claim of the paper (figure, table or sentence), and how a simulation is judged against it.

``claims.yaml`` says what the paper claims, and ``checks.csv`` what each number of a simulation is
held against: two bounds, both included, and why they lie where they do.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stickslip_ros.reporting import format_si, scale_of

#: Columns of a CSV: names with units, arrays of equal length.
Table = Mapping[str, NDArray[np.float64]]
#: Numbers of Python and NumPy by what they are; a pair where the joint set is shown beside Table 1.
Values = Mapping[str, Any]


def paired(values_of: Callable[[Any], Values], table_1: Any, joint: Any) -> dict[str, Any]:
    """Return the numbers of Table 1 and of the joint set in pairs; values_of makes both."""
    one, other = values_of(table_1), values_of(joint)
    return {what: (value, other[what]) for what, value in one.items()}


class ClaimVerdict(Enum):
    """How a simulation stands against a claim; the first three follow the rule of `of`."""

    AGREES = "agrees"
    IN_KIND = "agrees in kind"
    DISAGREES = "disagrees"
    CONTRADICTORY = "the paper contradicts itself"
    DATA = "data only"

    @classmethod
    def of(cls, checks: Sequence[Check]) -> ClaimVerdict:
        """Return the verdict that follows from checks, at least one of them judged.

        - a trend is missed, or there are printed numbers and none is met: disagrees
        - all trends hold, there are printed numbers and all are met: agrees
        - otherwise (no printed number, or some are off): agrees in kind
        """
        trends = [check.holds for check in checks if check.basis is Basis.TREND]
        numbers = [check.holds for check in checks if check.basis is Basis.NUMBER]
        if not all(trends) or (numbers and not any(numbers)):
            return ClaimVerdict.DISAGREES
        return ClaimVerdict.AGREES if numbers and all(numbers) else ClaimVerdict.IN_KIND


class Basis(Enum):
    """The kind of statement of the paper that a check tests."""

    TREND = "trend"  #: words without a number, such as "larger than"
    NUMBER = "number"  #: a number that the paper prints
    NOTHING = "nothing"  #: for the reader alone; never judged


@dataclass(frozen=True)
class Check:
    """One number of the simulation and the bounds that it has to keep (both included), SI units."""

    what: str
    value: float = math.nan  #: with the parameters of Table 1, or those of the claim
    unit: str = ""
    paper: str = ""  #: what the paper says, "" for nothing
    low: float = -math.inf
    high: float = math.inf
    basis: Basis = Basis.TREND
    joint: float | None = None  #: the same with the joint set, where both are shown
    why: str = ""  #: the bounds lie where they do

    @property
    def judged(self) -> bool:
        """Whether the check counts for the verdict."""
        return self.basis is not Basis.NOTHING

    @property
    def holds(self) -> bool:
        """Whether the number keeps its bounds; nan never does."""
        return self.low <= self.value <= self.high

    def of(self, values: Any) -> Check:
        """Return the check on a number, or on the pair of numbers of both sets."""
        value, joint = values if isinstance(values, tuple) else (values, None)
        return replace(self, value=float(value), joint=None if joint is None else float(joint))

    @property
    def with_joint_set(self) -> Check:
        """The same check on the number of the joint set."""
        return self if self.joint is None else self.of(self.joint)

    @property
    def bounds(self) -> str:
        """The bounds as text, "" if the check is not judged."""
        finite = [abs(bound) for bound in (self.low, self.high) if math.isfinite(bound)]
        if not self.judged or not finite:
            return ""
        factor, unit = scale_of(max(finite), self.unit)
        low, high = (f"{factor * bound:.4g}".replace("-", "−") for bound in (self.low, self.high))
        return f"{low if low == high else f'{low} to {high}'} {unit}".strip()

    @property
    def text(self) -> str:
        """The number with its unit."""
        return format_si(self.value, self.unit) if self.unit else f"{self.value:.4g}"


def read_checks(path: Path) -> dict[str, list[Check]]:
    """Return the checks of a table by the claim that they belong to, without their numbers."""
    found: dict[str, list[Check]] = {}
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            check = Check(
                row["what"],
                unit=row["unit"],
                paper=row["paper"],
                low=float(row["low"] or -math.inf),
                high=float(row["high"] or math.inf),
                basis=Basis(row["basis"]),
                why=row["why"],
            )
            found.setdefault(row["claim"], []).append(check)
    return found


@dataclass(frozen=True)
class Result:
    """Result of the simulation of a claim."""

    values: Values
    tables: Mapping[str, Table] = field(default_factory=dict)  #: ending of the file's name: columns
    drawn: Mapping[str, Table] = field(default_factory=dict)  #: what only the picture shows
    draw: Callable[[Figure], None] | None = None  #: fills a figure of `size`
    size: tuple[float, float] = (6.2, 3.9)  #: inches
    remark: str = ""  #: beside that of the claim, where it holds numbers
    settled: ClaimVerdict | None = None  #: where there is nothing to judge: why
    checks: tuple[Check, ...] = ()  #: of the values, which the claim brings

    def judged(self, checks: Sequence[Check]) -> Result:
        """Return the result with checks of its values; ValueError if they are of others.

        A verdict that is settled beforehand must not hide checks that are judged.
        """
        differ = set(self.values) ^ {check.what for check in checks}
        if differ:
            raise ValueError(f"there are no checks, or no values, of: {', '.join(sorted(differ))}")
        if (self.settled is None) != any(check.judged for check in checks):
            raise ValueError("a result has either checks to judge or a settled verdict")
        return replace(self, checks=tuple(check.of(self.values[check.what]) for check in checks))

    @property
    def verdict(self) -> ClaimVerdict:
        """The verdict with Table 1, or with the parameters of the claim."""
        return self.settled or ClaimVerdict.of(self.checks)

    @property
    def joint_verdict(self) -> ClaimVerdict | None:
        """With the joint set; None where only one set is shown."""
        if all(check.joint is None for check in self.checks):
            return None
        return self.settled or ClaimVerdict.of([check.with_joint_set for check in self.checks])


@dataclass(frozen=True)
class Claim:
    """A figure, table or sentence of the paper; ``statement`` says it in our words."""

    name: str  #: of its files, such as fig03
    title: str
    place: str  #: where in the paper
    statement: str
    setup: str  #: what is simulated, with every parameter that is not a default
    simulate: Callable[[], Result]
    checks: Sequence[Check]
    remark: str = ""  #: what a reader has to know to make sense of the numbers
    chart: Callable[[Result], Result] | None = None  #: gives a result its picture

    def compute(self) -> Result:
        """Simulate the claim, judge it, and give it its picture."""
        result = self.simulate().judged(self.checks)
        return self.chart(result) if self.chart else result
