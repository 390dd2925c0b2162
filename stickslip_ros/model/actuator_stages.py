# SPDX-License-Identifier: Apache-2.0
"""The response of the actuator's chain to a command: stage after stage, as straight lines."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled
from stickslip_ros.model.actuator_chain import (
    CAPACITY,
    COMMAND,
    DEFLECTION,
    DRIVEN,
    PLAYS,
    STILL,
    Chain,
    distance,
)
from stickslip_ros.model.actuator_dynamics import amplify, resonate
from stickslip_ros.model.drive_cycle import DriveCycle
from stickslip_ros.parameters import ParameterError

#: Cycles within which a command settles, or is refused
_MOST_CYCLES = 1000
#: Deviation allowed for each line of creep, as a share of the allowed deviation of the chain
_OF_CREEP = 0.5


def settled(chain: Chain, command: DriveCycle) -> DriveCycle:
    """Return the cycle of the deflection that cycles of a command settle to.

    Raises ParameterError if it does not within 1000 cycles, or takes too many straight lines.
    """
    nodes, spare = np.empty((2, CAPACITY)), np.empty((2, CAPACITY))
    state = chain.rest()
    for _ in range(_MOST_CYCLES):
        before = state.copy()
        count = follow(chain, state, command.durations, command.rates, nodes, spare)
        if count < 0 or distance(chain, before, state) <= STILL:
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
    lines, _, slip, slip_end = write_lines(nodes, count, (0.0, nodes[1, 0]), slips, spare)
    durations, rates = spare[:, :lines].copy()
    return DriveCycle(durations, rates, slip, command.sign, slip_end - slip)


@compiled
def write_lines(
    nodes: NDArray,
    count: int,
    offsets: tuple[float, float],
    slips: tuple[float, float],
    drive: NDArray,
) -> tuple[int, float, int, int]:
    """Write the lines between nodes into drive: durations (s) and rates (m/s).

    offsets (m): that of all nodes, and the level of the first node. Lines of no length are left
    out. Returns the number of lines, their total change (m), and the indices of the lines that
    begin at the times slips (s), or -1.
    """
    (offset, u), (slip_at, slip_end_at) = offsets, slips
    t, lines, shift = nodes[0, 0], 0, 0.0
    slip = 0 if t >= slip_at else -1
    slip_end = 0 if t >= slip_end_at else -1
    for k in range(1, count):
        duration = nodes[0, k] - t
        if not duration > 0.0:
            continue
        drive[0, lines], drive[1, lines] = duration, (nodes[1, k] + offset - u) / duration
        shift += drive[0, lines] * drive[1, lines]
        t, u, lines = nodes[0, k], nodes[1, k] + offset, lines + 1
        if slip < 0 and t >= slip_at:
            slip = lines
        if slip_end < 0 and t >= slip_end_at:
            slip_end = lines
    return lines, shift, slip, slip_end


@compiled
def follow(
    chain: Chain, state: NDArray, durations: NDArray, rates: NDArray, nodes: NDArray, spare: NDArray
) -> int:
    """Take the state over segments of the command; return how many ends of lines nodes holds.

    durations (s) and rates (m/s) are of the command; nodes and spare (2, capacity) take times (s)
    from 0 on and deflections (m); The ends of the segments
    are among the times, as the sums of the durations. Returns -1 if the nodes do not suffice.
    """
    count = _commanded(state, durations, rates, nodes)
    if chain.lag > 0.0 or chain.slew < math.inf:
        count = amplify(chain, state, durations, rates, nodes)
    else:
        state[DRIVEN] = state[COMMAND]
    if count > 0 and len(chain.thresholds):
        count = _hysteretic(chain, state, nodes, count, spare)
        nodes[:, :count] = spare[:, :count]
    elif count > 0:
        nodes[1, :count] *= chain.elastic
    if count > 0 and len(chain.creep_times):
        count = _crept(chain, state, nodes, count, spare)
        nodes[:, :count] = spare[:, :count]
    if count > 0 and chain.omega > 0.0:
        count = resonate(chain, state, nodes, count, spare, durations)
        nodes[:, :count] = spare[:, :count]
    elif count > 0:
        state[DEFLECTION] = nodes[1, count - 1]
    return count


@compiled
def _commanded(state: NDArray, durations: NDArray, rates: NDArray, nodes: NDArray) -> int:
    """Write the command itself into nodes; move the command in the state unless it lags."""
    t, c = 0.0, state[COMMAND]
    nodes[0, 0], nodes[1, 0] = t, c
    for k in range(len(durations)):
        t += durations[k]
        c += durations[k] * rates[k]
        nodes[0, k + 1], nodes[1, k + 1] = t, c
    state[COMMAND] = c
    return len(durations) + 1


@compiled
def _play(value: float, y: float, threshold: float) -> float:
    """Return the state of a play after its input has reached y."""
    return max(y - threshold, min(y + threshold, value))


@compiled
def _hysteretic(chain: Chain, state: NDArray, nodes: NDArray, count: int, out: NDArray) -> int:
    """Write the deflection with hysteresis into out; a line ends where a play begins to move."""
    operators = len(chain.thresholds)
    plays = state[PLAYS : PLAYS + operators]
    shares = np.empty(operators + 1)  # of a line, at which plays begin to move, and its end
    out[0, 0], written = nodes[0, 0], 1
    out[1, 0] = chain.elastic * nodes[1, 0] + _weighted(chain, plays)
    for k in range(1, count):
        t, y = nodes[0, k - 1], nodes[1, k - 1]
        span, way = nodes[0, k] - t, nodes[1, k] - y
        parts = 0
        for i in range(operators):
            gap = plays[i] + math.copysign(chain.thresholds[i], way) - y
            if way != 0.0 and 1e-9 < gap / way < 1.0 - 1e-9:
                shares[parts] = gap / way
                parts += 1
        if parts > 1:
            shares[:parts].sort()
        shares[parts] = 1.0
        last = 0.0
        for share in shares[: parts + 1]:
            if share <= last:
                continue
            if written >= out.shape[1] - 2:
                return -1
            here = nodes[1, k] if share == 1.0 else y + share * way
            for i in range(operators):
                plays[i] = _play(plays[i], here, chain.thresholds[i])
            out[0, written] = nodes[0, k] if share == 1.0 else t + share * span
            out[1, written] = chain.elastic * here + _weighted(chain, plays)
            written += 1
            last = share
    return written


@compiled
def _weighted(chain: Chain, plays: NDArray) -> float:
    """Return the sum of weights times plays, m."""
    total = 0.0
    for i in range(len(plays)):
        total += chain.weights[i] * plays[i]
    return total


@compiled
def _crept(chain: Chain, state: NDArray, nodes: NDArray, count: int, out: NDArray) -> int:
    """Write the deflection with creep into out, with lines short enough for its curvature."""
    first = PLAYS + len(chain.thresholds)
    creep, slopes, per_s = state[first:], np.empty(len(state) - first), 1.0 / chain.creep_times
    part = _OF_CREEP * chain.error
    out[0, 0], written = nodes[0, 0], 1
    out[1, 0] = nodes[1, 0] + chain.creep_weight * creep.sum()
    for k in range(1, count):
        t, q, end = nodes[0, k - 1], nodes[1, k - 1], nodes[0, k]
        rate = (nodes[1, k] - q) / (end - t) if end > t else 0.0
        while t < end:
            curvature = 0.0
            for i in range(len(creep)):
                slopes[i] = rate - (q - creep[i]) * per_s[i]
                curvature += abs(slopes[i]) * per_s[i]
            curvature *= chain.creep_weight
            h = end - t
            if curvature * h * h > 8.0 * part:
                h = h / math.ceil(h / math.sqrt(8.0 * part / curvature))
            if written >= out.shape[1] - 2:
                return -1
            for i in range(len(creep)):
                # As what it gains: tau times the rate is metres, and its rounding would add up.
                gone = -math.expm1(-h * per_s[i])
                creep[i] += (q - creep[i]) * gone + rate * h * (1.0 - gone / (h * per_s[i]))
            last = not end - t - h > 1e-9 * h
            t = end if last else t + h
            q = nodes[1, k] if last else q + rate * h
            out[0, written], out[1, written] = t, q + chain.creep_weight * creep.sum()
            written += 1
    return written
