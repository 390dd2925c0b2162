# SPDX-License-Identifier: Apache-2.0
"""Advances a runner on several contacts, as `integrator` does one on a single contact.

The buffers are those of the integrator with the contacts behind: of a plant their constants, of an
axis their deflections and the scratch for an arc. So whatever is done to the state of an axis from
outside, `begin` and `anchor`, serves both.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled
from stickslip_ros.solver.arcs import begin_arc, turning_point, within_arc
from stickslip_ros.solver.contact_arcs import (
    CONSTANTS,
    SIGMA_0,
    SIGMA_1,
    Z_BA,
    Contacts,
    alpha_in,
    contact_arc,
    deflections,
    force_of,
    mean_deflection,
)
from stickslip_ros.solver.contact_stops import arc_to_stop, held_arc, holding
from stickslip_ros.solver.cycles import keeps_away, repeat, write_row
from stickslip_ros.solver.integrator import (
    AT_ONCE,
    CARRIED,
    STALLED,
    Outlook,
    outlook_of,
    pass_kink,
    period_of,
    place_sample,
    prepare,
    prepare_once,
    sample_anchor,
    take_arc,
    track_backstep,
)
from stickslip_ros.solver.layout import (
    AXIS_BUFFER,
    DEFLECTIONS,
    ORDER,
    PER_CONTACT,
    PLANT_SIZE,
    ROW_SIZE,
    arc_in,
    axis_in,
    copied_axis,
    held_in,
    last_copy,
    plant_in,
)
from stickslip_ros.solver.sampling import SAMPLE_SIZE
from stickslip_ros.solver.stops import make_unmoved

#: Rows of what is kept of the contacts behind an axis, in the order of `layout.DEFLECTIONS`
_Z, _NOW, _CYCLE, _LOOK, _END, _BRANCH = range(DEFLECTIONS)
#: Share of the tolerance by which the deflections of two cycles that count as the same may differ
_REPEATED = 1e-3
#: Coefficients of a plant with one contact
_OF_ONE = 13
_NO_LIMIT = np.iinfo(np.int64).max


def prepared(
    coefficients: NDArray[np.float64], tolerance: float, factor: float | None = None
) -> NDArray[np.float64]:
    """Return the buffer of a plant of one contact or several, see `Plant.coefficients`.

    tolerance is the error in position (m) allowed per cycle. With a factor, all distances at which
    contacts give way are so much longer, and the plant is to be used without tables.
    """
    whole = coefficients[:_OF_ONE]
    plant = prepare(whole, tolerance) if factor is None else prepare_once(whole, factor, tolerance)
    if len(coefficients) == _OF_ONE:
        return plant
    each = coefficients[_OF_ONE:].reshape(-1, CONSTANTS).copy()
    each[:, Z_BA : Z_BA + 4] *= 1.0 if factor is None else factor  # z_ba, z_ss, z_k, z_s
    return np.concatenate([plant, each.ravel()])


def axis_buffer(coefficients: int) -> NDArray[np.float64]:
    """Return an empty buffer of an axis whose plant has so many coefficients."""
    return np.zeros(AXIS_BUFFER + (coefficients - _OF_ONE) // CONSTANTS * PER_CONTACT)


@compiled
def _constants_in(buffer: NDArray) -> NDArray:
    return buffer[PLANT_SIZE:].reshape((-1, CONSTANTS))


@compiled
def _deflections_in(axis: NDArray) -> NDArray:
    """Return the deflections in an axis's buffer, (DEFLECTIONS, contacts)."""
    count = (len(axis) - AXIS_BUFFER) // PER_CONTACT
    end = AXIS_BUFFER + DEFLECTIONS * count
    return axis[AXIS_BUFFER:end].reshape((DEFLECTIONS, count))


@compiled
def _contacts_in(plant: NDArray, axis: NDArray, row: int) -> Contacts:
    """Return the contacts, with their deflections at the anchor in a row."""
    z = _deflections_in(axis)
    series = axis[AXIS_BUFFER + z.size :].reshape((-1, ORDER + 1))
    return Contacts(_constants_in(plant), z[row], z[_END], z[_BRANCH], series)


