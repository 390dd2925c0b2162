# SPDX-License-Identifier: Apache-2.0
"""Why the steps of a run are not determined by a record."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stickslip_ros.base.reporting import format_si
from stickslip_ros.measurement.steps.fold import Rest
from stickslip_ros.measurement.steps.hum import MAINS
from stickslip_ros.measurement.steps.matching import Chain, change_of_cycles, cycle_rows
from stickslip_ros.measurement.steps.measured_value import MeasuredValue
from stickslip_ros.measurement.steps.periodicity import period_factor, possible_part
from stickslip_ros.measurement.steps.record import FASTER, MeanPosition, Pyramid, Record
from stickslip_ros.measurement.steps.ringing import Ringing
from stickslip_ros.measurement.steps.settings import SETTINGS
from stickslip_ros.measurement.steps.step_fit import PRECISION, Disturbances
from stickslip_ros.measurement.steps.timing import SlipGrid

#: What leaves the cycles sure.
NO_REST = "no rest beside the run, so step and drift cannot be told apart"
_JUMPS = (
    "the runner jumps the way it steps, where a slip throws it back: check the sign of the "
    "position, and the frequency, unless a load carries it off"
)
#: Periods from one run to the next of the other direction that leave no room for a missed slip.
_NEXT_RUN, _ODD = 2.5, 0.2
#: Samples that are missing where there is a gap.
_GAP_SAMPLES = 4.0
#: Parts by which the periods of two pieces of one run may differ, and their steps, by chance.
_SAME_PERIOD, _SAME_STEP = 0.05, 0.02
#: Steps that the rests may be apart beside the number of cycles, as the first ones differ, and more
#: of them for each cycle.
_MISSING, _GROWING = 1.0, 0.05
#: The same of a last rise without a slip.
_RISE = 1.5
#: Samples of a cycle that show all of its shape.
_CLEAR_SAMPLES = 60.0
#: Periods by which a run may be off the clock of the mains.
_LIKE_MAINS = 0.5
#: Part of the motion in a cycle that is no step; errors of a mean that are no chance; m.
_SWINGING, _CHANCE, _NO_STEP = 0.005, 5.0, 5e-11


@dataclass(frozen=True)
class Evidence:
    """What is known of the runs of a record when they are judged."""

    record: Record
    pyramid: Pyramid
    mean: MeanPosition
    grids: Sequence[SlipGrid]
    ringings: Sequence[Ringing | None]
    rests: Sequence[tuple[Rest | None, Rest | None]]
    steps: Sequence[MeasuredValue]
    disturbances: Disturbances
    given: float | None  #: the period that was given, s

    def doubts(self, k: int) -> tuple[str, ...]:
        """Return why run k is not determined; empty if it is."""
        found = [
            *self._sampling(k), *self._multiple(k), *self._ends(k), *self._size(k),
            *self._distance(k), *self._rests_beside(k),
            *self._cycles(k),
        ]  # fmt: skip
        return tuple(dict.fromkeys(found))

    def _sampling(self, k: int) -> list[str]:
        grid, found = self.grids[k], []
        if grid.count < SETTINGS.least_cycles and self.given is None:
            found.append(f"{grid.count} cycles; {SETTINGS.least_cycles} are needed")
        samples = grid.period / self.record.spacing
        if round(samples, 1) < SETTINGS.least_samples_a_cycle:
            found.append(too_few_samples(grid.period, self.record.spacing))
        if self.record.cut_samples:
            found.append(
                f"{self.record.cut_samples} samples in a row have the record's outermost value: "
                "it was cut off there"
            )
        limit = max(
            SETTINGS.largest_unevenness_periods * grid.period,
            SETTINGS.largest_unevenness_samples * self.record.spacing,
        )
        if grid.unevenness > limit:
            part = 100.0 * grid.unevenness / grid.period
            found.append(f"the slips miss even times by {part:.2g} % of a period")
        return found

    def _multiple(self, k: int) -> list[str]:
        """Return the doubt about cycles that may be several of those whose period was given."""
        if self.given is None:
            return []
        times = self.grids[k].period / self.given
        if round(times) < 2 or abs(times / round(times) - 1.0) > _SAME_PERIOD:
            return []
        return [f"each cycle may be {round(times)} of the {1.0 / self.given:.6g} Hz given"]

    def _ends(self, k: int) -> list[str]:
        """Return doubts about the number of slips."""
        grid, found = self.grids[k], []
        before, first, last, after = grid.end_sizes
        beyond = np.nanmax([before, after, 0.0])
        inside = np.nanmin([first, last, 1.0])
        if beyond > SETTINGS.largest_slip_beyond_ends or inside < SETTINGS.least_slip_at_ends:
            sizes = f"{before:.2f} {first:.2f} ... {last:.2f} {after:.2f}"
            found.append(f"first or last slip is not clear (sizes {sizes})")
        for j, other in enumerate(self.grids):
            gap = (other.first - grid.last) / grid.period
            turns = other.direction != grid.direction
            if turns and 0.0 < gap < _NEXT_RUN and abs(gap - 1.0) > _ODD:
                found.append(f"{gap - 1.0:.1f} periods between this run and the next one")
            sooner, later = sorted((grid, other), key=lambda one: one.first)
            apart = (later.first - sooner.last) / grid.period
            alike = abs(other.period / grid.period - 1.0) < _SAME_PERIOD and self._same_steps(j, k)
            if other is not grid and not turns and alike and apart < _NEXT_RUN:
                found.append(
                    "another run of the same steps is so near that both may be one"
                    + self._gap_between(sooner.last, later.first)
                )
        return found

    def _gap_between(self, begin: float, end: float) -> str:
        """Say where samples are missing about two slips (s), in which others may be lost."""
        t = self.record.t
        first, last = np.searchsorted(t, [min(begin, end), max(begin, end)])
        near = t[max(first - 1, 0) : last + 2]
        k = int(np.argmax(np.diff(near))) if len(near) > 1 else 0
        if len(near) < 2 or not near[k + 1] - near[k] > _GAP_SAMPLES * self.record.spacing:
            return ""
        lost = format_si(float(near[k + 1] - near[k]), "s", 3)
        return f", as {lost} without samples from {near[k]:.4g} s on hide a slip: cut them there"

    def _same_steps(self, j: int, k: int) -> bool:
        """Return whether the steps of two runs may be those of one."""
        one, other = self.steps[j], self.steps[k]
        error = math.hypot(one.error, other.error, _SAME_STEP * one.value)
        return not abs(one.value - other.value) > _CHANCE * error

    def _size(self, k: int) -> list[str]:
        grid, step, found = self.grids[k], self.steps[k], []
        if not math.isfinite(step.error):
            return ["too few settled cycles for an error of the step"]
        if not abs(step.value) > SETTINGS.least_step_errors * step.error:
            found.append(
                f"the step, {1e9 * step.value:.2f} nm ± {1e9 * step.error:.2f} nm, is not clear"
            )
        if step.value * grid.direction < 0.0:
            found.append(_JUMPS)
        return found

    def _distance(self, k: int) -> list[str]:
        """Return doubts where the rests are apart by another number of steps."""
        grid, step, (before, after) = self.grids[k], self.steps[k], self.rests[k]
        if before is None or after is None or not step.value or not math.isfinite(step.error):
            return []
        near = 0.5 * grid.period
        edges = np.array([
            [max(before[0], before[1] - near), before[1]],
            [after[0], min(after[1], after[0] + near)],
        ])  # fmt: skip
        first, last = self.mean.between(edges[:, 0], edges[:, 1])
        counted = float(last - first) / step.value
        uncertain = grid.count * abs(step.error / step.value)
        missing = _MISSING + _GROWING * grid.count + 2.0 * uncertain
        if -missing < counted - grid.count < missing + _RISE:
            return []
        return [f"the rests are {counted:.1f} steps apart, but {grid.count} cycles are seen"]

    def _rests_beside(self, k: int) -> list[str]:
        if self.rests[k] == (None, None):
            return [NO_REST]
        grid, ringing, found = self.grids[k], self.ringings[k], []
        width = max(0.25 * grid.period, 0.0 if ringing is None else ringing.swing)
        low, high = self._free_time(k)
        for name, begin, end in (
            ("before", low, grid.first - 1.1 * grid.period),
            ("after", grid.last + 1.1 * grid.period, high),
        ):
            count = int((end - begin) / width)
            if count < 2:
                continue
            edges = np.asarray(begin + width * np.arange(count + 1), np.float64)
            place = self.mean.between(edges[:-1], edges[1:])
            place -= self.disturbances.hum_at(0.5 * (edges[1:] + edges[:-1]), width)
            moved = float(np.ptp(place))
            if moved > SETTINGS.largest_move_in_rest_steps * abs(self.steps[k].value):
                found.append(
                    f"the runner moves by {1e9 * moved:.1f} nm {name} the run, about as far as in "
                    "a step"
                )
        return found

    def _free_time(self, k: int) -> tuple[float, float]:
        """Return the end of the run before and the begin of the next one, s."""
        low, high = float(self.record.t[0]), float(self.record.t[-1])
        if k > 0:
            other = self.grids[k - 1]
            low = other.last + SETTINGS.rest_after_slip_periods * other.period
        if k + 1 < len(self.grids):
            other = self.grids[k + 1]
            high = other.first - (1.0 + SETTINGS.rest_before_rise_periods) * other.period
        return low, high

    def _cycles(self, k: int) -> list[str]:
        grid, ringing, found = self.grids[k], self.ringings[k], []
        rows = cycle_rows(self.pyramid, Chain(grid.slips, grid.direction, grid.period))
        change = change_of_cycles(rows)
        if change > SETTINGS.largest_change_in_doubt:
            found.append(f"{100.0 * change:.0f} % of the motion differs from cycle to cycle")
        clear = grid.period > _CLEAR_SAMPLES * self.record.spacing  # no alias of a faster drive
        least = SETTINGS.least_cycles_without_ringing
        speed = np.diff(grid.direction * rows.mean(axis=0)) if len(rows) else np.zeros(1)
        if speed.max() > -SETTINGS.largest_speed_to_slip * speed.min():
            found.append(_JUMPS)
        few = grid.count < (least // 2 if clear else least)
        if few and ringing is None and self.given is None:
            found.append(f"{grid.count} cycles without ringing may be other motion")
        turns = grid.count * grid.period
        near = [abs(1.0 / grid.period - k * one) * turns for one in MAINS for k in (1, 2)]
        if ringing is None and self.given is None and min(near) < _LIKE_MAINS:
            found.append(
                "cycles as long as those of the mains, without ringing, may be hum: give the "
                "frequency of the drive, or take hum out (--remove-hum)"
            )
        longest = max(self.grids, key=lambda one: one.count)
        if grid is longest:
            factor = period_factor(self.record, self.mean, self.pyramid, grid, ringing)
            if factor != 1.0:
                better = 1.0 / (factor * grid.period)
                found.append(f"the motion repeats better at {better:.6g} Hz")
            elif self.given is None and ringing is None:
                part = possible_part(self.record, self.mean, grid)
                if part > 1:
                    found.append(f"the samples may also show {part / grid.period:.6g} Hz")
        return found


def too_few_samples(period: float, spacing: float) -> str:
    """Return what is said of cycles (s) with too few samples, which are so far (s) apart."""
    return (
        f"{1.0 / spacing:.4g} samples a second are {period / spacing:.1f} a cycle at "
        f"{1.0 / period:.6g} Hz; {SETTINGS.least_samples_a_cycle:g} are needed: {FASTER}"
    )


def comes_back(mean: MeanPosition, grid: SlipGrid) -> bool:
    """Return True if the runner comes back in each cycle, but for the scatter between cycles."""
    ends = grid.slips[grid.settling :]
    if len(ends) < 3:
        return False
    change = np.diff(mean.between(ends[:-1], ends[1:]))
    scatter = float(np.std(change)) / len(change) if len(change) > 2 else 0.0
    edges = ends[-2] + grid.period * np.linspace(0.0, 1.0, 65)
    motion = float(np.ptp(mean.between(edges[:-1], edges[1:])))
    least = max(_NO_STEP, _CHANCE * scatter, _SWINGING * motion, PRECISION)
    return abs(float(change.mean())) < least
