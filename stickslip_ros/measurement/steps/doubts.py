# SPDX-License-Identifier: Apache-2.0
"""Why the steps of a run are not determined by a record."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.reporting import format_si
from stickslip_ros.measurement.steps.disturbances import MAINS, Change, Disturbances
from stickslip_ros.measurement.steps.fold import Rest, way_between
from stickslip_ros.measurement.steps.period import (
    estimate_periods,
    explained_by,
    period_factor,
    slips_between,
)
from stickslip_ros.measurement.steps.record import (
    FASTER,
    MeanPosition,
    Pyramid,
    Record,
    beside_line,
)
from stickslip_ros.measurement.steps.ringing import Ringing
from stickslip_ros.measurement.steps.run import MeasuredValue
from stickslip_ros.measurement.steps.settings import SETTINGS
from stickslip_ros.measurement.steps.slips import SlipGrid, SlipSizes
from stickslip_ros.measurement.steps.step_fit import PRECISION

#: What leaves the cycles sure, if not how many they are.
UNSURE_END = "first or last slip is not clear: give the steps that were sent (--steps)"
NO_REST = "no rest beside the run, so step and drift cannot be told apart"
_WRONG_WAY = "the runner jumps the way it steps, where a slip throws it back"
_NAME_IT = "give the frequency of the drive (--frequency)"


@dataclass(frozen=True)
class Evidence:
    """What is known of the runs of a record when they are judged."""

    record: Record
    pyramid: Pyramid
    mean: MeanPosition
    grids: Sequence[SlipGrid]
    ringing: Ringing | None
    rests: Sequence[tuple[Rest | None, Rest | None]]
    steps: Sequence[MeasuredValue]
    changes: Sequence[Change | None]
    disturbances: Disturbances
    frequencies: Sequence[float]  #: of the drive, Hz, as far as they are known beforehand
    known: bool = False  #: whether the cycles are known, by an actuator

    def doubts(self, k: int) -> tuple[str, ...]:
        """Return why run k is not determined; empty if it is."""
        found = [*self._sampling(k)]
        if not self.known:
            found += [*self._ends(k), *self._size(k), *self._beside(k)]
            found += self._other_period(k) if self.frequencies else self._period(k)
        return tuple(dict.fromkeys(found))

    def _sampling(self, k: int) -> list[str]:
        grid, spacing, found = self.grids[k], self.record.spacing, []
        least = SETTINGS.samples_a_cycle_told if self.frequencies else SETTINGS.samples_a_cycle
        if round(grid.period / spacing, 1) < least:
            found.append(
                f"{1.0 / spacing:.4g} samples a second are {grid.period / spacing:.1f} a cycle at "
                f"{1.0 / grid.period:.6g} Hz; {least:g} are needed: {FASTER}"
            )
        if self.record.cut_samples:
            found.append(
                f"{self.record.cut_samples} samples in a row have the record's outermost value: "
                "it was cut off there"
            )
        if grid.unevenness > max(SETTINGS.unevenness_periods * grid.period, 2.0 * spacing):
            part = 100.0 * grid.unevenness / grid.period
            found.append(f"the slips miss even times by {part:.2g} % of a period")
        return found

    def _ends(self, k: int) -> list[str]:
        """Return doubts about the number of slips."""
        grid, found = self.grids[k], []
        if grid.sureness < SETTINGS.sure:
            found.append(UNSURE_END)
        seen = grid.count * grid.direction
        if grid.sent and grid.sent != seen:
            where = ""
            begins = self.record.t[0] > grid.first - 1.5 * grid.period
            if abs(grid.sent) > grid.count and (begins or self.rests[k][0] is None):
                where = ": the record begins within the first"
            elif abs(grid.sent) > grid.count and self.rests[k][1] is None:
                where = ": the record ends before the last"
            found.append(f"{grid.sent:+d} steps were sent, {seen:+d} are seen{where}")
        for j in (k - 1, k + 1):
            if not 0 <= j < len(self.grids):
                continue
            sooner, later = self.grids[min(j, k)], self.grids[max(j, k)]
            apart = (later.first - sooner.last) / grid.period
            if apart > 2.5:
                continue
            if sooner.direction != later.direction:
                if abs(apart - 1.0) > 0.2 and not grid.sent:
                    found.append(f"{apart - 1.0:.1f} periods between this run and another one")
            elif not self._alike(j, k):
                found.append(_change_at(later.first - later.period))
            else:
                found.append(
                    "another run of the same steps is so near that both may be one"
                    + self._gap_between(sooner.last, later.first)
                )
        return found

    def _alike(self, j: int, k: int) -> bool:
        """Return True if two runs have the same period and steps, but for chance."""
        one, other = self.steps[j], self.steps[k]
        apart = SETTINGS.step_errors * math.hypot(one.error, other.error) + 0.02 * abs(one.value)
        period = abs(self.grids[j].period / self.grids[k].period - 1.0)
        return period < 0.05 and not abs(one.value - other.value) > apart

    def _gap_between(self, begin: float, end: float) -> str:
        """Say which samples are missing within a stretch (s), if some are."""
        inside = self.record.t[(self.record.t >= begin) & (self.record.t <= end)]
        gaps = np.diff(inside)
        if not len(gaps) or gaps.max() < 4.0 * self.record.spacing:
            return ""
        at = float(inside[int(np.argmax(gaps))])
        lost = format_si(float(gaps.max()), "s", 3)
        return f", as {lost} without samples from {at:.4g} s on hide a slip: cut them there (--to)"

    def _size(self, k: int) -> list[str]:
        """Return doubts about the step, and whether the rests are as far apart as all steps."""
        grid, step, (before, after) = self.grids[k], self.steps[k], self.rests[k]
        if not math.isfinite(step.error):
            return ["too few settled cycles or rests for an error of the step"]
        found = []
        if step.error > SETTINGS.step_error * abs(step.value):
            size, error = 1e9 * step.value, 1e9 * step.error
            found.append(f"the step, {size:.2f} nm \u00b1 {error:.2f} nm, is not clear")
            if self.ringing is not None and self.ringing.decay * grid.period * grid.count < 2.0:
                found[-1] += ": the ringing lasts as long as the run, so it has not settled"
        if step.value * grid.direction < 0.0:
            found.append(_WRONG_WAY)
        changed = self.changes[k]
        if changed is not None:
            sizes = f", from {1e9 * changed.before:.2f} nm to {1e9 * changed.after:.2f} nm"
            found.append(_change_at(changed.t, sizes))
        if before is None or after is None or not step.value:
            return found
        apart = way_between(self.mean, before, after, grid.period) / step.value
        # The first steps differ, and a last rise without a slip may be one and a half of them.
        missing = 1.0 + (0.05 + 2.0 * abs(step.error / step.value)) * grid.count
        if not -missing < apart - grid.count < missing + 1.5 and not grid.sent:
            found.append(f"the rests are {apart:.1f} steps apart, but {grid.count} cycles are seen")
        return found

    def _beside(self, k: int) -> list[str]:
        """Return doubts about the rests: none, or some in which the runner moves."""
        if self.rests[k] == (None, None):
            return [NO_REST]
        grid, found = self.grids[k], []
        width = max(0.25 * grid.period, 0.0 if self.ringing is None else self.ringing.swing)
        for name, rest in zip(("before", "after"), self.rests[k], strict=True):
            begin, end = rest or (0.0, 0.0)
            begin += 0.1 * grid.period if name == "after" else 0.0
            count = int((end - begin) / width)
            if count < 2:
                continue
            first = begin if name == "after" else end - count * width
            edges = first + width * np.arange(count + 1, dtype=np.float64)
            place = self.mean.between(edges[:-1], edges[1:])
            place -= self.disturbances.at(0.5 * (edges[1:] + edges[:-1]), width=width)
            moved = float(np.ptp(place))
            if moved > SETTINGS.moves_in_rest * abs(self.steps[k].value):
                found.append(
                    f"the runner moves by {1e9 * moved:.1f} nm {name} the run, about as far as in "
                    "a step"
                )
        return found

    def _other_period(self, k: int) -> list[str]:
        """Return the doubt about a period that is known: the slips or the motion show another."""
        grid = self.grids[k]
        seen = 1.0 / grid.period
        given = min(self.frequencies, key=lambda one: abs(one / seen - 1.0))
        named = f"not at the {given:.6g} Hz that are given; correct the frequency"
        if grid.count > 1 and abs(seen / given - 1.0) > 0.5 * SETTINGS.period_error:
            return [f"slips are seen at {seen:.6g} Hz, {named}"]
        if grid is not max(self.grids, key=lambda one: one.count) or grid.count < 3:
            return []
        explained = explained_by(self.record, self.mean, grid)
        own = explained(grid.period)
        hum = [k * mains for mains in MAINS for k in (1, 2)]
        for other in estimate_periods(self.pyramid) if own < 0.4 else ():
            near = min(abs(other * one - 1.0) for one in (*hum, 1.0 / grid.period))
            near = min(near, abs(0.5 * other / grid.period - 1.0))  # two cycles explain as much
            if near > 0.05 and 0.4 < other / grid.period < 2.5 and own < 0.4 * explained(other):
                return [f"steps are seen at {1.0 / other:.4g} Hz, {named}"]
        sizes = SlipSizes(self.pyramid, grid.slips, grid.period, self.ringing)
        for m in (2, 3):
            if slips_between(sizes, grid, self.record.spacing, m) > 0.75:
                return [f"slips are seen at {m / grid.period:.6g} Hz, {named}"]
        return []

    def _cycles(self, grid: SlipGrid) -> Array:
        """Return the settled cycles of a run beside straight lines, (cycles, samples)."""
        level = self.pyramid.level_for(grid.period, 32)
        half = int(0.5 * grid.period / level.spacing)
        rows = level.rows(grid.settled, half, half)
        return beside_line(rows[np.isfinite(rows).all(axis=1)])

    def _period(self, k: int) -> list[str]:
        """Return doubts about a period that the record alone has shown."""
        grid, factor = self.grids[k], 1.0
        if grid is max(self.grids, key=lambda one: one.count):
            factor = period_factor(self.record, self.mean, self.pyramid, grid, self.ringing)
        rows = self._cycles(grid)
        change = change_of_cycles(rows)
        mean = rows.mean(axis=0) if len(rows) else np.zeros(3)
        speed = np.diff(grid.direction * mean)
        reasons = {
            f"{grid.count} cycles show no period": grid.count < SETTINGS.least_cycles,
            f"{100.0 * change:.0f} % of the motion differs from cycle to cycle": (
                change > SETTINGS.change_of_cycles
            ),
            "the motion is a sinusoid, which has no slips": len(rows) > 1 and is_sinusoid(mean),
            _WRONG_WAY: speed.max() > -1.4 * speed.min(),
            "no ringing is seen that tells slips from other motion": self.ringing is None,
            f"{1.0 / (factor * grid.period):.6g} Hz explains the motion as well": factor != 1.0,
        }
        return [f"{reason}; {_NAME_IT}" for reason, holds in reasons.items() if holds]


def _change_at(t: float, sizes: str = "") -> str:
    return f"the steps change at {t:.6g} s{sizes}: analyse both parts (--to, --from)"


def change_of_cycles(rows: Array) -> float:
    """Return what part of the motion in cycles, (cycles, n), differs from the mean one."""
    if len(rows) < 2:
        return 0.0
    mean = rows.mean(axis=0)
    power = max(float(mean @ mean), 1e-40)
    own = float(np.median(np.sum((rows - mean) ** 2, axis=1))) / power
    return own * len(rows) / (len(rows) - 1)


def is_sinusoid(cycle: Array) -> bool:
    """Return True if a cycle, (n,), is a sinusoid but for a hundredth of its motion."""
    turn = np.linspace(0.0, 2.0 * np.pi, len(cycle))
    waves = beside_line(np.stack([np.cos(turn), np.sin(turn)]))
    size, *_ = np.linalg.lstsq(waves.T, cycle, rcond=None)
    return float(np.sum((cycle - size @ waves) ** 2)) < 0.01 * float(cycle @ cycle)


def comes_back(mean: MeanPosition, grid: SlipGrid) -> bool:
    """Return True if the runner comes back in each cycle, but for the scatter between cycles."""
    ends = grid.slips[grid.settling :]
    if len(ends) < 3:
        return False
    change = np.diff(mean.between(ends[:-1], ends[1:]))
    scatter = float(np.std(change)) / len(change) if len(change) > 2 else 0.0
    edges = ends[-2] + grid.period * np.linspace(0.0, 1.0, 65)
    motion = float(np.ptp(mean.between(edges[:-1], edges[1:])))
    return abs(float(change.mean())) < max(5e-11, 5.0 * scatter, 0.005 * motion, PRECISION)
