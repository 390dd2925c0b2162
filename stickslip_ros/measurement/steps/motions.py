# SPDX-License-Identifier: Apache-2.0
"""The steps of a motion, by its actuator or a clock where these are known, else as found."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.reporting import format_si
from stickslip_ros.measurement.steps.actuator_cycles import (
    SHORT,
    cycles_of_actuator,
    cycles_of_clock,
    stretches_of_actuator,
)
from stickslip_ros.measurement.steps.analysis import find_steps
from stickslip_ros.measurement.steps.doubts import too_few_samples
from stickslip_ros.measurement.steps.known_cycles import analyse_cycles
from stickslip_ros.measurement.steps.measured_value import COVERAGE
from stickslip_ros.measurement.steps.record import (
    FEWEST_SAMPLES,
    ImplausibleError,
    TraceError,
    check_count,
)
from stickslip_ros.measurement.steps.run import Cycles, Run, main_run
from stickslip_ros.measurement.steps.settings import SETTINGS
from stickslip_ros.simulation.motion import Motion

#: Part of the actuator's stroke that a step never exceeds, gains of both sensors included.
_OUTRUN = 1.1
#: Part of a cycle by which slips may be away from where a start that is given has them.
_OFF_CLOCK = 0.1


def analyse_steps(
    t: ArrayLike,
    x: ArrayLike,
    u: ArrayLike | None = None,
    *,
    frequency: float | None = None,
    start: float | None = None,
    excitation: float | None = None,
    zero_amplitude: float | None = None,
) -> Run:
    """Analyse the steps of a trace; of several runs, the longest.

    Parameters
    ----------
    t, x, u : array_like
        Times (s), runner (m) and, where it was measured, actuator (m), of shape (samples,). A
        moving actuator gives the cycles; otherwise the runs of steps are searched for.
    frequency, start : float, optional
        Drive frequency (Hz) and start of the first cycle (s), found where they are not given.
    excitation, zero_amplitude : float, optional
        For Eq. 9: deflection of the actuator (m, peak to peak; that of u if not given), and the
        0-amplitude (m) measured on its own.

    Returns
    -------
    Run
        Steps, backsteps and ringing.

    Raises
    ------
    TraceError
        The trace cannot be read, has no steps, or none of the frequency given.
    """
    time, position, actuator = _checked(t, x, u)
    run = _analyse(time, position, actuator, frequency, start)
    return replace(
        run,
        excitation=run.excitation if excitation is None else excitation,
        zero_amplitude=math.nan if zero_amplitude is None else zero_amplitude,
    )


def find_runs(t: Array, x: Array, frequency: float | None = None) -> list[Run]:
    """Return the runs of steps in a measurement, none where there are no steps.

    t (s) increases, x is in m, both (samples,); frequency (Hz) is that of the drive if it is known.
    """
    if len(t) < FEWEST_SAMPLES or not np.ptp(x) > 0.0:
        return []
    return find_steps(t, x, frequency).runs


def has_actuator(u: Array | None) -> TypeGuard[Array]:
    """Return True if the deflection u (m) of an actuator was measured and moves."""
    return u is not None and len(u) > 0 and bool(np.ptp(u) > 0.0)


def runs_of(
    motion: Motion,
    runs: Sequence[Run] | None = None,
    frequency: float | None = None,
    start: float | None = None,
) -> list[Run]:
    """Return the runs of a motion in the order of time, from its actuator if that shows cycles.

    runs are those found in its position, if these were searched for; they are taken where they are
    determined and those of the actuator are not, as where it moves at several amplitudes. A
    frequency (Hz) and the start of the first cycle (s) are those of a single run. Raises
    ImplausibleError.
    """
    by_actuator: list[Run] = []
    if has_actuator(motion.u):
        try:
            by_actuator = runs_of_actuator(motion.t, motion.x, motion.u, frequency, start)
        except ImplausibleError:
            raise
        except TraceError:  # it shows no whole cycle: the position may
            pass
        if any(one.determined for one in by_actuator):
            return by_actuator
    found = find_runs(motion.t, motion.x, frequency) if runs is None else list(runs)
    if any(one.determined for one in found):
        return found
    return max(by_actuator, found, key=lambda one: sum(run.steps for run in one))


def determined_part(motion: Motion, runs: Sequence[Run]) -> tuple[Motion, list[Run]]:
    """Return the part of a motion without its runs that are not determined, and its other runs.

    Of several such parts, that with most steps; all of the motion where no run is determined.
    """
    if all(one.determined for one in runs) or not any(one.determined for one in runs):
        return motion, list(runs)
    edges = [-1, *(k for k, one in enumerate(runs) if not one.determined), len(runs)]
    before, after = max(
        pairwise(edges), key=lambda edge: sum(one.steps for one in runs[edge[0] + 1 : edge[1]])
    )
    begin = runs[before].end if before >= 0 else -math.inf
    end = runs[after].start if after < len(runs) else math.inf
    return motion.between(begin, end), list(runs[before + 1 : after])


def why_left_out(runs: Sequence[Run], kept: Sequence[Run]) -> list[str]:
    """Return of each run why it is in no part that is determined; "" for those kept."""
    return [
        ""
        if any(one is other for other in kept)
        else "; ".join(one.doubts) or "beyond a run that is not determined"
        for one in runs
    ]


def _analyse(
    t: Array, x: Array, u: Array | None, frequency: float | None, start: float | None
) -> Run:
    if has_actuator(u):
        runs = runs_of(Motion("trace", t, x, None, u), None, frequency, start)
        return main_run(runs or runs_of_actuator(t, x, u, frequency, start))  # it says why not
    if frequency is None or start is None:
        found = find_steps(t, x, frequency)
        runs = found.runs if frequency is None else found.at(frequency)
        if found.runs and not runs:
            seen = ", ".join(f"{one.frequency:.6g} Hz" for one in found.runs)
            raise TraceError(
                f"no run of steps is seen at the {frequency:g} Hz given (seen: {seen})"
            )
        run = main_run(runs)
        if start is None:
            return run
        return _at_clock(t, x, run.period, start, run)
    return _at_clock(t, x, 1.0 / frequency, start, None)


def runs_of_actuator(
    t: Array, x: Array, u: Array, frequency: float | None = None, start: float | None = None
) -> list[Run]:
    """Return the runs whose cycles an actuator shows: times t (s), runner x and actuator u (m).

    A frequency (Hz) and the start of the first cycle (s) are those of a single run. Raises
    TraceError where it shows no whole cycle, and where the runner outruns it.
    """
    stretches = [slice(0, len(t))]
    if frequency is None and start is None:
        stretches = stretches_of_actuator(t, u)
    runs, whys = [], []
    for one in stretches:
        try:
            cycles = cycles_of_actuator(t[one], u[one], frequency, start)
        except TraceError as error:
            whys.append(error)
        else:
            runs.append(_of_actuator(t[one], x[one], u[one], cycles))
    if not runs:
        raise whys[0]
    return runs


def _of_actuator(t: Array, x: Array, u: Array, cycles: Cycles) -> Run:
    run = analyse_cycles(t, x, u, cycles)
    even = cycles.slips[0] + cycles.period * np.arange(run.steps)
    uneven = float(np.abs(cycles.slips - even).max())
    if uneven > SHORT * cycles.period + 2.0 * float(np.median(np.diff(t))):
        doubt = f"the actuator's slips are uneven by {uneven / cycles.period:.2g} of a period"
        run = replace(run, doubts=(*run.doubts, doubt))
    elif abs(run.step_size) > _OUTRUN * run.excitation + COVERAGE * run.step_size_error:
        raise ImplausibleError(
            f"the runner moves by {format_si(abs(run.step_size), 'm', 4)} a cycle and its "
            f"actuator by {format_si(run.excitation, 'm', 4)}, which it cannot outrun; is the "
            "unit of one of them another one (--units), or are columns swapped (--columns)?"
        )
    return _with_doubts(t, run)


def _at_clock(t: Array, x: Array, period: float, start: float, found: Run | None) -> Run:
    """Analyse the cycles of a clock, of which a search may have found some."""
    run = analyse_cycles(t, x, None, cycles_of_clock(t, x, period, start))
    if found is None:
        seen = [one for one in find_runs(t, x, 1.0 / period) if one.steps]
        found = max(seen, key=lambda one: one.steps, default=None)
    doubts: tuple[str, ...] = ()
    if found is not None:
        late = math.remainder(found.slips[0] - run.slips[0], period) / period
        if abs(late) > _OFF_CLOCK:
            doubts = (f"the runner falls {late:+.2f} of a cycle away from where cycles begin",)
        beside = ((run.slips < found.start - period) | (run.slips > found.end + period)).sum()
        if beside:
            doubts += (f"no slip is seen in {beside} of the {run.steps} cycles",)
    return _with_doubts(t, replace(run, doubts=doubts))


def _with_doubts(t: Array, run: Run) -> Run:
    """Return a run whose cycles are known, with doubts if its samples are too few."""
    samples = run.period / float(np.median(np.diff(t)))
    doubts = run.doubts
    if run.steps < SETTINGS.least_cycles:
        doubts += (f"{run.steps} cycles; {SETTINGS.least_cycles} are needed",)
    if round(samples, 1) < SETTINGS.least_samples_a_cycle:
        doubts += (too_few_samples(run.period, float(np.median(np.diff(t)))),)
    return replace(run, doubts=doubts)


def _checked(t: ArrayLike, x: ArrayLike, u: ArrayLike | None) -> tuple[Array, Array, Array | None]:
    time, position = np.asarray(t, dtype=np.float64), np.asarray(x, dtype=np.float64)
    actuator = None if u is None else np.asarray(u, dtype=np.float64)
    named = [("time", time), ("position", position)]
    named += [("actuator", actuator)] if actuator is not None else []
    for name, values in named:
        if values.shape != (len(time),):
            raise TraceError(f"{name} has shape {values.shape}; it has to be ({len(time)},)")
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            raise TraceError(f"{name} sample {bad[0]} is {values[bad[0]]}; leave such samples out")
    check_count(len(time))
    back = np.flatnonzero(np.diff(time) <= 0.0)
    if len(back):
        raise TraceError(
            f"time does not increase from sample {back[0]} ({time[back[0]]:g} s) to the next "
            f"({time[back[0] + 1]:g} s); sort the samples and remove duplicates"
        )
    if not np.ptp(position) > 0.0:
        raise TraceError("the runner does not move in the trace")
    return time, position, actuator
