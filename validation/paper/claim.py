# SPDX-License-Identifier: Apache-2.0
"""A claim of the paper (figure, table or sentence), and how a simulation is judged against it.

``claims.yaml`` says what the paper claims, and ``checks.csv`` what each number of a simulation is
held against: two bounds, both included, and why they lie where they do. ``charts.yaml`` describes
the pictures: panels with curves, bars or a map.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.reporting import format_si, scale_of

#: Columns of a CSV: names with units, arrays of equal length.
Table = Mapping[str, Array]
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
        low, high = (f"{factor * bound:.4g}" for bound in (self.low, self.high))
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
                row["what"], unit=row["unit"], paper=row["paper"],
                low=float(row["low"] or -math.inf), high=float(row["high"] or math.inf),
                basis=Basis(row["basis"]), why=row["why"],
            )  # fmt: skip
            found.setdefault(row["claim"], []).append(check)
    return found


@dataclass(frozen=True)
class Result:
    """Result of the simulation of a claim."""

    values: Values
    tables: Mapping[str, Table] = field(default_factory=dict)  #: ending of the file's name: columns
    drawn: Mapping[str, Table] = field(default_factory=dict)  #: what only the picture shows
    draw: Callable[[Figure], None] | None = None  #: fills a figure, 170 mm wide
    height: float = 3.9  #: of that, inches
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


# -- pictures

NANO = 1e9
#: By the names that charts.yaml has for them; the blues are of values in order, small to large.
_COLOURS = {
    "ceim": "#1f4e9c", "lugre": "#c46a1b", "epm": "#2f7d4f", "epm_calc": "#8a4fa3",
    "black": "#222222", "grey": "#8c8c8c", "red": "#d3321d",
    "blue_1": "#9ecae1", "blue_2": "#4292c6", "blue_3": "#1f4e9c", "blue_4": "#0b2a5b",
}  # fmt: skip
#: Solid lines of these colours are drawn so that they differ in grey, too.
_FORMS = {"lugre": "--", "epm": "-.", "red": "--", "blue_2": "--", "blue_4": "-."}


class ChartCurve(NamedTuple):
    """A column over the x of its panel."""

    column: str
    label: str  #: in the legend, "" for none
    colour: str  #: by its name
    form: str = "-"  #: a format of Matplotlib
    of: str = ""  #: what the name of the table begins with that holds it, before the panel's ending
    error: str = ""  #: column with the standard deviation


@dataclass(frozen=True)
class Panel:
    """A part of a picture."""

    x: str  #: a column
    labels: tuple[str, str]  #: of the axes, units included
    curves: Sequence[ChartCurve] = ()
    table: str = ""  #: ending of the table that holds the columns
    y: str = ""  #: column of the vertical axis of a map
    values: tuple[str, str] = ("", "")  #: column (m) and label of a map, "" for none
    limit: float = 0.0  #: nm, ends of the colours of a map of steps of both signs
    factors: Sequence[float] = ()  #: nm, marks of the colours of a map whose scale is logarithmic
    bars: Sequence[str] = ()  #: names of bars, one for each row of x, in place of curves
    title: str = ""
    scales: tuple[float, float] = (1.0, NANO)  #: what one of x and of y is on the axes
    legend: Any = "best"  #: its place
    heading: str | None = None  #: of the legend
    levels: Sequence[tuple[float, str, str, str]] = ()  #: y, label, colour, form
    marks: Sequence[tuple[float, str, str]] = ()  #: x, text, colour
    ticks: Sequence[float] = ()  #: of x, the only ones
    span: tuple[float, float] | None = None  #: the least y, and the greatest over that of curves
    axes: Mapping[str, Any] = field(default_factory=dict)  #: for `Axes.set`

    @classmethod
    def of(cls, texts: Mapping[str, Any]) -> Panel:
        """Return the panel that a mapping of charts.yaml describes."""
        return cls(**{**texts, "curves": [ChartCurve(*one) for one in texts.get("curves", ())]})


def read_charts(path: Path) -> dict[str, Callable[[Result], Result]]:
    """Return functions that add the picture to a result, by the name of the claim."""
    return {
        name: partial(
            _with_picture,
            [Panel.of(one) for one in chart["panels"]],
            chart.get("height", Result.height),
        )
        for name, chart in yaml.safe_load(path.read_text(encoding="utf-8")).items()
    }


def _with_picture(panels: Sequence[Panel], height: float, result: Result) -> Result:
    tables = {**result.tables, **result.drawn}
    return replace(result, draw=partial(_draw, panels, tables), height=height)


def _draw(panels: Sequence[Panel], tables: Mapping[str, Table], figure: Figure) -> None:
    for row, one in enumerate(panels, 1):
        axes = figure.add_subplot(len(panels), 1, row)
        axes.set(xlabel=one.labels[0], ylabel=one.labels[1])
        axes.set_title(one.title, fontsize=10)
        axes.grid(alpha=0.3)
        if one.bars:
            _draw_bars(axes, one.bars, tables[one.table][one.x])
        if one.y:
            _draw_map(axes, one, tables[one.table])
        tops = [_draw_curve(axes, one, curve, tables) for curve in one.curves]
        for level, label, colour, form in one.levels:
            axes.axhline(level, color=_COLOURS[colour], linestyle=form, label=label)
        for x, text, colour in one.marks:
            axes.axvline(x, color=_COLOURS[colour], linewidth=0.9, linestyle=":")
            axes.annotate(text, (x + 0.06, 0.01), fontsize=8, color=_COLOURS[colour])
        axes.set(**one.axes)
        if one.span:
            axes.set_ylim(one.span[0], one.span[1] * max(tops))
        if one.ticks:
            axes.set_xticks(one.ticks, [f"{tick:g}" for tick in one.ticks])
            axes.minorticks_off()
        if len(axes.get_legend_handles_labels()[1]) > 1:
            axes.legend(loc=one.legend, fontsize=8.5, framealpha=0.9, title=one.heading)


def _draw_curve(axes: Axes, one: Panel, curve: ChartCurve, tables: Mapping[str, Table]) -> float:
    """Draw a curve and return its greatest y."""
    table = tables[curve.of + one.table]
    x, y = one.scales[0] * table[one.x], one.scales[1] * table[curve.column]
    look: dict[str, Any] = {"color": _COLOURS[curve.colour], "label": curve.label or None}
    form = _FORMS.get(curve.colour, "-") if curve.form == "-" else curve.form
    if curve.error:
        deviation = one.scales[1] * table[curve.error]
        axes.errorbar(x, y, deviation, fmt=form, markersize=4, capsize=3, **look)
    else:
        # Circles without a line are open, so that a curve below them is seen.
        fill = "none" if curve.form == "o" else look["color"]
        axes.plot(x, y, form, markersize=4, markerfacecolor=fill, **look)
    return float(np.nanmax(y))


def _draw_bars(axes: Axes, names: Sequence[str], values: Array) -> None:
    colours = [_COLOURS["ceim" if value > 0.0 else "lugre"] for value in values]
    axes.bar_label(axes.barh(names, values, color=colours), fmt="%.2g", padding=3, fontsize=8.5)
    axes.invert_yaxis()
    axes.axvline(0.0, color=_COLOURS["black"], linewidth=0.6)
    axes.margins(x=0.18)


def _draw_map(axes: Axes, one: Panel, table: Table) -> None:
    """Draw a map; nan stays grey, and of steps of both signs zero is white."""
    column, label = one.values
    x, y = table[one.x], table[one.y]
    across, up = np.unique(x), np.unique(y)
    grid = NANO * table[column][np.lexsort((x, y))].reshape(len(up), len(across))
    options: dict[str, Any] = {}
    if one.limit:
        options = {"cmap": "RdBu", "vmin": -one.limit, "vmax": one.limit}
    if one.factors:
        options = {"cmap": "viridis_r", "norm": LogNorm()}
    axes.grid(False)
    axes.set_facecolor("#d9d9d9")
    mesh = axes.pcolormesh(
        one.scales[0] * across, one.scales[1] * up, np.ma.masked_invalid(grid),
        shading="nearest", rasterized=True, **options,
    )  # fmt: skip
    figure: Any = axes.figure
    bar = figure.colorbar(mesh, ax=axes, label=label)
    if one.factors:
        bar.set_ticks(one.factors, labels=[f"{factor:g}" for factor in one.factors])
        bar.minorticks_off()
