# SPDX-License-Identifier: Apache-2.0
"""Many operating points at once: their steps, and searches over them.

The 0-amplitude (section 4.1.3) is the actuator deflection up to which the axis makes no steps. Fig.
7 has two methods. Direct: lower the amplitude until the step is no longer measurable. Intersection:
a straight line through clear steps, followed down to where it crosses zero. Steps shrink more
slowly near the end than the line does, so the two differ.

Parameters may hold columns, arrays of shape (points,); see `Parameters`. A set of columns never
becomes a set for each point: laws, plant and drive are evaluated for whole columns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.arrays import Array
from stickslip_ros.physics.laws import value_or
from stickslip_ros.physics.model import Plant, drive_of
from stickslip_ros.physics.model.actuator import strokes
from stickslip_ros.physics.model.friction import is_defined
from stickslip_ros.physics.model.plant import scale_distances
from stickslip_ros.physics.model.surface import Surface
from stickslip_ros.physics.model.waveforms import command_of, drives_of, largest_slip
from stickslip_ros.physics.parameters import PARAMETERS, ParameterError, Parameters
from stickslip_ros.physics.solver.batch import Batch
from stickslip_ros.simulation.left_out import OF_A_CYCLE
from stickslip_ros.simulation.settled import MEASURABLE, SETTLING, TRIAL_STEPS, settled_mean
from stickslip_ros.simulation.steps import run_steps

#: (values to try, at which points) -> at which points the value is high enough
Trial = Callable[[Array, NDArray[np.bool_]], NDArray[np.bool_]]

#: Ringing has ended once it has decayed by e to this power, or after so many cycles; steps settle
#: earlier where it changes them by less than this, m.
_DECAY, _MOST_CYCLES, _SETTLED = 7.0, 500.0, 1e-11
#: Search for the blocking preload: where it begins, the factor between its preloads, and the
#: accuracy of the result, N.
_LOWEST, _FACTOR, _RESOLUTION = 0.01, 1.5, 1e-4
#: N/m, where the parameter ``spring`` is not set: a stiff force sensor.
SPRING = 1e6
#: Cycles over which the position is averaged, and cycles after which a run is given up.
_BLOCK, _LIMIT = 10, 100_000
#: Accuracy of the direct method, m.
_ZERO_RESOLUTION = 1e-11
#: The slip takes at most this part of a period.
_SLIP_SHARE = 0.999
#: Amplitudes of the intersection method, as parts of the largest one, and the steps that count as
#: clear among them, as part of the actuator's deflection.
INTERSECTION_SHARES = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
CLEAR_STEP = 0.1
#: Why there may be no 0-amplitude.
NEVER_STEPS = "the axis does not step even at the largest amplitude"
LOAD_MOVES = "the load moves the runner without the drive"


def batch_of(p: Parameters, points: int, sign: int) -> tuple[Batch, NDArray[np.bool_]]:
    """Return the batch of columns, and whether each point is possible, (points,).

    sign is the direction of the steps, +1 or -1. `why_impossible` explains an impossible point.
    """
    plants = Plant.column(p)
    drive_cycles, possible = drives_of(p, points, sign)
    possible = possible & is_defined(plants.contact)
    plants = _aged(p, plants, possible)
    return Batch(plants, p.solver.tolerance, drive_cycles), possible


def _aged(p: Parameters, plants: Plant, possible: NDArray[np.bool_]) -> Plant:
    """Return the plants with contacts of the dwell and rate of their drives, if these count."""
    f = p.friction
    if not (np.any(f.dwell_growth) or np.any(f.rate_growth)):
        return plants
    factors: Any = np.ones(len(possible))
    for k in np.flatnonzero(possible).tolist():
        point = p.point(k)
        surface, command = Surface.of(point.friction), command_of(point)
        if surface and command.slip >= 0:
            factors[k] = surface.ageing_factor(command.dwell, command.slip_rate)
    return scale_distances(plants, factors)


def why_impossible(p: Parameters) -> str | None:
    """Return why the parameters of one point are impossible, None if they are possible."""
    try:
        Plant.of(p)
        drive_of(p)
    except ParameterError as error:
        return str(error)
    return None


def decay_of(plant: Plant, period: float) -> tuple[float, float]:
    """Return by which power of e ringing decays in a period (s), and how many cycles it lasts.

    Of the slower part of the motion on an elastic contact, where it is damped too much to ring.
    """
    damping = 0.5 * (plant.contact.sigma_1 + plant.contact.sigma_2) / plant.mass
    square = (plant.contact.sigma_0 + plant.spring) / plant.mass
    if damping * damping > square:
        damping = square / (damping + math.sqrt(damping * damping - square))
    decay = max(damping * period, 1e-9)
    return decay, min(_DECAY / decay, _MOST_CYCLES)


def steps_of(
    p: Parameters, points: int, steps: int | None, where: NDArray[np.bool_] | None = None
) -> tuple[Array, Array]:
    """Return step size and backstep (m) of columns, each (points,), as `run_steps` does.

    steps: how many from rest, sign: direction; None: forward, and as many as settle, of a steady
    cycle. nan at impossible points and, if given, where ``where`` is false.
    """
    if steps is not None and has_past(p):
        return _runs_from_rest(p, points, steps, where)
    batch, possible = batch_of(p, points, _sign(steps))
    if where is not None:
        possible = possible & where
    if steps is None:
        return _settled_steps(batch, possible)
    position, backstep = batch.run(abs(steps), possible)
    return (
        settled_mean(np.diff(position, prepend=0.0, axis=-1)),
        settled_mean(backstep),
    )


def has_past(p: Parameters) -> bool:
    """Return whether runs from rest do not begin with a steady cycle; numbers may be columns."""
    values = (p.value(name) for name in OF_A_CYCLE)
    return any(bool(np.any(np.nan_to_num(np.asarray(one, np.float64)))) for one in values)


def _runs_from_rest(
    p: Parameters, points: int, steps: int, where: NDArray[np.bool_] | None
) -> tuple[Array, Array]:
    """Return step size and backstep (m) of each point by itself, as `run_steps` does."""
    found = np.full((2, points), math.nan)
    for k in range(points) if where is None else np.flatnonzero(where).tolist():
        try:
            run = run_steps(p.point(k), steps)
        except ParameterError:  # that the point is impossible, as `why_impossible` says
            continue
        found[:, k] = run.step_size, run.backstep
    return found[0], found[1]


def _sign(steps: int | None) -> int:
    return -1 if steps is not None and steps < 0 else 1


def _settled_steps(batch: Batch, where: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return step size and backstep (m) once ringing no longer changes them, each (points,).

    Runs double from `TRIAL_STEPS` on and are judged by their second half. A point is done where the
    first half outlasts the ringing, or where steps of the second scatter so little that, at the
    rate at which ringing decays, less than `_SETTLED` of it is left in them.
    """
    points = len(where)
    plants = batch.plants.points(points)
    step_size, backstep = np.full(points, math.nan), np.full(points, math.nan)
    scatter, lasting = np.zeros(points), np.zeros(points)
    for k in np.flatnonzero(where).tolist():
        decay, lasting[k] = decay_of(plants[k], float(batch.drive_cycles.periods[k]))
        scatter[k] = -_SETTLED * math.expm1(-decay)
    count = TRIAL_STEPS
    while where.any():
        position, backsteps = batch.run(count, where)
        first = (count - TRIAL_STEPS) // 2
        steps = np.diff(position, prepend=0.0, axis=-1)[:, first:]
        step_size = np.where(where, settled_mean(steps), step_size)
        backstep = np.where(where, settled_mean(backsteps[:, first:]), backstep)
        where = (
            where
            & (lasting > first + SETTLING)
            & ~(np.ptp(steps[:, SETTLING:], axis=-1) <= scatter)
        )
        count *= 2
    return step_size, backstep


