# SPDX-License-Identifier: Apache-2.0
"""The runs of steps in a measurement, each with its numbers, their errors and doubts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.steps.backstep import find_ringing, measure_slip
from stickslip_ros.measurement.steps.cycle_values import cycle_values
from stickslip_ros.measurement.steps.doubts import Evidence, comes_back
from stickslip_ros.measurement.steps.fold import find_rests, fold_cycles, move_to_fall
from stickslip_ros.measurement.steps.hum import without_hum
from stickslip_ros.measurement.steps.matching import Chain, PeriodChoice, single_slip
from stickslip_ros.measurement.steps.periodicity import period_factor
from stickslip_ros.measurement.steps.record import (
    FASTER,
    FEWEST_SAMPLES,
    ImplausibleError,
    MeanPosition,
    Pyramid,
    Record,
    TraceError,
    check_samples,
    clean_record,
)
from stickslip_ros.measurement.steps.ringing import Ringing
from stickslip_ros.measurement.steps.run import Cycles, Run
from stickslip_ros.measurement.steps.search import Candidate, search_periods, stretch_of
from stickslip_ros.measurement.steps.step_fit import Disturbances, fit_steps
from stickslip_ros.measurement.steps.timing import (
    SlipGrid,
    count_slips,
    grid_of,
    join_grids,
    retime,
)

#: No stick-slip drive steps by more (m): its unit is another one.
WIDEST_STEP = 1e-3
#: Part by which a run may be off a frequency that was given, as clocks and short runs are.
AS_GIVEN = 0.02
#: How many times a period that is a part of the right one is corrected.
_CORRECTIONS = 3
#: Cycles that may be no run where they show no step.
_FEW = 8
#: Steps that the runner moves beside a run where there may be another one; how often that is asked.
_OTHER_STEPS, _ROUNDS = 1.5, 4
#: Part of that move that the steps of another run have to explain.
_EXPLAINED = 0.5


@dataclass(frozen=True)
class Findings:
    """The findings in a measurement: its runs, and the disturbances of the sensor."""

    runs: list[Run]
    disturbances: Disturbances

    def at(self, frequency: float) -> list[Run]:
        """Return the runs of a drive frequency (Hz)."""
        return [one for one in self.runs if abs(one.frequency / frequency - 1.0) < AS_GIVEN]


def find_steps(t: ArrayLike, x: ArrayLike, frequency: float | None = None) -> Findings:
    """Return the runs in a measurement, and what disturbs it.

    Parameters
    ----------
    t, x : array_like
        Times (s) and positions of the runner (m), of shape (samples,).
    frequency : float, optional
        Frequency of the drive, Hz, where it is known.

    Raises
    ------
    TraceError
        The record is too short, does not move, or holds no whole cycle of the frequency.
    """
    time, position = check_samples(t, x)
    try:
        found = _find_steps(time, position, frequency)
    except TraceError:
        raise
    except (ArithmeticError, LookupError, ValueError) as error:  # no record is worth a traceback
        raise TraceError(
            f"the search for steps cannot take a record of this shape ({error}); cut out the part "
            "with steps, and please report it with the record"
        ) from error
    widest = max((abs(one.step_size) for one in found.runs), default=0.0)
    if widest > WIDEST_STEP:
        raise ImplausibleError(
            f"a step would be {widest:g} m, which no stick-slip drive makes; its unit is another "
            "one (--units x=nm), or it is another column (--columns x=NAME)"
        )
    return found


def _find_steps(time: Array, position: Array, frequency: float | None) -> Findings:
    period = None if frequency is None else 1.0 / frequency
    if period is not None and time[-1] - time[0] < period:
        raise TraceError(
            f"the trace of {time[-1] - time[0]:g} s holds no whole cycle at {frequency:g} Hz; "
            "correct the frequency or record a longer one"
        )
    record = clean_record(time, position)
    if period is not None and period < 2.0 * record.spacing:
        raise TraceError(
            f"{1.0 / record.spacing:.4g} samples a second show no cycles of {frequency:.6g} Hz; "
            f"{FASTER}"
        )
    found = _Analysis(record, period).findings()
    if _determined(found):
        return found
    still = without_hum(record)
    if still is not None:
        other = _Analysis(still, period).findings()
        if _determined(other):
            return other
    if period is not None:  # it may be another one
        other = _Analysis(record, None).findings()
        if _determined(other):
            return other
    return found


def _determined(found: Findings) -> bool:
    return bool(found.runs) and all(one.determined for one in found.runs)


class _Analysis:
    """The steps of the analysis of one record."""

    def __init__(self, record: Record, period: float | None) -> None:
        self.record, self.period = record, period
        self.pyramid, self.mean = Pyramid(record), MeanPosition(record)

    def findings(self) -> Findings:
        """Return runs and disturbances."""
        grids, ringing = self.timed_runs()
        if not grids or all(comes_back(self.mean, one) for one in grids):
            return Findings([], Disturbances())
        for _ in range(_ROUNDS):
            others = self._others_beside(grids)
            grids = sorted([*grids, *others], key=lambda one: one.first)
            if not others:
                break
        found = self._measured(grids, ringing)
        few = max(one.count for one in grids) < _FEW
        if few and not any(one.is_clear for one in found.runs):
            return Findings([], Disturbances())  # what falls most need not be a slip
        return found

    def timed_runs(self) -> tuple[list[SlipGrid], Ringing | None]:
        """Return the grids of the runs in order of time, and their ringing."""
        chains = self._chains()
        grids, ringing = self._timed(chains)
        for _ in range(_CORRECTIONS if self.period is None and grids else 0):
            longest = max(grids, key=lambda one: one.count)
            factor = period_factor(self.record, self.mean, self.pyramid, longest, ringing)
            if factor == 1.0:
                break
            core = Candidate(factor * longest.period, longest.first, longest.last)
            chains = PeriodChoice(self.pyramid, self.mean, core.period).chains([core])
            if not chains:  # a sinusoid has no slips, nor has it over several of its periods
                return [], None
            grids, ringing = self._timed(chains)
        return grids, ringing

    def _chains(self) -> list[Chain]:
        """Return the chains of slips, by the period given or one that is found."""
        candidates = search_periods(self.pyramid)
        if self.period is None:
            return PeriodChoice(self.pyramid, self.mean, None).chains(candidates)
        own = stretch_of(self.pyramid, self.period)
        candidates = [own, *candidates] if own.quality > 0.0 else candidates
        chains = PeriodChoice(self.pyramid, self.mean, self.period).chains(candidates)
        return chains or [single_slip(self.pyramid, self.period)]

    def _timed(self, chains: Sequence[Chain]) -> tuple[list[SlipGrid], Ringing | None]:
        """Return grids with the slips that are there, and the ringing of the contact."""
        grids = [grid_of(one, self.pyramid) for one in chains]
        grids = [move_to_fall(self.record, self.mean, one) for one in grids]
        grids.sort(key=lambda one: one.first)
        rests = find_rests(grids, self.record.t[0], self.record.t[-1])
        found = []
        for grid, (_, rest) in zip(grids, rests, strict=True):
            fold = fold_cycles(self.record, self.mean, grid)
            found.append(find_ringing(self.record, fold, grid, rest))
        known = [one for one in found if one is not None]  # the contact is the same in all runs
        ringing = min(known, key=lambda one: one.frequency_error, default=None)
        grids = [retime(self.pyramid, one, ringing) for one in grids]
        counted = [count_slips(self.pyramid, self.mean, one, ringing) for one in grids]
        return join_grids(self.mean, counted), ringing

    def _others_beside(self, grids: Sequence[SlipGrid]) -> list[SlipGrid]:
        """Return runs of other periods in the stretches beside those that are known."""
        begins = [float(self.record.t[0]), *(one.last + 1.1 * one.period for one in grids)]
        ends = [*(one.first - 1.1 * one.period for one in grids), float(self.record.t[-1])]
        step = min(_mean_step(self.mean, one) for one in grids)
        found = []
        for begin, end in zip(begins, ends, strict=True):
            first, last = np.searchsorted(self.record.t, [begin, end])
            if last - first < FEWEST_SAMPLES:
                continue
            edges = np.linspace(begin, end, 33)
            moved = float(np.ptp(self.mean.between(edges[:-1], edges[1:])))
            if moved > _OTHER_STEPS * step:
                part = slice(first, last)
                record = replace(
                    self.record, t=self.record.t[part], x=self.record.x[part], jumps=()
                )
                other = _Analysis(record, None).timed_runs()[0]
                went = sum(one.count * _mean_step(self.mean, one) for one in other)
                found += other if went > _EXPLAINED * moved else []
        return found

    def _measured(self, grids: Sequence[SlipGrid], ringing: Ringing | None) -> Findings:
        rests = find_rests(grids, self.record.t[0], self.record.t[-1])
        ringings = [ringing] * len(grids)
        steps, disturbances = fit_steps(self.record, self.mean, grids, ringings, rests)
        known = Evidence(
            self.record, self.pyramid, self.mean, grids, ringings, rests, steps, disturbances,
            self.period,
        )  # fmt: skip
        runs = []
        for k, (grid, step) in enumerate(zip(grids, steps, strict=True)):
            fold = fold_cycles(self.record, self.mean, grid)
            slip = measure_slip(self.record, fold, grid.period, grid.unevenness, ringing)
            cycles = Cycles.even(grid.slips + slip.begin, grid.period, grid.direction)
            slip = replace(slip, begin=0.0, deepest=slip.deepest - slip.begin)
            values = cycle_values(
                self.record, self.pyramid, cycles, ringing, slip, step.value, driven=False
            )
            runs.append(Run(
                cycles, step, slip.backstep, ringing, values.step_sizes, values.backsteps,
                values.points, slip.regained, doubts=known.doubts(k),
                why_no_backstep=slip.why_unknown,
            ))  # fmt: skip
        return Findings(runs, disturbances)


def _mean_step(mean: MeanPosition, grid: SlipGrid) -> float:
    """Return the size (m) of the mean step of a run, roughly."""
    ends = np.array([grid.first, grid.last])
    if grid.count > 2:
        first, last = mean.between(ends - grid.period, ends)
        return abs(float(last - first)) / (grid.count - 1)
    ends += grid.period * np.array([-1.5, 0.5])
    first, last = mean.between(ends, ends + 0.5 * grid.period)
    return abs(float(last - first)) / grid.count
