# SPDX-License-Identifier: Apache-2.0
"""The runs of steps in a measurement, from rest to rest, each with its numbers and their errors."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from stickslip_ros.arrays import Array
from stickslip_ros.errors import StickslipError
from stickslip_ros.motion.motion import Motion
from stickslip_ros.motion.settled import settled_from
from stickslip_ros.traces.cycle_fit import CLOCK
from stickslip_ros.traces.cycles import (
    FASTER,
    Cycles,
    TraceError,
    cycles_of_actuator,
    cycles_of_clock,
)
from stickslip_ros.traces.doubts import doubts_of, find_clipping, find_jumps, fit_ends, too_few
from stickslip_ros.traces.even_samples import (
    EvenSamples,
    SlipGrid,
    noise_of,
    resample_evenly,
    without_spikes,
)
from stickslip_ros.traces.folding import shorter_period
from stickslip_ros.traces.hum import HUMMING
from stickslip_ros.traces.joint_fit import Disturbances, fit_steps, without_disturbances
from stickslip_ros.traces.measured_value import COVERAGE, MeasuredValue
from stickslip_ros.traces.ringing import Ringing, find_onset, thin_samples
from stickslip_ros.traces.run_growth import count_falls, move_to_fall
from stickslip_ros.traces.run_search import (
    REPORTS,
    Report,
    fit_ringing_down,
    may_have_period,
    report_nothing,
    search_runs,
)
from stickslip_ros.traces.runs import Run, main_run
from stickslip_ros.traces.squares import Squares
from stickslip_ros.traces.step_analysis import analyse_cycles, ringing_after

#: Reports of a search for steps.
STAGES = REPORTS + 1
#: Part by which a run may be off a frequency that was given, as clocks and short runs are.
AS_GIVEN = 0.02
#: Samples in which runs are looked for, at least and at most; of more, neighbours are averaged.
_LEAST, _MOST = 32, 2**21
#: How many times steps, drift and hum are fitted at most, as the number of cycles changes.
_RECOUNTS = 2
#: Part of a period, and of a step, by which runs that follow each other differ if they are one.
_IN_STEP = 0.1
#: Cycles that may be no run where they show no step.
_FEW = 5
#: Periods of a run, from its begin and after its end, that its own analysis sees.
_BEFORE, _AFTER = 0.5, 0.98
#: Least periods of ringing in a cycle that show where the slips begin; periods by which slips may
#: begin earlier than they seem to.
_SWINGS, _EARLIER = 3.0, 1.3
#: Steps change if the means of two halves differ by this many standard deviations.
_CHANGED = 4.0
#: Part of a cycle by which slips may be away from where a start that is given has them.
_OFF_CLOCK = 0.1
#: Largest error of the last slip, in periods of ringing, at which the onsets give the period.
_SWUNG = 0.5


@dataclass(frozen=True)
class Findings:
    """The findings in a measurement: its runs, and the disturbances of the sensor."""

    runs: list[Run]
    disturbances: Disturbances

    def at(self, frequency: float) -> list[Run]:
        """Return the runs of a drive frequency (Hz)."""
        return [one for one in self.runs if abs(one.frequency / frequency - 1.0) < AS_GIVEN]


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
    with _no_steps_told():
        run = _analyse(time, position, actuator, frequency, start)
    return replace(
        run,
        excitation=run.excitation if excitation is None else excitation,
        zero_amplitude=math.nan if zero_amplitude is None else zero_amplitude,
    )


def has_actuator(u: Array | None) -> TypeGuard[Array]:
    """Return True if the deflection u (m) of an actuator was measured and moves."""
    return u is not None and len(u) > 0 and bool(np.ptp(u) > 0.0)


def runs_of(motion: Motion, runs: Sequence[Run] | None = None) -> list[Run]:
    """Return the runs of a motion in the order of time, from its actuator if that shows cycles.

    runs are those found in its position, if these were searched for.
    """
    if has_actuator(motion.u):
        try:
            return [analyse_steps(motion.t, motion.x, motion.u)]
        except TraceError:  # it steps both ways, or shows no whole cycle: its position may
            pass
    return find_runs(motion.t, motion.x) if runs is None else list(runs)


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
        return _at_clock(t, x, u, cycles_of_actuator(t, u, frequency, start))
    period = None if frequency is None else 1.0 / frequency
    if period is None or start is None:
        found = find_steps(t, x, period)
        runs = found.runs if frequency is None else found.at(frequency)
        if found.runs and not runs:
            seen = ", ".join(f"{one.frequency:.6g} Hz" for one in found.runs)
            raise TraceError(
                f"no run of steps is seen at the {frequency:g} Hz given (seen: {seen})"
            )
        run = main_run(runs)
        if start is None:
            return run
        period = run.period
    return _at_clock(t, x, u, cycles_of_clock(t, x, period, start))


def _at_clock(t: Array, x: Array, u: Array | None, cycles: Cycles) -> Run:
    """Analyse cycles that are known; few of them, or few samples in each, do not determine it."""
    run = analyse_cycles(t, x, u, cycles)
    doubts = too_few(run.steps, run.frequency, 1.0 / float(np.median(np.diff(t))))
    if u is None:
        grid = SlipGrid(cycles.slips[0], run.period, run.steps, run.direction, 0.0, 0.0)
        fall = move_to_fall(resample_evenly(t, x, _MOST), grid, within=1.0)
        late = math.remainder(fall.first - grid.first, grid.period) / grid.period
        if abs(late) > _OFF_CLOCK:
            doubts += (f"the runner falls {late:+.2f} of a cycle away from where cycles begin",)
    return replace(run, doubts=doubts)


def find_runs(t: Array, x: Array, period: float | None = None) -> list[Run]:
    """Return the runs of steps in a measurement, none where there are no steps.

    t (s) increases, x is in m, both (samples,); period (s) is that of the drive where it is known.
    """
    return find_steps(t, x, period).runs


def find_steps(
    t: Array, x: Array, period: float | None = None, report: Report = report_nothing
) -> Findings:
    """Return the runs in a measurement, and its drift and hum; arguments as of `find_runs`.

    report is called with each stage of the search, `STAGES` times where all are needed. Raises
    TraceError for a period that is longer than the record.
    """
    with _no_steps_told():
        return _find_steps(t, x, period, report)


@contextmanager
def _no_steps_told() -> Iterator[None]:
    """Raise TraceError where a record has a shape that the search does not foresee.

    No record is worth a traceback, whoever made it. `validation.campaigns.record_shapes` counts
    such an end as a fault.
    """
    try:
        yield
    except StickslipError:
        raise
    except (ArithmeticError, LookupError, ValueError) as error:
        raise TraceError(
            f"the search for steps cannot take a record of this shape ({error}); cut out the part "
            "with steps, and please report it with the record"
        ) from error


def _find_steps(t: Array, x: Array, period: float | None, report: Report) -> Findings:
    if len(t) < _LEAST or not np.ptp(x) > 0.0:
        return Findings([], Disturbances())
    if period is not None and t[-1] - t[0] < period:
        raise TraceError(
            f"the trace of {t[-1] - t[0]:g} s holds no whole cycle at {1.0 / period:g} Hz; "
            "correct the frequency or record a longer one"
        )
    rate = 1.0 / float(np.median(np.diff(t)))
    if period is not None and rate * period < 2.0:
        raise TraceError(
            f"{rate:.4g} samples a second show no cycles of {1.0 / period:.6g} Hz; {FASTER}"
        )
    noise = noise_of(x)
    kept = without_spikes(x, noise)
    t, x = t[kept], x[kept]
    clipping = find_clipping(x, noise)
    even = resample_evenly(t, x, _MOST, noise if kept.all() else None)
    seen = _search(even, period, report)
    report("steps")
    fitted = _fit_all(t, x, even, seen, period)
    if seen and fitted.disturbances.hums:  # it hides runs, and where slips begin
        x = x - fitted.disturbances.at(t, drift=False)
        others = _search(fitted.still, period, report_nothing) or seen
        again = _fit_all(t, x, even, others, period)
        squares = Squares(again.still)
        if squares.left(fitted.grids) < squares.left(again.grids):
            again = _fit_all(t, x, even, seen, period)
        fitted = again
    for _ in range(_RECOUNTS):
        seen = _recount(fitted)
        if [one.count for one in seen] == [one.count for one in fitted.grids]:
            break
        fitted = _fit_all(t, x, even, seen, period)
    jumps = find_jumps(x)
    runs = []
    for part, grid, estimate in zip(fitted.parts, fitted.grids, fitted.steps, strict=True):
        run = analyse_grid(t[part], x[part], grid, estimate)
        others = [one for one in fitted.grids if one is not grid]
        # Hum may have hidden it, and the onset bettered the period.
        less = _shorter(fitted.still, grid)
        given = period is not None
        doubts = doubts_of(fitted.still, grid, others, run.mean_step, less, run.ringing, given)
        runs.append(replace(run, doubts=(*clipping, *doubts, *(jumps if doubts else ()))))
    return Findings(runs, fitted.disturbances)


@dataclass(frozen=True)
class _Fitted:
    """Runs with their slips where they begin, and what is fitted to them."""

    parts: list[slice]  #: samples of each run
    grids: list[SlipGrid]
    ringings: list[Ringing | None]
    steps: list[MeasuredValue]  #: m
    disturbances: Disturbances
    still: EvenSamples  #: the measurement without the disturbances that are plainly there


def _fit_all(
    t: Array, x: Array, even: EvenSamples, seen: list[SlipGrid], period: float | None
) -> _Fitted:
    parts, grids, ringings = [], [], []
    for one in seen:
        last = min([even.end, *(other.begin for other in seen if other.first > one.end)])
        after = min(one.end + _AFTER * one.period, last)
        part = slice(*np.searchsorted(t, [one.begin - _BEFORE * one.period, after]))
        grid, ringing = _with_onset(t[part], x[part], one, period)
        parts.append(part)
        grids.append(grid)
        ringings.append(ringing)
    steps, found = fit_steps(even, grids, ringings)
    return _Fitted(parts, grids, ringings, steps, found, without_disturbances(even, found))


def _recount(fitted: _Fitted) -> list[SlipGrid]:
    """Return the runs with the cycles that are likely once drift and hum are left out.

    A run whose cycles have no more in common than chance makes is none, nor are a guess or a few
    cycles without a step beside a run.
    """
    grids, still, squares = fitted.grids, fitted.still, Squares(fitted.still)
    found = []
    clear = [abs(step.value) > COVERAGE * step.error for step in fitted.steps]
    for grid, ringing, is_clear in zip(grids, fitted.ringings, clear, strict=True):
        others = [one for one in grids if one is not grid]
        doubtful = not is_clear and (not grid.explained or grid.count <= _FEW)
        if (doubtful and any(clear)) or not squares.repeats(grid) > 0.0:
            continue
        if ringing is None:
            found.append(squares.settle_ends(grid, others))
            continue
        fit = fit_ends(still, grid, others, ringing, equal=True)
        first, last = (0, -1) if fit is None else fit.extent()
        if last > first:
            begin = grid.first + first * grid.period
            grid = replace(grid, first=begin, count=last - first + 1)
        found.append(grid)
    return _join(found)


def _join(grids: list[SlipGrid]) -> list[SlipGrid]:
    """Return runs, those made one that follow each other in step and get about as far each time."""
    found: list[SlipGrid] = []
    for grid in grids:
        before = found[-1] if found else grid
        gap = abs(grid.begin - before.end) + abs(grid.period - before.period)
        far = abs(grid.step - before.step)
        if (
            found
            and max(gap / grid.period, far / grid.step) < _IN_STEP
            and (grid.direction == before.direction)
        ):
            count = before.count + grid.count
            apart = (grid.end - before.first) / (count - 1)
            found[-1] = replace(before, period=apart, count=count)
        else:
            found.append(grid)
    return found


def _search(even: EvenSamples, period: float | None, report: Report) -> list[SlipGrid]:
    """Return the runs.

    They are searched for again at a shorter period at which they would repeat better, if that then
    shows them. Where a run of a given one does not explain the motion, or a shorter one does, what
    is found without it counts if that is of the period given; and if nothing explains the motion at
    it, or at whole parts of it.
    """
    seen = search_runs(even, period, report)
    longest = sorted(seen, key=lambda one: one.begin - one.end)
    better = next((less for one in longest if (less := _shorter(even, one)) is not None), None)
    if period is None and better is not None:
        again = search_runs(even, better, report)
        if any(one.explained and abs(one.period / better - 1.0) < AS_GIVEN for one in again):
            return again
    explained = period is None or _explain(even, seen)
    if period is not None and not (explained and better is None):
        without = _search(even, None, report)
        turns = np.array([period / one.period for one in without if one.explained])
        other = len(turns) and (np.abs(turns - np.rint(turns)) > AS_GIVEN).all()
        if (np.abs(turns - 1.0) < AS_GIVEN).any() or (other and not explained):
            return [
                one.about_middle(period) if may_have_period(one, period) else one for one in without
            ]
    return seen


def _shorter(even: EvenSamples, run: SlipGrid) -> float | None:
    """Return the shorter period (s) at which a run repeats better, or falls; None if none."""
    shorter = shorter_period(even, run) or Squares(even).shorter_part(run)
    if shorter is None and (falls := count_falls(even, run)) > 1:
        # Ringing falls at even times, too.
        shorter = run.period / falls if fit_ringing_down(even, [run]) is None else None
    return shorter


def _explain(even: EvenSamples, seen: list[SlipGrid]) -> bool:
    """Return whether equal rises and falls, with their ringing, explain the motion of a run."""
    explained = [one for one in seen if one.explained]
    ringing = fit_ringing_down(even, seen) if explained else None
    fits = (fit_ends(even, one, [x for x in seen if x is not one], ringing) for one in explained)
    return any(fit is not None and fit.explains() for fit in fits)


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
    if len(time) < _LEAST:
        raise TraceError(f"the trace has {len(time)} samples; at least {_LEAST} are needed")
    back = np.flatnonzero(np.diff(time) <= 0.0)
    if len(back):
        raise TraceError(
            f"time does not increase from sample {back[0]} ({time[back[0]]:g} s) to the next "
            f"({time[back[0] + 1]:g} s); sort the samples and remove duplicates"
        )
    if not np.ptp(position) > 0.0:
        raise TraceError("the runner does not move in the trace")
    return time, position, actuator


def analyse_grid(t: Array, x: Array, grid: SlipGrid, estimate: MeasuredValue) -> Run:
    """Analyse a run that was found; estimate (m) is its step as fitted to all samples."""
    run = analyse_cycles(t, x, None, Cycles.even(grid.slips, grid.period, grid.direction))
    step = run.mean_step
    if math.isfinite(estimate.value):
        step = MeasuredValue(grid.direction * estimate.value, estimate.error)
    # Slips without visible ringing are known to a sample, and so is the time that all steps take.
    late = 0.0 if run.ringing is not None else float(np.median(np.diff(t)))
    clock = abs(step.value) * late / (grid.count * grid.period) if step.error > 0.0 else 0.0
    error = math.hypot(step.error, _change_of(run.step_sizes), clock)
    return replace(run, mean_step=replace(step, error=error), explained=grid.explained)


def _change_of(steps: Array) -> float:
    """Return by how much (m) the mean of the settled steps changes within a run, beyond chance.

    Creep and wear change the steps; the mean may stand for any of them.
    """
    kept = steps[settled_from(len(steps)) :]
    half = len(kept) // 2
    if half < 2:
        return 0.0
    first, last = kept[:half], kept[-half:]
    change = abs(float(np.mean(last) - np.mean(first)))
    chance = math.sqrt((float(np.var(first, ddof=1)) + float(np.var(last, ddof=1))) / half)
    return 0.5 * change if change > _CHANGED * chance else 0.0


def _with_onset(
    t: Array, x: Array, grid: SlipGrid, given: float | None
) -> tuple[SlipGrid, Ringing | None]:
    """Return a run whose slips are where they begin, not in the middle of the fall; its ringing.

    The ringing shows it: the fall is its first swing. Unchanged where none is seen. A period that
    was given (s) is bettered by what clocks differ alone.
    """
    ringing = ringing_after(t, x, Cycles.even(grid.slips, grid.period, grid.direction))
    if ringing is None or ringing.frequency < HUMMING:
        return grid, None
    if ringing.frequency * grid.period < _SWINGS:
        return grid, ringing
    t, x = thin_samples(t, x, grid.slips, grid.period)
    known = given is not None and abs(grid.period / given - 1.0) < AS_GIVEN
    for drift in (True, False) if grid.count > 2 else (False,):
        try:
            onset = find_onset(
                t, grid.direction * x, grid.slips, grid.period, ringing,
                drift=drift, middle=grid.first, before=_EARLIER,
            )  # fmt: skip
        except np.linalg.LinAlgError:  # nothing follows the slips
            return grid, ringing
        if not known or abs(onset.drift) < CLOCK:
            break
    late = abs(onset.drift) * (grid.count - 1) * grid.period
    slower = onset.drift if late * ringing.frequency < _SWUNG else 0.0
    period = grid.period * (1.0 + slower)
    return replace(grid, first=grid.first + onset.shift, period=period), ringing
