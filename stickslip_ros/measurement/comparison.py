# SPDX-License-Identifier: Apache-2.0
"""Comparison of a run with a measurement of the same motion."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.reporting import (
    MEASURED,
    SIMULATED,
    draw_lines,
    format_si,
    html_table,
    to_json,
)
from stickslip_ros.base.reporting.tables import Cell, frame
from stickslip_ros.base.reporting.terminal import format_rows, style_text
from stickslip_ros.measurement.alignment import align
from stickslip_ros.measurement.metric import LIMITS, WHOLE, ComparisonMetric, most_different
from stickslip_ros.measurement.metrics import RunPair, pair_runs, runs_in
from stickslip_ros.measurement.motion_pair import Alignment, Fits, MotionPair
from stickslip_ros.measurement.steps.analysis import determined_part, runs_of, why_left_out
from stickslip_ros.measurement.steps.drive import Drive
from stickslip_ros.measurement.steps.noise import noise_of
from stickslip_ros.measurement.steps.run import Run, main_run
from stickslip_ros.simulation.motion import Motion

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

_HEADING = ("metric", "run", "measured", "difference", "tolerance")
_STYLED = {"differs": ("DIFFERS", "bold red"), "agrees": ("agrees", "green")}


@dataclass(frozen=True, repr=False)
class Comparison:
    """Result of a comparison; the measurement is without zero and gain of its sensor."""

    run: Motion
    measurement: Motion
    pairs: list[RunPair]  #: each run of steps of the measurement, one at least
    fits: Fits
    alignment: Alignment
    t: Array  #: the instants compared, by the clock of the run, s
    x: Array  #: position of the run, m
    measured: Array  #: position measured, m
    rmse: float  #: root mean square difference over the time in common, m
    step_rmse: float  #: part of it that adds up from step to step, m; nan without steps
    shape_rmse: float  #: part of it within the cycles, m; rmse^2 = step_rmse^2 + shape_rmse^2
    shape_difference: Array  #: measured minus run without the mean of each cycle, m
    slips: Array  #: where cycles end, by the clock of the run, s, (cycles,)
    largest: float  #: largest difference, m
    largest_at: float  #: and when, s
    normalised: float  #: rmse as part of the range of the run
    noise: float  #: standard deviation of the sensor's noise, m

    @property
    def difference(self) -> Array:
        """Measured minus run, m."""
        return self.measured - self.x

    @property
    def metrics(self) -> list[ComparisonMetric]:
        """Each metric of the run of steps in which it is worst, of those that are compared."""
        return most_different([one.metrics for one in self.pairs if not one.left_out])

    @property
    def differing(self) -> list[str]:
        """Names of the metrics that differ, in any of the runs of steps."""
        return [metric.name for metric in self.metrics if metric.differs]

    @property
    def runs(self) -> list[Run]:
        """Runs of the measurement."""
        return [one.measured for one in self.pairs if one.measured is not None]

    @property
    def main(self) -> RunPair:
        """The run with most steps in both motions."""
        return max(self.pairs, key=lambda one: 0 if one.run is None else one.run.steps)

    def judge(self, allowed: Mapping[str, float]) -> list[ComparisonMetric]:
        """Return what is held against limits, by the names of `LIMITS`; SI units.

        A metric has to be known in all runs of steps; of those that are, the worst is returned.
        """
        sizes = (self.rmse, self.step_rmse, self.shape_rmse, self.largest, self.normalised,
                 self.alignment.offset)  # fmt: skip
        rows = [
            replace(row, run=0.0, measured=size, tolerance=0.0)
            for row, size in zip(WHOLE, sizes, strict=True)
        ]
        for pair in self.pairs:
            doubts = "; ".join(pair.measured.doubts) if pair.measured else ""
            why = f"{pair.name}, is not determined: {doubts}"
            rows += [
                replace(one, why_missing=why) if doubts and math.isfinite(one.difference) else one
                for one in pair.metrics
            ]
        found = []
        for limit in filter(allowed.__contains__, LIMITS):
            held = [replace(one, allowed=allowed[limit]) for one in rows if one.limit == limit]
            found.append(max(held, key=lambda one: (bool(one.unknown), abs(one.difference))))
        return found

    def notes(self) -> list[str]:
        """Return how the two were brought together, in words."""
        coarser = MotionPair(self.run, self.measurement).on_measurement
        base, other = ("measurement", "run") if coarser else ("run", "measurement")
        notes = [
            f"compared on {len(self.t)} samples of the {base}, the coarser of the two; "
            f"the {other} is interpolated"
        ]
        again = self.alignment.other_offset
        if again is not None and self.fits.offset:
            notes.append(
                f"steps repeat: a clock offset of {again:.9g} s fits about as well; of such "
                "offsets the one with most time in common is taken"
            )
        notes += [
            f"different number of steps: {int(count.run)} and {int(count.measured)}; they are "
            f"compared from {self.t[0]:.6g} s to {self.t[-1]:.6g} s of the run, where it makes "
            f"{one.run.steps} of them; the other values are means of each, compared as far as both "
            "are settled"
            for one in self.pairs
            if one.run is not None and (count := one.metrics[-1]).differs
        ]
        if len(self.pairs) > 1:
            notes += [f"{one.name}: {one.verdict}" for one in self.pairs]
            notes.append("each metric is that of the run of steps in which it is worst")
        return notes

    @property
    def summary(self) -> list[tuple[str, str, str]]:
        """Name, value and remark of the differences and of what was fitted, as people read them."""
        place, fits = self.alignment, self.fits
        lengths = [
            ("RMSE", self.rmse, f"{100.0 * self.normalised:.3g} % of the range"),
            ("RMSE of the steps", self.step_rmse, "adds up from step to step"),
            ("RMSE of the shape", self.shape_rmse, "within the cycles"),
            ("largest difference", self.largest, f"at {format_si(self.largest_at, 's', 6)}"),
            ("sensor noise", self.noise, "standard deviation"),
        ]
        rows = [(name, format_si(size, "m"), remark) for name, size, remark in lengths]
        if fits.offset:
            offset = format_si(place.offset, "s", uncertainty=place.offset_error)
            rows.append(("clock offset", offset, "time of the measurement less that of the run"))
        if fits.drift:
            rows.append(("clock drift", f"{1e6 * place.drift:.4g} ppm", "fitted"))
        if fits.gain:
            rows.append(("sensor gain", f"{place.gain:.6g}", "fitted"))
        return rows

    def report(self) -> str:
        """Return differences, metrics and how they were determined as text."""
        rows = [(name, f"{value}, {remark}") for name, value, remark in self.summary]
        lines = [format_rows(rows, 18), "", "{:<18} {:>12} {:>12} {:>12} {:>12}".format(*_HEADING)]
        for metric in self.metrics:
            row = f"{metric.name:<18} "
            if math.isfinite(metric.tolerance):
                row += " ".join(f"{text:>12}" for text in metric.texts) + "  "
            styled = _STYLED.get(metric.verdict)
            lines.append(row + (style_text(*styled) if styled else metric.verdict))
        return "\n".join([*lines, "", *self.notes()])

    @property
    def table(self) -> tuple[tuple[str, ...], list[list[Cell]]]:
        """Heading and a row for each metric, SI units."""
        names = ("unit", "run", "measured", "difference", "tolerance", "verdict")
        rows = [[one.name, *(getattr(one, name) for name in names)] for one in self.metrics]
        return ("metric", *names), rows

    def to_frame(self) -> pandas.DataFrame:
        """Return `table`, its first column being called name; needs pandas."""
        (_, *names), rows = self.table
        return frame(dict(zip(("name", *names), zip(*rows, strict=True), strict=True)), "metric")

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw run and measurement over time into axes of Matplotlib, or new ones; return them."""
        lines = [
            (self.t, self.measured, ".", MEASURED, "measured"),
            (self.t, self.x, "-", SIMULATED, "run"),
        ]
        return draw_lines(axes, lines, "time (s)", "position (m)")

    def __repr__(self) -> str:
        """Say the result in one line."""
        differing = ", ".join(self.differing) or "nothing"
        return (
            f"Comparison({self.run.source} and {self.measurement.source}: rmse "
            f"{format_si(self.rmse, 'm')}, noise {format_si(self.noise, 'm')}; {differing} differs)"
        )

    def _repr_html_(self) -> str:
        rows = [(one.name, *one.texts, one.verdict) for one in self.metrics]
        sizes = format_si(self.rmse, "m"), "noise", format_si(self.noise, "m")
        title = f"{self.run.source} and {self.measurement.source}"
        return html_table(title, [*rows, ("rmse", *sizes, "", "")], (*_HEADING, ""))

    def as_json(self) -> dict[str, Any]:
        """Return the results for JSON, SI units, None for unknown values."""
        of_pairs = []
        for pair in self.pairs:
            seen, metrics = pair.measured, {one.name: one.as_json() for one in pair.metrics}
            told = {"start": seen and seen.start, "direction": seen and seen.direction}
            of_pairs.append({**told, "steps": seen.steps if seen else 0, "metrics": metrics})
        found = {
            **{one: getattr(self, one) for one in ("rmse", "step_rmse", "shape_rmse", "noise")},
            "max_error": self.largest,
            "max_error_at": self.largest_at,
            "normalised_error": self.normalised,
            "samples": len(self.t),
            **{one: getattr(self.alignment, one) for one in ("offset", "drift", "level", "gain")},
            "offset_uncertainty": self.alignment.offset_error,
            "metrics": {metric.name: metric.as_json() for metric in self.metrics},
            "by_run": of_pairs,
            "steps": sum(p.measured.steps for p in self.pairs if p.measured and not p.left_out),
            "runs": [run.as_json() for run in self.runs],
            "differing": self.differing,
            "notes": self.notes(),
        }
        return to_json(found)


