# SPDX-License-Identifier: Apache-2.0
"""A run and a measurement of the same motion: how far they are apart, and in what."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.measurement.alignment import (
    Alignment,
    Fits,
    Pairs,
    on_samples_of_measurement,
    pair,
    time_weights,
)
from stickslip_ros.measurement.filtering import ORDER, filtered
from stickslip_ros.measurement.metrics import (
    ComparisonMetric,
    error_of_steps_and_shape,
    level_of_cycles,
    most_different,
    step_metrics,
)
from stickslip_ros.measurement.run_pairs import (
    RunPair,
    align_runs,
    measured_runs,
    pair_runs,
)
from stickslip_ros.reporting import html_table, plain, shown
from stickslip_ros.traces.evenly import noise_of
from stickslip_ros.traces.motion import Motion
from stickslip_ros.traces.runs import Run
from stickslip_ros.traces.step_analysis import StepAnalysis

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CycleTable:
    """Cycle by cycle, each of shape (cycles,); nan where a thing cannot be determined."""

    slip: Array  #: begin of the slip by the clock of the run, s
    step: Array  #: of the run, m
    measured_step: Array  #: m
    backstep: Array  #: of the run, m
    measured_backstep: Array  #: m
    rmse: Array  #: root mean square difference from slip to slip, m


@dataclass(frozen=True, repr=False)
class Comparison:
    """What was found; zero and gain of its sensor are taken out of the measurement."""

    run: Motion
    measurement: Motion
    pairs: list[RunPair]  #: each run of steps in both, one at least
    fits: Fits
    cutoff: float | None  #: of the low-pass filter, Hz
    alignment: Alignment
    t: Array  #: the instants compared, by the clock of the run, s
    x: Array  #: position of the run, m
    measured: Array  #: position measured, m
    rmse: float  #: root mean square difference over the time in common, m
    step_rmse: float  #: part of it that adds up from step to step, m; nan without steps
    shape_rmse: float  #: part of it within the cycles, m; rmse^2 = step_rmse^2 + shape_rmse^2
    slips: Array  #: where cycles end, by the clock of the run, s, (cycles,)
    largest: float  #: largest difference, m
    largest_at: float  #: and when, s
    normalised: float  #: rmse as part of the range of the run
    noise: float  #: standard deviation of the sensor's noise, m
    runs: list[Run]  #: of the measurement; empty where the actuator shows its steps
    by_run: list[list[ComparisonMetric]]  #: the metrics of each of the pairs
    cycles: CycleTable | None

    @property
    def difference(self) -> Array:
        """Measured minus run, m."""
        return self.measured - self.x

    @property
    def shape_difference(self) -> Array:
        """Measured minus run without the mean of each cycle, m: what steps do not make."""
        levels = level_of_cycles(self.t, self.difference, self.slips, time_weights(self.t))
        return self.difference - levels

    @property
    def metrics(self) -> list[ComparisonMetric]:
        """Each metric of the run of steps in which it is worst."""
        return most_different(self.by_run)

    @property
    def differing(self) -> list[str]:
        """Names of the metrics that differ, in any of the runs of steps."""
        return [metric.name for metric in self.metrics if metric.differs]

    @property
    def main(self) -> RunPair:
        """The run with most steps in both motions."""
        return max(self.pairs, key=lambda one: 0 if one.run is None else len(one.run.slips))

    @property
    def run_steps(self) -> StepAnalysis | None:
        """Steps of `main` in the run, None if there are none."""
        return self.main.run

    @property
    def measured_steps(self) -> StepAnalysis | None:
        """Steps of `main` in the measurement, None if there are none."""
        return self.main.measured

    @property
    def _measured_count(self) -> int:
        return sum(0 if one.measured is None else len(one.measured.slips) for one in self.pairs)

    def notes(self) -> list[str]:
        """Return how the two were brought together, in words."""
        on_measurement = on_samples_of_measurement(self.run, self.measurement)
        base, other = ("measurement", "run") if on_measurement else ("run", "measurement")
        notes = [
            f"compared on {len(self.t)} samples of the {base}, the coarser of the two; "
            f"the {other} is interpolated"
        ]
        if self.cutoff is not None:
            notes.append(
                f"low-pass at {self.cutoff:g} Hz on both (Butterworth, order {ORDER}, forward and "
                "back: no delay); steps and ringing come from the unfiltered data"
            )
        again = self.alignment.other_offset
        if again is not None and self.fits.offset:
            notes.append(
                f"steps repeat: a clock offset of {again:.9g} s fits about as well; of such "
                "offsets the one with most time in common is taken"
            )
        if len(self.pairs) > 1:
            notes += [_verdict(*one) for one in zip(self.pairs, self.by_run, strict=True)]
            notes.append("each metric is that of the run of steps in which it is worst")
        return notes

    def __repr__(self) -> str:
        """Say the result in one line."""
        differing = ", ".join(self.differing) or "nothing"
        return (
            f"Comparison({self.run.source} and {self.measurement.source}: rmse "
            f"{shown(self.rmse, 'm')}, noise {shown(self.noise, 'm')}; {differing} differs)"
        )

    def _repr_html_(self) -> str:
        rows = [
            (
                metric.name,
                shown(metric.run, metric.unit, 5),
                shown(metric.measured, metric.unit, 5),
                shown(metric.tolerance, metric.unit, 3),
                "differs" if metric.differs else "agrees",
            )
            for metric in self.metrics
            if metric.differs is not None
        ]
        rows.append(("rmse", shown(self.rmse, "m"), "noise", shown(self.noise, "m"), ""))
        title = f"{self.run.source} and {self.measurement.source}"
        return html_table(title, rows, ("metric", "run", "measured", "tolerance", ""))

    def as_json(self) -> dict[str, Any]:
        """Return what JSON can hold, SI units, None for what cannot be determined."""
        found = {
            "rmse": self.rmse,
            "step_rmse": self.step_rmse,
            "shape_rmse": self.shape_rmse,
            "max_error": self.largest,
            "max_error_at": self.largest_at,
            "normalised_error": self.normalised,
            "noise": self.noise,
            "samples": len(self.t),
            "offset": self.alignment.offset,
            "offset_uncertainty": self.alignment.offset_error,
            "drift": self.alignment.drift,
            "level": self.alignment.level,
            "gain": self.alignment.gain,
            "metrics": _metrics_json(self.metrics),
            "by_run": [
                {
                    "start": math.nan if pair.measured is None else pair.measured.starts[0],
                    "direction": None if pair.measured is None else pair.measured.direction,
                    "steps": 0 if pair.measured is None else len(pair.measured.slips),
                    "metrics": _metrics_json(metrics),
                }
                for pair, metrics in zip(self.pairs, self.by_run, strict=True)
            ],
            "steps": self._measured_count,
            "runs": [run.as_json() for run in self.runs],
            "differing": self.differing,
            "cycles": None
            if self.cycles is None
            else {name: getattr(self.cycles, name).tolist() for name in vars(self.cycles)},
            "notes": self.notes(),
        }
        return plain(found)  # type: ignore[no-any-return]


def compare(
    run: Motion,
    measurement: Motion,
    fits: Fits | None = None,
    cutoff: float | None = None,
    runs: Sequence[Run] | None = None,
) -> Comparison:
    """Compare; cutoff (Hz) is that of a low-pass filter on both. Raises ComparisonError.

    runs are those of the measurement, if they were looked for.
    """
    fits = fits or Fits()
    shown_runs = measured_runs(measurement, runs)
    alignment = align_runs(run, measurement, fits, shown_runs)
    pairs = pair(run, measurement, alignment)
    run_pairs = pair_runs(run, measurement, shown_runs, alignment, pairs)
    if cutoff is not None:
        pairs = filtered(pairs, cutoff)
    measured = (pairs.measured - alignment.level) / alignment.gain
    difference = measured - pairs.run
    weights = time_weights(pairs.t)
    rmse = math.sqrt(float(weights @ difference**2))
    slips = _slips_of(run_pairs, alignment)
    of_steps, of_shape = error_of_steps_and_shape(pairs.t, difference, slips, weights)
    span = float(np.ptp(pairs.run))
    worst = int(np.argmax(np.abs(difference)))
    return Comparison(
        run=run,
        measurement=measurement,
        pairs=run_pairs,
        fits=fits,
        cutoff=cutoff,
        alignment=alignment,
        t=pairs.t,
        x=pairs.run,
        measured=measured,
        rmse=rmse,
        step_rmse=of_steps,
        shape_rmse=of_shape,
        slips=slips,
        largest=float(abs(difference[worst])),
        largest_at=float(pairs.t[worst]),
        normalised=rmse / span if span > 0.0 else math.nan,
        noise=noise_of(measurement.x) / alignment.gain,
        runs=[one.found for one in run_pairs if one.found is not None],
        by_run=[step_metrics(run, one, alignment) for one in run_pairs],
        cycles=_cycle_table(run_pairs, alignment, pairs, difference),
    )


def _metrics_json(metrics: Sequence[ComparisonMetric]) -> dict[str, Any]:
    return {
        metric.name: {
            "unit": metric.unit,
            "run": metric.run,
            "measured": metric.measured,
            "difference": metric.difference,
            "tolerance": metric.tolerance,
            "differs": metric.differs,
            "why_missing": metric.why_missing or None,
        }
        for metric in metrics
    }


def _verdict(pair: RunPair, metrics: Sequence[ComparisonMetric]) -> str:
    """Return in words what of one run of steps differs."""
    differing = ", ".join(metric.name for metric in metrics if metric.differs)
    if pair.run is None:
        return f"{pair.name}: {pair.why_missing}"
    return f"{pair.name}: {differing} differs" if differing else f"{pair.name}: agrees"


def _slips_of(pairs: Sequence[RunPair], alignment: Alignment) -> Array:
    """Return the slips (s, by the clock of the run) of all runs; empty without steps.

    Those of the run are the better known, those of the measurement stand in for them.
    """
    found = [np.empty(0)]
    for one in pairs:
        if one.run is not None:
            found.append(one.run.slips)
        elif one.measured is not None:
            found.append(alignment.run_time(one.measured.slips))
    return np.concatenate(found)


def _cycle_table(
    pairs: Sequence[RunPair], alignment: Alignment, samples: Pairs, difference: Array
) -> CycleTable | None:
    """Return the cycles of all runs that both motions show, None if there are none."""
    found = [
        _cycles_of(one.run, one.measured, alignment, samples, difference)
        for one in pairs
        if one.run is not None and one.measured is not None
    ]
    if not found:
        return None
    return CycleTable(*(np.concatenate(same) for same in zip(*found, strict=True)))


def _cycles_of(
    run: StepAnalysis,
    measured: StepAnalysis,
    alignment: Alignment,
    samples: Pairs,
    difference: Array,
) -> tuple[Array, ...]:
    """Return the columns of the `CycleTable` for one run."""
    slips = run.slips
    there = alignment.run_time(measured.slips)
    nearest = np.searchsorted(0.5 * (there[1:] + there[:-1]), slips)
    met = np.abs(there[nearest] - slips) < 0.25 * run.period

    def matched(values: Array) -> Array:
        return np.where(met, values[nearest] / alignment.gain, np.nan)

    edges = np.append(slips, slips[-1] + run.period)
    at = np.searchsorted(samples.t, edges)
    sums = np.concatenate(([0.0], np.cumsum(difference**2)))
    with np.errstate(invalid="ignore"):
        rmse = np.sqrt(np.diff(sums[at]) / np.diff(at))
    return (
        slips,
        run.step_sizes,
        matched(measured.step_sizes),
        run.backsteps,
        matched(measured.backsteps),
        rmse,
    )
