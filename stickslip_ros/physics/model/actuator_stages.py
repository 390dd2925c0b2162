# SPDX-License-Identifier: Apache-2.0
"""The response of the actuator's chain to a command: stage after stage, as parabolas."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.compiled import compiled
from stickslip_ros.physics.model.actuator_chain import (
    CAPACITY,
    COMMAND,
    DEFLECTION,
    DRIVEN,
    PLAYS,
    STILL,
    Chain,
    distance,
)
from stickslip_ros.physics.model.actuator_dynamics import amplify, resonate
from stickslip_ros.physics.model.drive_cycle import DriveCycle
from stickslip_ros.physics.parameters import ParameterError

#: Cycles within which a command settles, or is refused
_MOST_CYCLES = 1000
#: Deviation allowed for each piece of creep, as a multiple of the allowed deviation of the chain
_OF_CREEP = 5.0
#: A creeping piece of L seconds is off by u''' L^3 / 125
_BESIDE = 125.0
#: Below so many time constants the ways of creep are summed up as series
_SHORT = 0.02
#: A piece whose bend moves it by less than this many allowed deviations is straight
_STRAIGHT = 1.5


def settled(chain: Chain, command: DriveCycle) -> DriveCycle:
    """Return the cycle of the deflection that cycles of a command settle to.

    Raises ParameterError if it does not within 1000 cycles, or takes too many pieces.
    """
    nodes, spare = np.empty((3, CAPACITY)), np.empty((3, CAPACITY))
    state = chain.rest()
    for _ in range(_MOST_CYCLES):
        before = state.copy()
        count = follow(chain, state, command.durations, command.rates, nodes, spare)
        if count < 0 or distance(before, state, chain.omega) <= STILL:
            break
    else:
        count = -1
    if count < 0:
        raise ParameterError(
            "amplifier and actuator do not settle within a cycle that can be run: raise "
            "amplifier_bandwidth, amplifier_slew or actuator_damping, or lower the frequency"
        )
    closing = nodes[0, :count] == nodes[0, count - 1]
    nodes[1, :count][closing] = nodes[1, 0]
    ends = [0.0, *np.cumsum(command.durations).tolist()]
    slips = ends[command.slip], ends[command.slip_end]
    pieces, _, slip, slip_end = write_drive(
        nodes, count, (0.0, nodes[1, 0]), slips, chain.error, spare
    )
    durations, rates, bends = spare[:, :pieces].copy()
    return DriveCycle(durations, rates, slip, command.sign, slip_end - slip, bends)


@compiled
def write_drive(
    nodes: NDArray,
    count: int,
    offsets: tuple[float, float],
    slips: tuple[float, float],
    error: float,
    drive: NDArray,
) -> tuple[int, float, int, int]:
    """Write the pieces between nodes into drive: durations (s), first rates (m/s), bends (m/s^2).

    offsets (m): that of all nodes, and the level of the first node. Pieces of no length are left
    out; those get straight which are hardly bent for the deviation that is allowed, error (m).
    Returns the number of pieces, their total change (m), and the indices of the pieces that begin
    at the times slips (s), or -1.
    """
    (offset, u), (slip_at, slip_end_at) = offsets, slips
    t, pieces, shift = nodes[0, 0], 0, 0.0
    slip = 0 if t >= slip_at else -1
    slip_end = 0 if t >= slip_end_at else -1
    for k in range(1, count):
        duration, bend = nodes[0, k] - t, nodes[2, k]
        if not duration > 0.0:
            continue
        if abs(bend) * duration * duration < 12.0 * _STRAIGHT * error:
            bend = 0.0
        mean = (nodes[1, k] + offset - u) / duration
        drive[0, pieces], drive[1, pieces] = duration, mean - 0.5 * bend * duration
        drive[2, pieces] = bend
        shift += duration * mean
        t, u, pieces = nodes[0, k], nodes[1, k] + offset, pieces + 1
        if slip < 0 and t >= slip_at:
            slip = pieces
        if slip_end < 0 and t >= slip_end_at:
            slip_end = pieces
    return pieces, shift, slip, slip_end


@compiled
def follow(
    chain: Chain, state: NDArray, durations: NDArray, rates: NDArray, nodes: NDArray, spare: NDArray
) -> int:
    """Take the state over segments of the command; return how many ends of pieces nodes holds.

    durations (s) and rates (m/s) are of the command; nodes and spare (3, capacity) take times (s)
    from 0 on, deflections (m) and the bend (m/s^2) of the piece that ends there. The ends of the
    segments are among the times, as the sums of the durations. -1 if the nodes do not suffice.
    """
    count = _commanded(state, durations, rates, nodes)
    if chain.lag > 0.0 or chain.slew < math.inf:
        count = amplify(chain, state, durations, rates, nodes)
    else:
        state[DRIVEN] = state[COMMAND]
    if count > 0 and len(chain.thresholds):
        count = _hysteresis(chain, state, nodes, count, spare)
        _take(nodes, spare, count)
    elif count > 0:
        for k in range(count):
            nodes[1, k] *= chain.elastic
            nodes[2, k] *= chain.elastic
    if count > 0 and len(chain.creep_times):
        count = _creep(chain, state, nodes, count, spare)
        _take(nodes, spare, count)
    if count > 0 and chain.omega > 0.0:
        count = resonate(chain, state, nodes, count, spare)
        _take(nodes, spare, count)
    elif count > 0:
        state[DEFLECTION] = nodes[1, count - 1]
    return count


@compiled
def _take(nodes: NDArray, spare: NDArray, count: int) -> None:
    """Let the first nodes be those in spare."""
    # Number by number: for an assignment numba compiles texts of errors for 2 s.
    for row in range(3):
        for k in range(count):
            nodes[row, k] = spare[row, k]


@compiled
def lay_pieces(
    chain: Chain,
    state: NDArray,
    command: NDArray,
    offsets: tuple[float, float],
    slips: tuple[float, float],
    buffers: tuple[NDArray, NDArray],
) -> tuple[int, float, int, int]:
    """Take the state over a command, durations (s) and rates (m/s), and write its pieces.

    buffers are those of `follow`; the second takes the pieces. Returns what `write_drive` does, -1
    pieces if there is no room for them.
    """
    nodes, spare = buffers
    count = follow(chain, state, command[0], command[1], nodes, spare)
    if count < 0:
        return -1, 0.0, -1, -1
    return write_drive(nodes, count, offsets, slips, chain.error, spare)


@compiled
def _commanded(state: NDArray, durations: NDArray, rates: NDArray, nodes: NDArray) -> int:
    """Write the command itself into nodes; move the command in the state unless it lags."""
    t, c = 0.0, state[COMMAND]
    nodes[:, : len(durations) + 1] = 0.0
    nodes[0, 0], nodes[1, 0] = t, c
    for k in range(len(durations)):
        t += durations[k]
        c += durations[k] * rates[k]
        nodes[0, k + 1], nodes[1, k + 1] = t, c
    state[COMMAND] = c
    return len(durations) + 1


@compiled
def _hysteresis(chain: Chain, state: NDArray, nodes: NDArray, count: int, out: NDArray) -> int:
    """Write the deflection with hysteresis into out; a piece ends where a play begins to move."""
    operators = len(chain.thresholds)
    plays = state[PLAYS : PLAYS + operators]
    shares = np.empty(operators + 1)  # of a piece's rise, at which plays begin to move, and its end
    out[0, 0], written = nodes[0, 0], 1
    out[1, 0] = chain.elastic * nodes[1, 0] + _weighted(chain, plays)
    for k in range(1, count):
        t, y, bend = nodes[0, k - 1], nodes[1, k - 1], nodes[2, k]
        span, rise = nodes[0, k] - t, nodes[1, k] - y
        rate = rise / span - 0.5 * bend * span if span > 0.0 else 0.0
        parts = 0
        for i in range(operators):
            gap = plays[i] + math.copysign(chain.thresholds[i], rise) - y
            if rise != 0.0 and 1e-9 < gap / rise < 1.0 - 1e-9:
                shares[parts] = gap / rise
                parts += 1
        if parts > 1:
            shares[:parts].sort()
        shares[parts] = 1.0
        last, before = 0.0, y
        for share in shares[: parts + 1]:
            if share <= last:
                continue
            if written >= out.shape[1] - 2:
                return -1
            here = nodes[1, k] if share == 1.0 else y + share * rise
            for i in range(operators):
                gap = chain.thresholds[i]
                plays[i] = max(here - gap, min(here + gap, plays[i]))
            out[0, written] = nodes[0, k]
            if share < 1.0:
                gone = share * span
                if bend != 0.0:  # when rate t + bend t^2 / 2 has gone that part of the rise
                    passed = share * rise
                    root = math.sqrt(max(rate * rate + 2.0 * bend * passed, 0.0))
                    whole = abs(rate) + root
                    gone = min(2.0 * abs(passed) / whole, span) if whole > 0.0 else span
                out[0, written] = t + gone
            out[1, written] = chain.elastic * here + _weighted(chain, plays)
            out[2, written] = 0.0
            if bend != 0.0 and here != before:
                out[2, written] = bend * (out[1, written] - out[1, written - 1]) / (here - before)
            written += 1
            last, before = share, here
    return written


@compiled
def _weighted(chain: Chain, plays: NDArray) -> float:
    """Return the sum of weights times plays, m."""
    total = 0.0
    for i in range(len(plays)):
        total += chain.weights[i] * plays[i]
    return total


@compiled
def _creep(chain: Chain, state: NDArray, nodes: NDArray, count: int, out: NDArray) -> int:
    """Write the deflection with creep into out, in pieces short enough for its curvature."""
    first = PLAYS + len(chain.thresholds)
    creep, per_s = state[first:], 1.0 / chain.creep_times
    part = _OF_CREEP * _BESIDE * chain.error
    out[0, 0], written = nodes[0, 0], 1
    out[1, 0] = nodes[1, 0] + chain.creep_weight * creep.sum()
    for k in range(1, count):
        t, q, end, bend = nodes[0, k - 1], nodes[1, k - 1], nodes[0, k], nodes[2, k]
        rate = (nodes[1, k] - q) / (end - t) - 0.5 * bend * (end - t) if end > t else 0.0
        while t < end:
            jerk = bent = 0.0
            for i in range(len(creep)):
                curved = (rate - (q - creep[i]) * per_s[i]) * per_s[i]
                bent += curved
                jerk += abs(bend - curved) * per_s[i]
            jerk *= chain.creep_weight
            h = end - t
            if jerk * h * h * h > part:
                h = h / math.ceil(h / (part / jerk) ** (1.0 / 3.0))
            if written >= out.shape[1] - 2:
                return -1
            for i in range(len(creep)):
                creep[i] += _creep_path(q - creep[i], rate, bend, h, h * per_s[i])
            last = not end - t - h > 1e-9 * h
            t = end if last else t + h
            q = nodes[1, k] if last else q + (rate + 0.5 * bend * h) * h
            rate += bend * h
            for i in range(len(creep)):
                bent += (rate - (q - creep[i]) * per_s[i]) * per_s[i]
            out[0, written], out[1, written] = t, q + chain.creep_weight * creep.sum()
            out[2, written] = bend + 0.5 * chain.creep_weight * bent
            written += 1
    return written


@compiled
def _creep_path(behind: float, rate: float, bend: float, h: float, x: float) -> float:
    """Return how far (m) one exponential of the creep gets in h (s), x of its time constants.

    It is behind (m) what comes in, which goes at a rate (m/s) with a bend (m/s^2).
    """
    if x < _SHORT:  # 1/3! - x/4! + x^2/5! ..
        third = 1.0 - x / 7.0 * (1.0 - x / 8.0 * (1.0 - x / 9.0))
        third = (1.0 - x / 4.0 * (1.0 - x / 5.0 * (1.0 - x / 6.0 * third))) / 6.0
        second = 0.5 - x * third
        first = 1.0 - x * second
    else:
        first = -math.expm1(-x) / x
        second = (1.0 - first) / x
        third = (0.5 - second) / x
    # Of the rise: tau times the rate is metres, and its rounding would add up.
    return x * (behind * first + h * (rate * second + bend * h * third))
