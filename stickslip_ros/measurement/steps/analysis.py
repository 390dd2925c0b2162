# SPDX-License-Identifier: Apache-2.0
"""The runs of steps in a record, each with its numbers, their errors and doubts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.reporting import format_si
from stickslip_ros.measurement.steps.actuator_cycles import runs_of_signal
from stickslip_ros.measurement.steps.backstep import find_ringing, measure_slip, ringing_at_the_end
from stickslip_ros.measurement.steps.cycle_values import (
    EXACT,
    as_simulated,
    points_of_cycles,
    steps_of_cycles,
)
from stickslip_ros.measurement.steps.disturbances import Disturbances
from stickslip_ros.measurement.steps.doubts import Evidence, comes_back
from stickslip_ros.measurement.steps.drive import Drive
from stickslip_ros.measurement.steps.fold import find_rests, fold_cycles, move_to_fall
from stickslip_ros.measurement.steps.noise import noise_of
from stickslip_ros.measurement.steps.period import estimate_periods, period_factor
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
from stickslip_ros.measurement.steps.run import COVERAGE, Cycles, Run, even_cycles
from stickslip_ros.measurement.steps.settings import SETTINGS
from stickslip_ros.measurement.steps.slips import (
    SlipGrid,
    SlipSizes,
    as_sent,
    counted,
    find_grids,
    retimed,
    single_slip,
    timed,
)
from stickslip_ros.measurement.steps.step_fit import fit_steps
from stickslip_ros.simulation.motion import Motion

#: No stick-slip drive steps by more (m): its unit is another one.
WIDEST_STEP = 1e-3
#: Part of the actuator's stroke that a step never exceeds, gains of both sensors included.
_OUTRUN = 1.1
#: Part of a step from which on hum is taken out before slips are looked for.
_HUMS = 0.05
#: Swings in a cycle from which on ringing hides no slips; decays in a cycle below which it does.
_FAST_RINGING, _OUTLASTS = 6.0, 0.7
#: Part by which an estimated period may be off.
_ESTIMATED = 0.06
#: How many times an estimated period is tried, as it may be a part of the right one.
_CORRECTIONS = 4


@dataclass(frozen=True)
class Findings:
    """The findings in a measurement: its runs, and the disturbances of the sensor."""

    runs: list[Run]
    disturbances: Disturbances = field(default_factory=Disturbances)
    notes: tuple[str, ...] = ()  #: what was left out, in words

    @property
    def hides_slips(self) -> bool:
        """Whether there is hum that a search for slips may take for some, or for none."""
        seen = self.disturbances
        return seen.hums and any(seen.hum > _HUMS * abs(run.step_size) for run in self.runs)


def find_steps(
    t: ArrayLike, x: ArrayLike, drive: Drive | None = None, u: ArrayLike | None = None
) -> Findings:
    """Return the runs in a measurement, and what disturbs it.

    Parameters
    ----------
    t, x : array_like
        Times (s) and positions of the runner (m), of shape (samples,).
    drive : Drive, optional
        What is known of the drive; its period is estimated where the frequency is not known.
    u : array_like, optional
        Deflection of the actuator (m), of shape (samples,); if it moves, it gives the cycles.

    Raises
    ------
    TraceError
        The record is too short, does not move, or holds no whole cycle of the frequency.
    """
    try:
        found = _find_steps(t, x, drive or Drive(), u)
    except TraceError:
        raise
    except (ArithmeticError, LookupError, ValueError) as error:  # no record is worth a traceback
        raise TraceError(
            f"the search for steps cannot take a record of this shape ({error}); cut out the part "
            "with steps, and please report it with the record"
        ) from error
    for run in found.runs:
        if abs(run.step_size) > WIDEST_STEP:
            raise ImplausibleError(
                f"a step would be {abs(run.step_size):g} m, which no stick-slip drive makes; its "
                "unit is another one (--units x=nm), or it is another column (--columns x=NAME)"
            )
        if run.determined and abs(run.step_size) > _OUTRUN * run.excitation + (
            COVERAGE * run.step_size_error
        ):
            raise ImplausibleError(
                f"the runner moves by {format_si(abs(run.step_size), 'm', 4)} a cycle and its "
                f"actuator by {format_si(run.excitation, 'm', 4)}, which it cannot outrun; is the "
                "unit of one of them another one (--units), or are columns swapped (--columns)?"
            )
    return found


def _find_steps(t: ArrayLike, x: ArrayLike, drive: Drive, u: ArrayLike | None) -> Findings:
    time, position, strays = check_samples(t, x)
    notes = tuple(
        f"a sample at {at:g} s is left out, as its time is far from all others" for at in strays[:3]
    )
    by_actuator: list[Run] = []
    if u is not None:
        cycles = runs_of_signal(np.asarray(t, np.float64), np.asarray(u, np.float64))
        by_actuator = analyse_cycles(time, position, cycles) if cycles else []
        if any(one.determined for one in by_actuator):
            return Findings(by_actuator, notes=notes)
    record = clean_record(time, position)
    for frequency in drive.frequencies:
        if record.duration * frequency < 1.0:
            raise TraceError(
                f"the trace of {record.duration:g} s holds no whole cycle at {frequency:g} Hz; "
                "correct the frequency or record a longer one"
            )
        if 2.0 * record.spacing * frequency > 1.0:
            raise TraceError(
                f"{1.0 / record.spacing:.4g} samples a second show no cycles of {frequency:.6g} "
                f"Hz; {FASTER}"
            )
    parts = [_Analysis(one, drive) for one in record.between_pauses()]
    each = _read(parts, drive)
    quiet = [
        _Analysis(part.record, drive, one.disturbances) if one.hides_slips else part
        for part, one in zip(parts, each, strict=True)
    ]
    each = each if quiet == parts else _read(quiet, drive)
    longest = max(each, key=lambda one: one.disturbances.duration)
    found = replace(longest, runs=[run for one in each for run in one.runs], notes=notes)
    if by_actuator and not any(one.determined for one in found.runs):
        return replace(found, runs=max(by_actuator, found.runs, key=len))
    return found


def _read(parts: Sequence[_Analysis], drive: Drive) -> list[Findings]:
    """Return what parts of a record hold, of which each has the steps that were sent to it."""
    searched = [one.search() for one in parts]
    sent = iter(drive.sent_to([grid for grids, _ in searched for grid in grids]))
    return [
        part.findings([next(sent) for _ in grids], ringing)
        for part, (grids, ringing) in zip(parts, searched, strict=True)
    ]


class _Analysis:
    """The steps of the analysis of one record."""

    def __init__(self, record: Record, drive: Drive, hum: Disturbances | None = None) -> None:
        self.drive, self.raw, self.raw_mean = drive, record, MeanPosition(record)
        self.record, self.mean = record, self.raw_mean
        if hum is not None:
            self.record = replace(record, x=record.x - hum.at(record.t))
            self.mean = MeanPosition(self.record)
        self.pyramid = Pyramid(self.record)

    def findings(self, grids: list[SlipGrid], ringing: Ringing | None) -> Findings:
        """Return runs and disturbances by the grids and the ringing that a search has found."""
        if not grids or all(comes_back(self.mean, one) for one in grids):
            return Findings([])
        if self.drive.steps:
            grids = [as_sent(self.pyramid, self.record, one, ringing) for one in grids]
        found = self.measured(grids, ringing)
        # What falls most need not be a slip, nor need what repeats be a run of steps.
        runs = [one for one in found.runs if one.is_clear or (one.steps > 2 and self._is_told(one))]
        return replace(found, runs=runs)

    def _is_told(self, run: Run) -> bool:
        return any(
            abs(run.frequency / one - 1.0) < SETTINGS.period_error for one in self.drive.frequencies
        )

    def search(self) -> tuple[list[SlipGrid], Ringing | None]:
        """Return the grids of the runs in order of time, and their ringing."""
        if self.drive.frequencies:
            # The shortest first: several of its cycles are one of a longer one, too.
            periods = sorted(1.0 / one for one in set(self.drive.frequencies))
            grids, ringing = self._told(periods)
            if ringing is None or ringing.frequency * periods[0] <= _FAST_RINGING:
                quick = ringing_at_the_end(self.record, periods[0])
                if quick is None and ringing and ringing.decay * periods[0] < _OUTLASTS:
                    quick = ringing
                grids, ringing = (grids, ringing) if quick is None else self._told(periods, quick)
            return grids, ringing
        return self._estimated()

    def _told(
        self, periods: Sequence[float], quick: Ringing | None = None
    ) -> tuple[list[SlipGrid], Ringing | None]:
        """Return the same for known periods (s), and for ringing that hides the slips, if known."""
        found: list[SlipGrid] = []
        for one in periods:
            found += find_grids(self.pyramid, one, quick, taken=found)
        return self._timed(_apart(found) or [single_slip(self.pyramid, periods[0])], quick)

    def _estimated(self) -> tuple[list[SlipGrid], Ringing | None]:
        """Return the same for a period that is estimated."""
        trials: list[tuple[float, float, list[SlipGrid]]] = []
        for period in estimate_periods(self.pyramid):
            for part in (period, period / 2.0, period / 3.0):
                if part > 4.0 * self.record.spacing:
                    found = find_grids(self.pyramid, part, near=_ESTIMATED)
                    trials.append((part * sum(one.seen for one in found), part, found))
        most = max((one[0] for one in trials), default=0.0)
        if not most > 0.0:
            return [], None
        _, _, grids = min((one for one in trials if one[0] > 0.85 * most), key=lambda one: one[1])
        period, ringing = max(grids, key=lambda one: one.count).period, None
        for _ in range(_CORRECTIONS):
            grids, ringing = self._timed(find_grids(self.pyramid, period) or grids)
            longest = max(grids, key=lambda one: one.count)
            factor = period_factor(self.record, self.mean, self.pyramid, longest, ringing)
            if factor == 1.0:
                break
            period = factor * longest.period
        return grids, ringing

    def _timed(
        self, grids: Sequence[SlipGrid], quick: Ringing | None = None
    ) -> tuple[list[SlipGrid], Ringing | None]:
        """Return grids with the slips that are there, and the ringing of the contact.

        quick is the ringing that lasts so long that it hides the slips, if that is known.
        """
        if quick is None:
            grids = [move_to_fall(self.record, self.mean, timed(self.pyramid, g)) for g in grids]
        ringing = quick or self.ringing(grids)
        found = []
        lasts = [-math.inf, *(one.last + 0.5 * one.period for one in grids)]
        firsts = [*(one.first - 0.5 * one.period for one in grids[1:]), math.inf]
        for grid, *free in zip(grids, lasts, firsts, strict=False):
            own = retimed(self.pyramid, grid, ringing)
            found += counted(self.pyramid, own, ringing, (free[0], free[1]))
        if quick is None and [one.count for one in found] != [one.count for one in grids]:
            ringing = self.ringing(found)  # a slip is no part of a rest
        return found, ringing

    def ringing(self, grids: Sequence[SlipGrid]) -> Ringing | None:
        """Return the ringing of the contact, which is the same in all runs; None if unclear."""
        rests = find_rests(grids, self.record.t[0], self.record.t[-1])
        found = []
        for grid, (_, rest) in zip(grids, rests, strict=True):
            fold = fold_cycles(self.record, self.mean, grid)
            found.append(find_ringing(self.record, fold, grid, rest))
        known = [one for one in found if one is not None]
        return min(known, key=lambda one: one.frequency_error, default=None)

    def measured(
        self,
        grids: Sequence[SlipGrid],
        ringing: Ringing | None,
        known: Sequence[Cycles] | None = None,
    ) -> Findings:
        """Return the runs of grids with all numbers; known: their cycles, if these are known."""
        rests = find_rests(grids, self.record.t[0], self.record.t[-1])
        steps, changes, disturbances = fit_steps(self.raw, self.raw_mean, grids, ringing, rests)
        evidence = Evidence(
            self.record, self.pyramid, self.raw_mean, grids, ringing, rests, steps, changes,
            disturbances, self.drive.frequencies, known is not None,
        )  # fmt: skip
        runs = []
        for k, (grid, step) in enumerate(zip(grids, steps, strict=True)):
            fold = fold_cycles(self.record, self.mean, grid)
            slip = measure_slip(self.record, fold, grid.period, grid.unevenness, ringing)
            begin = slip.begin if known is None else 0.0
            cycles = even_cycles(grid.slips + begin, grid.period, grid.direction)
            cycles = cycles if known is None else known[k]
            sizes = SlipSizes(self.pyramid, cycles.slips, cycles.period, ringing)
            runs.append(Run(
                **vars(cycles), step_size=step.value, step_size_error=step.error,
                backstep=slip.backstep.value, backstep_error=slip.backstep.error,
                ringing=ringing, step_sizes=steps_of_cycles(self.record, cycles, step.value),
                backsteps=slip.backstep.value * sizes.at(cycles.slips)[0],
                points=points_of_cycles(cycles, ringing, slip.deepest - begin, known is not None),
                regained=slip.regained, doubts=evidence.doubts(k),
                why_no_backstep=slip.why_unknown,
            ))  # fmt: skip
        return Findings(runs, disturbances)


def _apart(grids: Sequence[SlipGrid]) -> list[SlipGrid]:
    """Return the longest of grids that overlap, in the order of time."""
    kept: list[SlipGrid] = []
    for grid in sorted(grids, key=lambda one: one.period - one.count * one.period):
        if all(grid.last < one.first or grid.first > one.last for one in kept):
            kept.append(grid)
    return sorted(kept, key=lambda one: one.first)


def analyse_cycles(
    time: Array, position: Array, cycles: Sequence[Cycles], noise: float | None = None
) -> list[Run]:
    """Return the runs of cycles that are known: times (s) and positions (m), (samples,).

    noise (m) is that of a sample, estimated if not given. Positions of simulated motion, without
    noise, are taken as they are; to treat one like a noisy motion, pass the noise of that one.
    """
    noise = noise_of(position) if noise is None else noise
    record = Record(time, position) if noise < EXACT else clean_record(time, position)
    analysis = _Analysis(record, Drive())
    grids = [
        SlipGrid(float(one.slips[0]), one.period, len(one.slips), one.direction) for one in cycles
    ]
    runs = analysis.measured(grids, analysis.ringing(grids), cycles).runs
    return [as_simulated(record, one) for one in runs] if noise < EXACT else runs


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


def runs_of(motion: Motion, drive: Drive | None = None) -> list[Run]:
    """Return the runs of a motion in the order of time, none where it does not step.

    Its actuator gives the cycles where that was measured and moves. Raises TraceError.
    """
    if len(motion.t) < FEWEST_SAMPLES or not np.ptp(motion.x) > 0.0:
        return []
    return find_steps(motion.t, motion.x, drive, motion.u).runs
