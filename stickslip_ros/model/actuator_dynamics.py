# SPDX-License-Identifier: Apache-2.0
"""The two dynamic stages of the actuator's chain: amplifier and resonance.

Each is solved in closed form between the kinks of what comes in, and handed on as straight lines
again, two for each bend. A bend begins and ends on the curve; the point in its middle lies beside
it, so that both lines together have the mean of the curve. For a curve of even bend the slopes of
both lie within those of the curve, so a bend along which the actuator is faster than the runner
does not turn the contact.

How long a bend may be is the only approximation. It is off by ``error`` at most where the contact
may turn. Elsewhere only what follows counts, the resonance behind the amplifier or the runner
behind the actuator: whatever swings at omega hardly notices an error of no mean that changes
faster.
"""

from __future__ import annotations

import math

from numpy.typing import NDArray

from stickslip_ros.compiled import compiled, compiled_inline
from stickslip_ros.model.actuator_chain import (
    DEFLECTION,
    DRIVEN,
    RATE,
    ROUNDING,
    STILL,
    Chain,
)

#: Shares of the allowed deviation: what the bends of the amplifier may change the resonance behind
#: them by, and what one bend may move the runner by, for a ringing has many
_INPUT, _ONE_OF_MANY = 1e-3, 2e-3
#: A bend of L seconds bends by L^2 / 24 beside the curve; what swings at omega follows such an
#: error to a share of (omega L)^2 / 40
_BESIDE, _FOLLOWED = 24.0, 40.0
#: Share of the deviation where bends are longer than the runner's ringing takes for a radian: their
#: errors may come in its time, and then it adds up some of them
_IN_TIME = 0.1
#: Longest bend of a ringing or fading, in units of its angular frequency or time constant: along
#: it, it bends evenly
_EVEN = 2.0
#: Damping ratio below which bends are finer: errors of turns add up, and there are 1 / zeta of them
_FIRM = 0.15
#: Steps of Newton's method, or bisections, to find where the actuator turns
_MOST_STEPS = 60


@compiled
def _bend_span(
    bend: float, errors: tuple[float, float, float], longest: float, follower: float
) -> float:
    """Return how long (s) a bend may be, of a curve whose second derivative is bend (m/s^2).

    errors (m) are that of the bend, that of one longer than what follows takes for a radian, which
    swings at follower (1/s), and that of what follows; for up to longest (s) the last is all that
    counts.
    """
    if not bend > 0.0:
        return math.inf
    error, of_long, of_follower = errors
    exact = math.sqrt(_BESIDE * error / bend)
    if exact * follower > 1.0:
        exact = max(1.0 / follower, math.sqrt(_BESIDE * of_long / bend))
    unnoticed = math.sqrt(math.sqrt(_FOLLOWED * _BESIDE * of_follower / bend) / follower)
    return max(exact, min(longest, unnoticed))


@compiled_inline
def _errors_of_bends(error: float) -> tuple[float, float, float]:
    """Return the errors (m) for `_bend_span` of bends that the runner follows."""
    return error, _IN_TIME * error, _ONE_OF_MANY * error


@compiled
def _add_bend(nodes: NDArray, count: int, t: float, u: float, area: float, summed: float) -> int:
    """Add a bend to t (s) and u (m); return the count.

    area (m s) is the integral along it of how far the curve is from where the bend begins: measured
    from 0, the rounding of t would show in bends of 1e-15 s. summed (m s) is how large the terms
    are that it is the sum of: a bend within their rounding is one line, as one that is straight.
    """
    begin, way = nodes[0, count - 1], u - nodes[1, count - 1]
    span = t - begin
    if span > 0.0:
        beside = 2.0 * (area / span - 0.5 * way)
        if abs(beside) > STILL + ROUNDING * summed / span:
            nodes[0, count] = begin + 0.5 * span
            nodes[1, count] = nodes[1, count - 1] + 0.5 * way + beside
            count += 1
    nodes[0, count], nodes[1, count] = t, u
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
                nodes[0, count], nodes[1, count] = t_end, y
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
    """Add the bends of c + b (s - lag) - e exp(-s / lag), with output (c, b, e); return the count.

    piece is the time (s) at which s comes to its end, and that end. A bend ends where the curve
    turns.
    """
    (t_end, span), (c, b, e), lag = piece, output, chain.lag
    turn = lag * math.log(-e / (b * lag)) if -e * b > 0.0 and abs(e) > abs(b) * lag else math.inf
    at = 0.0
    while at < span and count < nodes.shape[1] - 4:
        left = e * _fading(at, lag)
        bend = abs(left) / (lag * lag) if left != 0.0 else 0.0
        if chain.omega > 0.0:
            error = _INPUT * chain.error
            h = _bend_span(bend, (error, error, error), 1.0 / chain.omega, chain.omega)
        else:
            faster = (abs(b + left / lag) - chain.mean_only_rate) / bend if bend > 0.0 else 0.0
            errors = _errors_of_bends(chain.error)
            h = _bend_span(bend, errors, min(faster, _EVEN * lag), chain.runner)
        to = at + h if at + h < span else span
        if at < turn < to:
            to = turn
        h = to - at
        gone = left * lag * _faded(h, lag)
        u = c + b * (to - lag) - e * _fading(to, lag)
        t = t_end if to == span else t_end - (span - to)
        summed = (abs(left) + abs(b) * h) * h
        count = _add_bend(nodes, count, t, u, (left + 0.5 * b * h) * h - gone, summed)
        at = to
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
def _faded(t: float, lag: float) -> float:
    """Return 1 - exp(-t / lag), exact for a short t too; 1 without a lag."""
    return -math.expm1(-t / lag) if lag > 0.0 else 1.0


