# SPDX-License-Identifier: Apache-2.0
"""Arcs of contacts whose law has its own rate: one step of an explicit method of order 8.

So go several contacts whose limit of z follows w, too: they have no series.

State and step are mirrored so that w > 0: w, the z of each contact, their second states if the law
has two, and with a spring the path, the integral of w. The step gives polynomials of time, which
the rest of the solver uses like a Taylor series for events, samples and sums. An arc ends where w
turns, or with the step, whose length keeps the error of the polynomials, of order 7, within its
limit.

The method is that of `dop853`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.compiled import compiled
from stickslip_ros.physics.laws.law import ELASTOPLASTIC_CALC, FOREIGN
from stickslip_ros.physics.model.friction import has_two_states, rates_of_law
from stickslip_ros.physics.solver.arc_motion import AT_REST, end_at, is_at_rest
from stickslip_ros.physics.solver.contact_arcs import mean_at_end, stay
from stickslip_ros.physics.solver.dop853 import (
    DEGREES,
    ERRORS,
    OUTPUT,
    POWERS,
    STAGES,
    STEP,
    THIRD,
    TIMES,
    A,
)
from stickslip_ros.physics.solver.layout import ORDER, PLASTIC, TAYLOR, TURN
from stickslip_ros.physics.solver.taylor import W, Z, integral, polynomial, turn_end

#: Error allowed in a step, as a fraction of the tolerance per cycle. The estimate is that of the
#: output, several times the error of the state at the end.
_PER_STEP = 0.03
#: This many steps of a cycle may each have that error. Where there are more, each gets a fraction
#: by its length: a sliding contact keeps their errors, and a slow drive takes thousands of steps.
_FREE_STEPS = 3.0
#: Smallest such share: a rest may last for ever, and its steps grow
_LEAST_PART = 1e-4
#: Error allowed in a step, as a fraction of the motion that is left: a ringing has to die away
_OF_MOTION = 1e-3
#: First step, in units of the ringing; its length soon adapts to the allowed error
_FIRST = 0.1
#: Least factor from one step to the next
_LEAST = 0.2
#: Largest factor from one step to the next
_MOST = 5.0
#: Step taken, as a fraction of the one whose error would be just allowed: so the next try succeeds
_SAFE = 0.9
#: Power of its length with which the error of a step grows
_ORDER = 8.0
#: Fraction of the error allowed that counts as none: a step without any would grow for ever
_NO_ERROR = 1e-30
#: Longest step of a runner in motion, in the fastest time of its elastic contact: beyond, no such
#: method is stable. Its estimate of the error, a polynomial of that number, has a root at 5.65, and
#: is less than the error within the step from 4 on
_STABLE = 4.0
#: Lengths tried for one arc. Where none is exact enough, the arc has no length, and the next one
#: tries still shorter ones; the event loop ends that.
_TRIES = 40
#: Places of w and of the z of the first contact in the state
_W, _FIRST_Z = range(2)
#: Row of the second state among the series of a contact, after that of its deflection
SECOND = 1


@compiled
def needs_steps(c: np.record) -> bool:
    """Return whether arcs of a contact are steps: its law has its own rate, or z_lim follows w."""
    return c.kind >= FOREIGN or c.kind == ELASTOPLASTIC_CALC or c.z_k != c.z_s


@compiled
def force_of(c: np.record, z: float, second: float, w: float) -> float:
    """Return F (N) of Eq. 1 of one of the contacts, whatever its law."""
    z_rate, _ = rates_of_law(z, second, w, c)
    return c.sigma_0 * z + c.sigma_1 * z_rate + c.sigma_2 * w


@compiled
def second_after(arc: np.record, c: np.record, t: float) -> float:
    """Return the second state of a contact after t (s) within the arc."""
    if arc.kind == TAYLOR and c.kind >= FOREIGN:
        return polynomial(c.series, SECOND, t)
    return c.second


@compiled
def general_arc(arc: np.record, plant: np.record, contacts: NDArray, limit: float) -> None:
    """Find the end of the arc that `begin_arc` started, at most limit (s) long."""
    net = arc.force - plant.spring * arc.x - plant.sigma_0 * arc.z
    arc.kind, arc.cost = TAYLOR, len(contacts)
    arc.mirror = 1.0 if arc.w > 0.0 or (arc.w == 0.0 and net > 0.0) else -1.0
    still = is_at_rest(arc, plant, net)
    two = has_two_states(contacts[0].kind)
    if still and not two:
        stay(arc, contacts, limit, 0.0)
        return
    size = _FIRST_Z + (2 if two else 1) * len(contacts) + (1 if plant.spring != 0.0 else 0)
    rates = np.zeros((STAGES + 2, size))  # at the stages; the state there, and that at the start
    y = rates[STAGES + 1]
    y[_W] = 0.0 if still else arc.mirror * arc.w
    for i in range(len(contacts)):
        y[_FIRST_Z + i] = arc.mirror * contacts[i].z
        if two:
            y[_FIRST_Z + len(contacts) + i] = contacts[i].second
    h = _accepted_step(arc, plant, contacts, rates, limit, math.inf if still else plant.mass)
    if h == 0.0:
        stay(arc, contacts, 0.0, arc.w)
        return
    _write_output(arc.work[W], rates, _W, h)
    arc.work[Z] = 0.0
    for i in range(len(contacts)):
        c = contacts[i]
        c.branch = PLASTIC
        _write_output(c.series[Z], rates, _FIRST_Z + i, h)
        if two:
            _write_output(c.series[SECOND], rates, _FIRST_Z + len(contacts) + i, h)
        for n in range(DEGREES):
            arc.work[Z, n] += c.sigma_0 / plant.sigma_0 * c.series[Z, n]
    t = h
    if not still:
        t, event = turn_end(arc.work, h, 0.0)
    for c in contacts:
        c.z_end = arc.mirror * polynomial(c.series, Z, t)
        c.second_end = polynomial(c.series, SECOND, t)
    turned = not still and event == TURN
    w_end = 0.0 if turned else arc.mirror * polynomial(arc.work, W, t)
    end_at(arc, t, mean_at_end(contacts), w_end, arc.mirror * integral(arc.work, W, t))


@compiled
def _accepted_step(
    arc: np.record, plant: np.record, contacts: NDArray, rates: NDArray, limit: float, mass: float
) -> float:
    """Fill the rates of all stages of a step within the error limit; return its length (s).

    0 if no step is exact enough. mass (kg) is that of the runner, infinite if it is still.
    """
    h = arc.trial if arc.trial > 0.0 else _FIRST * min(plant.inv_omega, 1.0)
    net = arc.force - plant.spring * arc.x - plant.sigma_0 * arc.z
    motion = abs(arc.w) * plant.inv_omega + abs(net) / plant.sigma_0
    allowed = _PER_STEP * plant.tolerance
    if mass < math.inf:
        h = min(h, _STABLE * min(plant.inv_omega, 0.5 / plant.delta))
        allowed = min(allowed, _OF_MOTION * max(motion, AT_REST * plant.tolerance))
    _fill_stage(arc, plant, contacts, rates, (0, 0.0), mass)
    for _ in range(_TRIES):
        cut = h >= limit
        h = min(h, limit)
        for stage in range(1, STEP):
            _fill_stage(arc, plant, contacts, rates, (stage, h), mass)
        part = min(1.0, max(_FREE_STEPS * h / limit, _LEAST_PART)) if limit > 0.0 else 1.0
        off = _error(arc, contacts, rates, h) / (part * allowed)
        factor = min(_MOST, max(_LEAST, _SAFE * max(off, _NO_ERROR) ** (-1.0 / _ORDER)))
        if off <= 1.0:
            # The length of a step cut by a limit does not predict the next one.
            arc.trial = max(h * factor, arc.trial) if cut else h * factor
            for stage in range(STEP, STAGES):
                _fill_stage(arc, plant, contacts, rates, (stage, h), mass)
            return h
        arc.cost += len(contacts)
        h *= min(factor, _SAFE)
    arc.trial = h
    return 0.0


@compiled
def _fill_stage(
    arc: np.record,
    plant: np.record,
    contacts: NDArray,
    rates: NDArray,
    step: tuple[int, float],
    mass: float,
) -> None:
    """Fill the rates at a stage of a step; step is the number of the stage and the length (s)."""
    (stage, h), size = step, rates.shape[1]
    y = STAGES
    for k in range(size):
        rates[y, k] = rates[STAGES + 1, k]
    for j in range(stage):
        a = h * A[stage, j]
        if a != 0.0:
            for k in range(size):
                rates[y, k] += a * rates[j, k]
    w, count = rates[y, _W], len(contacts)
    seconds = _FIRST_Z + count if has_two_states(contacts[0].kind) else 0
    force = plant.sigma_2 * w
    for i in range(count):
        c = contacts[i]
        z, second = rates[y, _FIRST_Z + i], rates[y, seconds + i] if seconds else 0.0
        z_rate, second_rate = rates_of_law(z, second, abs(w), c)
        if w < 0.0:  # beyond the turn: what the law would do if it went on as before
            at_turn = rates_of_law(z, second, 0.0, c)
            z_rate, second_rate = 2.0 * at_turn[0] - z_rate, 2.0 * at_turn[1] - second_rate
        force += c.sigma_0 * z + c.sigma_1 * z_rate
        rates[stage, _FIRST_Z + i] = z_rate
        if seconds:
            rates[stage, seconds + i] = second_rate
    pull = arc.force
    if plant.spring != 0.0:
        rates[stage, size - 1] = w
        dr = arc.mirror * rates[y, size - 1] + arc.pulled * h * TIMES[stage]
        pull -= plant.spring * (arc.x + dr)
    rates[stage, _W] = (arc.mirror * pull - force) / mass


@compiled
def _error(arc: np.record, contacts: NDArray, rates: NDArray, h: float) -> float:
    """Return the error of a step of h (s), m; infinite if it is beyond all numbers."""
    largest, count = 0.0, len(contacts)
    for k in range(rates.shape[1]):
        fifth = third = 0.0
        for j in range(STEP):
            fifth += ERRORS[0, j] * rates[j, k]
            third += ERRORS[1, j] * rates[j, k]
        whole = math.sqrt(fifth * fifth + THIRD * third * third)
        off = h * fifth * fifth / whole if whole > 0.0 else 0.0
        if k == _W:
            off *= arc.weight
        elif _FIRST_Z + count <= k < _FIRST_Z + 2 * count and has_two_states(contacts[0].kind):
            # What a fraction of the second state is off changes the limit of z by less than that.
            off *= contacts[k - _FIRST_Z - count].z_k / (abs(rates[STAGES + 1, k]) + h)
        if not off < math.inf:
            return math.inf
        largest = max(largest, off)
    return largest


@compiled
def _write_output(row: NDArray, rates: NDArray, k: int, h: float) -> None:
    """Write the continuous output of one state into a row of coefficients (ORDER + 1,)."""
    f0 = f3 = f4 = f5 = f6 = 0.0
    for j in range(STAGES):
        rate = h * rates[j, k]
        f0 += A[STEP, j] * rate
        f3 += OUTPUT[0, j] * rate
        f4 += OUTPUT[1, j] * rate
        f5 += OUTPUT[2, j] * rate
        f6 += OUTPUT[3, j] * rate
    f1 = h * rates[0, k] - f0
    f2 = 2.0 * f0 - h * (rates[STEP, k] + rates[0, k])
    per_power = 1.0
    row[0] = rates[STAGES + 1, k]
    for n in range(1, ORDER + 1):
        per_power /= h
        row[n] = 0.0
        if n < DEGREES:
            row[n] = POWERS[0, n] * f0 + POWERS[1, n] * f1 + POWERS[2, n] * f2
            row[n] += POWERS[3, n] * f3 + POWERS[4, n] * f4 + POWERS[5, n] * f5
            row[n] = (row[n] + POWERS[6, n] * f6) * per_power
