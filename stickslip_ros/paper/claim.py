# SPDX-License-Identifier: Apache-2.0
"""A claim of the paper (figure, table or sentence), and how a simulation is judged against it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stickslip_ros.reporting import scale_of, shown

#: Columns of a CSV: names with units, arrays of equal length.
Table = Mapping[str, NDArray[np.float64]]
#: What checks are made of: numbers of Python and NumPy alike.
Number = Any


class Verdict(Enum):
    """How a simulation stands against a claim; `Verdict.of` has the rule for the first three."""

    AGREES = "agrees"
    IN_KIND = "agrees in kind"
    DISAGREES = "disagrees"
    CONTRADICTORY = "the paper contradicts itself"
    DATA = "data only"

    @classmethod
    def of(cls, checks: Sequence[Check]) -> Verdict:
        """Return the verdict that follows from checks, at least one of them judged.

        - a trend is missed, or there are printed numbers and none is met: disagrees
        - all trends hold, there are printed numbers and all are met: agrees
        - otherwise (no printed number, or some are off): agrees in kind
        """
        trends = [check.holds for check in checks if check.basis is Basis.TREND]
        numbers = [check.holds for check in checks if check.basis is Basis.NUMBER]
        if not all(trends) or (numbers and not any(numbers)):
            return Verdict.DISAGREES
        return Verdict.AGREES if numbers and all(numbers) else Verdict.IN_KIND


@dataclass(frozen=True)
class Bounds:
    """What words of the paper come to in numbers: both ends (included), and why they lie there."""

    low: float
    high: float
    why: str


#: Part by which a number may differ from the printed one, which has two digits at best.
MET_WITHIN = 0.1
ALL_OF_THEM = "no exception"
#: A quantity in parts of another, and changes in %
LESS = Bounds(0.0, 0.9, "less by a tenth at least, which two printed digits show")
LITTLE = Bounds(0.0, 0.5, "at most half of what it is compared with")
VANISHES = Bounds(0.0, 0.1, "a tenth at most is left")
HALF = Bounds(2.0**-1.5, 2.0**-0.5, "nearer to a half than to a quarter or to the whole")
HARDLY = Bounds(0.0, 5.0, "a twentieth at most: less than repeated steps scatter")
CONSTANT = Bounds(0.0, 1.0, "1 % is what a bench resolves of a step")
SAME = Bounds(0.0, 100.0 * MET_WITHIN, "as near as printed numbers have to be met")
#: Rank correlations
FALLS = Bounds(-1.0, -0.9, "falls throughout; neighbours may change places")
RISES = Bounds(0.9, 1.0, "rises throughout; neighbours may change places")


class Basis(Enum):
    """What of the paper a check is held against."""

    TREND = "trend"  #: words without a number, such as "larger than"
    NUMBER = "number"  #: a number that the paper prints
    NOTHING = "nothing"  #: for the reader alone; never judged


@dataclass(frozen=True)
class Check:
    """One number of the simulation and the bounds that it has to keep (both included), SI units.

    Use `trend`, `number` and `extra` to make one.
    """

    what: str
    value: float  #: with the parameters of Table 1, or those of the claim
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

    @property
    def with_joint_set(self) -> Check:
        """The same check on the number of the joint set."""
        return self if self.joint is None else replace(self, value=self.joint, joint=None)

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
        return shown(self.value, self.unit) if self.unit else f"{self.value:.4g}"


def trend(
    what: str,
    value: Number,
    unit: str,
    paper: str,
    bounds: Bounds,
    joint: Number | None = None,
) -> Check:
    """Return a check against words of the paper; the bounds say what the words mean."""
    low, high, why = bounds.low, bounds.high, bounds.why
    return Check(what, float(value), unit, paper, low, high, Basis.TREND, _float(joint), why)


def number(
    what: str,
    value: Number,
    unit: str,
    printed: float,
    paper: str = "",
    joint: Number | None = None,
    within: float = MET_WITHIN,
) -> Check:
    """Return a check against a printed number, to be met within a part of it."""
    margin = within * abs(printed)
    said = paper or (shown(printed, unit, 3) if unit else f"{printed:g}")
    return Check(
        what,
        float(value),
        unit,
        said,
        printed - margin,
        printed + margin,
        Basis.NUMBER,
        _float(joint),
        f"printed, within {100.0 * within:.2g} %",
    )


def extra(
    what: str, value: Number, unit: str = "", paper: str = "", joint: Number | None = None
) -> Check:
    """Return a number for the reader, which is not judged."""
    return Check(what, float(value), unit, paper, basis=Basis.NOTHING, joint=_float(joint))


def _float(value: Number | None) -> float | None:
    return None if value is None else float(value)


@dataclass(frozen=True)
class Result:
    """What the simulation of a claim gives."""

    checks: Sequence[Check]
    tables: Mapping[str, Table] = field(default_factory=dict)  #: ending of the file's name: columns
    draw: Callable[[Figure], None] | None = None  #: fills a figure of `size`
    size: tuple[float, float] = (6.2, 3.9)  #: inches
    remark: str = ""  #: beside that of the claim, where it holds numbers
    settled: Verdict | None = None  #: where there is nothing to judge: why

    def __post_init__(self) -> None:
        """A verdict that is settled beforehand must not hide checks that are judged."""
        if (self.settled is None) != any(check.judged for check in self.checks):
            raise ValueError("a result has either checks to judge or a settled verdict")

    @property
    def verdict(self) -> Verdict:
        """With the parameters of Table 1, or those of the claim; see `Verdict.of`."""
        return self.settled or Verdict.of(self.checks)

    @property
    def joint_verdict(self) -> Verdict | None:
        """With the joint set; None where only one set is shown."""
        if all(check.joint is None for check in self.checks):
            return None
        return self.settled or Verdict.of([check.with_joint_set for check in self.checks])


@dataclass(frozen=True)
class Claim:
    """A figure, table or sentence of the paper; ``statement`` says it in our words."""

    name: str  #: of its files, such as fig03
    title: str
    place: str  #: where in the paper
    statement: str
    setup: str  #: what is simulated, with every parameter that is not a default
    compute: Callable[[], Result]
    remark: str = ""  #: what a reader has to know to make sense of the numbers
