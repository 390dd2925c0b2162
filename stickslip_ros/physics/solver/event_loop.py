# SPDX-License-Identifier: Apache-2.0
"""Advances a runner on its contacts from event to event, restarting at every kink of u(t).

The state is kept at the last event, the anchor. Asking for a time between two events evaluates
the arc there and leaves the anchor alone, so how often a run is sampled never changes its path.
Time counts from the start of the cycle, so a cycle that starts in the same state is the same to
the last bit whenever it happens.

A drive is an array (3, segments) of one cycle: durations (s), rates u' at their starts (m/s), and
bends u'' (m/s^2). ``contacts`` are an array of CONTACT_RECORD, or None for a runner on one contact,
whose constants are those of the plant.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.compiled import compiled, compiled_inline
from stickslip_ros.physics.laws.law import ALWAYS_PLASTIC
from stickslip_ros.physics.solver.arc_dispatch import (
    ArcLimits,
    arc_limits,
    find_arc,
    sample_anchor,
    sample_within,
    turn_of_arc,
)
from stickslip_ros.physics.solver.arc_motion import (
    actuator_path,
    begin_arc,
    position_integral,
    rate_after,
)
from stickslip_ros.physics.solver.contact_arcs import mean_at_end
from stickslip_ros.physics.solver.layout import TABULATED
from stickslip_ros.physics.solver.oscillator import Oscillator, half_period, propagate
from stickslip_ros.physics.solver.stops import (
    arc_to_stop,
    held_arc,
    held_friction_work,
    holding_stop,
    make_held_plant,
)

#: The solver gives up after this many arcs without a length
STALLED = 1000
#: A hit so soon after the event before, in units of the ringing, leaves no time for a motion
_NO_TIME = 1e-6
#: A drive of fewer pieces is not searched for those along which nothing happens
_FEWEST_TO_SEARCH = 8
#: Eight times what a straight line in place of a bent piece may be beside it, m
_STRAIGHT_WITHIN = 4e-12
#: The same for a contact that slides all the time: each return of the line costs it deflection
_SLIDING_WITHIN = 4e-14
#: A bent piece shorter than this, in units of the ringing, is run as a straight line, which ends in
#: the same state: its acceleration would hold the contact at a deflection so large that differences
#: from it, and the friction work that follows from these, are lost to rounding
_SHORTEST_BENT = 1e-5
#: Largest difference at the start of two equal cycles, as a fraction of the tolerance
REPEATED = 1e-3
#: Cycles over which a runner that the load keeps sliding carries an error in speed along
CARRIED = 10.0


@compiled
def solve_cycles(
    plant: np.record,
    s: np.record,
    kernel: np.record,
    contacts: NDArray | None,
    drive: NDArray,
    rows: NDArray,
) -> int:
    """Advance as the request of the kernel has it, solving every cycle.

    s is the state to advance; rows (cycles, row) take the results of cycles. Returns how many
    ended. While kernel.arc ``holds``, it is not found again.
    """
    arc, request, period, ended = kernel.arc, kernel.request, period_of(drive), 0
    # The contact holds back a sticking runner; a runner that never sticks keeps the error.
    arc.weight = max(plant.inv_omega, CARRIED * period if plant.slides != 0 else 0.0)
    while True:
        if drive.shape[1] > _FEWEST_TO_SEARCH:
            _pass_elastic_pieces(plant, s, kernel, contacts, drive, period)
        limits = arc_limits(s, request, drive, period)
        over = s.done >= request.stop_cycle and s.segment == 0 and s.tau == 0.0
        if over or (limits.last and not limits.ahead > 0.0):
            sample_anchor(s, contacts, drive, s.tracking)
            break
        if request.spent >= request.allowance:
            request.unfinished = 1
            break
        if not arc.holds:
            too_short = drive[0, s.segment] < _SHORTEST_BENT * plant.inv_omega
            _next_arc(plant, s, kernel, contacts, limits, too_short)
        s.rate, straightened, s.bend = arc.rate, s.bend != arc.bend, arc.bend
        arc.holds = 0
        if s.stalled > STALLED or not math.isfinite(s.x):  # `Simulation` raises an error
            sample_anchor(s, contacts, drive, 0)
            s.now_x = math.nan
            break
        if arc.length > limits.ahead or arc.length == math.inf:
            moving = kernel.held if s.stopped != 0 else plant
            # A tabulated arc is replaced by those that it is made of.
            arc.holds = 0 if arc.kind == TABULATED or limits.last else 1
            sample_within(s, kernel, moving, contacts, drive, limits)
            if straightened:
                s.rate = drive[1, s.segment] + drive[2, s.segment] * s.tau
            break
        _track_backstep(plant, s, kernel, contacts, limits.resting)
        _pass_arc(plant, s, kernel, contacts)
        if straightened:
            s.friction_work += friction_work_since(s, plant, s.tau - s.open_tau)
            open_account(s)
            s.rate = drive[1, s.segment] + drive[2, s.segment] * s.tau
        if arc.length < limits.limit:
            continue
        if limits.last:
            sample_anchor(s, contacts, drive, s.tracking)
            break
        if _pass_kink(plant, s, drive):
            end_cycle(s, plant, contacts, request.replay != 0)
            write_row(s, rows, ended)
            ended += 1
    return ended


@compiled
def _pass_elastic_pieces(
    plant: np.record,
    s: np.record,
    kernel: np.record,
    contacts: NDArray | None,
    drive: NDArray,
    period: float,
) -> None:
    """Advance over pieces of an actuator along each of which the contact only bends one way.

    Most pieces are of this kind. The results are those of the arcs of `_next_arc`, to the last bit.
    """
    if contacts is not None or kernel.arc.holds != 0 or s.tau != 0.0 or s.stopped != 0:
        return
    request, stops = kernel.request, kernel.stops
    if s.tracking or s.done >= min(s.count, request.stop_cycle):
        return
    if plant.spring != 0.0 or plant.kind >= ALWAYS_PLASTIC:
        return
    o = Oscillator(plant.delta, plant.kappa, plant.omega)
    longest, z_ba, left = half_period(o), plant.z_ba, (request.t_end - s.start) - s.done * period
    shortest = _SHORTEST_BENT * plant.inv_omega
    while s.segment < drive.shape[1] - 1 and s.segment != s.slip:
        if not request.spent + 1 < request.allowance:
            return
        h, rate, bend = drive[0, s.segment], drive[1, s.segment], drive[2, s.segment]
        w, a = s.v - rate, (plant.force - plant.mass * bend) / plant.sigma_0
        if not (h <= left - s.since and shortest <= h < longest and abs(s.z) < z_ba):
            return
        y, w_end = propagate(s.z - a, w, h, o)
        z = a + y
        x = s.x + (z - s.z) + (rate + 0.5 * bend * h) * h
        inside = _is_clear(stops, s.x) and _is_clear(stops, x)
        if not (w * w_end > 0.0 and abs(z) < z_ba and inside):
            return
        rate += bend * h
        v = w_end + rate
        s.rate, s.bend, s.x, s.z, s.v = rate, bend, x, z, v
        s.z_max, s.z_min = max(s.z_max, z), min(s.z_min, z)
        s.x_min, s.x_max = min(s.x_min, x), max(s.x_max, x)
        s.v_most, s.stalled, s.tau = max(s.v_most, abs(v)), 0, h
        request.spent += 1
        _pass_kink(plant, s, drive)


@compiled
def _next_arc(
    plant: np.record,
    s: np.record,
    kernel: np.record,
    contacts: NDArray | None,
    limits: ArcLimits,
    too_short: bool,
) -> None:
    """Fill kernel.arc from the anchor to the next event; too_short: see `_SHORTEST_BENT`."""
    arc, stops, limit, rate, bend = kernel.arc, kernel.stops, limits.limit, s.rate, s.bend
    arc.trial = s.trial
    arc.hit = 0
    near = not _is_clear(stops, s.x)
    if bend != 0.0 and (too_short or (near and s.v == 0.0)):
        # At a stop a straight line takes the place of a part of a bent piece.
        slides_on = plant.kind == ALWAYS_PLASTIC or plant.slides != 0
        chord = _SLIDING_WITHIN if slides_on else _STRAIGHT_WITHIN
        limit = min(limit, math.sqrt(chord / abs(bend)))
        rate, bend = rate + 0.5 * bend * limit, 0.0
        s.rate = rate  # which decides whether the stop holds the runner
    elif bend != 0.0 and plant.spring != 0.0:
        # The line that pulls it moves the runner by this share of what it is beside the piece.
        share = plant.spring / (plant.sigma_0 + plant.spring)
        limit = min(limit, math.sqrt(_STRAIGHT_WITHIN / (share * abs(bend))))
    if near:
        s.stopped = holding_stop(plant, s, stops, contacts)
    begin_arc(arc, plant, (s.x, s.z, s.v - rate), (rate, bend, limit))
    if s.stopped != 0:
        if s.tracking and (s.segment != s.slip or limits.resting):
            s.backstep = s.x_top - s.x_low
            s.tracking = 0
        make_held_plant(plant, kernel)
        held_arc(arc, plant, kernel.held, contacts, s.stopped, limit)
    else:
        find_arc(arc, plant, contacts, limit, True)
        x_end = s.x + arc.path + actuator_path(arc, arc.length)
        if near or not _is_clear(stops, x_end):
            arc.hit = arc_to_stop(arc, plant, contacts, stops)
    at_once = _NO_TIME * plant.inv_omega if arc.hit != 0 else 0.0
    s.stalled = s.stalled + 1 if not arc.length > at_once else 0
    kernel.request.spent += arc.cost


@compiled_inline
def _is_clear(stops: np.record, x: float) -> bool:
    """Return whether no arc that begins at x (m) can reach a stop."""
    return stops.near_low <= x <= stops.near_high


@compiled
def _end_position(s: np.record, kernel: np.record) -> float:
    """Return the position (m) at the end of the arc."""
    if s.stopped != 0:
        return s.x
    arc, stops = kernel.arc, kernel.stops
    x = s.x + arc.path + actuator_path(arc, arc.length)
    if _is_clear(stops, s.x) and _is_clear(stops, x):
        return x
    return min(max(x, stops.low), stops.high)


@compiled
def _track_backstep(
    plant: np.record, s: np.record, kernel: np.record, contacts: NDArray | None, resting: bool
) -> None:
    """Follow the runner from the start of a slip to where it turns back towards the step."""
    if s.segment == s.slip and s.tau == 0.0 and not resting:
        if s.tracking:
            s.backstep = s.x_top - s.x_low
        s.tracking = 1
        s.x_top = s.x_low = s.sign * s.x
    if not s.tracking:
        return
    if s.segment != s.slip or resting:
        t, dr = turn_of_arc(kernel.arc, kernel.part, plant, contacts, s.sign)
        if t == t:
            s.x_low = min(s.x_low, s.sign * (s.x + dr))
            if resting or not s.slip < s.segment < s.slip_end:
                s.backstep = s.x_top - s.x_low
                s.tracking = 0
    s.x_low = min(s.x_low, s.sign * _end_position(s, kernel))


@compiled
def _pass_arc(plant: np.record, s: np.record, kernel: np.record, contacts: NDArray | None) -> None:
    """Move the anchor to the end of the arc; bring extremes and the account of energy up to it."""
    arc = kernel.arc
    if contacts is not None:
        _move_contacts(plant, s, arc, contacts)
    x = _end_position(s, kernel)
    s.trial = arc.trial
    s.slid += abs(arc.path - (arc.z_end - s.z))  # w keeps its sign where alpha is not 0
    s.z_max = max(s.z_max, arc.z_end, arc.z_max)
    s.z_min = min(s.z_min, arc.z_end, arc.z_min)
    s.x_min, s.x_max = min(s.x_min, x), max(s.x_max, x)
    if s.stopped == 0 and plant.spring != 0.0:
        s.impulse += position_integral(arc, plant) * plant.spring
    s.rate = rate_after(arc, arc.length)
    v = arc.w_end + s.rate
    s.tau, s.x, s.v, s.z = s.tau + arc.length, x, v, arc.z_end
    s.v_most = max(s.v_most, abs(v))
    if s.stopped != 0:
        s.friction_work += held_friction_work(arc, plant)
        open_account(s)
    elif arc.hit != 0:  # its remaining kinetic energy goes into the stop
        s.x = kernel.stops.low if arc.hit < 0 else kernel.stops.high
        s.friction_work += friction_work_since(s, plant, s.tau - s.open_tau)
        s.v = 0.0
        open_account(s)
        s.stopped, s.hits = arc.hit, s.hits + 1


@compiled
def _move_contacts(plant: np.record, s: np.record, arc: np.record, contacts: NDArray) -> None:
    """Move each contact to the end of the arc, and correct the energy of their mean deflection.

    The correction is the elastic energy of all contacts minus that of the mean deflection; for a
    runner held by a stop, also the work of all dampers minus that of the mean.
    """
    mean = arc.z_end = mean_at_end(contacts)
    stored = -0.5 * plant.sigma_0 * (mean * mean - s.z * s.z)
    damped = -plant.sigma_1 * (mean - s.z)
    for c in contacts:
        stored += 0.5 * c.sigma_0 * (c.z_end * c.z_end - c.z * c.z)
        damped += c.sigma_1 * (c.z_end - c.z)
        c.z, c.second = c.z_end, c.second_end
    s.friction_work -= stored
    if s.stopped != 0:
        s.friction_work -= s.rate * damped


@compiled
def _pass_kink(plant: np.record, s: np.record, drive: NDArray) -> bool:
    """Begin the next segment, where the rate changes; return whether that ends the cycle."""
    duration = drive[0, s.segment]
    s.friction_work += friction_work_since(s, plant, duration - s.open_tau)
    s.since += duration
    s.tau = 0.0
    open_account(s)
    s.segment += 1
    if s.segment < drive.shape[1]:
        return False
    s.since, s.segment = 0.0, 0
    return True


@compiled
def open_account(s: np.record) -> None:
    """Start the energy balance of `friction_work_since` at the anchor."""
    s.open_tau, s.open_x, s.open_v, s.open_z = s.tau, s.x, s.v, s.z
    s.impulse = 0.0


@compiled
def friction_work_since(s: np.record, plant: np.record, duration: float) -> float:
    """Return the friction work (J) of the contact since `open_account`.

    It is the work F w of both bodies on the contact minus its elastic energy. It follows from
    momentum and energy of the runner at the ends: F dt = -m dv + (F_ext - k x) dt, over duration
    (s).
    """
    mass, force, spring = plant.mass, plant.force, plant.spring
    x0, v0, z0 = s.open_x, s.open_v, s.open_z
    x, v, z = s.x, s.v, s.z
    on_runner = 0.5 * mass * (v0 * v0 - v * v) + force * (x - x0) + 0.5 * spring * (x0 * x0 - x * x)
    impulse = mass * (v0 - v) + force * duration - s.impulse
    stored = 0.5 * plant.sigma_0 * (z * z - z0 * z0)
    if s.bend != 0.0:  # u' gets from s.rate - s.bend * duration to s.rate
        moment = 0.5 * force * duration * duration - mass * (duration * v - (x - x0))
        # of the spring: x is a parabola of its ends and its mean
        moment -= (0.5 * s.impulse + spring * (x - x0) * duration / 12.0) * duration
        stored += s.bend * (moment - duration * impulse)
    return on_runner - s.rate * impulse - stored


# -- the end of a drive cycle


@compiled
def end_cycle(s: np.record, plant: np.record, contacts: NDArray | None, replay: bool) -> None:
    """Let the running cycle end at the anchor, and the next begin; replay: it may be steady."""
    done = s.done + 1
    s.done, s.steady = done, 0
    s.level += s.shift
    close, step = REPEATED * plant.tolerance, s.x - s.cycle_x
    if (
        replay
        and done > 1
        and abs(s.z - s.cycle_z) <= close
        and abs(s.v - s.cycle_v) * plant.inv_omega <= close
        and abs(step - s.last_step) <= close
        and (plant.spring == 0.0 or abs(step) <= close)
    ):  # it ended in the state in which it began, one step further
        s.steady = 1
    s.last_step, s.last_friction_work = step, s.friction_work
    s.last_z_max, s.last_z_min = s.z_max, s.z_min
    s.cycle_x, s.cycle_v, s.cycle_z = s.x, s.v, s.z
    s.z_max = s.z_min = s.z
    s.last_x_min, s.last_x_max = s.x_min, s.x_max
    s.x_min = s.x_max = s.x
    s.friction_work = 0.0
    if contacts is not None:  # it repeats only if every contact ends it as it began
        for c in contacts:
            if not abs(c.z - c.cycle_z) <= close:
                s.steady = 0
            if not abs(c.second - c.cycle_second) <= REPEATED * abs(c.second):
                s.steady = 0
            c.cycle_z, c.cycle_second = c.z, c.second


@compiled
def stays_clear(s: np.record, stops: np.record) -> bool:
    """Return whether a repetition of the last cycle would reach no stop."""
    low, high = s.last_x_min + s.last_step, s.last_x_max + s.last_step
    return low >= stops.near_low and high <= stops.near_high


@compiled
def repeat(s: np.record) -> None:
    """End one more cycle just as the last one ended, one step further on."""
    step = s.last_step
    s.cycle_x = s.x + step
    s.x = s.cycle_x
    s.open_x = s.x
    s.x_min = s.x_max = s.x
    s.last_x_min += step
    s.last_x_max += step
    s.x_top += s.sign * step
    s.x_low += s.sign * step
    s.done += 1


@compiled
def write_row(s: np.record, rows: NDArray, at: int) -> None:
    """Write the last whole cycle, as `simulation.CycleResults` names it, if there is a row left."""
    if at < len(rows):
        row = rows[at]
        row[0], row[1] = s.x, s.backstep
        row[2], row[3], row[4] = s.last_z_max, s.last_z_min, s.last_friction_work


@compiled
def period_of(drive: NDArray) -> float:
    """Return the duration of a cycle (s), as `DriveCycle.period` sums it up."""
    period = 0.0
    for duration in drive[0]:
        period += duration
    return period