@compiled
def advance_contacts(
    plant: NDArray, axis: NDArray, drive: NDArray, t_end: float, stop_cycle: int, rows: NDArray
) -> int:
    """Do what `integrator.advance` does."""
    s, p = axis_in(axis), plant_in(plant)
    on = _contacts_in(plant, axis, _Z)
    s.t_end, s.stop_cycle, s.unfinished = t_end, stop_cycle, 0
    if s.cut or not s.replay:
        return _run(p, s, axis, on, drive, rows)
    period = period_of(drive)
    ended = 0
    while s.done < min(s.count, stop_cycle):
        if s.steady and not keeps_away(s):
            s.steady = 0
        if s.steady:
            if (t_end - s.start) - s.done * period < period:
                _look_into(plant, axis, drive, True)
                return ended
            if s.spent >= s.allowance:
                s.unfinished = 1
                return ended
            s.spent += 1
            repeat(s, rows[ended : ended + 1])
            ended += 1
            continue
        s.stop_cycle = s.done + 1
        if not _run(p, s, axis, on, drive, rows[ended : ended + 1]):
            return ended
        ended += 1
    s.stop_cycle = stop_cycle
    return ended + _run(p, s, axis, on, drive, rows[ended:])


@compiled
def _look_into(plant: NDArray, axis: NDArray, drive: NDArray, afresh: bool) -> None:
    """Do what `integrator.look_into` does."""
    s, z = axis_in(axis), _deflections_in(axis)
    if afresh:
        z[_LOOK] = z[_Z]
    look = copied_axis(axis) if afresh else last_copy(axis)
    look.t_end, look.stop_cycle = s.t_end, s.done + 1
    look.spent, look.unfinished = s.spent, 0
    on = _contacts_in(plant, axis, _LOOK)
    _run(plant_in(plant), look, axis, on, drive, np.empty((0, ROW_SIZE)))
    s.now_tau, s.now_x, s.now_v, s.now_z = look.now_tau, look.now_x, look.now_v, look.now_z
    s.now_rate, s.now_u = look.now_rate, look.now_u
    s.now_segment, s.now_tracking = look.now_segment, look.now_tracking
    s.spent, s.unfinished = look.spent, look.unfinished


@compiled
def _run(
    plant: np.record, s: np.record, axis: NDArray, on: Contacts, drive: NDArray, rows: NDArray
) -> int:
    """Do what `advance_contacts` says, solving every cycle."""
    arc, z = arc_in(axis), _deflections_in(axis)
    period = period_of(drive)
    carried = CARRIED * period if plant.slides != 0 else 0.0
    arc.weight = max(plant.inv_omega, carried)
    ended = 0
    while True:
        outlook = outlook_of(s, drive, period)
        over = s.done >= s.stop_cycle and s.segment == 0 and s.tau == 0.0
        if over or (outlook.last and not outlook.ahead > 0.0):
            sample_anchor(s, drive, s.tracking)
            z[_NOW] = on.z
            break
        if s.spent >= s.allowance:
            s.unfinished = 1
            break
        hit = _next_arc(plant, s, axis, on, outlook)
        if s.stalled > STALLED or not math.isfinite(s.x):  # `Simulation` refuses to go on
            sample_anchor(s, drive, 0)
            s.now_x = math.nan
            break
        if arc.length > outlook.ahead or arc.length == math.inf:
            _sample_within(plant, s, axis, on, drive, outlook)
            break
        track_backstep(plant, s, arc, outlook.resting)
        _store(plant, s, arc, on)
        take_arc(plant, s, arc, hit)
        on.z[:] = on.end
        if arc.length < outlook.limit:
            continue
        if outlook.last:
            sample_anchor(s, drive, s.tracking)
            z[_NOW] = on.z
            break
        if pass_kink(plant, s, drive):
            _end_cycle(plant, s, on.z, z[_CYCLE])
            if ended < len(rows):
                write_row(s, rows[ended])
            ended += 1
    return ended


@compiled
def _next_arc(plant: np.record, s: np.record, axis: NDArray, on: Contacts, outlook: Outlook) -> int:
    """Fill the arc with the way from the anchor to the next event; return the stop that it hits."""
    arc, held = arc_in(axis), held_in(axis)
    begin_arc(arc, s.x, s.z, s.v - s.rate, s.rate)
    near, hit = not s.near_low <= s.x <= s.near_high, 0
    if near:
        s.stopped = holding(plant, s, on)
    if s.stopped != 0:
        if s.tracking and (s.segment != s.slip or outlook.resting):
            s.backstep = s.x_top - s.x_low
            s.tracking = 0
        make_unmoved(plant, held)
        held_arc(arc, plant, held, on, s.stopped, outlook.limit)
    else:
        contact_arc(arc, plant, on, outlook.limit)
        x_end = s.x + arc.path + s.rate * arc.length
        if near or not s.near_low <= x_end <= s.near_high:
            hit = arc_to_stop(arc, plant, on, s)
    at_once = AT_ONCE * plant.inv_omega if hit != 0 else 0.0
    s.stalled = s.stalled + 1 if not arc.length > at_once else 0
    s.spent += 1
    return hit


