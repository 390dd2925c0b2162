# SPDX-License-Identifier: Apache-2.0
"""What becomes of a commanded deflection: amplifier, hysteresis with its past, creep, resonance.

The command c is the voltage times the gain, straight between kinks. Four stages follow, each of
which may be missing; lengths are in metres throughout:

    amplifier    y' = (c - y) / lag, but |y'| <= slew
    hysteresis   q = elastic y + sum of weights times plays of y, see `actuator.py`
    creep        s = q + sum of w c_i,   c_i' = (q - c_i) / tau_i
    resonance    u'' = omega^2 (s - u) - 2 zeta omega u'

Each stage is solved in closed form between the kinks of the one before, and handed on as straight
lines again. Their inner ends lie beside the curve, so that the mean of the lines is that of the
curve; the ends at which the actuator turns lie on it. Lines are off by ``error`` at most where the
contact may turn. Where the actuator is faster than any runner, only the mean counts, and lines are
longer. How they are chosen is the only approximation.

Creep is the usual logarithm of time, s = q (1 + gamma log10(t / t0)) after a jump (H. Jung, D.-G.
Gweon, Rev. Sci. Instrum. 71 (2000) 1896), as two exponentials a decade: from 10 to a million times
t0 this is within 0.003 gamma q; after a hundred million it ends.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled
from stickslip_ros.model.actuator import Actuator
from stickslip_ros.model.drive_cycle import DriveCycle
from stickslip_ros.model.friction import FOREIGN, contacts_of
from stickslip_ros.parameters import (
    ActuatorParameters,
    FrictionParameters,
    ParameterError,
    Parameters,
)

#: Distance (m) of straight lines from what they stand for, of the whole chain, near its turns
ERROR = 1e-11
#: Share of it that lines of the amplifier may be off, and the least that lines of the actuator may
_AMPLIFIER, _LEAST = 0.5, 0.25
#: From this damping ratio on lines of the actuator may be off by all of it: one that rings turns
#: often
_FIRM = 0.25
#: Share of it by which lines of the amplifier may move the actuator that follows them
_INPUT = 1e-3
#: Rate (m/s) of the actuator that no runner has while it sticks: faster, no line turns the contact
BRISK = 3e-3
#: How many times longer lines may be at most where no line turns the contact, and the angular
#: frequency (1/s) up to which they may not, for the runner goes along with the actuator
_LONGER, OMEGA_REF = 8.0, 2.0 * math.pi * 40e3
#: Exponentials of creep in a decade, and decades from creep_start on
_PER_DECADE, _DECADES = 2, 8
#: Lengths (m) below which nothing moves any more; share of themselves by which sums are rounded
STILL, _ROUNDING = 1e-15, 1e-14
#: Places of a state before those of plays and creep: command, y, u, u'
COMMAND, DRIVEN, DEFLECTION, RATE, PLAYS = range(5)
#: Ends of straight lines that one stretch may have
CAPACITY = 2**17
#: Steps of Newton's method, or bisections, to find where the actuator turns
_MOST_STEPS = 60
#: Cycles within which a command settles, or is refused
_MOST_CYCLES = 1000


class Chain(NamedTuple):
    """Constants of the stages, as compiled functions take them."""

    lag: float  #: of the amplifier, s; 0: none
    slew: float  #: of the amplifier in terms of deflection, m/s; infinite: no limit
    elastic: float  #: share of the deflection without hysteresis
    thresholds: NDArray[np.float64]  #: of the plays in terms of deflection, m
    weights: NDArray[np.float64]  #: of the plays
    creep_times: NDArray[np.float64]  #: tau_i, s
    creep_weight: float  #: w of each
    omega: float  #: of the resonance, 1/s; 0: none
    zeta: float  #: its damping ratio
    error: float  #: m
    brisk: float  #: rate (m/s) of the actuator from which on only the mean of a line counts

    def rest(self) -> NDArray[np.float64]:
        """Return the state of an actuator without a past, at 0."""
        return np.zeros(PLAYS + len(self.thresholds) + len(self.creep_times))

    @classmethod
    def of(cls, parameters: Parameters, creeping: bool = True) -> Chain:
        """Return the chain that the parameters describe; without an effect, the command itself.

        Raises ParameterError.
        """
        p = parameters.actuator
        p = p if has_chain(p) else without_chain(p)
        actuator = Actuator.of(p)
        times = np.empty(0)
        if p.creep and creeping:
            # Exponentials of all times from e^0.5772 t0 on add up to the logarithm of t / t0.
            first = p.creep_start * math.exp(np.euler_gamma)
            times = first * 10.0 ** ((np.arange(_DECADES * _PER_DECADE) + 0.5) / _PER_DECADE)
        return cls(
            lag=1.0 / (2.0 * math.pi * p.amplifier_bandwidth) if p.amplifier_bandwidth else 0.0,
            slew=1e6 * p.amplifier_slew * p.gain if p.amplifier_slew else math.inf,
            elastic=actuator.elastic / p.gain,
            thresholds=actuator.thresholds * p.gain,
            weights=actuator.weights / p.gain,
            creep_times=times,
            creep_weight=(p.creep or 0.0) / _PER_DECADE,
            omega=2.0 * math.pi * p.actuator_resonance if p.actuator_resonance else 0.0,
            zeta=p.actuator_damping,
            error=ERROR,
            brisk=_brisk(parameters.friction),
        )


def _brisk(friction: FrictionParameters) -> float:
    """Return the rate (m/s) from which on only the mean of a line counts for the contact.

    While w keeps its sign, a contact without a Stribeck curve goes by the path alone, so where no
    line turns it, the mean is all that counts. With a Stribeck curve it goes by the rate, too, and
    so may a law with a rate of its own: lines then are as fine as at the turns.
    """
    contact = contacts_of(friction)
    depends = (contact.z_s != contact.z_k) | (contact.kind >= FOREIGN)
    return math.inf if np.any(depends) else BRISK


def has_chain(p: ActuatorParameters) -> bool:
    """Return whether the deflection hangs on more than the command of the moment."""
    return bool(p.actuator_memory or p.creep or has_dynamics(p))


def has_dynamics(p: ActuatorParameters) -> bool:
    """Return whether amplifier or actuator take time; numbers in p may be columns (points,)."""
    stages: tuple[Any, ...] = (p.amplifier_bandwidth, p.amplifier_slew, p.actuator_resonance)
    return any(stage is not None and bool(np.any(stage > 0.0)) for stage in stages)


def without_chain(p: ActuatorParameters) -> ActuatorParameters:
    """Return the linear actuator that deflects as it is commanded."""
    return replace(
        p, actuator="linear", actuator_memory=False, creep=None,
        amplifier_bandwidth=None, amplifier_slew=None, actuator_resonance=None,
    )  # fmt: skip


def same_chain(one: Chain, other: Chain) -> bool:
    """Return whether two chains have the same constants."""
    pairs: list[tuple[Any, Any]] = list(zip(one, other, strict=True))
    return all(np.array_equal(a, b) for a, b in pairs)


def standing(chain: Chain, state: NDArray[np.float64]) -> float:
    """Return the deflection (m) at which hysteresis and creep hold the actuator at present."""
    plays, creep = np.split(state[PLAYS:], [len(chain.thresholds)])
    slow = chain.creep_weight * float(creep.sum())
    return float(chain.elastic * state[DRIVEN] + chain.weights @ plays) + slow


def motion_left(chain: Chain, state: NDArray[np.float64]) -> float:
    """Return how far (m) the actuator still moves, about, while the command rests."""
    creep, s = state[PLAYS + len(chain.thresholds) :], standing(chain, state)
    q = s - chain.creep_weight * float(creep.sum())
    left = abs(state[COMMAND] - state[DRIVEN])
    left += chain.creep_weight * float(np.abs(q - creep).sum())
    if chain.omega:
        left += abs(s - state[DEFLECTION]) + abs(state[RATE]) / chain.omega
    return float(left)


def changed(old: Chain, new: Chain, state: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the state with which a changed chain goes on.

    Plays and creep keep what they remember if they are the same ones; else the actuator has no past
    but the way to its present command.
    """
    taken, operators = new.rest(), len(new.thresholds)
    taken[:PLAYS] = state[:PLAYS]
    if np.array_equal(old.thresholds, new.thresholds):
        taken[PLAYS : PLAYS + operators] = state[PLAYS : PLAYS + operators]
    if np.array_equal(old.creep_times, new.creep_times):
        taken[PLAYS + operators :] = state[PLAYS + len(old.thresholds) :]
    plays = taken[PLAYS : PLAYS + operators]
    np.clip(plays, taken[DRIVEN] - new.thresholds, taken[DRIVEN] + new.thresholds, out=plays)
    return taken