def bisect(
    is_enough: Trial,
    low: Array,
    high: Array,
    where: NDArray[np.bool_],
    accuracy: Array | float,
) -> Array:
    """Return the lowest value found that is enough, shape (points,); nan where ``where`` is false.

    low is known not to be enough and high to be enough. Ends where the two are no further apart
    than accuracy; every point takes the same path as if it were alone.
    """
    low, high = low.copy(), high.copy()
    while True:
        active = where & (high - low > accuracy)
        if not active.any():
            return np.where(where, high, np.nan)
        middle = 0.5 * (low + high)
        enough = is_enough(middle, active)
        high = np.where(active & enough, middle, high)
        low = np.where(active & ~enough, middle, low)


def blocking_preloads(p: Parameters, points: int, steps: int | None) -> Array:
    """Return the blocking preload (N) of columns, (points,).

    The preload goes up from 0.01 N in factors until the step falls below `MEASURABLE`, judged as in
    `steps_of`, and bisection from there finds the limit: the first one from below, as on a bench.
    The preload in p plays no part; preloads that the law is not defined for are passed over. nan
    where no preload steps, or every one does up to the end of the table's range.
    """

    def blocks(preload: Array, where: NDArray[np.bool_]) -> NDArray[np.bool_]:
        step_size, _ = steps_of(p.replace(preload=preload), points, steps, where)
        return np.abs(step_size) < MEASURABLE  # nan does not block: the law is not defined there

    low = np.full(points, _LOWEST)
    high = np.full(points, np.nan)
    stepped = np.zeros(points, dtype=bool)
    _, searching = batch_of(p.replace(preload=PARAMETERS["preload"].high), points, 1)
    trial = _LOWEST
    while searching.any() and trial <= PARAMETERS["preload"].high:
        preload = np.full(points, trial)
        step_size, _ = steps_of(p.replace(preload=preload), points, steps, searching)
        stopped = searching & (np.abs(step_size) < MEASURABLE)
        stepped |= searching & (np.abs(step_size) >= MEASURABLE)
        high[stopped] = trial
        searching &= ~stopped
        low[searching] = trial
        trial *= _FACTOR
    return bisect(blocks, low, high, stepped & np.isfinite(high), _RESOLUTION)


