# SPDX-License-Identifier: Apache-2.0
"""The two dynamic stages of the actuator's chain: amplifier and resonance.

Each is solved in closed form over the pieces of what comes in, and handed on as parabolas, whose
ends lie on the curve and whose mean is that of the curve. What is left beside the curve goes with
the cube of a piece's length, and has no mean.

How long a piece may be is the only approximation. It is off by ``error`` at most where the contact
may turn. Elsewhere only what follows counts, the resonance behind the amplifier or the runner
behind the actuator: whatever swings at omega hardly notices an error of no mean that changes
faster.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.compiled import compiled
from stickslip_ros.physics.model.actuator_chain import (
    DEFLECTION,
    DRIVEN,
    RATE,
    ROUNDING,
    STILL,
    Chain,
)

#: Fractions of the allowed deviation: what the pieces of the amplifier may change the resonance
#: behind them by, and what one piece may move the runner by, for a ringing has many
_INPUT, _ONE_OF_MANY = 0.1, 2e-3
#: A piece of L seconds is u''' L^3 / 125 beside the curve; what swings at omega follows such an
#: error to a fraction of (omega L)^2 / 40
_BESIDE, _FOLLOWED = 125.0, 40.0
#: Fraction of the deviation where pieces are longer than the runner's ringing takes for a radian:
#: their errors may come in its time, and then it adds up some of them
IN_TIME = 0.1
#: Longest piece where the actuator is faster than the runner, in units of its angular frequency or
#: time constant: along it, it bends evenly
_EVEN = 2.0


@compiled
def _piece_span(
    jerk: float, errors: tuple[float, float, float], longest: float, follower: float
) -> float:
    """Return how long (s) a piece may be, of a curve whose third derivative is jerk (m/s^3).

    errors (m) are that of the piece, that of one longer than what follows takes for a radian, which
    swings at follower (1/s), and that of what follows; for up to longest (s) the last is all that
    counts.
    """
    if not jerk > 0.0:
        return math.inf
    error, of_long, of_follower = errors
    exact = np.cbrt(_BESIDE * error / jerk)
    if exact * follower > 1.0:
        exact = max(1.0 / follower, np.cbrt(_BESIDE * of_long / jerk))
    if not longest > exact:
        return exact
    unnoticed = (_FOLLOWED * _BESIDE * of_follower / (jerk * follower * follower)) ** 0.2
    return max(exact, min(longest, unnoticed))


@compiled
def _add_piece(nodes: NDArray, count: int, t: float, u: float, area: float, summed: float) -> int:
    """Add a piece to t (s) and u (m); return the count.

    area (m s) is the integral along it of how far the curve is from where the piece begins:
    measured from 0, the rounding of t would show in pieces of 1e-15 s. summed (m s) is how large
    the terms are that it is the sum of: a piece within their rounding is straight.
    """
    span, rise, bend = t - nodes[0, count - 1], u - nodes[1, count - 1], 0.0
    if span > 0.0:
        beside = area / span - 0.5 * rise
        if abs(beside) > STILL + ROUNDING * summed / span:
            bend = -12.0 * beside / (span * span)
    nodes[0, count], nodes[1, count], nodes[2, count] = t, u, bend
    return count + 1


@compiled
def amplify(
    chain: Chain, state: NDArray, durations: NDArray, rates: NDArray, nodes: NDArray
) -> int:
    """Replace the command in nodes by the output of the amplifier."""
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
                nodes[0, count], nodes[1, count], nodes[2, count] = t_end, y, 0.0
                count += 1
                if count > capacity:
                    return -1
            else:
                output = (c, b, (c - y) - b * chain.lag)
                count = _relax(chain, (t_end, h), output, nodes, count)
                if count > capacity:
                    return -1
                y = nodes[1, count - 1]
            c += b * h
        start = end
    state[DRIVEN] = y
    return count


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
    # What the command moves in the least part of the time that can be told from none counts, too.
    near = 1e-9 * edge + ROUNDING * max(abs(c), abs(y), abs(b) * left)
    side = math.copysign(1.0, e if abs(e) > near else b)
    if abs(e) > edge + near or (abs(e) >= edge - near and side * b > slew):
        closing = slew - side * b
        catching_up = (abs(e) - edge) / closing if closing > 0.0 else math.inf
        return min(left, max(catching_up, 0.0)), side * slew
    if abs(b) > slew:
        target = math.copysign(edge, b)
        return min(left, lag * math.log1p((e - target) / (target - b * lag))), 0.0
    return left, 0.0


@compiled
def _relax(
    chain: Chain,
    piece: tuple[float, float],
    output: tuple[float, float, float],
    nodes: NDArray,
    count: int,
) -> int:
    """Add the pieces of c + b (s - lag) - e exp(-s / lag), output (c, b, e); return the count.

    piece is the time (s) at which s comes to its end, and that end. A piece ends where the curve
    turns.
    """
    (t_end, span), (c, b, e), lag = piece, output, chain.lag
    turn = lag * math.log(-e / (b * lag)) if -e * b > 0.0 and abs(e) > abs(b) * lag else math.inf
    at = 0.0
    while at < span and count < nodes.shape[1] - 4:
        left = e * _decay(at, lag)
        jerk = abs(left) / (lag * lag * lag) if left != 0.0 else 0.0
        if chain.omega > 0.0:
            error = _INPUT * chain.error
            h = _piece_span(jerk, (error, error, error), 1.0 / chain.omega, chain.omega)
        else:
            faster = (
                (abs(b + left / lag) - chain.mean_only_rate) / jerk / lag if jerk > 0.0 else 0.0
            )
            error = chain.error
            errors = error, IN_TIME * error, _ONE_OF_MANY * error
            h = _piece_span(jerk, errors, min(faster, _EVEN * lag), chain.runner)
        to = at + h if at + h < span else span
        if at < turn < to:
            to = turn
        h = to - at
        gone = -left * lag * math.expm1(-h / lag) if lag > 0.0 else 0.0
        u = c + b * (to - lag) - e * _decay(to, lag)
        t = t_end if to == span else t_end - (span - to)
        summed = (abs(left) + abs(b) * h) * h
        count = _add_piece(nodes, count, t, u, (left + 0.5 * b * h) * h - gone, summed)
        at = to
    return count


@compiled
def _decay(t: float, lag: float) -> float:
    """Return exp(-t / lag), 0 without a lag."""
    if not lag > 0.0:
        return 0.0
    x = t / lag
    if x < 1e-4:  # a series is as exact, and quicker
        return 1.0 - x * (1.0 - 0.5 * x * (1.0 - x / 3.0 * (1.0 - 0.25 * x)))
    return math.exp(-x)


@compiled
def resonate(chain: Chain, state: NDArray, nodes: NDArray, count: int, out: NDArray) -> int:
    """Write the deflection of the resonant actuator into out; a piece ends with that of nodes."""
    u, v = state[DEFLECTION], state[RATE]
    lag, flexible = 2.0 * chain.zeta / chain.omega, 1.0 / (chain.omega * chain.omega)
    # of the free oscillation
    decay, omega = chain.zeta * chain.omega, chain.omega * math.sqrt(1.0 - chain.zeta * chain.zeta)
    out[0, 0], out[1, 0], written = nodes[0, 0], u, 1
    for k in range(1, count):
        t, s, bend = nodes[0, k - 1], nodes[1, k - 1], nodes[2, k]
        span = nodes[0, k] - t
        if not span > 0.0:
            continue
        rate = (nodes[1, k] - s) / span - 0.5 * bend * span
        # It swings around a parabola as bent as that of s.
        drift = rate - lag * bend
        level = s - lag * drift - flexible * bend
        a, b = u - level, v - drift
        side = (b + decay * a) / omega
        at, free, free_rate = 0.0, a, b
        while at < span:
            if written >= out.shape[1] - 4:
                return -1
            to = at + _ringing_span(chain, free, free_rate, v)
            to = to if to < span else span
            fading, cosine, sine = math.exp(-decay * to), math.cos(omega * to), math.sin(omega * to)
            x = a * cosine + side * sine
            free, free_rate = fading * x, fading * ((side * cosine - a * sine) * omega - decay * x)
            u_end = level + (drift + 0.5 * bend * to) * to + free
            v_end, h = drift + bend * to + free_rate, to - at
            # The integral of s - u along the piece, and that of u - s from the equation of motion
            area = (s - u + 0.5 * rate * (at + to) + bend / 6.0 * (at * at + at * to + to * to)) * h
            area -= flexible * (v_end - v) + lag * (u_end - u)
            summed = flexible * (abs(v_end) + abs(v) + abs(rate)) + lag * abs(u)
            end = nodes[0, k] if to == span else t + to
            written = _add_piece(out, written, end, u_end, area, summed)
            at, u, v = to, u_end, v_end
    state[DEFLECTION], state[RATE] = u, v
    return written


@compiled
def _ringing_span(chain: Chain, u: float, v: float, rate: float) -> float:
    """Return how long (s) a piece may be that begins with (u, v) of the free oscillation.

    rate (m/s) is that of the actuator.
    """
    omega = chain.omega
    side = (v + chain.zeta * omega * u) / (omega * math.sqrt(1.0 - chain.zeta**2))
    most = omega * omega * math.sqrt(u * u + side * side)  # |u''| at any later time
    if most == 0.0:
        return math.inf
    error = chain.error
    bend = -omega * (omega * u + 2.0 * chain.zeta * v)
    jerk, steepest = abs(omega * (omega * v + 2.0 * chain.zeta * bend)), omega * most
    # The jerk in the middle decides how far a piece is off.
    half = 0.5 * omega * steepest * np.cbrt(_BESIDE * error / steepest)
    left, faster = abs(rate) - chain.mean_only_rate, 0.0
    if left > 0.0:
        away = math.copysign(bend, bend * rate) / steepest
        faster = away + math.sqrt(away * away + 2.0 * left / steepest)
    errors = error, IN_TIME * error, _ONE_OF_MANY * error
    return _piece_span(min(steepest, jerk + half), errors, min(faster, _EVEN / omega), chain.runner)