def compare_motions(
    run: Motion,
    measurement: Motion,
    fits: Fits | None = None,
    runs: Sequence[Run] | None = None,
    period: float | None = None,
    drive: Drive | None = None,
) -> Comparison:
    """Compare a run and a measurement of the same motion. Raises ComparisonError.

    runs are those of the measurement, if they were looked for, else drive is what is known of it;
    period (s) is that of the parameters where the run was simulated at the frequency that the
    measurement shows.
    """
    found_runs = runs_of(measurement, drive) if runs is None else list(runs)
    measurement, shown = determined_part(measurement, found_runs)
    fits, motions = fits or Fits(), MotionPair(run, measurement)
    own = runs_in(run, main_run(shown).frequency) if shown else []
    alignment = align(motions, fits, own, shown)
    pairs = motions.at(alignment)
    run_pairs = pair_runs(motions, own, shown, alignment, pairs, period)
    measured = (pairs.measured - alignment.level) / alignment.gain
    difference = measured - pairs.run
    weights = pairs.weights
    rmse = math.sqrt(float(weights @ difference**2))
    slips = alignment.run_time(np.concatenate([np.empty(0), *(one.slips for one in shown)]))
    # The mean difference of each cycle, of slip to slip or of a rest, grows by that of the step
    # sizes in every cycle. What is left is the shape: backstep, ringing, rise. Both are orthogonal.
    cycle = np.searchsorted(slips, pairs.t, side="right")
    sums = [np.bincount(cycle, one) for one in (weights * difference, weights)]
    level = (sums[0] / np.maximum(sums[1], 1e-300))[cycle]
    of_steps = math.sqrt(float(weights @ level**2)) if len(slips) else math.nan
    left_out, their = why_left_out(found_runs, shown), iter(run_pairs)
    every_pair = [
        RunPair.without_run(one, f"left out: {why}", left_out=True) if why else next(their)
        for one, why in zip(found_runs, left_out, strict=True)
    ]
    span = float(np.ptp(pairs.run))
    worst = int(np.argmax(np.abs(difference)))
    return Comparison(
        run=run,
        measurement=measurement,
        pairs=every_pair or run_pairs,
        fits=fits,
        alignment=alignment,
        t=pairs.t,
        x=pairs.run,
        measured=measured,
        rmse=rmse,
        step_rmse=of_steps,
        shape_rmse=math.sqrt(max(rmse**2 - of_steps**2, 0.0)) if len(slips) else math.nan,
        shape_difference=difference - level,
        slips=slips,
        largest=float(abs(difference[worst])),
        largest_at=float(pairs.t[worst]),
        normalised=rmse / span if span > 0.0 else math.nan,
        noise=noise_of(measurement.x) / alignment.gain,
    )
