# SPDX-License-Identifier: Apache-2.0
"""A run of steps from rest, with its numbers, its trace, its table and its plot."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from numbers import Integral
from typing import TYPE_CHECKING, Any

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.compiled import report_compilation
from stickslip_ros.base.reporting import ACTUATOR, SIMULATED, draw_lines, format_si, html_table
from stickslip_ros.base.reporting.tables import frame
from stickslip_ros.base.reporting.terminal import format_rows
from stickslip_ros.physics.model.waveforms import largest_slip
from stickslip_ros.physics.parameters import PARAMETERS, ParameterError, Parameters, ParameterSource
from stickslip_ros.simulation.motion import Motion
from stickslip_ros.simulation.operating_points import zero_amplitude
from stickslip_ros.simulation.readings import read_steps
from stickslip_ros.simulation.sampling import trace_at_rate, trace_steps
from stickslip_ros.simulation.steps import PUSHED, UNSTABLE, StepRun, growth_of, run_steps
from stickslip_ros.simulation.trace import Trace

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

#: Steps whose positions fit into memory, and steps whose trace fits there and onto a disk
_MOST, _MOST_TRACED = 10_000_000, 2_000
#: Share of a step by which settled ones differ at most
_SETTLED = 0.01


def check_steps(steps: int, traced: bool = False, name: str = "steps") -> None:
    """Raise ParameterError, under a name, for a number of steps that is none or too large."""
    given: object = steps
    if not isinstance(given, Integral):
        raise ParameterError(f"{name} is {steps!r}; it has to be a whole number")
    if not 0 < abs(steps) <= _MOST:
        raise ParameterError(
            f"{name} is {steps}; ask for 1 to {_MOST}, or a negative number to go backward"
        )
    if traced and abs(steps) > _MOST_TRACED:
        raise ParameterError(
            f"a trace of {steps} steps would be too large; trace at most {_MOST_TRACED} steps"
        )


def simulate(
    parameters: ParameterSource = None, /, *, steps: int = 30, **values: Any
) -> SimulatedRun:
    """Simulate steps from rest.

    Parameters
    ----------
    parameters : Parameters, mapping, path or None
        A full set, some by name, or a parameter file; None for the defaults.
    steps : int
        Number of steps; the sign is the direction.
    **values
        Parameters by name, which replace others; SI units, slewrate in V/us.

    Returns
    -------
    SimulatedRun
        Positions and steps of shape (steps,), in m, with trace, table and plot.

    Raises
    ------
    ParameterError
        The message names the value, its limits, or the nearest name.

    Examples
    --------
    >>> import stickslip_ros as ss
    >>> run = ss.simulate("table1_typical", preload=1.0, mass=0.003, steps=12)
    >>> print(f"{1e9 * run.step_size:.1f} nm a step, {1e6 * run.position[-1]:.3f} um in all")
    113.0 nm a step, 1.402 um in all
    >>> ss.simulate(preloadd=1.0)
    Traceback (most recent call last):
    stickslip_ros...ParameterError: there is no parameter 'preloadd'; did you mean ...
    """
    p = Parameters.of(parameters, **values)
    check_steps(steps)
    with report_compilation():
        return SimulatedRun(p, run_steps(p, steps), steps)


@dataclass(frozen=True)
class SimulatedRun:
    """Steps from rest; made by `simulate`.

    >>> import stickslip_ros as ss
    >>> run = ss.simulate("table1_typical", steps=3)
    >>> run
    SimulatedRun(3 steps, ceim, preload 0.4 N: 133.8 nm a step, backstep 48.4 nm)
    >>> (1e9 * run.steps).round(2)
    array([159.75, 133.83, 133.83])
    """

    parameters: Parameters
    result: StepRun
    count: int  #: steps that were asked for; the sign is the direction

    @property
    def position(self) -> Array:
        """Position of the runner at the end of each drive cycle, m, shape (steps,)."""
        return self.result.position

    @property
    def steps(self) -> Array:
        """How far the runner got in each drive cycle, m, shape (steps,)."""
        return np.diff(self.result.position, prepend=0.0)

    @property
    def step_size(self) -> float:
        """Mean step over the settled steps, m, with the sign of the direction."""
        return self.result.step_size

    @property
    def backstep(self) -> float:
        """Mean backstep over the settled steps, m; nan where the runner never turns back."""
        return self.result.backstep

    @property
    def mean_speed(self) -> float:
        """Step size times frequency, m/s, with the sign of the direction."""
        return self.step_size * self.parameters.drive.frequency

    @cached_property
    def zero_amplitude(self) -> float | None:
        """The largest actuator stroke that makes no step, m; None where there is none."""
        with report_compilation():
            return zero_amplitude(self.parameters)

    @cached_property
    def growth(self) -> float:
        """How many times a small change of the start grows within the run, see `growth_of`."""
        with report_compilation():
            return growth_of(self.parameters, self.count, self.position)

    @property
    def unstable(self) -> bool:
        """Whether runs that begin alike end apart, by more than a millionth of the way."""
        apart = PUSHED * self.growth
        return self.growth > UNSTABLE and apart > 1e-6 * float(np.abs(self.position).max())

    @property
    def _once_settled(self) -> str:
        """What the report says of numbers of settled steps where the last two steps differ."""
        last = self.steps[-2:]
        same = len(last) == 2 and abs(np.diff(last)[0]) <= _SETTLED * abs(last[-1])
        return "" if same else ", once the steps have settled"

    @cached_property
    def trace(self) -> Trace:
        """Runner, actuator and contact over time, with the ringing and the slips resolved.

        Each of its arrays has the shape (samples,), in SI units. Raises ParameterError for a run
        of more than 2000 steps.
        """
        check_steps(self.count, traced=True)
        with report_compilation():
            return trace_steps(self.parameters, self.count)

    def trace_at(self, rate: float) -> Trace:
        """Return the trace at even times, rate (Hz) of them a second, each value exact.

        >>> import stickslip_ros as ss
        >>> len(ss.simulate("table1_typical", steps=2).trace_at(1e5).t)
        2001
        """
        with report_compilation():
            return trace_at_rate(self.parameters, self.count, rate)

    @property
    def deflections(self) -> Array:
        """Deflection of each contact at the times of the trace, m, shape (contacts, samples).

        >>> import stickslip_ros as ss
        >>> run = ss.simulate(steps=2, contacts=6, contact_shares="guide")
        >>> run.deflections.shape == (6, len(run.trace.t))
        True
        """
        return self.trace.each if len(self.trace.each) else self.trace.z[np.newaxis]

    @property
    def motion(self) -> Motion:
        """The trace as a motion, for `analyse` and `compare`."""
        return Motion.of_trace(self.trace, f"simulation of {self.count} steps")

    @cached_property
    def readings(self) -> Motion:
        """Readings of the simulated sensor, with a rest before and after the run.

        >>> import stickslip_ros as ss
        >>> run = ss.simulate(steps=10, sensor_rate=1e5, sensor_bandwidth=2e4)
        >>> print(f"{1e9 * ss.analyse(run.readings).step_size:.0f} nm a step")
        134 nm a step
        """
        with report_compilation():
            return read_steps(self.parameters, self.count)

    def to_frame(self) -> pandas.DataFrame:
        """Return a table with one row for each step; needs pandas.

        >>> import stickslip_ros as ss
        >>> table = ss.simulate(steps=3).to_frame()
        >>> table.columns.tolist()
        ['time (s)', 'position (m)', 'step (m)']
        >>> table.index.tolist()
        [1, 2, 3]
        """
        return frame(self.table, "step")

    @property
    def table(self) -> dict[str, Array]:
        """Time, position and step after each drive cycle, each of shape (steps,), by their names.

        >>> import stickslip_ros as ss
        >>> list(ss.simulate(steps=3).table)
        ['time (s)', 'position (m)', 'step (m)']
        """
        period = 1.0 / self.parameters.drive.frequency
        return {
            "time (s)": period * np.arange(1.0, len(self.position) + 1.0),
            "position (m)": self.position,
            "step (m)": self.steps,
        }

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw runner and actuator over time into axes of Matplotlib, or new ones; return them.

        >>> import matplotlib
        >>> matplotlib.use("agg")
        >>> import stickslip_ros as ss
        >>> ss.simulate(steps=3).plot().get_xlabel()
        'time (ms)'
        """
        t = self.trace.t
        lines = [
            (t, self.trace.u, "-", ACTUATOR, "actuator u"),
            (t, self.trace.x, "-", SIMULATED, "runner x"),
        ]
        return draw_lines(axes, lines, "time (s)", "displacement (m)", self.title)

    @property
    def title(self) -> str:
        """Steps, friction law and preload, in a line."""
        friction = self.parameters.friction
        return f"{self.count} steps, {friction.model}, preload {friction.preload:g} N"

    def __repr__(self) -> str:
        """Say the run in one line."""
        sizes = f"{1e9 * self.step_size:.1f} nm a step, backstep {1e9 * self.backstep:.1f} nm"
        return f"SimulatedRun({self.title}: {sizes})"

    def report(self) -> str:
        """Return what `stickslip simulate` prints: one line for each name and value."""
        p, d = self.parameters, self.parameters.drive
        drive = f"{d.amplitude:g} V, {d.frequency:g} Hz"
        if math.isfinite(largest_slip(d)):
            drive += f", slip {d.slewrate:g} V/us"
        if d.waveform != PARAMETERS["waveform"].default:
            drive += f", {d.waveform}"
        try:
            zero = self.zero_amplitude
            none = "none: no amplitude makes steps, or the load moves the runner without the drive"
            found = none if zero is None else f"{1e9 * zero:.2f} nm{self._once_settled}"
        except ParameterError:  # the run has been possible, so a drive of the search is not
            found = "not found"
        law, mass = p.friction.model, f"{1e3 * p.runner.mass:g} g"
        rows = [
            ("model", f"{law}, preload {p.friction.preload:g} N, mass {mass}"),
            ("drive", drive),
            ("steps", f"{self.count}"),
            ("position", f"{format_si(float(self.position[-1]), 'm', 7)}, as the last slip ends"),
            ("step size", f"{1e9 * self.step_size:.3f} nm"),
            ("backstep", f"{1e9 * self.backstep:.3f} nm"),
            ("0-amplitude", found),
            ("mean speed", f"{1e6 * self.mean_speed:.3f} µm/s"),
        ]
        if self.unstable:
            told = f"a start that is 0.01 nm off ends {1e9 * PUSHED * self.growth:.2g} nm off"
            rows.append(("unstable", f"{told}: one of many runs that begin alike"))
        return format_rows(rows)

    def _repr_html_(self) -> str:
        drive = self.parameters.drive
        rows = [
            ("drive", f"{drive.waveform}, {drive.amplitude:g} V, {drive.frequency:g} Hz"),
            ("position", f"{format_si(float(self.position[-1]), 'm', 5)}, as the last slip ends"),
            ("step size", format_si(self.step_size, "m")),
            ("backstep", format_si(self.backstep, "m")),
            ("mean speed", f"{1e6 * self.mean_speed:.3f} µm/s"),
        ]
        return html_table(self.title, rows)
