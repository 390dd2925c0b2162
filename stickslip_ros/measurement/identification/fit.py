# SPDX-License-Identifier: Apache-2.0
"""Results of an identification."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.reporting import MEASURED, SIMULATED, draw_lines, format_si, html_table
from stickslip_ros.base.reporting.tables import frame
from stickslip_ros.measurement.identification.free import LAG, WIDTH, unit_of
from stickslip_ros.measurement.identification.posterior import Posterior
from stickslip_ros.physics.parameters import Parameters

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes


#: Largest ratio of the ends of an interval that is determined.
DETERMINED = 4.0


@dataclass(frozen=True)
class Estimate:
    """One parameter, SI units, with the ends of its 95 % interval; None where it has none."""

    name: str
    value: float
    low: float | None
    high: float | None
    doubt: str = ""  #: why the value does not hold, whatever its interval; empty where it may

    @property
    def unit(self) -> str:
        """Unit of the value."""
        return unit_of(self.name)

    @property
    def determined(self) -> bool:
        """Whether the interval has two ends, not far apart, and nothing speaks against it."""
        return (
            self.low is not None
            and self.high is not None
            and not self.doubt
            and self.high <= DETERMINED * self.low
        )

    @property
    def remark(self) -> str:
        """How far the value can be trusted, in words."""
        return self.doubt or ("determined" if self.determined else "not determined")

    @property
    def texts(self) -> tuple[str, str, str]:
        """Value, low and high with their unit; a dash for a missing end."""
        ends = [abs(end - self.value) for end in (self.low, self.high) if end is not None]
        narrow = min((end for end in ends if end > 0.0), default=abs(self.value))
        digits = 4
        if narrow and self.value:
            digits = max(4, 1 + math.ceil(math.log10(abs(self.value) / narrow)))
        value, low, high = (
            "–" if number is None else format_si(number, self.unit, digits, like=self.value or None)
            for number in (self.value, self.low, self.high)
        )
        return value, low, high


@dataclass(frozen=True)
class FittedRun:
    """One experiment as it was fitted."""

    source: str  #: where the measurement comes from
    start: float  #: of the first step, by the clock of the measurement, s
    steps: int  #: forward and backward
    clock_drift: float  #: how much longer times of the measurement are, s/s
    noise: float  #: standard deviation of one sample, m
    residual: float  #: root mean square of the residuals of the blocks, m
    mains: tuple[float, ...]  #: frequencies of hum that stands out, Hz
    cycle: Array  #: how many cycles each block is after its run began; nan outside of the runs
    t: Array  #: times of the blocks of samples, s
    measured: Array  #: their means, m
    left: Array  #: their residuals, m

    def as_json(self) -> dict[str, Any]:
        """Return the numbers, SI units."""
        keys = ("start", "steps", "clock_drift", "noise", "residual", "mains")
        return {"measurement": self.source, **{key: getattr(self, key) for key in keys}}


@dataclass(frozen=True)
class FittedCurve:
    """One table of metrics as it was fitted, SI units; arrays have shape (points,)."""

    source: str  #: where the table comes from
    varied: Mapping[str, Array]  #: parameters by name
    measured: Mapping[str, Array]  #: metrics by name; nan where a point lacks one
    fitted: Mapping[str, Array]  #: the model's
    deviations: Mapping[str, Array]  #: standard deviations: stated, or from the residuals

    @property
    def points(self) -> int:
        """Number of points."""
        return len(next(iter(self.varied.values())))

    def as_json(self) -> dict[str, Any]:
        """Return the root mean square of the residuals of each metric, SI units."""
        residuals: dict[str, float | None] = {}
        for name, values in self.measured.items():
            left = values - self.fitted[name]
            left = left[np.isfinite(left)]
            residuals[name] = math.sqrt(float(np.mean(left**2))) if len(left) else None
        return {"curve": self.source, "points": self.points, "residuals": residuals}


@dataclass(frozen=True)
class Misfit:
    """Residuals of a fit that are more than noise."""

    text: str  #: for people: how much, where, and which effect would take it up
    probability: float  #: by chance


@dataclass(frozen=True)
class Profile:
    """Deviance over one parameter, SI units; arrays have shape (looks,)."""

    name: str
    values: Array  #: of the parameter, rising
    rise: Array  #: of the deviance over the optimum, in units of the scale
    low: float | None  #: lower end of the 95 % interval, None where there is none
    high: float | None  #: upper end, likewise
    limit: float  #: the rise at the ends: 3.84 for many residuals


@dataclass(frozen=True)
class Fit:
    """Parameters found in measurements, with how sure they are."""

    parameters: Mapping[str, Estimate]
    base: Parameters  #: parameters of the first experiment, with the values found
    correlations: Mapping[str, Mapping[str, float]]  #: of the logarithms
    deviance: float  #: -2 log likelihood, but for a constant of the measurements
    unknown: tuple[str, ...]  #: freedoms that the measurements leave, in words
    given: tuple[str, ...]  #: what would change the values and not show, in words
    runs: tuple[FittedRun, ...]
    curves: tuple[FittedCurve, ...]
    profiles: tuple[Profile, ...]
    misfit: Misfit | None = None  #: residuals that are more than noise
    notes: tuple[str, ...] = ()  #: contradictions of records and parameters, gaps of records
    complete: bool = True  #: False if it was interrupted: the best so far, without intervals

    @property
    def sources(self) -> list[str]:
        """Names of the measurements."""
        return [*(run.source for run in self.runs), *(one.source for one in self.curves)]

    @property
    def noise(self) -> float | None:
        """Standard deviation of one sample (m), root mean square over the runs, None without."""
        return _mean_square([run.noise for run in self.runs])

    @property
    def residual(self) -> float | None:
        """Root mean square (m) of the residuals of the blocks, None without runs."""
        return _mean_square([run.residual for run in self.runs])

    def without_intervals(self) -> Fit:
        """Return the same fit with values only: nothing is known of how far they may be off."""
        values = {name: replace(one, low=None, high=None) for name, one in self.parameters.items()}
        return replace(self, parameters=values)

    @property
    def posterior(self) -> Posterior | None:
        """The values with their uncertainty, as a twin takes them; None after an interruption.

        A missing end of an interval counts as a factor of `DETERMINED`.
        """
        if not self.complete or not self.correlations:
            return None
        found = [one for one in self.parameters.values() if one.name not in (LAG, WIDTH)]
        return Posterior(
            tuple(one.name for one in found),
            tuple(one.value for one in found),
            tuple(one.low or one.value / DETERMINED for one in found),
            tuple(one.high or one.value * DETERMINED for one in found),
            tuple(tuple(self.correlations[a.name][b.name] for b in found) for a in found),
        )

    def comments(self) -> str:
        """Return the comments at the top of a fitted file."""
        lines = [f"identified from {', '.join(self.sources)}; 95 % intervals, SI units"]
        if not self.complete:
            lines = ["INTERRUPTED: the best so far, not the result of an identification"]
        for name, one in self.parameters.items():
            low, high = (("-" if end is None else f"{end:.4g}") for end in (one.low, one.high))
            lines.append(f"{name}: {one.value:.5g} {one.unit}, from {low} to {high}")
        lines += [*self.unknown, *self.given]
        if self.posterior:
            lines.append(self.posterior.comment())
        if self.misfit:
            lines.append(f"MISFIT: {self.misfit.text}")
        return "".join(f"# {line}\n" for line in lines)

    def __repr__(self) -> str:
        """Say the fit in one line."""
        values = ", ".join(f"{name} {one.texts[0]}" for name, one in self.parameters.items())
        return f"Fit({len(self.runs)} runs: {values})"

    def report(self) -> str:
        """Return values, intervals, measurements and undetermined parameters as text."""
        lines = [f"{'parameter':<16} {'value':>14} {'low (95 %)':>14} {'high (95 %)':>14}"]
        for name, one in self.parameters.items():
            cells = " ".join(f"{text:>14}" for text in one.texts)
            quiet = one.determined or not (self.complete or one.doubt)
            lines.append(f"{name:<16} {cells}" + ("" if quiet else f"  {one.remark}"))
        lines += self.given
        lines.append("")
        for run in self.runs:
            hum = f", hum of {' and '.join(f'{f:g}' for f in run.mains)} Hz" if run.mains else ""
            lines.append(
                f"{run.source}: {run.steps} steps, "
                f"noise {format_si(run.noise, 'm', 3)} a sample{hum}"
            )
        for curve in self.curves:
            lines.append(f"{curve.source}: {curve.points} points")
        lines.append(f"deviance {self.deviance:.1f}")
        lines += self.unknown
        return "\n".join(lines)

    def to_frame(self) -> pandas.DataFrame:
        """Return a table with one row for each parameter, SI units; needs pandas."""
        found = list(self.parameters.values())
        names = ("name", "value", "low", "high", "unit", "determined")
        return frame({name: [getattr(one, name) for one in found] for name in names}, "parameter")

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw each measured run and its fit over time into axes of Matplotlib, or new ones."""
        lines = []
        for run in self.runs:
            t = run.t - run.t[0]
            lines += [
                (t, run.measured, ".", MEASURED, run.source),
                (t, run.measured - run.left, "-", SIMULATED, "fit"),
            ]
        return draw_lines(axes, lines, "time (s)", "position (m)")

    def _repr_html_(self) -> str:
        rows = [
            (one.name, *one.texts, "" if one.determined else one.remark)
            for one in self.parameters.values()
        ]
        heading = ("parameter", "value", "low (95 %)", "high (95 %)", "")
        return html_table("Identified parameters", rows, heading)

    def as_json(self) -> dict[str, Any]:
        """Return one object for JSON, SI units; low and high are null where there is none."""
        return {
            "parameters": {
                name: {
                    key: getattr(one, key) for key in ("value", "low", "high", "unit", "determined")
                }
                for name, one in self.parameters.items()
            },
            "correlations": {name: dict(row) for name, row in self.correlations.items()},
            "not_determined": list(self.unknown),
            "given": list(self.given),
            "noise": self.noise,
            "residual": self.residual,
            "deviance": self.deviance,
            "misfit": self.misfit.text if self.misfit else None,
            "notes": list(self.notes),
            "runs": [run.as_json() for run in self.runs],
            "curves": [one.as_json() for one in self.curves],
            "complete": self.complete,
        }


def _mean_square(values: list[float]) -> float | None:
    if not values:
        return None
    return math.sqrt(sum(value * value for value in values) / len(values))