def settled(chain: Chain, command: DriveCycle) -> DriveCycle:
    """Return the cycle of the deflection that cycles of a command settle to.

    Raises ParameterError if it does not within 1000 cycles, or takes too many straight lines.
    """
    nodes, spare = np.empty((3, CAPACITY)), np.empty((3, CAPACITY))
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
    t, u = lines_of(nodes[:2, :count])
    u[-1] = u[0]
    ends = np.concatenate([[0.0], np.cumsum(command.durations)])
    slip, slip_end = np.searchsorted(t, ends[[command.slip, command.slip_end]]).tolist()
    durations = np.diff(t)
    return DriveCycle(durations, np.diff(u) / durations, slip, command.sign, slip_end - slip)


def lines_of(nodes: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times (s) and deflections (m) of the ends of lines, without lines of no length."""
    t, u = nodes[:, np.append(True, np.diff(nodes[0]) > 0.0)]
    return t, u


def distance(chain: Chain, one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Return how far two states are apart, m."""
    apart = np.abs(one - other)
    apart[RATE] /= chain.omega or 1.0
    return float(apart.max())


@compiled
def follow(
    chain: Chain, state: NDArray, durations: NDArray, rates: NDArray, nodes: NDArray, spare: NDArray
) -> int:
    """Take the state over segments of the command; return how many ends of lines nodes holds.

    durations (s) and rates (m/s) are of the command; nodes and spare (3, capacity) take times (s)
    from 0 on and deflections (m); their third row is for the work between. The ends of the segments
    are among the times, as the sums of the durations. Returns -1 if the nodes do not suffice.
    """
    count = _commanded(state, durations, rates, nodes)
    if chain.lag > 0.0 or chain.slew < math.inf:
        count = _amplified(chain, state, durations, rates, nodes)
    else:
        state[DRIVEN] = state[COMMAND]
    if count > 0 and len(chain.thresholds):
        count = _hysteretic(chain, state, nodes, count, spare)
        nodes[:2, :count] = spare[:2, :count]
    elif count > 0:
        nodes[1, :count] *= chain.elastic
    if count > 0 and len(chain.creep_times):
        count = _crept(chain, state, nodes, count, spare)
        nodes[:2, :count] = spare[:2, :count]
    if count > 0 and chain.omega > 0.0:
        count = _resonant(chain, state, nodes, count, spare, durations)
        nodes[:2, :count] = spare[:2, :count]
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
def _amplified(
    chain: Chain, state: NDArray, durations: NDArray, rates: NDArray, nodes: NDArray
) -> int:
    """Replace the command in nodes by what the amplifier makes of it."""
    capacity = nodes.shape[1] - 4
    c, y, count = nodes[1, 0], state[DRIVEN], 1
    nodes[1, 0] = y
    start = 0.0
    for k in range(len(durations)):
        b, left = rates[k], durations[k]
        end = start + left
        while left > 0.0:
            h, climb = _amplifier_piece(chain, c, y, (b, left))
            left = left - h if h < left else 0.0
            t_end = end - left
            if climb != 0.0:
                y += climb * h
                nodes[0, count], nodes[1, count] = t_end, y
            else:
                first = count - 1
                output = (c, b, (c - y) - b * chain.lag)
                count = _relaxation(chain, (t_end - h, h), output, nodes, count)
                if count > capacity:
                    return -1
                _write(nodes, count, t_end, *_relaxed(output, chain.lag, h))
                y = nodes[1, count]
                _balance(nodes, first, count)
            c += b * h
            count += 1
        start = end
    state[DRIVEN] = y
    return count


@compiled
def _fading(t: float, lag: float) -> float:
    """Return exp(-t / lag), 0 without a lag."""
    if not lag > 0.0:
        return 0.0
    x = t / lag
    if x < 1e-4:  # a series is as exact, and quicker
        return 1.0 - x * (1.0 - 0.5 * x * (1.0 - x / 3.0 * (1.0 - 0.25 * x)))
    return math.exp(-x)


@compiled
def _amplifier_piece(
    chain: Chain, c: float, y: float, line: tuple[float, float]
) -> tuple[float, float]:
    """Return how long (s) the amplifier stays as it is, and its rate (m/s) if the slew limits it.

    The rate is 0 if it does not. c is the command (m), y the output (m), line the rate of the
    command (m/s) and the time (s) until its kink. Without a lag an output that has caught up is the
    command to rounding: not what is left, but the rate of the command says then where it goes.
    """
    (b, left), lag, slew = line, chain.lag, chain.slew
    if slew == math.inf:
        return left, 0.0
    e, edge = c - y, slew * lag  # edge: |e| at which the limit is reached
    near = 1e-9 * edge + _ROUNDING * max(abs(c), abs(y))
    side = math.copysign(1.0, e if abs(e) > near else b)
    if abs(e) > edge + near or (abs(e) >= edge - near and side * b > slew):
        closing = slew - side * b
        catching_up = (abs(e) - edge) / closing if closing > 0.0 else math.inf
        return min(left, max(catching_up, 0.0)), side * slew
    if abs(b) > slew:
        target = math.copysign(edge, b)
        return min(left, lag * math.log((e - b * lag) / (target - b * lag))), 0.0
    return left, 0.0


@compiled
def _relaxation(
    chain: Chain,
    piece: tuple[float, float],
    output: tuple[float, float, float],
    nodes: NDArray,
    count: int,
) -> int:
    """Add nodes within what `_relaxed` gives for output; return how many there are then.

    piece is the time t of s = 0 and the span of s (s).
    """
    (t, span), (_, b, e), lag = piece, output, chain.lag
    nodes[2, count - 1] = 0.0
    if lag == 0.0 or e == 0.0:
        return count
    turn = lag * math.log(-e / (b * lag)) if -e * b > 0.0 and abs(e) > abs(b) * lag else math.inf
    at = 0.0
    while count < nodes.shape[1] - 4:
        left = e * math.exp(-at / lag)
        bend = abs(left) / (lag * lag)
        h = math.sqrt(8.0 * chain.error / bend) if bend > 0.0 else math.inf
        if chain.omega == 0.0:
            brisk = (abs(b + left / lag) - chain.brisk) / bend if bend > 0.0 else 0.0
            h = _line(chain, h, brisk, _longer(1.0 / lag) * h)
        elif bend > 0.0:
            h = _unnoticed(h, bend, chain)
            if at == 0.0:
                # Of the first line the area is moved away from where it belongs, to a free node.
                h = 0.5 * min(h, lag, turn)
        before, at = at, at + h
        if before < turn < at:
            at = turn
        if not at < span:
            break
        _write(nodes, count, t + at, *_relaxed(output, lag, at))
        count += 1
    return count


@compiled
def _relaxed(output: tuple[float, float, float], lag: float, s: float) -> tuple[float, float]:
    """Return c + b (s - lag) - e exp(-s / lag) (m) for output (c, b, e), and its integral (m s)."""
    c, b, e = output
    fading = _fading(s, lag)
    gone = e * lag * (1.0 - fading)
    return c + b * (s - lag) - e * fading, (c + b * (0.5 * s - lag)) * s - gone


@compiled
def _unnoticed(fine: float, bend: float, chain: Chain) -> float:
    """Return how long (s) a line may be that the resonance follows; fine (s) is exact enough.

    The actuator hardly follows an error of no mean that changes faster than it swings: of a line of
    h seconds, a share of (omega h)^2 / 40.
    """
    omega, error = chain.omega, _INPUT * chain.error
    quick = math.sqrt(math.sqrt(320.0 * error / bend) / omega)
    return max(math.sqrt(_INPUT) * fine, min(quick, 1.0 / omega))


@compiled
def _line(chain: Chain, fine: float, brisk: float, long: float) -> float:
    """Return how long (s) a line may be that is off by ``error`` if it is as long as fine.

    For brisk (s) the actuator stays faster than any runner, so that no line turns the contact; what
    counts then is the mean error, which is none, and a line may be long (s).
    """
    share = _AMPLIFIER
    if chain.omega > 0.0:  # behind a slow amplifier the actuator turns slowly
        share = max(_LEAST, math.sqrt(chain.zeta / _FIRM) / (1.0 + chain.lag * chain.omega))
    return min(max(math.sqrt(share) * fine, brisk), long)


@compiled
def _longer(omega: float) -> float:
    """Return how many times longer lines may be of what changes as fast as omega (1/s)."""
    return min(max(1.0, omega / OMEGA_REF), _LONGER)


@compiled
def _write(nodes: NDArray, k: int, t: float, u: float, integral: float) -> None:
    """Set node k: time (s), deflection (m), and its integral (m s) as `_balance` takes it."""
    nodes[0, k], nodes[1, k], nodes[2, k] = t, u, integral


@compiled
def _balance(nodes: NDArray, first: int, last: int) -> None:
    """Move the nodes between two of them so that lines have the mean of the curve they stand for.

    The integral of the curve (m s) up to each node is in the third row. The area between a line and
    its curve goes to its ends, most to the one beside the longer line. Nodes at which the curve
    turns stay where they are, for they say how far the contact is deflected.
    """
    before, shift, u = 0.0, 0.0, nodes[1, first]  # the line before a free node k, s; its shift
    for k in range(first, last):
        h, after, u_next = nodes[0, k + 1] - nodes[0, k], 0.0, nodes[1, k + 1]
        if k + 1 < last and (nodes[1, k + 2] - u_next) * (u_next - u) > 0.0:
            after = nodes[0, k + 2] - nodes[0, k + 1]
        total = before * before + after * after
        area = 0.5 * h * (u + u_next) - (nodes[2, k + 1] - nodes[2, k])
        share = area / total if total > 0.0 else 0.0
        if before > 0.0:
            nodes[1, k] = u + shift - 2.0 * share * before * before / (before + h)
        shift = -2.0 * share * after * after / (h + after) if after > 0.0 else 0.0
        before, u = (h if after > 0.0 else 0.0), u_next


@compiled
def _play(value: float, y: float, threshold: float) -> float:
    """Return where a play stands after its input came to y."""
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
    part = 0.25 * chain.error
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


@compiled
def _resonant(
    chain: Chain, state: NDArray, nodes: NDArray, count: int, out: NDArray, durations: NDArray
) -> int:
    """Write the deflection of the resonant actuator into out.

    A line ends where `_step` says so, where the actuator turns, and at the kinks of the command.
    """
    u, v = state[DEFLECTION], state[RATE]
    lag, flexible = 2.0 * chain.zeta / chain.omega, 1.0 / (chain.omega * chain.omega)
    area = 0.0  # integral of what comes in; with it that of u follows from u and u'
    _write(out, 0, nodes[0, 0], u, -flexible * v - lag * u)
    written, segment, kink = 1, 0, durations[0]
    due = math.inf  # when the present line has to end, s
    for k in range(1, count):
        t, s, end = nodes[0, k - 1], nodes[1, k - 1], nodes[0, k]
        span = end - t
        if not span > 0.0:
            continue
        rate = (nodes[1, k] - s) / span
        a, b = u - s + lag * rate, v - rate
        wide = _amplitude(chain, a, b)
        # What comes in may have set off a ringing since the line was laid out.
        due = min(due, max(t, out[0, written - 1] + _step(chain, (a, b), v, wide)))
        last, v_last = 0.0, v
        while True:
            h = min(due - t, span)
            free, free_rate = _free(chain, a, b, h)
            turns = v_last * (rate + free_rate) < 0.0
            if turns:
                h = _turning(chain, (a, b), rate, (last, h))
                free, free_rate = _free(chain, a, b, h)
            if not h < span:
                break
            if written >= out.shape[1] - 2:
                return -1
            u, v = s + rate * (h - lag) + free, rate + free_rate
            gone = (s + 0.5 * rate * h) * h
            _write(out, written, t + h, u, area + gone - flexible * v - lag * u)
            written += 1
            fading = math.exp(-chain.zeta * chain.omega * h)
            due = t + h + _step(chain, (free, free_rate), v, wide * fading)
            last, v_last = h, 0.0 if turns else v  # at a turn its sign is one of rounding
        u, v = nodes[1, k] - lag * rate + free, rate + free_rate
        area += (s + 0.5 * rate * span) * span
        if end >= kink or k == count - 1:
            due = math.inf
            if written >= out.shape[1] - 2:
                return -1
            _write(out, written, end, u, area - flexible * v - lag * u)
            written += 1
            segment += 1
            kink = kink + durations[segment] if segment < len(durations) else math.inf
    state[DEFLECTION], state[RATE] = u, v
    _balance(out, 0, written - 1)
    return written


@compiled
def _amplitude(chain: Chain, a: float, b: float) -> float:
    """Return the amplitude (m) of the free oscillation that begins with a and b."""
    side = (b + chain.zeta * chain.omega * a) / (chain.omega * math.sqrt(1.0 - chain.zeta**2))
    return math.sqrt(a * a + side * side)


@compiled
def _step(chain: Chain, motion: tuple[float, float], rate: float, wide: float) -> float:
    """Return how long (s) a line may be.

    It begins with (u, u') of the free oscillation at a rate u' (m/s); wide is the amplitude (m).
    """
    omega = chain.omega
    most = omega * omega * wide  # |u''| at any later time
    if most == 0.0:
        return math.inf
    free, free_rate = motion
    bend = -omega * (omega * free + 2.0 * chain.zeta * free_rate)
    jerk = omega * most
    fine = math.sqrt(8.0 * chain.error / most)
    # The bend in the middle of a line decides how far it is off.
    half, longer = 0.5 * jerk * fine, _longer(omega)
    long = longer * math.sqrt(8.0 * chain.error / min(most, abs(bend) + longer * half))
    fine = math.sqrt(8.0 * chain.error / min(most, abs(bend) + half))
    left = abs(rate) - chain.brisk
    if not left > 0.0:
        return _line(chain, fine, 0.0, long)
    away = math.copysign(bend, bend * rate) / jerk
    return _line(chain, fine, away + math.sqrt(away * away + 2.0 * left / jerk), long)


@compiled
def _turning(
    chain: Chain, motion: tuple[float, float], rate: float, bracket: tuple[float, float]
) -> float:
    """Return when (s) the actuator turns, which it does in the bracket.

    motion is that of the free oscillation at 0, rate (m/s) that of the line around which it swings.
    Where the slip turns decides how far the contact is deflected, so this has to be exact.
    """
    (low, high), (a, b) = bracket, motion
    falling = rate + _free(chain, a, b, low)[1] > 0.0
    t = 0.5 * (low + high)
    for _ in range(_MOST_STEPS):
        x, v = _free(chain, a, b, t)
        if (rate + v > 0.0) == falling:
            low = t
        else:
            high = t
        bend = -chain.omega * (chain.omega * x + 2.0 * chain.zeta * v)
        nearer = t - (rate + v) / bend if bend != 0.0 else low
        if not low < nearer < high:
            nearer = 0.5 * (low + high)
        if abs(nearer - t) <= 1e-9 / chain.omega:
            return nearer
        t = nearer
    return t


@compiled
def _free(chain: Chain, a: float, b: float, t: float) -> tuple[float, float]:
    """Return the free oscillation (m) and its rate (m/s) at t (s); at 0 they are a and b."""
    decay = chain.zeta * chain.omega
    omega_d = chain.omega * math.sqrt(1.0 - chain.zeta * chain.zeta)
    fading = math.exp(-decay * t)
    cosine, sine = math.cos(omega_d * t), math.sin(omega_d * t)
    side = (b + decay * a) / omega_d
    x = a * cosine + side * sine
    return fading * x, fading * ((side * cosine - a * sine) * omega_d - decay * x)