@compiled
def _store(plant: np.record, s: np.record, arc: np.record, on: Contacts) -> None:
    """Correct the energy lost by what the springs hold beyond that of the mean deflection.

    Of a runner that a stop holds, also by what the dampers take beyond that of the mean.
    """
    mean = arc.z_end = mean_deflection(on.constants, on.end)
    stored = -0.5 * plant.sigma_0 * (mean * mean - s.z * s.z)
    damped = -plant.sigma_1 * (mean - s.z)
    for i in range(len(on.z)):
        z, z_end = on.z[i], on.end[i]
        stored += 0.5 * on.constants[i, SIGMA_0] * (z_end * z_end - z * z)
        damped += on.constants[i, SIGMA_1] * (z_end - z)
    s.dissipated -= stored
    if s.stopped != 0:
        s.dissipated -= s.rate * damped


@compiled
def _end_cycle(plant: np.record, s: np.record, z: NDArray, before: NDArray) -> None:
    """Let a cycle count as one that repeats only if every contact ends it as it began."""
    close = _REPEATED * plant.tolerance
    for i in range(len(z)):
        if not abs(z[i] - before[i]) <= close:
            s.steady = 0
        before[i] = z[i]


@compiled
def _sample_within(
    plant: np.record, s: np.record, axis: NDArray, on: Contacts, drive: NDArray, outlook: Outlook
) -> None:
    """Keep the state at t_end, which lies within the arc."""
    arc, now = arc_in(axis), _deflections_in(axis)[_NOW]
    tracking, ahead = s.tracking, outlook.ahead
    if tracking and outlook.resting:  # at rest the last arc never ends
        t, gone = turning_point(arc, plant, s.sign)
        if t <= ahead:
            s.backstep = s.x_top - min(s.x_low, s.sign * (s.x + gone))
            tracking = 0
    sample_anchor(s, drive, tracking)
    now[:] = on.z
    if not 0.0 < ahead < math.inf:
        return
    p = held_in(axis) if s.stopped != 0 else plant
    gone, _, w = within_arc(arc, p, ahead)
    deflections(arc, p, on, ahead, now)
    x = s.x
    if s.stopped == 0:
        x = min(max(arc.x + gone + arc.rate * ahead, s.low), s.high)
    s.now_x, s.now_v, s.now_z = x, w + s.rate, mean_deflection(on.constants, now)
    place_sample(s, drive, s.tau + ahead)


@compiled
def sample_contacts(
    plant: NDArray, axis: NDArray, drive: NDArray, times: NDArray, samples: NDArray, first: int
) -> int:
    """Do what `sampling.sample` does; the force (N) and each deflection (m) are rows more."""
    s, now, constants = axis_in(axis), _deflections_in(axis)[_NOW], _constants_in(plant)
    rows = np.empty((0, ROW_SIZE))
    period = period_of(drive)
    looking = False  # within a cycle that repeats the one before: the look into it goes on
    for k in range(first, len(times)):
        if looking and (times[k] - s.start) - s.done * period < period:
            s.t_end = times[k]
            _look_into(plant, axis, drive, False)
        else:
            advance_contacts(plant, axis, drive, times[k], _NO_LIMIT, rows)
            looking = s.steady != 0 and s.done < s.count
        if s.unfinished:
            return k
        samples[0, k], samples[1, k], samples[2, k] = s.now_x, s.now_v, s.now_z
        samples[3, k], samples[4, k] = s.now_rate, s.now_u
        samples[SAMPLE_SIZE, k] = force_of(constants, now, s.now_v - s.now_rate)
        for i in range(len(now)):
            samples[SAMPLE_SIZE + 1 + i, k] = now[i]
    return len(times)


@compiled
def force_now(plant: NDArray, axis: NDArray) -> float:
    """Return the friction force F (N) at the time asked for."""
    s = axis_in(axis)
    w = s.now_v - s.now_rate
    return force_of(_constants_in(plant), _deflections_in(axis)[_NOW], w)  # type: ignore[no-any-return]


@compiled
def alpha_now(plant: NDArray, axis: NDArray) -> float:
    """Return the mean of alpha of the contacts by stiffness, at the time asked for."""
    s, constants, now = axis_in(axis), _constants_in(plant), _deflections_in(axis)[_NOW]
    w = s.now_v - s.now_rate
    sliding = stiffness = 0.0
    for i in range(len(now)):
        sliding += constants[i, SIGMA_0] * alpha_in(constants, i, now[i], w)
        stiffness += constants[i, SIGMA_0]
    return sliding / stiffness


def deflections_now(axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the deflections (m) of several contacts at the time asked for, (contacts,)."""
    count = (len(axis) - AXIS_BUFFER) // PER_CONTACT
    return axis[AXIS_BUFFER + count : AXIS_BUFFER + 2 * count].copy()