@compiled
def resonate(
    chain: Chain, state: NDArray, nodes: NDArray, count: int, out: NDArray, durations: NDArray
) -> int:
    """Write the deflection of the resonant actuator into out.

    A bend ends where `_ringing_span` says so, where the actuator turns, at kinks of the command.
    """
    u, v = state[DEFLECTION], state[RATE]
    lag, flexible = 2.0 * chain.zeta / chain.omega, 1.0 / (chain.omega * chain.omega)
    out[0, 0], out[1, 0] = nodes[0, 0], u
    written, segment, kink = 1, 0, durations[0]
    # Since the bend began at u = begun: the integral of s - begun. That of u follows from u and u'.
    area, held, begun = 0.0, flexible * v + lag * u, u
    due = math.inf  # when the bend has to end, s
    steepest = 0.0  # rate (m/s) of what came in along the bend: its rounding is in the area
    for k in range(1, count):
        t, s, end = nodes[0, k - 1], nodes[1, k - 1], nodes[0, k]
        span = end - t
        if not span > 0.0:
            continue
        rate = (nodes[1, k] - s) / span
        steepest = max(steepest, abs(rate))
        a, b = u - s + lag * rate, v - rate
        wide = _amplitude(chain, a, b)
        # What comes in may have set off a ringing since the bend was laid out.
        due = min(due, max(t, out[0, written - 1] + _ringing_span(chain, (a, b), v, wide)))
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
            if written >= out.shape[1] - 4:
                return -1
            u, v = s + rate * (h - lag) + free, rate + free_rate
            area += (s - begun + 0.5 * rate * (last + h)) * (h - last) - flexible * v - lag * u
            at = t + h, area + held
            written, held = _end_bend(out, written, at, (u, v, steepest), (lag, flexible))
            area, begun, steepest = 0.0, u, abs(rate)
            fading = math.exp(-chain.zeta * chain.omega * h)
            due = t + h + _ringing_span(chain, (free, free_rate), v, wide * fading)
            last, v_last = h, 0.0 if turns else v  # at a turn its sign is one of rounding
        u, v = nodes[1, k] - lag * rate + free, rate + free_rate
        area += (s - begun + 0.5 * rate * (last + span)) * (span - last)
        if end >= kink or k == count - 1:
            due = math.inf
            if written >= out.shape[1] - 4:
                return -1
            area += held - flexible * v - lag * u
            bend = (u, v, steepest)
            written, held = _end_bend(out, written, (end, area), bend, (lag, flexible))
            area, begun, steepest = 0.0, u, 0.0
            segment += 1
            kink = kink + durations[segment] if segment < len(durations) else math.inf
    state[DEFLECTION], state[RATE] = u, v
    return written


@compiled
def _end_bend(
    nodes: NDArray,
    count: int,
    end: tuple[float, float],
    motion: tuple[float, float, float],
    constants: tuple[float, float],
) -> tuple[int, float]:
    """Add a bend of the actuator that ends; return the count, and what the area of the next lacks.

    end is the time (s) and the area (m s), see `_add_bend`; motion the deflection (m), its rate and
    the largest of the lines around which it swung (m/s); constants those of `resonate`.
    """
    (t, area), (u, v, steepest), (lag, flexible) = end, motion, constants
    summed = flexible * (abs(v) + steepest) + lag * abs(u)
    return _add_bend(nodes, count, t, u, area, summed), flexible * v + lag * u


@compiled
def _amplitude(chain: Chain, a: float, b: float) -> float:
    """Return the amplitude (m) of the free oscillation that begins with a and b."""
    side = (b + chain.zeta * chain.omega * a) / (chain.omega * math.sqrt(1.0 - chain.zeta**2))
    return math.sqrt(a * a + side * side)


@compiled
def _ringing_span(chain: Chain, motion: tuple[float, float], rate: float, wide: float) -> float:
    """Return how long (s) a bend may be.

    It begins with (u, u') of the free oscillation at a rate u' (m/s); wide is the amplitude (m).
    """
    omega = chain.omega
    most = omega * omega * wide  # |u''| at any later time
    if most == 0.0:
        return math.inf
    bend = -omega * (omega * motion[0] + 2.0 * chain.zeta * motion[1])
    jerk = omega * most
    # The bend in the middle decides how far both lines are off.
    half = 0.5 * jerk * math.sqrt(_BESIDE * chain.error / most)
    left, faster = abs(rate) - chain.mean_only_rate, 0.0
    if left > 0.0:
        away = math.copysign(bend, bend * rate) / jerk
        faster = away + math.sqrt(away * away + 2.0 * left / jerk)
    longest = min(faster, _EVEN / omega)
    error = min(1.0, chain.zeta / _FIRM) * chain.error
    errors = _errors_of_bends(error)
    return _bend_span(min(most, abs(bend) + half), errors, longest, chain.runner)


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
