# SPDX-License-Identifier: Apache-2.0
"""Curves of the page: a settled step, steps over three parameters, a measured step laid over them.

Every answer is computed anew: a few hundred drive cycles of some microseconds each.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.reporting import format_si, scale_of, to_json
from stickslip_ros.base.reporting.page import thin_columns
from stickslip_ros.cli.pages.compared import PHASES
from stickslip_ros.cli.workbench.controls import recipes, set_names, shown_values
from stickslip_ros.measurement.steps.analysis import runs_of
from stickslip_ros.measurement.steps.drive import Drive
from stickslip_ros.measurement.steps.record import TraceError
from stickslip_ros.measurement.steps.run import main_run
from stickslip_ros.physics.model import Plant, drive_of
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.physics.solver import Simulation
from stickslip_ros.simulation.left_out import OF_A_CYCLE, left_out
from stickslip_ros.simulation.motion import Motion
from stickslip_ros.simulation.phases import points
from stickslip_ros.simulation.sampling import sample_times
from stickslip_ros.simulation.settled import TRIAL_STEPS
from stickslip_ros.simulation.steps import run_steps
from stickslip_ros.simulation.sweep_plan import Sweep, SweepAxis
from stickslip_ros.simulation.trace import Trace

#: The parameters that steps are drawn over: from, to, whether by factors, points of the curve.
#: Over the frequency a slip meets the ringing of the last one, so that curve has many turns.
_RANGES = {
    "preload": (0.05, 8.0, True, 33),
    "amplitude": (1.0, 300.0, False, 25),
    "frequency": (10.0, 20e3, True, 81),
}
#: Points of the lines of the step.
_SAMPLES = 900
#: Samples in a period of the ringing.
_DENSITY = 40.0
#: Periods of ringing that the closer look at a slip shows.
_SWINGS = 4.0
_NANO = 1e9
#: Periods that a drawn step holds: a cycle, its slip, and the ringing after it.
SPAN = 1.25
#: Places in a step at which the cycles are put together, at most; points that are drawn.
_GRID, _SHOWN = 10_000, 700


@dataclass(frozen=True)
class Overlay:
    """The mean settled step of the longest run in a measurement."""

    source: str
    frequency: float  #: of the drive, Hz
    direction: int  #: +1 or -1
    steps: int  #: of the run
    step_size: float  #: m, with the sign of the direction
    step_error: float  #: its standard error, m
    t: Array  #: since the start of the cycle, s, shape (places,)
    x: Array  #: m, shape (places,)
    motion: Motion  #: the whole measurement

    @classmethod
    def of(cls, motion: Motion, frequency: float | None = None) -> Overlay:
        """Return the overlay of a measurement; frequency (Hz): of the drive, if it is known.

        Raises TraceError where the measurement shows no steps.
        """
        runs = runs_of(motion, Drive.given(frequency))
        try:
            run = main_run(runs)
        except TraceError:
            raise TraceError(f"no steps are found in {motion.source}") from None
        starts = run.starts
        period = run.period
        per_cycle = int(np.searchsorted(motion.t, starts[0] + period)) - int(
            np.searchsorted(motion.t, starts[0])
        )
        grid = np.linspace(0.0, SPAN * period, int(np.clip(SPAN * per_cycle, 16, _GRID)))
        # Without the last cycle, which no other follows.
        kept = [s for s in starts[:-1] if motion.t[0] <= s and s + grid[-1] <= motion.t[-1]]
        kept = kept[min(run.first_cycle, len(kept) - 1) :] if kept else []
        if not kept:
            raise TraceError(f"{motion.source} shows no whole drive cycle")
        laid = [np.interp(s + grid, motion.t, motion.x) for s in kept]
        mean = np.mean([one - one.mean() for one in laid], axis=0)
        return cls(
            motion.source, run.frequency, run.direction, run.steps,
            run.step_size, run.step_size_error, grid, mean, motion,
        )  # fmt: skip

    def laid_over(self, t: Array, x: Array, window: tuple[float, float]) -> tuple[Array, Array]:
        """Return times (s) and positions (m) at the level of a simulated step, within a window.

        t (s) and x (m), shape (samples,), are those of the simulated step. The zero of a sensor
        means nothing, so the level is that of the least squares.
        """
        level = float(np.mean(np.interp(self.t, t, x) - self.x))
        kept = (self.t >= window[0]) & (self.t <= window[1])
        at, laid = thin_columns(self.t[kept], self.x[kept] + level, count=_SHOWN)
        return at, laid


def curves(p: Parameters, overlay: Overlay | None = None) -> dict[str, Any]:
    """Return everything that the page shows for a set of parameters, ready for JSON.

    Raises ParameterError where they describe no axis, SolverError where it cannot be solved.
    """
    direction = overlay.direction if overlay else 1
    run = run_steps(p, direction * TRIAL_STEPS)
    plant = Plant.of(p)
    ringing = float(plant.ringing_frequency)
    numbers = {
        "step size": format_si(run.step_size, "m"),
        "backstep": format_si(run.backstep, "m"),
        "mean speed": f"{1e6 * run.step_size * p.drive.frequency:.4g} µm/s",
        "ringing": f"{ringing:.4g} Hz" if 0.0 < ringing < math.inf else "none",
    }
    if overlay:
        numbers["step measured"] = format_si(overlay.step_size, "m", uncertainty=overlay.step_error)
    return {
        **_step(p, direction, overlay),
        "over": {name: _steps_over(p, name, direction) for name in _RANGES},
        "numbers": numbers,
        "left_out": list(left_out(p, OF_A_CYCLE)),
        "values": shown_values(p),
        "set": set_names(p),
        "copy": recipes(p, direction),
    }


def settled_step(p: Parameters, direction: int) -> tuple[Trace, dict[str, float]]:
    """Return the trace of a settled drive cycle and the one after it, with its points A to F.

    Times count from the start of the cycle, displacements from there. Raises ParameterError.
    """
    plant = Plant.of(p)
    drive_cycle = drive_of(p, direction)
    simulation = Simulation(plant, p.solver.tolerance)
    simulation.start(drive_cycle, TRIAL_STEPS)
    simulation.run_cycles(TRIAL_STEPS - 2)
    start, state = simulation.t, simulation.state
    within = sample_times(drive_cycle, _DENSITY * plant.ringing_frequency)
    t = np.concatenate((start + within, start + drive_cycle.period + within))
    t = t[np.concatenate((np.diff(t) > 0.0, [True]))]
    s = simulation.sample(t)
    trace = Trace(t - start, s.x - state.x, s.v, s.u - state.u, s.z, s.v - s.rate, s.force)
    return trace, points(trace, drive_cycle, plant.contact, 0)


def _step(p: Parameters, direction: int, overlay: Overlay | None) -> dict[str, Any]:
    """Return a settled step as a whole, and its slip closer: each with phases and points."""
    trace, marks = settled_step(p, direction)
    period, slip = 1.0 / p.drive.frequency, marks["C"]
    ringing = float(Plant.of(p).ringing_frequency)
    after = _SWINGS / ringing if 0.0 < ringing < math.inf else 0.1 * period
    after = min(max(after, 3.0 * drive_of(p, direction).slip_duration), SPAN * period - slip)
    windows = {"step": (0.0, SPAN * period), "slip": (slip - 0.25 * after, slip + after)}
    return {
        name: _window(trace, marks, window, overlay, after if name == "slip" else period)
        for name, window in windows.items()
    }


def _window(
    trace: Trace,
    marks: dict[str, float],
    window: tuple[float, float],
    overlay: Overlay | None,
    width: float,
) -> dict[str, Any]:
    """Return the lines within a window of time (s), in nm and a unit of time that suits width."""
    factor, unit = scale_of(width, "s")
    start, end = window
    kept = (trace.t >= start) & (trace.t <= end)
    t, x, u = thin_columns(trace.t[kept], trace.x[kept], trace.u[kept], count=_SAMPLES)
    found: dict[str, Any] = {
        "unit": unit,
        "t": _listed(factor * t, 6),
        "x": _listed(_NANO * x, 3),
        "u": _listed(_NANO * u, 3),
        "phases": [
            {"from": factor * max(marks[a], start), "to": factor * min(marks[b], end),
             "name": name, "tint": tint}
            for a, b, name, tint in PHASES
            if marks[a] < end and marks[b] > start
        ],
        "points": [
            {"name": name, "t": factor * at, "x": _NANO * float(np.interp(at, trace.t, trace.x))}
            for name, at in marks.items()
            if start <= at <= end
        ],
    }  # fmt: skip
    if overlay:
        at, measured = overlay.laid_over(trace.t, trace.x, window)
        found["measured"] = {"t": _listed(factor * at, 6), "x": _listed(_NANO * measured, 3)}
    return found


def _steps_over(p: Parameters, name: str, direction: int) -> dict[str, list[float | None]]:
    """Return the step size (nm) over the values of a parameter, None where no axis is possible."""
    low, high, log, count = _RANGES[name]
    at = float(p.flat()[name])
    if name == "amplitude":
        high = p.actuator.max_voltage
    elif name == "frequency":
        high = min(high, p.drive.max_frequency)
    low, high = min(low, at), max(high, at)
    values = np.geomspace(low, high, count) if log else np.linspace(low, high, count)
    values = np.unique(np.clip(np.append(values, at), low, high))
    plan = Sweep(p, (SweepAxis.of(name, values),), ("step_size",), TRIAL_STEPS)
    size = direction * plan.evaluate(0, len(values))[:, 0]
    here = int(np.searchsorted(values, at))
    return {
        "x": _listed(values, 6),
        "y": _listed(_NANO * size, 3),
        "now": [at, *_listed(_NANO * size[here : here + 1], 3)],
    }


def _listed(values: Array, places: int) -> list[float | None]:
    return to_json(np.round(values, places))
