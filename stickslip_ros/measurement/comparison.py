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
    align,
    on_samples_of_measurement,
    pair,
    time_weights,
)
from stickslip_ros.measurement.filtering import ORDER, filtered
from stickslip_ros.measurement.metrics import (
    Metric,
    error_of_steps_and_shape,
    level_of_cycles,
    step_metrics,
)
from stickslip_ros.reporting import html_table, plain, shown
from stickslip_ros.traces.cycles import TraceError
from stickslip_ros.traces.evenly import noise_of
from stickslip_ros.traces.motion import Motion
from stickslip_ros.traces.runs import Run, find_runs, main_run
from stickslip_ros.traces.step_analysis import StepAnalysis, analyse_steps

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
    run_steps: StepAnalysis | None
    measured_steps: StepAnalysis | None
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
    metrics: list[Metric]
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
    def differing(self) -> list[str]:
        """Names of the metrics that differ."""
        return [metric.name for metric in self.metrics if metric.differs]

    @property
    def _measured_count(self) -> int:
        return 0 if self.measured_steps is None else len(self.measured_steps.slips)

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
            "metrics": {
                metric.name: {
                    "unit": metric.unit,
                    "run": metric.run,
                    "measured": metric.measured,
                    "difference": metric.difference,
                    "tolerance": metric.tolerance,
                    "differs": metric.differs,
                    "why_missing": metric.why_missing or None,
                }
                for metric in self.metrics
            },
            "steps": sum(run.steps for run in self.runs) if self.runs else self._measured_count,
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
    if runs is None and measurement.u is None:
        runs = find_runs(measurement.t, measurement.x)
    run_steps, measured_steps = steps_of(run), steps_of(measurement, runs)
    alignment = align(run, measurement, fits, run_steps, measured_steps)
    pairs = pair(run, measurement, alignment)
    if cutoff is not None:
        pairs = filtered(pairs, cutoff)
    measured = (pairs.measured - alignment.level) / alignment.gain
    difference = measured - pairs.run
    weights = time_weights(pairs.t)
    rmse = math.sqrt(float(weights @ difference**2))
    slips = _slips_of(runs or (), run_steps, measured_steps, alignment)
    of_steps, of_shape = error_of_steps_and_shape(pairs.t, difference, slips, weights)
    span = float(np.ptp(pairs.run))
    worst = int(np.argmax(np.abs(difference)))
    return Comparison(
        run=run,
        measurement=measurement,
        run_steps=run_steps,
        measured_steps=measured_steps,
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
        runs=list(runs or ()),
        metrics=step_metrics(run, measurement, run_steps, measured_steps, alignment),
        cycles=_cycle_table(run_steps, measured_steps, alignment, pairs, difference),
    )


def _slips_of(
    runs: Sequence[Run],
    run_steps: StepAnalysis | None,
    measured_steps: StepAnalysis | None,
    alignment: Alignment,
) -> Array:
    """Return the slips (s, by the clock of the run) of all runs; empty without steps.

    Of one run, those of the simulation are the better known.
    """
    if len(runs) > 1:
        return alignment.run_time(np.concatenate([run.analysis.slips for run in runs]))
    if run_steps is not None:
        return run_steps.slips
    return np.empty(0) if measured_steps is None else alignment.run_time(measured_steps.slips)


def steps_of(motion: Motion, runs: Sequence[Run] | None = None) -> StepAnalysis | None:
    """Return the steps of a motion, those of its longest run; None if it has none.

    runs are those found in it, if they were looked for.
    """
    try:
        if motion.u is not None and np.ptp(motion.u) > 0.0:
            return analyse_steps(motion.t, motion.x, motion.u)
        runs = find_runs(motion.t, motion.x) if runs is None else runs
        return main_run(list(runs)).analysis
    except TraceError:
        return None


def _cycle_table(
    run_steps: StepAnalysis | None,
    measured_steps: StepAnalysis | None,
    alignment: Alignment,
    pairs: Pairs,
    difference: Array,
) -> CycleTable | None:
    if run_steps is None or measured_steps is None:
        return None
    slips = run_steps.slips
    there = alignment.run_time(measured_steps.slips)
    nearest = np.searchsorted(0.5 * (there[1:] + there[:-1]), slips)
    met = np.abs(there[nearest] - slips) < 0.25 * run_steps.period

    def matched(values: Array) -> Array:
        return np.where(met, values[nearest] / alignment.gain, np.nan)

    cycle = np.searchsorted(slips, pairs.t, side="right")
    count = np.bincount(cycle, minlength=len(slips) + 1)[: len(slips)]
    squares = np.bincount(cycle, difference**2, minlength=len(slips) + 1)[: len(slips)]
    with np.errstate(invalid="ignore"):
        rmse = np.sqrt(squares / count)
    return CycleTable(
        slips,
        run_steps.step_sizes,
        matched(measured_steps.step_sizes),
        run_steps.backsteps,
        matched(measured_steps.backsteps),
        rmse,
    )
