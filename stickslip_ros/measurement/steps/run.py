# SPDX-License-Identifier: Apache-2.0
"""A run of steps, with all results that texts, JSON, pages, pictures and programs show."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.reporting import MEASURED, SIMULATED, draw_lines, format_si, html_table
from stickslip_ros.base.reporting.tables import frame
from stickslip_ros.base.reporting.terminal import format_rows, nanometres
from stickslip_ros.measurement.steps.measured_value import MeasuredValue
from stickslip_ros.measurement.steps.record import TraceError
from stickslip_ros.measurement.steps.ringing import Ringing
from stickslip_ros.measurement.steps.settings import SETTINGS
from stickslip_ros.simulation.settled import settled_from

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

#: Cycles that the mean slip comes from at most, samples of one at least, points of it at most.
_CYCLES, _SAMPLES, _POINTS = 200, 8, 1000
#: Parts of a period that it shows before and after the slip at most; swings of the ringing after
#: it, and part of a period that counts as one where there is none.
_BEFORE, _AFTER, _SWINGS, _NO_SWING = 0.2, 0.5, 8.0, 0.05


@dataclass(frozen=True)
class Cycles:
    """When the cycles of a run begin and slip, each array of shape (cycles,)."""

    period: float  #: s
    direction: int  #: of the steps, +1 or -1
    starts: Array  #: begin of each cycle, s
    slips: Array  #: begin of the slip of each cycle, s
    ends: Array  #: end of the slip and of the cycle, s; the begin of the slip where that is unknown
    excitation: float = math.nan  #: deflection of the actuator, peak to peak, m

    @classmethod
    def even(cls, slips: Array, period: float, direction: int) -> Cycles:
        """Return cycles of one period (s) before slips (s) whose ends are unknown."""
        return cls(period, direction, slips - period, slips, slips)


@dataclass(frozen=True)
class Balance:
    """The parts of the excitation (Eq. 9), means over the settled cycles in m.

    A ringing runner falls beyond its next equilibrium and regains that part of the backstep. With
    weak damping this is half of the backstep, and Eq. 9 gives a negative 0-amplitude; ``left +
    regained`` is the length lost in the contact.
    """

    excitation: float  #: actuator deflection, peak to peak; nan where unknown
    step: float  #: step size in the direction of the steps
    backstep: float  #: 0 where the runner never falls back
    regained: float  #: part of the backstep that ringing gives back; nan where none is visible
    left: float  #: excitation - step - backstep, which Eq. 9 gives to the 0-amplitude
    zero_amplitude: float  #: as measured on its own; nan where unknown
    remainder: float  #: left - zero_amplitude: what Eq. 9 does not account for


@dataclass(frozen=True)
class Run:
    """Steps between two rests, or between two changes of the drive.

    Lengths in m, times in s; nan if a value cannot be determined. Arrays have shape (cycles,).
    Step size and backstep are means over the settled cycles, as `settled_from` says, of backsteps
    without the last one, which runs into rest. Steps have the sign of their motion, backsteps are
    positive.
    """

    cycles: Cycles
    mean_step: MeasuredValue  #: of the settled cycles, by all samples of the record
    mean_backstep: MeasuredValue  #: of the settled cycles, from the begin of the slip on
    ringing: Ringing | None  #: after the slips; None where none is visible
    step_sizes: Array  #: from just before a slip to just before the next one
    backsteps: Array  #: from just before the slip to the deepest point after it
    #: Times of the points A to F of Fig. 2 in each cycle (as in ``trace.points``): the presliding
    #: lies between A and B, the stick between B and C, slowdown and second presliding between C
    #: and D, the slip between D and E, the second slowdown between E and F. E and F lie in the next
    #: cycle. D needs the asperity deflection and is nan; B needs the actuator; B and F the ringing.
    points: dict[str, Array]
    regained: float = math.nan  #: part of the backstep that ringing gives back
    excitation: float = math.nan  #: actuator deflection, peak to peak
    zero_amplitude: float = math.nan  #: as measured on its own
    doubts: tuple[str, ...] = ()  #: why the steps are not determined, in words; none if they are
    why_no_backstep: str = ""  #: why the backstep is not determined, in words

    @property
    def period(self) -> float:
        """Period of the drive, s."""
        return self.cycles.period

    @property
    def frequency(self) -> float:
        """Frequency of the drive, Hz."""
        return 1.0 / self.cycles.period

    @property
    def direction(self) -> int:
        """Direction of the steps, +1 or -1."""
        return self.cycles.direction

    @property
    def starts(self) -> Array:
        """Begin of each cycle, s."""
        return self.cycles.starts

    @property
    def slips(self) -> Array:
        """Begin of the slip of each cycle, s."""
        return self.cycles.slips

    @property
    def start(self) -> float:
        """Begin of the first cycle, s."""
        return float(self.cycles.starts[0])

    @property
    def end(self) -> float:
        """End of the last slip, s."""
        return float(self.cycles.ends[-1])

    @property
    def span(self) -> str:
        """Begin and end as text, to a hundredth of a cycle: ``0.02 s to 0.12 s``."""
        places = 2 - math.floor(math.log10(self.period))
        begin, end = (f"{round(at, places):.15g} s" for at in (self.start, self.end))
        return f"{begin} to {end}"

    @property
    def steps(self) -> int:
        """Number of cycles."""
        return len(self.cycles.slips)

    @property
    def first_cycle(self) -> int:
        """The first of the cycles, from 0, that the step size comes from."""
        return settled_from(self.steps)

    @property
    def step_size(self) -> float:
        """Mean step of the settled cycles, with the sign of the direction, m."""
        return self.mean_step.value

    @property
    def step_size_error(self) -> float:
        """Standard error of the step size, m."""
        return self.mean_step.error

    @property
    def is_clear(self) -> bool:
        """Whether the step is no chance."""
        return abs(self.step_size) > SETTINGS.step_errors * self.step_size_error

    @property
    def backstep(self) -> float:
        """Mean backstep of the settled cycles, m."""
        return self.mean_backstep.value

    @property
    def backstep_error(self) -> float:
        """Standard error of the mean backstep, method included, m."""
        return self.mean_backstep.error

    @property
    def mean_speed(self) -> float:
        """Step size times frequency, m/s."""
        return self.step_size * self.frequency

    @property
    def ringing_frequency(self) -> float:
        """Frequency of the ringing after the slips, Hz."""
        return math.nan if self.ringing is None else self.ringing.frequency

    @property
    def decay(self) -> float:
        """Decay of the ringing, 1/s: sigma_1 / (2 m)."""
        return math.nan if self.ringing is None else self.ringing.decay

    @property
    def damping_ratio(self) -> float:
        """Damping of the ringing as part of the critical damping."""
        return math.nan if self.ringing is None else self.ringing.damping_ratio

    @property
    def explained(self) -> bool:
        """Whether equal steps explain the motion; other runs are not returned."""
        return True

    @property
    def determined(self) -> bool:
        """Whether the record determines the run; if not, see `doubts`."""
        return not self.doubts

    @property
    def balance(self) -> Balance:
        """Eq. 9 of the step size and the backstep above."""
        step = self.direction * self.step_size
        left = self.excitation - step - (0.0 if math.isnan(self.backstep) else self.backstep)
        return Balance(
            self.excitation, step, self.backstep, self.regained, left,
            self.zero_amplitude, left - self.zero_amplitude,
        )  # fmt: skip

    def __repr__(self) -> str:
        """Say the run in one line."""
        size = format_si(self.step_size, "m", uncertainty=self.step_size_error)
        return f"Run({self.steps} steps at {self.frequency:.6g} Hz from {self.span}: {size} a step)"

    def report(self) -> str:
        """Return cycles, step size, backstep, ringing and Eq. 9 as text."""
        balance, unknown = self.balance, "not determined"
        rings, damps, backstep = "none visible", "-", unknown
        if self.ringing is not None:
            rings = f"{self.ringing_frequency:.1f} Hz"
            damps = f"{self.decay:.1f} 1/s, {self.damping_ratio:.4f} of critical"
            if not self.ringing.told:
                rings, damps = f"{unknown}: {rings}, or another one that looks the same", unknown
        if math.isfinite(self.backstep):
            backstep = nanometres(self.backstep, self.backstep_error)
        elif self.why_no_backstep:
            backstep += f": {self.why_no_backstep}"
        rows = [
            ("cycles", f"{self.steps} of {format_si(self.period, 's')}, from {self.span}"),
            ("step size", nanometres(self.step_size, self.step_size_error)),
            ("backstep", backstep),
            ("ringing", rings),
            ("decay", damps),
            ("mean speed", f"{1e6 * self.mean_speed:.3f} µm/s"),
        ]
        if math.isnan(balance.excitation):
            rows.append(("Eq. 9", "needs the deflection of the actuator, which is not known"))
            return format_rows(rows)
        rows += [
            ("excitation", nanometres(balance.excitation)),
            ("regained", nanometres(balance.regained)),
            ("left (Eq. 9)", nanometres(balance.left)),
            ("0-amplitude", nanometres(balance.zero_amplitude)),
            ("remainder", nanometres(balance.remainder)),
        ]
        return format_rows(rows)

    def to_frame(self) -> pandas.DataFrame:
        """Return a table with one row for each cycle, SI units; needs pandas."""
        columns = {
            "start (s)": self.starts,
            "slip (s)": self.slips,
            "step (m)": self.step_sizes,
            "backstep (m)": self.backsteps,
        }
        return frame(columns, "cycle")

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw steps and backsteps, cycle by cycle, into axes of Matplotlib, or new ones."""
        cycle = np.arange(1, self.steps + 1)
        lines = [
            (cycle, sizes, "o-", colour, name)
            for sizes, colour, name in (
                (self.step_sizes, SIMULATED, "step"),
                (self.backsteps, MEASURED, "backstep"),
            )
        ]
        return draw_lines(axes, lines, "cycle", "size (m)")

    def _repr_html_(self) -> str:
        told = self.as_json()
        rows = [
            ("cycles", f"{self.steps} at {self.frequency:.6g} Hz"),
            ("step size", format_si(self.step_size, "m", uncertainty=self.step_size_error)),
            ("backstep", format_si(told["backstep"], "m", uncertainty=told["backstep_error"])),
            ("ringing", format_si(told["ringing_frequency"], "Hz")),
            *(("not determined", doubt) for doubt in self.doubts),
        ]
        return html_table(f"Steps from {self.span}", rows)

    def as_json(self) -> dict[str, Any]:
        """Return the numbers of the run, SI units; nan where a thing cannot be measured."""
        ringing = self.ringing
        if ringing is None or not ringing.told:
            ringing = Ringing(math.nan, math.nan)
        return {
            "start": self.start,
            "end": self.end,
            "frequency": self.frequency,
            "direction": self.direction,
            "steps": self.steps,
            "step_size": self.step_size,
            "step_size_error": self.step_size_error,
            "from_cycle": self.first_cycle + 1,
            "to_cycle": self.steps,
            "explained": self.explained,
            "determined": self.determined,
            "doubts": list(self.doubts),
            "scatter": float(np.std(self.step_sizes[self.first_cycle :])),
            "backstep": self.backstep,
            "backstep_error": self.backstep_error,
            "backstep_from": "fold",
            "ringing_frequency": ringing.frequency,
            "ringing_frequency_error": ringing.frequency_error,
            "damping_ratio": ringing.damping_ratio,
            "damping_ratio_error": ringing.damping_ratio_error,
            "mean_speed": self.mean_speed,
        }

    def cycles_as_json(self) -> dict[str, Any]:
        """Return the run cycle by cycle, SI units; nan where a thing cannot be measured."""
        names = (
            "period", "direction", "starts", "slips", "step_sizes", "step_size", "backsteps",
            "backstep", "ringing_frequency", "decay", "damping_ratio", "mean_speed", "points",
        )  # fmt: skip
        own = {name: getattr(self, name) for name in names} | {"balance": asdict(self.balance)}
        return own | {name: told for name, told in self.as_json().items() if name in own}


