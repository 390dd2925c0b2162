# SPDX-License-Identifier: Apache-2.0
"""Advances one axis: from event to event, restarting at every kink of u(t).

The state is kept at the last event, the anchor. Asking for a time between two events evaluates
the arc there and leaves the anchor alone, so how often a run is sampled never changes its path.
Time counts from the start of the cycle, so a cycle that starts in the same state is the same to
the last bit whenever it happens.

A drive is an array (2, segments): durations (s) and rates (m/s) of one cycle.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled
from stickslip_ros.solver.arcs import (
    begin_arc,
    next_arc,
    position_integral,
    turning_point,
    within_arc,
)
from stickslip_ros.solver.branches import settling, sliding_deflection, stribeck_edge
from stickslip_ros.solver.cycles import advancing, end_cycle, looking, period_of, write_row
from stickslip_ros.solver.layout import (
    PLANT_SIZE,
    STIFF,
    TABULATED,
    arc_in,
    axis_in,
    held_in,
    plant_in,
    take_deflections,
)
from stickslip_ros.solver.oscillator import oscillator
from stickslip_ros.solver.stops import arc_to_stop, held_arc, held_heat, holding, make_unmoved

#: The solver gives up after this many arcs without a length
STALLED = 1000
#: The tolerance is at most this share of the limit of z: it says how well the friction is known
_FINEST = 1e-2
#: A hit so soon after the event before, in units of the ringing, leaves no time for a motion
_AT_ONCE = 1e-6
#: Share of the friction above which a load counts as one that may keep the runner sliding
_NEARLY = 0.5
#: Cycles over which a runner that the load keeps sliding carries an error in speed along
CARRIED = 10.0
#: What an implicit arc counts in the budget beyond another
_IMPLICIT = 15


@compiled
def prepare(coefficients: NDArray, tolerance: float) -> NDArray:
    """Return the buffer of a PLANT: `Plant.coefficients` with what follows from them.

    tolerance is the error in position (m) allowed per cycle.
    """
    buffer = np.zeros(PLANT_SIZE)
    for k in range(8):
        buffer[k] = coefficients[k]
    plant = plant_in(buffer)
    plant.kind, plant.printed = int(coefficients[8]), int(coefficients[9])
    plant.mass, plant.force, plant.spring = coefficients[10], coefficients[11], coefficients[12]
    plant.tolerance = min(tolerance, _FINEST * min(plant.z_k, plant.z_s))
    friction = plant.sigma_0 * min(plant.z_k, plant.z_s)
    load = max(coefficients[11], -coefficients[11])
    plant.slides = 1 if load > _NEARLY * friction else 0
    plant.v_edge = stribeck_edge(plant)
    plant.z_slide = sliding_deflection(plant)
    kappa = (plant.sigma_0 + plant.spring) / plant.mass
    o = oscillator(0.5 * (plant.sigma_1 + plant.sigma_2) / plant.mass, kappa)
    plant.delta, plant.kappa, plant.omega = o
    plant.inv_omega = 1.0 / math.sqrt(kappa)
    plant.settling, plant.settled = settling(plant)
    return buffer


@compiled
def at_rest(axis: NDArray) -> None:
    """Set the buffer of an AXIS to one that never moved."""
    for k in range(len(axis)):
        axis[k] = 0.0
    s = axis_in(axis)
    s.backstep = s.last_step = s.last_dissipated = math.nan
    s.low = s.near_low = -math.inf
    s.high = s.near_high = math.inf
    s.replay = 1


@compiled
def begin(
    axis: NDArray, t: float, count: int, slip: tuple[int, int], sign: int, shift: float
) -> None:
    """Start count drive cycles at time t (s), from the state asked for last.

    slip names the segment in which the slip begins and the one that follows it; shift is what u
    gains over a cycle (m).
    """
    s = axis_in(axis)
    s.start = t
    s.level, s.shift = s.now_u, shift
    s.tau = s.since = 0.0
    s.x, s.v, s.z = s.now_x, s.now_v, s.now_z
    take_deflections(axis)
    _open_account(s)
    s.z_max = s.z_min = s.z
    s.dissipated = 0.0
    s.cycle_x, s.cycle_v, s.cycle_z = s.x, s.v, s.z
    s.x_min = s.x_max = s.x
    s.tracking = s.now_tracking = s.now_segment = 0
    s.count, s.done, s.segment, s.steady = count, 0, 0, 0
    s.slip, s.slip_end = slip
    s.sign = sign


@compiled
def anchor(plant: NDArray, axis: NDArray, x: float, v: float, z: float) -> None:
    """Make the time that `advance` has cut an event: from there on the plant may be another.

    x (m), v (m/s), z (m) is the state asked for last. It stays as it is, to the last bit; extremes,
    backstep and the account of energy have been brought up to it.
    """
    s, p = axis_in(axis), plant_in(plant)
    s.cut, s.steady = 0, 0
    s.cycle_z = math.nan  # a cycle under two plants is like none
    s.x, s.v, s.z = s.now_x, s.now_v, s.now_z = x, v, z
    s.rate = s.now_rate
    s.dissipated += _dissipated(s, p, s.tau - s.open_tau)
    _open_account(s)


@compiled
def _open_account(s: np.record) -> None:
    """Let what `_dissipated` accounts for begin at the anchor."""
    s.open_tau, s.open_x, s.open_v, s.open_z = s.tau, s.x, s.v, s.z
    s.impulse = 0.0


class Outlook(NamedTuple):
    """What bounds the next arc."""

    resting: bool  #: the drive cycle is over
    limit: float  #: s until the next kink, or until t_end where that is an event
    ahead: float  #: s until t_end
    last: bool  #: t_end is an event and comes before the next kink


@compiled
def _run(plant_buffer: NDArray, s: np.record, axis: NDArray, drive: NDArray, rows: NDArray) -> int:
    """Do what `advance` says, solving every cycle; with s.cut, t_end becomes an event itself.

    s is the state to advance, axis the buffer with the scratch.
    """
    plant, arc, held = plant_in(plant_buffer), arc_in(axis), held_in(axis)
    period = period_of(drive)
    # The contact holds a runner back that sticks; one that slides for ever goes on with the error.
    carried = CARRIED * period if plant.slides != 0 else 0.0
    arc.weight = max(plant.inv_omega, carried)
    ended = 0
    while True:
        outlook = outlook_of(s, drive, period)
        if s.done >= s.stop_cycle and s.segment == 0 and s.tau == 0.0:
            sample_anchor(s, drive, s.tracking)
            break
        if outlook.last and not outlook.ahead > 0.0:
            sample_anchor(s, drive, s.tracking)
            break
        if s.spent >= s.allowance:
            s.unfinished = 1
            break
        hit = _next_arc(plant, s, arc, held, outlook)
        if s.stalled > STALLED or not math.isfinite(s.x):  # `Simulation` refuses to go on
            sample_anchor(s, drive, 0)
            s.now_x = math.nan
            break
        if arc.length > outlook.ahead or arc.length == math.inf:
            _sample_within(plant, s, axis, drive, outlook)
            break
        track_backstep(plant, s, arc, outlook.resting)
        take_arc(plant, s, arc, hit)
        if arc.length < outlook.limit:
            continue
        if outlook.last:
            sample_anchor(s, drive, s.tracking)
            break
        if pass_kink(plant, s, drive):
            if ended < len(rows):
                write_row(s, rows[ended])
            ended += 1
    return ended


look_into = looking(_run)
_advance = advancing(_run, look_into)


@compiled
def advance(
    plant: NDArray, axis: NDArray, drive: NDArray, t_end: float, stop_cycle: int, rows: NDArray
) -> int:
    """Advance to t_end (s) or to the end of cycle stop_cycle, whichever comes first.

    plant as `prepare` makes it, axis the buffer of an AXIS; rows (cycles, row) take the results of
    the cycles that end, further ones are dropped. Returns the number of cycles that ended. With
    ``unfinished`` set, the allowance ran out first: call again to go on.

    With ``replay``, a cycle that begins as the one before did is not solved again. With ``cut``,
    t_end becomes an event, to be finished by `anchor`.
    """
    return _advance(plant, axis, drive, t_end, stop_cycle, rows)


@compiled
def outlook_of(s: np.record, drive: NDArray, period: float) -> Outlook:
    """Set s.rate and return what bounds the next arc."""
    resting = s.done >= s.count
    s.rate = 0.0 if resting else drive[1, s.segment]
    limit = math.inf if resting else drive[0, s.segment] - s.tau
    ahead = (s.t_end - s.start) - s.done * period - s.since - s.tau
    last = s.cut != 0 and ahead < limit
    return Outlook(resting, ahead if last and ahead > 0.0 else limit, ahead, last)


@compiled
def _next_arc(
    plant: np.record, s: np.record, arc: np.record, held: np.record, outlook: Outlook
) -> int:
    """Fill arc with the way from the anchor to the next event; return the stop that it hits."""
    begin_arc(arc, s.x, s.z, s.v - s.rate, s.rate)
    arc.trial = s.trial
    near, hit = not s.near_low <= s.x <= s.near_high, 0
    if near:
        s.stopped = holding(plant, s)
    if s.stopped != 0:
        hold(plant, s, held, outlook.resting)
        held_arc(arc, plant, held, s.stopped, outlook.limit)
    else:
        next_arc(arc, plant, outlook.limit, True)
        x_end = s.x + arc.path + s.rate * arc.length
        if near or not s.near_low <= x_end <= s.near_high:
            hit = arc_to_stop((arc, plant), s)
    count_arc(plant, s, arc, hit)
    return hit


@compiled
def hold(plant: np.record, s: np.record, held: np.record, resting: bool) -> None:
    """Fill held for a runner that a stop holds; its backstep is complete but within the slip."""
    if s.tracking and (s.segment != s.slip or resting):
        s.backstep = s.x_top - s.x_low
        s.tracking = 0
    make_unmoved(plant, held)


@compiled
def count_arc(plant: np.record, s: np.record, arc: np.record, hit: int) -> None:
    """Count an arc that ends at the stop ``hit`` in the budget, and whether it has a length."""
    at_once = _AT_ONCE * plant.inv_omega if hit != 0 else 0.0
    s.stalled = s.stalled + 1 if not arc.length > at_once else 0
    s.spent = s.spent + (_IMPLICIT if arc.kind == STIFF else 1)


@compiled
def _end_position(s: np.record, arc: np.record) -> float:
    """Return the position (m) at the end of the arc."""
    if s.stopped != 0:
        return s.x  # type: ignore[no-any-return]
    x = s.x + arc.path + s.rate * arc.length
    if s.near_low <= s.x <= s.near_high and s.near_low <= x <= s.near_high:
        return x  # type: ignore[no-any-return]
    return min(max(x, s.low), s.high)  # type: ignore[no-any-return]


@compiled
def track_backstep(plant: np.record, s: np.record, arc: np.record, resting: bool) -> None:
    """Follow the runner from the start of a slip to where it turns back towards the step."""
    if s.segment == s.slip and s.tau == 0.0 and not resting:
        if s.tracking:
            s.backstep = s.x_top - s.x_low
        s.tracking = 1
        s.x_top = s.x_low = s.sign * s.x
    if not s.tracking:
        return
    if s.segment != s.slip or resting:
        t, gone = turning_point(arc, plant, s.sign)
        if t == t:
            s.x_low = min(s.x_low, s.sign * (s.x + gone))
            if resting or not s.slip < s.segment < s.slip_end:
                s.backstep = s.x_top - s.x_low
                s.tracking = 0
    s.x_low = min(s.x_low, s.sign * _end_position(s, arc))


@compiled
def take_arc(plant: np.record, s: np.record, arc: np.record, hit: int) -> None:
    """Move the anchor to the end of the arc; bring extremes and the account of energy up to it."""
    x = _end_position(s, arc)
    s.trial = arc.trial
    s.z_max = max(s.z_max, arc.z_end, arc.z_max)
    s.z_min = min(s.z_min, arc.z_end, arc.z_min)
    s.x_min, s.x_max = min(s.x_min, x), max(s.x_max, x)
    if s.stopped == 0 and plant.spring != 0.0:
        s.impulse += position_integral(arc, plant) * plant.spring
    s.tau, s.x, s.v, s.z = s.tau + arc.length, x, arc.w_end + s.rate, arc.z_end
    if s.stopped != 0:
        s.dissipated += held_heat(arc, plant)
        _open_account(s)
    elif hit != 0:  # what is left of its motion goes into the stop
        s.x = s.low if hit < 0 else s.high
        s.dissipated += _dissipated(s, plant, s.tau - s.open_tau)
        s.v = 0.0
        _open_account(s)
        s.stopped, s.hits = hit, s.hits + 1


@compiled
def pass_kink(plant: np.record, s: np.record, drive: NDArray) -> bool:
    """Begin the next segment, where the rate changes; return whether a cycle ended."""
    duration = drive[0, s.segment]
    s.dissipated += _dissipated(s, plant, duration - s.open_tau)
    s.since += duration
    s.tau = 0.0
    _open_account(s)
    s.segment += 1
    if s.segment < drive.shape[1]:
        return False
    s.since, s.segment = 0.0, 0
    end_cycle(s, plant)
    return True


@compiled
def _sample_within(
    plant: np.record, s: np.record, axis: NDArray, drive: NDArray, outlook: Outlook
) -> None:
    """Keep the state at t_end, which lies within the arc."""
    arc, ahead = arc_in(axis), outlook.ahead
    sample_begun(plant, s, arc, drive, outlook)
    if not 0.0 < ahead < math.inf:
        return
    if s.stopped != 0:
        x = s.x
        _, z, w = within_arc(arc, held_in(axis), ahead)
    else:
        x, z, w = _look(arc, plant, outlook.limit, ahead)
        x = min(max(x, s.low), s.high)
    s.now_x, s.now_v, s.now_z = x, w + s.rate, z
    place_sample(s, drive, s.tau + ahead)


@compiled
def sample_begun(
    plant: np.record, s: np.record, arc: np.record, drive: NDArray, outlook: Outlook
) -> None:
    """Keep the state at the anchor for a time within the arc; a backstep may be complete by then.

    At rest the last arc never ends.
    """
    tracking = s.tracking
    if tracking and outlook.resting:
        t, gone = turning_point(arc, plant, s.sign)
        if t <= outlook.ahead:
            s.backstep = s.x_top - min(s.x_low, s.sign * (s.x + gone))
            tracking = 0
    sample_anchor(s, drive, tracking)


@compiled
def _look(
    arc: np.record, plant: np.record, limit: float, ahead: float
) -> tuple[float, float, float]:
    """Return x, z (m), w (m/s) at ``ahead`` (s) after the start of the present arc."""
    if arc.kind == TABULATED:  # there is nothing within: go through it arc by arc
        next_arc(arc, plant, limit, False)
        while arc.length <= ahead:
            h = arc.length
            begin_arc(arc, arc.x + arc.path + arc.rate * h, arc.z_end, arc.w_end, arc.rate)
            ahead -= h
            limit -= h
            next_arc(arc, plant, limit, False)
    gone, z, w = within_arc(arc, plant, ahead)
    return arc.x + gone + arc.rate * ahead, z, w


@compiled
def sample_anchor(s: np.record, drive: NDArray, tracking: int) -> None:
    """Keep the state at the anchor as what was asked for."""
    s.now_segment, s.now_tracking = s.segment, tracking
    s.now_x, s.now_v, s.now_z, s.now_rate = s.x, s.v, s.z, s.rate
    place_sample(s, drive, s.tau)


@compiled
def place_sample(s: np.record, drive: NDArray, tau: float) -> None:
    """Set time and deflection of the actuator at tau (s) into the segment."""
    s.now_tau, s.now_u = tau, s.rate * tau
    for k in range(s.segment):
        s.now_tau += drive[0, k]
        s.now_u += drive[0, k] * drive[1, k]
    s.now_u += s.level


@compiled
def _dissipated(s: np.record, plant: np.record, duration: float) -> float:
    """Return the energy (J) turned into heat by the contact since its account was opened.

    Work F w of both bodies on the contact less what its springs hold. Momentum and energy of the
    runner give it from the ends alone: F dt = -m dv + (F_ext - k x) dt, over duration (s).
    """
    mass, force, spring = plant.mass, plant.force, plant.spring
    x0, v0, z0 = s.open_x, s.open_v, s.open_z
    x, v, z = s.x, s.v, s.z
    on_runner = 0.5 * mass * (v0 * v0 - v * v) + force * (x - x0) + 0.5 * spring * (x0 * x0 - x * x)
    impulse = mass * (v0 - v) + force * duration - s.impulse
    stored = 0.5 * plant.sigma_0 * (z * z - z0 * z0)
    return on_runner - s.rate * impulse - stored  # type: ignore[no-any-return]
