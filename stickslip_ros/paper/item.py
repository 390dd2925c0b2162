# SPDX-License-Identifier: Apache-2.0
"""One figure, table or finding of the paper, and how what we compute is judged against it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

#: Columns of a CSV: names with units, arrays of equal length.
Table = Mapping[str, NDArray[np.float64]]


class Verdict(Enum):
    """What `verdict_of` says of an item."""

    AGREES = "agrees"
    IN_KIND = "agrees in kind"
    DISAGREES = "disagrees"
    UNTOLD = "cannot be told"


class Kind(Enum):
    """What a check compares."""

    TREND = "trend"  #: something that the paper says without a number, such as "larger than"
    NUMBER = "number"  #: a number that the paper prints
    OURS = "ours"  #: ours alone, for the reader; never judged


@dataclass(frozen=True)
class Check:
    """One number of ours and the bounds that it has to keep (both included)."""

    what: str
    ours: float
    unit: str = ""
    paper: str = ""  #: what the paper says, "" for nothing
    low: float = -math.inf
    high: float = math.inf
    kind: Kind = Kind.TREND

    @property
    def judged(self) -> bool:
        """Whether the check counts for the verdict."""
        return self.kind is not Kind.OURS

    @property
    def holds(self) -> bool:
        """Whether our number keeps its bounds; nan never does."""
        return self.low <= self.ours <= self.high

    @property
    def bounds(self) -> str:
        """The bounds as text."""
        low, high = f"{self.low:.6g}", f"{self.high:.6g}"
        if not self.judged:
            return ""
        if math.isinf(self.low):
            return f"at most {high}"
        if math.isinf(self.high):
            return f"at least {low}"
        return low if low == high else f"{low} to {high}"


@dataclass(frozen=True)
class Result:
    """What computing an item gave."""

    checks: Sequence[Check]
    tables: Mapping[str, Table] = field(default_factory=dict)  #: ending of the file's name: columns
    draw: Callable[[Figure], None] | None = None  #: fills a figure of `size`
    size: tuple[float, float] = (6.2, 3.9)  #: inches
    remark: str = ""  #: what a reader has to know to make sense of it

    @property
    def verdict(self) -> Verdict:
        """See `verdict_of`."""
        return verdict_of(self.checks)


@dataclass(frozen=True)
class Item:
    """A figure, table or finding; ``statement`` is the paper's, in our words."""

    name: str  #: of its files, such as fig03
    title: str
    place: str  #: where in the paper
    statement: str
    setup: str  #: what is simulated, with every parameter that is not a default
    compute: Callable[[], Result]


def verdict_of(checks: Sequence[Check]) -> Verdict:
    """Return the verdict that follows from the checks.

    - nothing to judge: cannot be told
    - a trend is missed, or there are numbers and none is met: disagrees
    - all trends hold, there are numbers and all are met: agrees
    - otherwise (no number to compare, or some are off): agrees in kind
    """
    trends = [check.holds for check in checks if check.kind is Kind.TREND]
    numbers = [check.holds for check in checks if check.kind is Kind.NUMBER]
    if not trends and not numbers:
        return Verdict.UNTOLD
    if not all(trends) or (numbers and not any(numbers)):
        return Verdict.DISAGREES
    return Verdict.AGREES if numbers and all(numbers) else Verdict.IN_KIND