def main_run(runs: Sequence[Run]) -> Run:
    """Return the run with most cycles. TraceError where there is none."""
    if not runs:
        raise TraceError(
            "the trace shows no steps; give the drive frequency if it is known, and fewer than "
            "three steps with rests of two periods around them"
        )
    return max(runs, key=lambda one: one.steps)


def after_slip(t: Array, x: Array, run: Run) -> tuple[Array, Array]:
    """Return times (s) about the slip and the displacement (m) there, mean of the settled cycles.

    t (s) and x (m) are the measurement, (samples,). Positive is the direction of the run. Empty
    where there are too few samples; at most half a period of the drive, eight of the ringing.
    """
    period, ringing = run.period, run.ringing_frequency
    swing = 1.0 / ringing if ringing > 0.0 else _NO_SWING * period
    slips = run.slips[run.first_cycle : run.first_cycle + _CYCLES]
    begin, end = -min(swing, _BEFORE * period), min(_SWINGS * swing, _AFTER * period)
    inside = [slice(*np.searchsorted(t, [slip + begin, slip + end])) for slip in slips]
    parts = [(t[one] - slip, x[one]) for one, slip in zip(inside, slips, strict=True)]
    parts = [(since, place) for since, place in parts if len(since) > _SAMPLES]
    if not parts:
        return np.empty(0), np.empty(0)
    grid = np.linspace(begin, end, min(_POINTS, int(np.median([len(one[0]) for one in parts]))))
    rows = [np.interp(grid, since, place) for since, place in parts]
    before = np.mean([row - np.interp(0.0, grid, row) for row in rows], axis=0)
    return grid, np.asarray(run.direction * before)
