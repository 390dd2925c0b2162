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
from stickslip_ros.measurement.steps.record import TraceError
from stickslip_ros.measurement.steps.ringing import Ringing
from stickslip_ros.measurement.steps.settings import SETTINGS
from stickslip_ros.simulation.settled import settled_from

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

#: Standard errors of a significant difference: 0.3 % of a normal distribution lie beyond.
COVERAGE = 3.0


@dataclass(frozen=True)
class MeasuredValue:
    """A value with its standard error; both nan where it cannot be determined."""

    value: float = math.nan
    error: float = math.nan


@dataclass(frozen=True)
class Cycles:
    """When the cycles of a run begin and slip, each array of shape (cycles,)."""

    period: float  #: s
    direction: int  #: of the steps, +1 or -1
    starts: Array  #: begin of each cycle, s
    slips: Array  #: begin of the slip of each cycle, s
    ends: Array  #: end of the slip and of the cycle, s; the begin of the slip where that is unknown
    excitation: float = math.nan  #: deflection of the actuator, peak to peak, m; nan if unknown

    @property
    def frequency(self) -> float:
        """Frequency of the drive, Hz."""
        return 1.0 / self.period

    @property
    def start(self) -> float:
        """Begin of the first cycle, s."""
        return float(self.starts[0])

    @property
    def end(self) -> float:
        """End of the last slip, s."""
        return float(self.ends[-1])

    @property
    def span(self) -> str:
        """Begin and end as text, to a hundredth of a cycle: ``0.02 s to 0.12 s``."""
        places = 2 - math.floor(math.log10(self.period))
        begin, end = (f"{round(at, places):.15g} s" for at in (self.start, self.end))
        return f"{begin} to {end}"

    @property
    def steps(self) -> int:
        """Number of cycles."""
        return len(self.slips)


def even_cycles(slips: Array, period: float, direction: int) -> Cycles:
    """Return cycles of one period (s) before slips (s) whose ends are unknown."""
    return Cycles(period, direction, slips - period, slips, slips)


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
    zero_amplitude: float  #: as measured by itself; nan where unknown
    remainder: float  #: left - zero_amplitude: what Eq. 9 does not account for


@dataclass(frozen=True, kw_only=True)
class Run(Cycles):
    """Steps between two rests, or between two changes of the drive.

    Lengths in m, times in s; nan if a value cannot be determined. Arrays have shape (cycles,).
    Step size and backstep are means over the settled cycles, as `settled_from` says, of backsteps
    without the last one, which runs into rest. Steps have the sign of their motion, backsteps are
    positive.
    """

    step_size: float  #: mean of the settled cycles, by all samples of the record
    step_size_error: float  #: standard error
    backstep: float  #: mean of the settled cycles, from the begin of the slip on
    backstep_error: float  #: standard error, method included
    ringing: Ringing | None  #: after the slips; None where none is visible
    step_sizes: Array  #: from just before a slip to just before the next one
    backsteps: Array  #: from just before the slip to the deepest point after it
    #: Times of the points A to F of Fig. 2 in each cycle (as in ``trace.points``): the presliding
    #: lies between A and B, the stick between B and C, slowdown and second presliding between C
    #: and D, the slip between D and E, the second slowdown between E and F. E and F lie in the next
    #: cycle. D needs the asperity deflection and is nan; B needs the actuator; B and F the ringing.
    points: dict[str, Array]
    regained: float = math.nan  #: part of the backstep that ringing gives back
    zero_amplitude: float = math.nan  #: as measured by itself
    doubts: tuple[str, ...] = ()  #: why the steps are not determined, in words; none if they are
    why_no_backstep: str = ""  #: why the backstep is not determined, in words

    @property
    def first_cycle(self) -> int:
        """The first of the cycles, from 0, that the step size comes from."""
        return settled_from(self.steps)

    @property
    def is_clear(self) -> bool:
        """Whether the step is no chance."""
        return abs(self.step_size) > SETTINGS.step_errors * self.step_size_error

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

    def _rows(self) -> list[tuple[str, str]]:
        """Return names and values as text."""
        unknown = "not determined"
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
        return [
            ("cycles", f"{self.steps} of {format_si(self.period, 's')}, from {self.span}"),
            ("step size", nanometres(self.step_size, self.step_size_error)),
            ("backstep", backstep),
            ("ringing", rings),
            ("decay", damps),
            ("mean speed", f"{1e6 * self.mean_speed:.3f} µm/s"),
        ]

    def report(self) -> str:
        """Return cycles, step size, backstep, ringing and Eq. 9 as text."""
        parts = asdict(self.balance)
        del parts["step"], parts["backstep"]
        names = ("excitation", "regained", "left (Eq. 9)", "0-amplitude", "remainder")
        balance = zip(names, map(nanometres, parts.values()), strict=True)
        unknown = [("Eq. 9", "needs the deflection of the actuator, which is not known")]
        return format_rows([*self._rows(), *(unknown if math.isnan(self.excitation) else balance)])

    def to_frame(self) -> pandas.DataFrame:
        """Return a table with one row for each cycle, SI units; needs pandas."""
        columns = {
            "start (s)": self.starts, "slip (s)": self.slips,
            "step (m)": self.step_sizes, "backstep (m)": self.backsteps,
        }  # fmt: skip
        return frame(columns, "cycle")

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw steps and backsteps, cycle by cycle, into axes of Matplotlib, or new ones."""
        cycle = np.arange(1, self.steps + 1)
        lines = [
            (cycle, self.step_sizes, "o-", SIMULATED, "step"),
            (cycle, self.backsteps, "o-", MEASURED, "backstep"),
        ]
        return draw_lines(axes, lines, "cycle", "size (m)")

    def _repr_html_(self) -> str:
        doubts = [("not determined", doubt) for doubt in self.doubts]
        return html_table(f"Steps from {self.span}", [*self._rows(), *doubts])

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
            "determined": self.determined,
            "doubts": list(self.doubts),
            "scatter": float(np.std(self.step_sizes[self.first_cycle :])),
            "backstep": self.backstep,
            "backstep_error": self.backstep_error,
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
        values = {name: getattr(self, name) for name in names} | {"balance": asdict(self.balance)}
        return values | {name: one for name, one in self.as_json().items() if name in values}


def main_run(runs: Sequence[Run]) -> Run:
    """Return the run with most cycles. TraceError where there is none."""
    if not runs:
        raise TraceError(
            "the trace shows no steps; give the drive frequency if it is known, and fewer than "
            "three steps with rests of two periods around them"
        )
    return max(runs, key=lambda one: one.steps)
