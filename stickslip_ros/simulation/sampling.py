# SPDX-License-Identifier: Apache-2.0
"""Samples a simulated run over time, with its kinks and turns or at even times."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.physics.model import DriveCycle, Plant
from stickslip_ros.physics.model.actuator_chain import has_chain
from stickslip_ros.physics.model.waveforms import command_of
from stickslip_ros.physics.parameters import ParameterError, Parameters
from stickslip_ros.physics.solver.driven import simulation_of
from stickslip_ros.simulation.trace import HEADER, Trace, trace_of_rows

#: Samples of an even trace, which is a table of some 140 bytes each: a file of 1.4 GB
MOST_SAMPLES = 10_000_000
#: Samples in a period of the ringing
_DENSITY = 40.0
#: Swings after a run that are drawn densely: with the damping of Table 1, 1 % is left then
_SWINGS = 60.0
#: Cycles that are traced at a time: those of a ringing actuator have thousands of kinks each
_AT_A_TIME = 100
#: Two times nearer together than this (s) are one sample: no runner gets anywhere in between
_NEAREST = 1e-12


@dataclass(frozen=True)
class PlannedRun:
    """Steps that begin at a time of their own."""

    start: float  #: s
    steps: int  #: sign: direction
    frequency: float | None = None  #: Hz; None: that of the parameters


def trace_steps(p: Parameters | Mapping[str, Any], steps: int) -> Trace:
    """Run steps (sign: direction) from rest, sampled so that ringing and slips can be seen.

    Among the samples are all kinks of u(t), all times at which the runner or the deflection turns,
    and those at which the contact breaks away or sticks again. Raises ParameterError.
    """
    p = Parameters.of(p)
    drive_cycle = command_of(p, 1 if steps >= 0 else -1)
    within = sample_times(drive_cycle, _DENSITY * Plant.of(p).ringing_frequency)
    begins = drive_cycle.period * np.arange(abs(steps) + 1)
    grid = np.append((begins[:-1, None] + within).ravel(), begins[-1])
    return _trace(p, steps, grid, with_events=True)


def trace_at_rate(p: Parameters | Mapping[str, Any], steps: int, rate: float) -> Trace:
    """Run steps (sign: direction) from rest; return samples at even times, with a rate in Hz.

    Raises ParameterError.
    """
    p = Parameters.of(p)
    drive_cycle = command_of(p, 1 if steps >= 0 else -1)
    count = rate * abs(steps) * drive_cycle.period
    if not 1.0 <= count <= MOST_SAMPLES:
        raise ParameterError(
            f"the rate of the trace is {rate:g} Hz, which makes {count:.3g} samples of {steps} "
            f"steps; it may have 1 to {MOST_SAMPLES}: "
            + ("raise the rate" if count < 1.0 else "lower the rate, or steps")
        )
    t = np.arange(math.floor(count * (1.0 + 1e-12)) + 1) / rate
    return _trace(p, steps, t, with_events=False)


def _trace(p: Parameters, steps: int, grid: NDArray[np.float64], with_events: bool) -> Trace:
    """Return the trace of steps at the times of a grid (s), and at events where these are wanted.

    A second simulation goes ahead and finds the events: sampling never changes a run. Without them
    the work needs the kinks of u(t) nevertheless.
    """
    drive_cycle, plant = command_of(p, 1 if steps >= 0 else -1), Plant.of(p)
    simulation, scout = (simulation_of(p, plant, replay) for replay in (True, False))
    for one in (simulation, scout):
        one.start(drive_cycle, abs(steps))
    ends, rigid = np.cumsum(drive_cycle.durations), not has_chain(p.actuator)
    parts, last = [], np.zeros((8, 1))
    for part in np.array_split(grid, math.ceil(abs(steps) / _AT_A_TIME)):
        first, stop = np.floor(part[[0, -1]] / drive_cycle.period)
        begins = drive_cycle.period * np.arange(max(first - 1.0, 0.0), stop + 1.0)
        events = (begins[:, None] + ends).ravel()
        events = events[(last[0, -1] < events) & (events < part[-1])]
        if with_events or not rigid:  # which are no events where a cycle ends
            events = np.union1d(events, scout.event_times(part[-1]))
        times = _merge_times(part, events)
        before = 0.5 * (np.append(last[0], times[:-1]) + times)
        both = times if rigid else np.stack([before, times], axis=1).ravel()
        s, own = simulation.sample(both), slice(None) if rigid else slice(1, None, 2)
        columns = both, s.x, s.v, s.u, s.z, s.v - s.rate, s.force, np.zeros(len(both))
        rows = np.vstack([*columns, s.each])[:, own]
        rows[7] = _work(plant, np.hstack([last, rows[:8]]), None if rigid else s.u[::2])
        last = rows[:8, -1:]
        parts.append(rows if with_events else rows[:, np.isin(times, part)])
    return trace_of_rows(np.hstack(parts)[: None if len(plant.contacts) > 1 else len(HEADER)])


def _merge_times(grid: NDArray[np.float64], events: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the times (s) of a grid with those events that are apart from them and each other."""
    events = np.unique(events)
    events = events[np.diff(events, prepend=-math.inf) > _NEAREST]
    after = np.searchsorted(grid, events)
    ends = np.concatenate([[-math.inf], grid, [math.inf]])
    apart = np.minimum(events - ends[after], ends[after + 1] - events) > _NEAREST
    return np.union1d(grid, events[apart])


