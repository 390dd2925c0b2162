# SPDX-License-Identifier: Apache-2.0
"""Waveforms found by search: the slip in two parts, and holds around the slip (section 4.2).

Input shaping: the second part of the slip takes out the ringing of the first. Where the contact
stays elastic half a ringing period between two halves would do; it breaks away in the slip, so
share and latency have to be searched for.

Step elongation: holds before and after the slip win the elastic deflection back. It works at high
frequencies, where a hold catches the runner while it still rings, and with a runner in motion:
steps are judged once they have settled.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.compiled import report_compilation
from stickslip_ros.base.reporting import format_si
from stickslip_ros.physics.model import Plant, drive_of
from stickslip_ros.physics.parameters import ParameterError, Parameters, ParameterSource
from stickslip_ros.physics.solver import Simulation
from stickslip_ros.simulation.left_out import OF_ONE_CONTACT, left_out
from stickslip_ros.simulation.operating_points import batch_of, decay_of
from stickslip_ros.simulation.settled import MEASURABLE, TRIAL_STEPS

#: Ringing periods over which ringing is measured, and samples in each.
_WINDOW, _SAMPLES = 3, 80
#: The step size is the mean of this many steps at the end.
_MEAN_STEPS = 10
#: First search: shares of the first part, and latencies in ringing periods.
_SPLITS, _LATENCIES = np.linspace(0.5, 0.98, 13), np.linspace(0.1, 0.9, 9)
#: Cycles from rest, and how many of them at the end a step is averaged over.
_CYCLES, _LAST = 300, 50
#: Holds tried at first, shares of the period, and the most that both may take.
_HOLDS, _MOST = np.linspace(0.0, 0.9, 19), 0.95
#: Holds that a further search tries between the neighbours of the best one; number of searches.
_FINER, _SEARCHES = 5, 4
#: A step counts as better if it is larger by this, m; a blocked drive creeps by less.
_GAIN = 1e-13


def _nano(length: float) -> str:
    return f"{1e9 * length:.3f} nm"


def _columns(rows: Sequence[tuple[str, str, str]]) -> str:
    return "\n".join(f"{name:<14}{before:<16}{after}".rstrip() for name, before, after in rows)


@dataclass(frozen=True)
class ShapedSlip:
    """A shaped slip next to the single slip of the same amplitude; lengths in m."""

    split: float  #: share of the first part in the slip
    latency: float  #: between the parts, s
    ringing_period: float  #: s
    ringing_before: float  #: after the single slip, peak to peak
    ringing_after: float  #: after the shaped slip, peak to peak
    step_before: float  #: step size with the single slip
    step_after: float  #: step size with the shaped slip
    left_out: tuple[str, ...] = ()  #: effects of the parameters that the search is without

    def report(self) -> str:
        """Return a table of ringing and step, before and after, and the two numbers found."""
        latency = format_si(self.latency, "s", 5)
        rows = [
            ("", "single slip", "shaped slip"),
            ("ringing", _nano(self.ringing_before), _nano(self.ringing_after)),
            ("step size", _nano(self.step_before), _nano(self.step_after)),
            ("split", "", f"{100 * self.split:.2f} %"),
            ("latency", "", f"{latency}, {self.latency / self.ringing_period:.3f} ringing periods"),
        ]
        return _columns(rows)


@report_compilation()
def shape_slip(parameters: ParameterSource = None, /, **values: Any) -> ShapedSlip:
    """Return the slip in two parts that leaves the least ringing (section 4.2 of the paper).

    Holds of the waveform stay the same; `ringing_and_step` defines the ringing.

    Parameters
    ----------
    parameters : Parameters, mapping, path or None
        As in `simulate`.
    **values
        Parameters by name, laid over the others.

    Returns
    -------
    ShapedSlip
        Split and latency, with ringing and step before and after.

    Raises
    ------
    ParameterError
        The slip cannot be shaped: another waveform, a contact that does not ring, too short a
        period, or a drive without steps.

    Examples
    --------
    >>> import stickslip_ros as ss
    >>> found = ss.shape_slip("table1_typical")
    >>> found.ringing_after < 0.1 * found.ringing_before
    True
    >>> two_parts = {"waveform": "shaped", "split": found.split, "latency": found.latency}
    >>> run = ss.simulate("table1_typical", **two_parts)
    """
    p = Parameters.of(parameters, **values)
    single = _single_slip(p)
    frequency = Plant.of(p).ringing_frequency
    if not frequency > 0.0:
        raise ParameterError("the contact is damped too much to ring: there is nothing to shape")
    period = 1.0 / frequency
    ringing_before, step_before = ringing_and_step(single)
    if abs(step_before) < MEASURABLE:
        raise ParameterError(
            f"preload is {p.friction.preload:g} N and amplitude {p.drive.amplitude:g} V: the axis "
            "makes no steps then, and there is no slip to shape; lower the preload or raise the "
            "amplitude"
        )
    first = shaping_map(p, _SPLITS, _LATENCIES * period)
    if not np.isfinite(first).any():
        raise ParameterError(
            f"a ringing period takes {1e6 * period:g} us; no latency of "
            f"{_LATENCIES[0]:g} of it or more fits into the cycle: lower the frequency or the holds"
        )
    row, column = np.unravel_index(int(np.nanargmin(first)), first.shape)

    def left(point: Array) -> float:
        found = _ringing_or_nan(single, float(point[0]), float(point[1]) * period)
        return 1e9 * (found if math.isfinite(found) else 2.0 * ringing_before)

    start = np.array([_SPLITS[row], _LATENCIES[column]])
    simplex = start + np.array([[0.0, 0.0], [0.03, 0.0], [0.0, 0.06]]) - [0.01, 0.02]
    best = scipy.optimize.minimize(
        left,
        start,
        method="Nelder-Mead",
        bounds=((0.0, 1.0), (0.0, 2.0)),
        options={"initial_simplex": simplex, "xatol": 1e-5, "fatol": 1e-4, "maxfev": 300},
    ).x
    split, latency = float(best[0]), float(best[1]) * period
    ringing_after, step_after = ringing_and_step(
        single.replace(waveform="shaped", split=split, latency=latency)
    )
    return ShapedSlip(
        split, latency, period, ringing_before, ringing_after, step_before, step_after,
        left_out(p, OF_ONE_CONTACT),
    )  # fmt: skip


def shaping_map(p: Parameters, splits: Array, latencies: Array) -> Array:
    """Return the ringing (m) after a shaped slip, shape (splits, latencies); nan if impossible."""
    single = _single_slip(p)
    return np.array(
        [[_ringing_or_nan(single, float(a), float(b)) for b in latencies] for a in splits]
    )


def ringing_and_step(p: Parameters) -> tuple[float, float]:
    """Return the ringing after a slip, peak to peak, and the step size, both in m.

    Of a settled cycle: the runner against the actuator, x - u, over the first three ringing periods
    after the slip, but not longer than to the next one.
    """
    plant, drive_cycle = Plant.of(p), drive_of(p)
    settling = int(TRIAL_STEPS + decay_of(plant, drive_cycle.period)[1])
    simulation = Simulation(plant, p.solver.tolerance)
    simulation.start(drive_cycle, settling + 2)
    position = simulation.run_cycles(settling).position
    within = float(np.sum(drive_cycle.durations[: drive_cycle.slip_end]))
    start = settling * drive_cycle.period + within
    length = min(_WINDOW / plant.ringing_frequency, drive_cycle.period - drive_cycle.slip_duration)
    found = simulation.sample(start + np.linspace(0.0, length, _WINDOW * _SAMPLES))
    step = float(position[-1] - position[-1 - _MEAN_STEPS]) / _MEAN_STEPS
    return float(np.ptp(found.x - found.u)), step


def _single_slip(p: Parameters) -> Parameters:
    """Return p with the slip in one part."""
    if p.drive.waveform == "sawtooth":
        return p.replace(hold_before=0.0, hold_after=0.0)
    _check_waveform(p, "be shaped")
    return p.replace(waveform="hold")


def _ringing_or_nan(single: Parameters, split: float, latency: float) -> float:
    try:
        shaped = single.replace(waveform="shaped", split=split, latency=latency)
        return ringing_and_step(shaped)[0]
    except ParameterError:
        return math.nan


@dataclass(frozen=True)
class ElongatedStep:
    """A step with holds next to one without; lengths in m."""

    hold_before: float  #: share of the period
    hold_after: float  #: share of the period
    step_before: float  #: settled step size of the same slip without holds
    step_after: float  #: settled step size with the holds
    left_out: tuple[str, ...] = ()  #: effects of the parameters that the search is without

    def report(self) -> str:
        """Return a table of the step, without and with the holds, and the holds."""
        rows = [
            ("", "without holds", "with holds"),
            ("step size", _nano(self.step_before), _nano(self.step_after)),
            ("hold before", "", f"{100 * self.hold_before:.2f} % of the period"),
            ("hold after", "", f"{100 * self.hold_after:.2f} % of the period"),
        ]
        return _columns(rows)


@report_compilation()
def elongate_step(parameters: ParameterSource = None, /, **values: Any) -> ElongatedStep:
    """Return the hold times around the slip that give the largest step (section 4.2).

    They are 0 if no hold gives a larger step. The slip stays as it is, in one part or in two.

    Parameters
    ----------
    parameters : Parameters, mapping, path or None
        As in `simulate`.
    **values
        Parameters by name, laid over the others.

    Returns
    -------
    ElongatedStep
        The holds, as parts of the period, with the step before and after.

    Raises
    ------
    ParameterError
        The waveform has no holds, or the slip is impossible without them.

    Examples
    --------
    >>> import stickslip_ros as ss
    >>> found = ss.elongate_step("table1_typical", frequency=10e3)
    >>> print(f"{found.step_after / found.step_before:.1f} times the step")
    1.6 times the step
    """
    p = Parameters.of(parameters, **values)
    _check_waveform(p, "have holds")
    held = p.replace(waveform="hold") if p.drive.waveform == "sawtooth" else p
    plain = held.replace(hold_before=0.0, hold_after=0.0)
    Plant.of(plain)
    drive_of(plain)
    before, after = _grid(_HOLDS, _HOLDS)
    width = float(_HOLDS[1])
    step_before = float(elongation_map(plain, np.zeros(1), np.zeros(1))[0])
    best, step = (0.0, 0.0), step_before
    for _ in range(_SEARCHES):
        steps = elongation_map(held, before, after)
        if np.isfinite(steps).any() and np.nanmax(steps) > step + _GAIN:
            k = int(np.nanargmax(steps))
            best, step = (float(before[k]), float(after[k])), float(steps[k])
        around = np.linspace(-width, width, _FINER)
        before, after = _grid(*(np.clip(hold + around, 0.0, _HOLDS[-1]) for hold in best))
        width *= 2.0 / (_FINER - 1)
    return ElongatedStep(*best, step_before, step, left_out(p))


def elongation_map(p: Parameters, before: Array, after: Array) -> Array:
    """Return the settled step (m) for each pair of holds (points,); nan where they do not fit."""
    held = p.replace(hold_before=before, hold_after=after)
    batch, possible = batch_of(held, len(before), 1)
    position, _ = batch.run(_CYCLES, possible)
    return np.asarray((position[:, -1] - position[:, -1 - _LAST]) / _LAST)


def _grid(before: Array, after: Array) -> tuple[Array, Array]:
    """Return all pairs that leave some of the period, each (points,)."""
    a, b = (one.ravel() for one in np.meshgrid(before, after, indexing="ij"))
    fits = a + b <= _MOST
    return a[fits], b[fits]


def _check_waveform(p: Parameters, what: str) -> None:
    """Raise ParameterError for a waveform without a slip; what: the purpose, for the message."""
    if p.drive.waveform not in ("sawtooth", "hold", "shaped"):
        raise ParameterError(
            f"waveform is {p.drive.waveform}; the slip of sawtooth, hold and shaped can {what}"
        )
