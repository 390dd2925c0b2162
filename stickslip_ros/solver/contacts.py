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
from stickslip_ros.model.friction import DISTANCES
from stickslip_ros.solver.arcs import begin_arc, within_arc
from stickslip_ros.solver.contact_arcs import (
    CONSTANTS,
    SIGMA_0,
    SIGMA_1,
    Contacts,
    alpha_in,
    contact_arc,
    deflections,
    force_of,
    mean_deflection,
)
from stickslip_ros.solver.contact_stops import arc_to_stop, held_arc, holding
from stickslip_ros.solver.cycles import REPEATED, advancing, looking, period_of, write_row
from stickslip_ros.solver.integrator import (
    CARRIED,
    STALLED,
    Outlook,
    count_arc,
    hold,
    outlook_of,
    pass_kink,
    place_sample,
    prepare,
    sample_anchor,
    sample_begun,
    take_arc,
    track_backstep,
)
from stickslip_ros.solver.layout import (
    ASKED_FOR,
    AT_ANCHOR,
    AT_END,
    AT_START,
    AXIS_BUFFER,
    BRANCH,
    DEFLECTIONS,
    IN_LOOK,
    ORDER,
    PER_CONTACT,
    PLANT,
    PLANT_SIZE,
    arc_in,
    axis_in,
    held_in,
    opened,
    plant_in,
)
from stickslip_ros.solver.sampling import SAMPLE_SIZE, keep_motion, sampling

#: Coefficients of a plant with one contact
_OF_ONE = 13


def prepared(
    coefficients: NDArray[np.float64], tolerance: float, factor: float | None = None
) -> NDArray[np.float64]:
    """Return the buffer of a plant of one contact or several, see `Plant.coefficients`.

    tolerance is the error in position (m) allowed per cycle. With a factor, all distances at which
    contacts give way are so much longer, and no tables are filled for the plant: `take_tables` may
    fill them.
    """
    whole = coefficients[:_OF_ONE].copy()
    each = coefficients[_OF_ONE:].reshape(-1, CONSTANTS).copy()
    if factor is not None:
        whole[DISTANCES] *= factor
        each[:, DISTANCES] *= factor
    plant = prepare(whole, tolerance)
    if factor is not None:
        opened(plant, PLANT)["precomputed"] = -1
    return np.concatenate([plant, each.ravel()]) if each.size else plant


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
    return Contacts(_constants_in(plant), z[row], z[AT_END], z[BRANCH], series)


@compiled
def _run(plant_buffer: NDArray, s: np.record, axis: NDArray, drive: NDArray, rows: NDArray) -> int:
    """Do what `integrator._run` does."""
    plant, arc, z = plant_in(plant_buffer), arc_in(axis), _deflections_in(axis)
    on = _contacts_in(plant_buffer, axis, IN_LOOK if s.looks_ahead else AT_ANCHOR)
    period = period_of(drive)
    carried = CARRIED * period if plant.slides != 0 else 0.0
    arc.weight = max(plant.inv_omega, carried)
    ended = 0
    while True:
        outlook = outlook_of(s, drive, period)
        over = s.done >= s.stop_cycle and s.segment == 0 and s.tau == 0.0
        if over or (outlook.last and not outlook.ahead > 0.0):
            sample_anchor(s, drive, s.tracking)
            z[ASKED_FOR] = on.z
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
            z[ASKED_FOR] = on.z
            break
        if pass_kink(plant, s, drive):
            _end_cycle(plant, s, on.z, z[AT_START])
            if ended < len(rows):
                write_row(s, rows[ended])
            ended += 1
    return ended


_look_into = looking(_run)
_advance = advancing(_run, _look_into)


@compiled
def advance_contacts(
    plant: NDArray, axis: NDArray, drive: NDArray, t_end: float, stop_cycle: int, rows: NDArray
) -> int:
    """Do what `integrator.advance` does."""
    return _advance(plant, axis, drive, t_end, stop_cycle, rows)


@compiled
def _next_arc(plant: np.record, s: np.record, axis: NDArray, on: Contacts, outlook: Outlook) -> int:
    """Fill the arc with the way from the anchor to the next event; return the stop that it hits."""
    arc, held = arc_in(axis), held_in(axis)
    begin_arc(arc, s.x, s.z, s.v - s.rate, s.rate)
    near, hit = not s.near_low <= s.x <= s.near_high, 0
    if near:
        s.stopped = holding(plant, s, on)
    if s.stopped != 0:
        hold(plant, s, held, outlook.resting)
        held_arc(arc, plant, held, on, s.stopped, outlook.limit)
    else:
        contact_arc(arc, plant, on, outlook.limit)
        x_end = s.x + arc.path + s.rate * arc.length
        if near or not s.near_low <= x_end <= s.near_high:
            hit = arc_to_stop((arc, plant, on), s)
    count_arc(plant, s, arc, hit)
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
    close = REPEATED * plant.tolerance
    for i in range(len(z)):
        if not abs(z[i] - before[i]) <= close:
            s.steady = 0
        before[i] = z[i]


@compiled
def _sample_within(
    plant: np.record, s: np.record, axis: NDArray, on: Contacts, drive: NDArray, outlook: Outlook
) -> None:
    """Keep the state at t_end, which lies within the arc."""
    arc, now, ahead = arc_in(axis), _deflections_in(axis)[ASKED_FOR], outlook.ahead
    sample_begun(plant, s, arc, drive, outlook)
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
def _keep(plant: NDArray, axis: NDArray, sample: NDArray) -> None:
    """Keep force (N) and each deflection (m) behind what is kept of one contact."""
    now = _deflections_in(axis)[ASKED_FOR]
    keep_motion(axis, sample)
    sample[SAMPLE_SIZE] = force_now(plant, axis)
    for i in range(len(now)):
        sample[SAMPLE_SIZE + 1 + i] = now[i]


_sample = sampling(_advance, _look_into, _keep)


@compiled
def sample_contacts(
    plant: NDArray, axis: NDArray, drive: NDArray, times: NDArray, samples: NDArray, first: int
) -> int:
    """Do what `sampling.sample` does; the force (N) and each deflection (m) are rows more."""
    return _sample(plant, axis, drive, times, samples, first)


@compiled
def force_now(plant: NDArray, axis: NDArray) -> float:
    """Return the friction force F (N) at the time asked for."""
    s = axis_in(axis)
    w = s.now_v - s.now_rate
    return force_of(_constants_in(plant), _deflections_in(axis)[ASKED_FOR], w)  # type: ignore[no-any-return]


@compiled
def alpha_now(plant: NDArray, axis: NDArray) -> float:
    """Return the mean of alpha of the contacts by stiffness, at the time asked for."""
    s, constants, now = axis_in(axis), _constants_in(plant), _deflections_in(axis)[ASKED_FOR]
    w = s.now_v - s.now_rate
    sliding = stiffness = 0.0
    for i in range(len(now)):
        sliding += constants[i, SIGMA_0] * alpha_in(constants, i, now[i], w)
        stiffness += constants[i, SIGMA_0]
    return sliding / stiffness


def deflections_now(axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the deflections (m) of several contacts at the time asked for, (contacts,)."""
    count = (len(axis) - AXIS_BUFFER) // PER_CONTACT
    begin = AXIS_BUFFER + ASKED_FOR * count
    return axis[begin : begin + count].copy()