def _work(
    plant: Plant, rows: NDArray[np.float64], middles: NDArray[np.float64] | None
) -> NDArray[np.float64]:
    """Return the work of friction on the contact (J) at all samples but the first.

    rows are those of a `Trace`, (8, samples), with all kinks of u(t) among them: in between, the
    momentum of the runner gives the impulse of F exactly, and its energy the work on the runner.
    Where u may be bent it is a parabola there, for which F counts with the time as well; middles
    are then u (m) in the middle of the time from sample to sample.
    """
    t, x, v, u = rows[:4]
    dt, dv = np.diff(t), np.diff(v)
    mean_x = 0.5 * (x[1:] + x[:-1]) - dt * dv / 12.0  # of the cubic with these slopes at its ends
    impulse = (plant.force - plant.spring * mean_x) * dt - plant.mass * dv
    rates = np.divide(np.diff(u), dt, out=np.zeros_like(dt), where=dt > 0.0)
    on_runner = np.diff(plant.force * x - 0.5 * plant.spring * x**2 - 0.5 * plant.mass * v**2)
    work = on_runner - rates * impulse
    if middles is not None:
        between = 0.5 * (u[1:] + u[:-1]) - middles
        leans = np.divide(4.0 * between, dt, out=np.zeros_like(dt), where=dt > 0.0)
        moment = 0.5 * (plant.force - plant.spring * mean_x) * dt**2
        moment -= plant.mass * (dt * v[1:] - np.diff(x))
        mean = np.divide(moment, dt, out=np.zeros_like(dt), where=dt > 0.0)
        work -= leans * (2.0 * mean - impulse)
    return rows[-1, 0] + np.cumsum(work)


def trace_runs(
    p: Parameters | Mapping[str, Any],
    runs: Sequence[PlannedRun],
    density: float = 40.0,
    before: float = 0.0,
    after: float = 0.0,
) -> NDArray[np.float64]:
    """Return t, x, v and u (as of a `Trace`) of runs from rest in the order of their starts.

    The shape is (4, samples). before and after are times (s) of rest before the first and after the
    last run; times count from the first start. A run begins when the one before it has ended, at
    the earliest.
    """
    p = Parameters.of(p)
    plant = Plant.of(p)
    simulation = simulation_of(p, plant)
    ringing = plant.ringing_frequency
    times, parts, now = [], [], 0.0
    for run in runs:
        drive_cycle = command_of(
            p if run.frequency is None else p.replace(frequency=run.frequency),
            1 if run.steps >= 0 else -1,
        )
        start = max(run.start - runs[0].start, now)
        if start > now:
            times.append(_resting_times(now, start, density, ringing, drive_cycle.period))
            parts.append(simulation.sample(times[-1]))
            simulation.advance(start)
        simulation.start(drive_cycle, abs(run.steps))
        within = sample_times(drive_cycle, density * ringing)
        count = abs(run.steps)
        end = start + count * drive_cycle.period
        cycles = [start + k * drive_cycle.period + within for k in range(count)]
        times.append(np.append(np.concatenate(cycles), end))
        parts.append(simulation.sample(times[-1]))
        now = end
    if after > 0.0:
        times.append(_resting_times(now, now + after, density, ringing, drive_cycle.period))
        parts.append(simulation.sample(times[-1]))
    rows = np.hstack([np.stack([t, s.x, s.v, s.u]) for t, s in zip(times, parts, strict=True)])
    if before > 0.0:
        rest = np.zeros((4, 500))
        rest[0] = np.linspace(-before, 0.0, 500, endpoint=False)
        rows = np.hstack([rest, rows])
    return rows[:, np.append(np.diff(rows[0]) > 0.0, True)]


def _resting_times(
    start: float, end: float, density: float, ringing: float, period: float
) -> NDArray[np.float64]:
    """Return times (s) after a run: dense while the runner rings down, then a few.

    density: samples in a period of the ringing (Hz), which is 0 if the contact is overdamped.
    """
    rung = min(end, start + max(_SWINGS / ringing if ringing > 0.0 else 0.0, period))
    count = int(np.clip(density * ringing * (rung - start), 100, 20_000))
    times = np.linspace(start, rung, count + 1)[1:]
    if rung < end:
        times = np.concatenate((times, np.linspace(rung, end, 501)[1:]))
    return times


def sample_times(drive_cycle: DriveCycle, rate: float) -> NDArray[np.float64]:
    """Return times (s) within a cycle at a rate (Hz), within bounds for each piece."""
    parts = []
    for start, end in pairwise(np.concatenate(([0.0], np.cumsum(drive_cycle.durations)))):
        count = int(min(4000, max(100, rate * (end - start))))
        parts.append(np.linspace(start, end, count, endpoint=False))
    return np.concatenate(parts)