def generated_forces(p: Parameters, points: int, steps: int | None) -> Array:
    """Return the generated force (N) of columns, (points,): spring times final position (Fig. 15).

    The runner pushes a spring, that of p or `SPRING`, until slip and stick cost as much as they
    bring; only the sign of steps counts. Positions at the ends of cycles are averaged over ten
    cycles; the run ends when this mean has risen by less than `MEASURABLE` over that of the ten
    cycles before, 0.01 nm a cycle. nan where it still rises after 100 000 cycles.
    """
    spring = value_or(p.runner.spring, SPRING)
    batch, possible = batch_of(p.replace(spring=spring), points, _sign(steps))
    return spring * batch.run_until_still(_BLOCK, MEASURABLE, _LIMIT, possible)


def zero_amplitude(p: Parameters | Mapping[str, Any]) -> float | None:
    """Return the 0-amplitude (m of actuator deflection), by the direct method.

    None if it does not exist; `why_no_zero_amplitude` gives the reason. Raises ParameterError.
    """
    p = Parameters.of(p)
    found = float(zero_amplitudes(p, 1, None)[0])
    if np.isfinite(found):
        return found
    lowest = PARAMETERS["amplitude"].low
    fault = why_impossible(p.replace(amplitude=max(float(largest_amplitude(p)), lowest)))
    if fault:
        raise ParameterError(fault)
    return None


def why_no_zero_amplitude(p: Parameters, steps: int | None = None) -> str:
    """Return why the parameters of one point, which are possible, have no 0-amplitude."""
    return LOAD_MOVES if _moves_undriven(p, 1, steps)[0] else NEVER_STEPS


def largest_amplitude(p: Parameters) -> Array:
    """Return the largest amplitude (V) that amplifier, frequency, slewrate and waveform allow."""
    return np.minimum(p.actuator.max_voltage, _SLIP_SHARE * largest_slip(p.drive))


def zero_amplitudes(p: Parameters, points: int, steps: int | None) -> Array:
    """Return the 0-amplitude (m) of columns, (points,), by the direct method.

    Bisection between zero and `largest_amplitude` for the largest amplitude whose step stays below
    `MEASURABLE`, judged as in `steps_of`. The amplitude in p plays no part. nan where the axis does
    not step even at the largest amplitude, and where the load alone moves the runner.
    """
    high = np.broadcast_to(largest_amplitude(p), (points,))

    def steps_at(volts: Array, where: NDArray[np.bool_]) -> NDArray[np.bool_]:
        return _measurable(p.replace(amplitude=volts), points, steps, where)

    where = steps_at(high, ~_moves_undriven(p, points, steps))
    volts = bisect(
        steps_at, np.zeros(points), high, where, _ZERO_RESOLUTION / p.actuator.gain_in_force
    )
    return np.asarray(strokes(p, volts))


def _moves_undriven(p: Parameters, points: int, steps: int | None) -> NDArray[np.bool_]:
    """Return where the runner moves at a vanishing amplitude already, (points,)."""
    return _measurable(p.replace(amplitude=PARAMETERS["amplitude"].low), points, steps)


def _measurable(
    p: Parameters, points: int, steps: int | None, where: NDArray[np.bool_] | None = None
) -> NDArray[np.bool_]:
    step_size, _ = steps_of(p, points, steps, where)
    return np.abs(step_size) >= MEASURABLE


def intersections(p: Parameters, points: int, steps: int | None) -> Array:
    """Return the 0-amplitude (m) of columns, (points,), by the intersection method.

    Least squares through the steps at `INTERSECTION_SHARES` of the `largest_amplitude`, those left
    out that are no `CLEAR_STEP`. nan where fewer than three are clear.
    """
    largest = np.broadcast_to(largest_amplitude(p), (points,))
    deflection = np.stack([strokes(p, share * largest) for share in INTERSECTION_SHARES])
    step = np.stack(
        [
            _sign(steps) * steps_of(p.replace(amplitude=share * largest), points, steps)[0]
            for share in INTERSECTION_SHARES
        ]
    )
    return crossings(deflection, step, step >= CLEAR_STEP * deflection)


def crossings(deflection: Array, step: Array, clear: NDArray[np.bool_]) -> Array:
    """Return where straight lines through clear steps cross zero, m of actuator deflection.

    All of shape (amplitudes, points), lengths in m; least squares, (points,). nan where fewer than
    three steps are clear.
    """
    count = clear.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean_deflection = np.where(clear, deflection, 0.0).sum(axis=0) / count
        mean_step = np.where(clear, step, 0.0).sum(axis=0) / count
        from_mean = np.where(clear, deflection - mean_deflection, 0.0)
        slope = (from_mean * np.where(clear, step, 0.0)).sum(axis=0) / (from_mean**2).sum(axis=0)
        crossing = mean_deflection - mean_step / slope
    return np.where(count >= 3, crossing, np.nan)
