# SPDX-License-Identifier: Apache-2.0
"""The linear damped oscillator y'' + 2 delta y' + kappa y = 0, exactly, and the root finder.

While alpha = 0 the contact is such an oscillator around a straight line (`spring` makes the line
slope): z(t) = a + b t + y(t). Nothing here is approximate but for rounding.

Each root finder is made for one function, because compiled code with functions as arguments cannot
be cached. Only `passes` uses another method: Halley's, which needs a step less there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from stickslip_ros.base.compiled import compiled, compiled_anew, compiled_inline

#: Bisections, more than a double has digits: the bracket may begin at 0
_HALVINGS = 200
#: Steps of Newton's method; most roots take five
STEPS = 100
#: Fraction of the bracket at which Newton's method stops: rounding of the times in it
CLOSE = 1e-14
#: Fraction of the bracket from which on a first guess lies: at an end the slope may be 0
_INNERMOST = 0.05
#: The same of its other end
_OUTERMOST = 0.95


@compiled
def within(share: float) -> float:
    """Return a fraction of a bracket for a first guess, from one that may be near an end."""
    return min(_OUTERMOST, max(_INNERMOST, share))


def bisection(holds: Callable[[float, Any], bool]) -> Callable[[Any, float, float], float]:
    """Return the compiled function (args, left, right) that finds where a condition ends.

    holds(t, args) is True from left on and becomes False at some t, at right at the latest. The
    result is the first t at which it is False, or right.
    """

    def end(args: Any, left: float, right: float) -> float:
        for _ in range(_HALVINGS):
            middle = 0.5 * (left + right)
            if not left < middle < right:
                break
            if holds(middle, args):
                left = middle
            else:
                right = middle
        return right

    return compiled_anew(end)


def newton(
    value_and_slope: Callable[[float, Any], tuple[float, float]],
) -> Callable[[Any, tuple[float, float], bool, float, float], float]:
    """Return the compiled function (args, bracket, rising, t, close) that finds a root.

    value_and_slope(t, args) gives the function and its derivative; rising says whether it passes
    from below 0 to above within the bracket; t is the first guess. A step that would leave the
    bracket is replaced by a bisection; one shorter than close is the last.
    """

    def root(
        args: Any, bracket: tuple[float, float], rising: bool, t: float, close: float
    ) -> float:
        left, right = bracket
        for _ in range(STEPS):
            value, slope = value_and_slope(t, args)
            if value == 0.0:
                return t
            if (value > 0.0) == rising:
                right = t
            else:
                left = t
            step = value / slope if slope != 0.0 else math.inf
            if not left < t - step < right:
                step = t - 0.5 * (left + right)
            t -= step
            if abs(step) <= close or not left < t < right:
                return t
        return t

    return compiled_inline(root)


# -- the oscillator

#: Two roots closer than this count as one; the error is this number times (delta t)^2 / 6.
_DOUBLE_ROOT = 1e-14
#: sinh(x) / x is summed up as a series for x up to this: a difference of exponentials would cancel
_CANCELS = 0.05
#: Sixty of the slow time constants, 2 delta / kappa at most: an overdamped motion has ended then,
#: for exp(-60) is far below rounding
_ENDED = 120.0
#: A step of Halley's method is the last if it is this fraction of the bracket: what is left goes
#: with the cube of it, and is below rounding
_LAST_STEP = 1e-6
#: And if the slope changes by this fraction over it
_LAST_BEND = 1e-4


class Oscillator(NamedTuple):
    """Constants of one oscillator; build it with `oscillator`."""

    delta: float  #: 1/s
    kappa: float  #: 1/s^2
    omega: float  #: 1/s: angular frequency if it swings, minus the root's half distance if not


class Line(NamedTuple):
    """The straight line a + b t around which it swings."""

    a: float  #: m
    b: float  #: m/s


class Span(NamedTuple):
    """A piece of the time in which z is monotone: times (s) and values (m) at its ends."""

    left: float
    z_left: float
    right: float
    z_right: float


@compiled
def oscillator(delta: float, kappa: float) -> Oscillator:
    """Return the oscillator of delta (1/s) and kappa (1/s^2)."""
    square = kappa - delta * delta
    omega = 0.0
    if not abs(square) <= _DOUBLE_ROOT * kappa:
        omega = math.sqrt(square) if square > 0.0 else -math.sqrt(-square)
    return Oscillator(delta, kappa, omega)


@compiled
def propagate(y: float, w: float, t: float, o: Oscillator) -> tuple[float, float]:
    """Return (y, y') after t (s) from y, w = y' at 0."""
    delta, kappa, omega = o
    if omega > 0.0:
        decay = math.exp(-delta * t)
        c = decay * math.cos(omega * t)
        s = decay * math.sin(omega * t) / omega
    elif omega < 0.0:
        fast = math.exp((omega - delta) * t)
        slow = math.exp(-kappa / (delta - omega) * t)  # delta + omega without cancellation
        if omega * t > -_CANCELS:
            x2 = omega * omega * t * t
            s = math.exp(-delta * t) * t * (1.0 + x2 / 6.0 * (1.0 + x2 / 20.0 * (1.0 + x2 / 42.0)))
        else:
            s = (fast - slow) / (2.0 * omega)
        c = 0.5 * (slow + fast)
    else:
        decay = math.exp(-delta * t)
        c = decay
        s = decay * t
    return c * y + s * (w + delta * y), c * w - s * (kappa * y + delta * w)


@compiled
def half_period(o: Oscillator) -> float:
    """Return the time (s) between two turns, inf where the oscillator does not swing."""
    return math.pi / o.omega if o.omega > 0.0 else math.inf


@compiled
def first_turn(y: float, w: float, o: Oscillator) -> float:
    """Return the first t > 0 (s) at which y' = 0, inf if there is none."""
    delta, kappa, omega = o
    # y'(t) = c w - s load with c, s as in `propagate`
    load = kappa * y + delta * w
    if omega > 0.0:
        if w == 0.0:
            return math.pi / omega
        if w < 0.0:  # mirrored, the same to the last bit
            w, load = -w, -load
        return math.atan2(w * omega, load) / omega
    if w * load <= 0.0:
        return math.inf
    ratio = w / load  # = s / c at the turn
    if omega == 0.0:
        return ratio
    x = -ratio * omega
    return -math.atanh(x) / omega if x < 1.0 else math.inf


@compiled
def overdamped_end(o: Oscillator) -> float:
    """Return when (s) an overdamped motion has ended, to rounding."""
    return _ENDED * o.delta / o.kappa


@compiled
def passes(
    y: float, w: float, o: Oscillator, line: Line, level: float, span: Span
) -> tuple[float, float]:
    """Return (t, z') where a + b t + y(t) = level; z is monotone in the span.

    Halley's method, the bracket as a safeguard; a step that lands on the root stops there.
    """
    left, z_left, right, z_right = span
    rising = z_right > z_left
    width = right - left
    # Between two turns the path is half a cosine, up to its decay.
    swing = (z_left + z_right - 2.0 * level) / (z_right - z_left)
    t = left + width * (0.5 - math.asin(min(1.0, max(-1.0, swing))) / math.pi)
    slope = 0.0
    for _ in range(STEPS):
        yt, wt = propagate(y, w, t, o)
        e = line.a + line.b * t + yt - level
        slope = line.b + wt
        if e == 0.0:
            break
        if (e > 0.0) == rising:
            right = t
        else:
            left = t
        bend = -2.0 * o.delta * wt - o.kappa * yt
        step = e / slope / (1.0 - 0.5 * e * bend / (slope * slope)) if slope != 0.0 else math.inf
        halved = not left < t - step < right
        if halved:
            step = t - 0.5 * (left + right)
        t -= step
        # The error that is left goes with the cube of a step of Halley's, not with one of halving.
        near = abs(step) <= _LAST_STEP * width and abs(step * bend) <= _LAST_BEND * abs(slope)
        if (near and not halved) or not left < t < right:
            slope -= step * bend
            break
    return t, slope


@compiled
def next_turn(y: float, w: float, o: Oscillator, b: float, after: float, limit: float) -> float:
    """Return the first t (s) after ``after`` at which b + y'(t) = 0, inf if none before limit.

    ``after`` is 0 or a turn. Between two zeros of y'', half a period apart, b + y' is monotone and
    has at most one zero.
    """
    delta, kappa, _ = o
    half = half_period(o)
    left = 0.0
    right = first_turn(w, -2.0 * delta * w - kappa * y, o)
    if after > right and half == math.inf:
        left, right = right, math.inf
    elif after > right:
        skipped = math.ceil((after - right) / half)
        left, right = right + (skipped - 1) * half, right + skipped * half
    fresh = after == 0.0  # the piece that holds the turn `after` holds no other
    while True:
        end = min(right, limit)
        if end == math.inf:
            end = left + overdamped_end(o)
        if fresh:
            speed_left = b + propagate(y, w, left, o)[1]
            speed_right = b + propagate(y, w, end, o)[1]
            if speed_left * speed_right < 0.0:
                guess, close = 0.5 * (left + end), CLOSE * (end - left)
                return _turn_root((y, w, o, b), (left, end), speed_right > 0.0, guess, close)
            if speed_right == 0.0:
                return end
        if right >= limit:
            return math.inf
        y1, w1 = propagate(y, w, right, o)
        if kappa * y1 * y1 + w1 * w1 < b * b:
            return math.inf  # the swing has become slower than the line
        fresh = True
        left, right = right, right + half


@compiled_inline
def _speed(t: float, args: tuple[float, float, Oscillator, float]) -> tuple[float, float]:
    """Return b + y' (m/s) and y'' (m/s^2) at t (s)."""
    y, w, o, b = args
    yt, wt = propagate(y, w, t, o)
    return b + wt, -2.0 * o.delta * wt - o.kappa * yt


_turn_root = newton(_speed)
