# SPDX-License-Identifier: Apache-2.0
"""Arcs with alpha > 0: Taylor series of high order, their coefficients by recurrence.

The arc is mirrored so that w > 0. While w keeps its sign the equations

    z' = w (1 - alpha z / z_lim),   m w' = -sigma_0 z - sigma_1 z' - sigma_2 w + F_ext - k x

are smooth, and every coefficient follows from the lower ones. One step is as long as several steps
of a Runge-Kutta method, and the polynomial also gives events and samples within the step.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.compiled import compiled, compiled_inline
from stickslip_ros.physics.laws.law import ALWAYS_PLASTIC
from stickslip_ros.physics.model.friction import alpha_at
from stickslip_ros.physics.solver.layout import FREE, ORDER, TURN
from stickslip_ros.physics.solver.oscillator import CLOSE, bisection, newton, within

#: 1 / (n + 1): turns coefficient n of a derivative into coefficient n + 1 of the function
PER_NEXT = 1.0 / np.arange(1.0, ORDER + 2.0)
#: Rows of the workspace (ROWS, ORDER + 1). The series of one of several contacts has the first
#: four: z, cosine and sine of alpha, and z'/w.
Z, C, S, P, W, Q, G, Y, E, D = range(10)
#: Width, as a fraction of z_k, of the band below the speed-dependent z_ss in which an arc keeps its
#: branch: either serves there, and rounding cannot throw it back and forth
BAND = 1e-12
#: The exponent of the Stribeck curve changes by so much at most within a step. Far out on its
#: flank the curve is flat, and no coefficient there knows of the rise to come; and beyond pi lie
#: the zeros of z_lim in the complex plane, where the series would end.
_EXPONENT = 2.0
#: Factor by which such a step is shortened at once, at most
_SHORTENED = 0.1
#: The same, at least
_LEAST_SHORTENED = 0.9
#: Halvings of a step in search of w above its floor, as many as bisection makes
_HALVINGS = 200

#: z leaves its limit when its rate differs from that of the limit by more than this fraction of w
_MARGIN = 1e-9


class Branch(NamedTuple):
    """One smooth branch of a plant's equations on the way of one arc, mirrored."""

    z_ss: float  #: steady-state deflection of alpha in force, m
    plastic: bool  #: alpha = 1
    calc: bool  #: z_ss follows z_lim(w)
    stribeck: bool  #: z_lim follows w
    along: bool  #: z follows z_lim(w) itself
    sine_start: float  #: z at which the sine of alpha begins, m
    mass: float  #: kg
    pull: float  #: F_ext - k x at the start, N
    spring: float  #: N/m
    rate: float  #: u', m/s


@compiled
def expand(work: NDArray, plant: np.record, branch: Branch, z: float, w: float) -> None:
    """Fill rows Z (m) and W (m/s) of work with the coefficients of z(t), w(t); w >= 0."""
    sigma_0, sigma_1, sigma_2 = plant.sigma_0, plant.sigma_1, plant.sigma_2
    spring, rate = branch.spring, branch.rate
    work[Z, 0] = z
    work[W, 0] = w
    graded = not branch.plastic and not branch.calc
    scale = math.pi / (branch.z_ss - plant.z_ba) if graded else 0.0
    per_limit = 1.0 / plant.z_k
    per_mass = 1.0 / branch.mass
    for n in range(ORDER):
        if branch.stribeck:
            _limit_coefficient(work, n, plant)
        if branch.plastic:
            q = work[Z, n]
        else:
            if branch.calc and n == 0:  # of pi (z - z_ba) / (z_lim - z_ba), Eq. 8
                work[D, 0] = math.pi * (z - branch.sine_start) / (work[G, 0] - plant.z_ba)
            elif branch.calc:
                d = math.pi * work[Z, n]
                for j in range(1, n + 1):
                    d -= work[G, j] * work[D, n - j]
                work[D, n] = d / (work[G, 0] - plant.z_ba)
            else:
                work[D, n] = scale * (z - branch.sine_start if n == 0 else work[Z, n])
            q = loading_coefficient(work, D, work[D, 0], 1.0, n)
        # P: coefficient n of 1 - alpha z / z_lim
        if branch.stribeck:
            for j in range(1, n + 1):
                q -= work[G, j] * work[Q, n - j]
            q /= work[G, 0]
            work[Q, n] = q
            work[P, n] = -q
        else:
            work[P, n] = -q * per_limit
        if n == 0:
            work[P, 0] += 1.0
        z_rate = 0.0
        for j in range(n + 1):
            z_rate += work[W, j] * work[P, n - j]
        per_next = PER_NEXT[n]
        work[Z, n + 1] = z_rate * per_next
        net = -sigma_0 * work[Z, n] - sigma_1 * z_rate - sigma_2 * work[W, n]
        if n == 0:
            net += branch.pull
        elif spring != 0.0:
            x = (work[W, n - 1] + (rate if n == 1 else 0.0)) / n
            net -= spring * x
        work[W, n + 1] = net * per_mass * per_next


@compiled
def loading_coefficient(work: NDArray, row: int, start: float, scale: float, n: int) -> float:
    """Return coefficient n of alpha z, from alpha = (1 - cos angle) / 2; it fills rows C and S.

    The angle begins at start; its further coefficients are scale times those of the row.
    """
    if n == 0:
        work[C, 0], work[S, 0] = math.cos(start), math.sin(start)
    else:
        cosine = sine = 0.0
        for j in range(1, n + 1):
            d = j * work[row, j]
            cosine -= d * work[S, n - j]
            sine += d * work[C, n - j]
        scale *= PER_NEXT[n - 1]
        work[C, n], work[S, n] = scale * cosine, scale * sine
    q = work[Z, n]
    for j in range(n + 1):
        q -= work[C, j] * work[Z, n - j]
    return 0.5 * q


@compiled
def expand_along(work: NDArray, plant: np.record, branch: Branch, w: float) -> None:
    """Fill rows Z (m) and W (m/s) of work where z = z_lim(w): (m + sigma_1 z_lim'(w)) w' = net."""
    sigma_1 = plant.sigma_1
    per_square = -2.0 * (plant.z_s - plant.z_k) / (plant.v_s * plant.v_s)
    work[W, 0] = w
    for n in range(ORDER + 1):
        _limit_coefficient(work, n, plant)
        work[Z, n] = work[G, n]
        if n == ORDER:
            break
        slope = 0.0
        for j in range(n + 1):
            slope += work[E, j] * work[W, n - j]
        work[P, n] = per_square * slope
        net = -plant.sigma_0 * work[Z, n] - plant.sigma_2 * work[W, n]
        for j in range(1, n + 1):
            net -= sigma_1 * work[P, j] * (n - j + 1) * work[W, n - j + 1]
        if n == 0:
            net += branch.pull
        else:
            net -= branch.spring * (work[W, n - 1] + (branch.rate if n == 1 else 0.0)) / n
        work[W, n + 1] = net / (branch.mass + sigma_1 * work[P, 0]) * PER_NEXT[n]


@compiled
def limit_and_slope(w: float, plant: np.record) -> tuple[float, float]:
    """Return z_lim (m) at w (m/s), and its derivative (s)."""
    ratio = w / plant.v_s
    height = (plant.z_s - plant.z_k) * math.exp(-ratio * ratio)
    return plant.z_k + height, -2.0 * ratio / plant.v_s * height


@compiled
def alpha_deficit(z: float, z_ba: float, sine_start: float) -> float:
    """Return 1 - alpha just below a z_ss of z (m)."""
    return 1.0 - alpha_at(math.pi * (z - sine_start) / (z - z_ba))[0]


@compiled
def _limit_coefficient(work: NDArray, n: int, plant: np.record) -> None:
    """Coefficient n of z_lim(w) = z_k + (z_s - z_k) exp(-(w / v_s)^2) into row G."""
    square = 0.0
    for j in range(n + 1):
        square += (work[W, j] / plant.v_s) * (work[W, n - j] / plant.v_s)
    work[Y, n] = -square
    if n == 0:
        work[E, 0] = math.exp(work[Y, 0])
        work[G, 0] = plant.z_k + (plant.z_s - plant.z_k) * work[E, 0]
    else:
        e = 0.0
        for j in range(1, n + 1):
            e += j * work[Y, j] * work[E, n - j]
        work[E, n] = e / n
        work[G, n] = (plant.z_s - plant.z_k) * work[E, n]


@compiled
def step_length(work: NDArray, tolerance: float, inv_omega: float, stribeck: bool) -> float:
    """Return the step (s) whose truncation stays below tolerance (m); inv_omega (s) weighs w.

    Judged by the last three terms: one or two of them may vanish by chance.
    """
    h = math.inf
    for n in range(ORDER, ORDER - 3, -1):
        size = max(abs(work[Z, n]), inv_omega * abs(work[W, n]))
        if size > 0.0 and (h == math.inf or size * h**n > tolerance):
            h = (tolerance / size) ** (1.0 / n)
    if stribeck:
        while True:
            change = 0.0
            for n in range(ORDER - 1, 0, -1):
                change = (change + abs(work[Y, n])) * h
            if not change > _EXPONENT:
                break
            h *= min(_LEAST_SHORTENED, max(_SHORTENED, math.sqrt(_EXPONENT / change)))
    return h


@compiled
def polynomial(work: NDArray, row: int, t: float) -> float:
    """Return the polynomial of a row at t (s)."""
    value = work[row, ORDER]
    for n in range(ORDER - 1, -1, -1):
        value = value * t + work[row, n]
    return value


@compiled
def slope(work: NDArray, row: int, t: float) -> float:
    """Return the derivative of the polynomial of a row at t (s)."""
    value = ORDER * work[row, ORDER]
    for n in range(ORDER - 1, 0, -1):
        value = value * t + n * work[row, n]
    return value


@compiled
def integral(work: NDArray, row: int, t: float) -> float:
    """Return the integral of the polynomial of a row from 0 to t (s)."""
    value = work[row, ORDER] * PER_NEXT[ORDER]
    for n in range(ORDER - 1, -1, -1):
        value = value * t + work[row, n] * PER_NEXT[n]
    return value * t


@compiled
def moment(work: NDArray, t: float) -> float:
    """Return the integral (m s) of the path, which is that of w, from 0 to t (s)."""
    value = work[W, ORDER] / ((ORDER + 1) * (ORDER + 2))
    for n in range(ORDER - 1, -1, -1):
        value = value * t + work[W, n] / ((n + 1) * (n + 2))
    return value * t * t


@compiled
def time_at_level(work: NDArray, row: int, level: float, h: float) -> float:
    """Return the t between 0 and h (either sign) at which the row's polynomial passes level."""
    e0 = work[row, 0] - level
    e1 = polynomial(work, row, h) - level
    if e1 == 0.0:
        return h
    t = h * within(e0 / (e0 - e1))
    rising = (e1 > 0.0) == (h > 0.0)
    span = (min(0.0, h), max(0.0, h))
    return _level_root((work, row, level), span, rising, t, CLOSE * abs(h))


@compiled_inline
def _above_level(t: float, args: tuple[NDArray, int, float]) -> tuple[float, float]:
    """Return how far the polynomial of a row is above a level at t (s), and its derivative."""
    work, row, level = args
    return polynomial(work, row, t) - level, slope(work, row, t)


_level_root = newton(_above_level)


class TaylorEnd(NamedTuple):
    """Where a step of the series ends."""

    t: float  #: s
    event: int  #: TURN: w = 0 is exact there, else FREE
    z: float  #: z (m) that is exact there, nan if none is


@compiled
def turn_end(work: NDArray, h: float, floor: float) -> tuple[float, int]:
    """Return where a step of length h (s) ends as w comes down to floor (m/s): TURN, else FREE."""
    event = FREE
    w_end = polynomial(work, W, h)
    if w_end <= floor:
        if work[W, 0] > floor or work[W, 1] > 0.0:
            event = TURN
            h = _first_at(work, floor, h)
    elif work[W, 1] < 0.0 and slope(work, W, h) > 0.0:
        lowest = _end_of_fall(work, 0.0, h)
        if polynomial(work, W, lowest) < floor:
            event = TURN
            h = _first_at(work, floor, lowest)
    return h, event


@compiled
def taylor_end(work: NDArray, plant: np.record, branch: Branch, h: float) -> TaylorEnd:
    """Return where a step of length h (s) has its first event."""
    floor = 0.0 if branch.stribeck else plant.v_edge
    h, event = turn_end(work, h, floor)
    if floor > 0.0:
        event = FREE
    if plant.kind == ALWAYS_PLASTIC:
        return TaylorEnd(h, event, math.nan)
    if branch.calc:
        if _holds(h, (work, plant, branch)):
            return TaylorEnd(h, event, math.nan)
        return TaylorEnd(_end_of_branch((work, plant, branch), 0.0, h), FREE, math.nan)
    z_end, z_ss = polynomial(work, Z, h), branch.z_ss
    crossed = z_end < z_ss < work[Z, 0] if branch.plastic else z_end > z_ss > work[Z, 0]
    if crossed:
        return TaylorEnd(time_at_level(work, Z, z_ss, h), FREE, z_ss)
    z_ba = plant.z_ba
    if branch.sine_start < 0.0 and z_end < z_ba < work[Z, 0]:  # down to the other jump
        return TaylorEnd(time_at_level(work, Z, z_ba, h), FREE, z_ba)
    return TaylorEnd(h, event, math.nan)


@compiled
def _first_at(work: NDArray, floor: float, h: float) -> float:
    """Return where w is at the floor in (0, h]; from there on rising, the later one."""
    if work[W, 0] == floor:
        # leave the start: halve until w is above it again
        t = h
        for _ in range(_HALVINGS):
            t *= 0.5
            if polynomial(work, W, t) > floor:
                break
        return _end_above((work, W, floor), t, 2.0 * t)
    return time_at_level(work, W, floor, h)


@compiled
def _is_above(t: float, args: tuple[NDArray, int, float]) -> bool:
    work, row, level = args
    return polynomial(work, row, t) > level


_end_above = bisection(_is_above)


@compiled
def _falls(t: float, work: NDArray) -> bool:
    return slope(work, W, t) < 0.0


_end_of_fall = bisection(_falls)


@compiled
def _holds(t: float, args: tuple[NDArray, np.record, Branch]) -> bool:
    """Return whether a branch with a speed-dependent z_ss (Eq. 8) still holds at t (s).

    z is on the side of z_ss that the branch is for. Along z_lim(w) it neither falls, nor rises
    faster than it can.
    """
    work, plant, branch = args
    w, z = polynomial(work, W, t), polynomial(work, Z, t)
    if not branch.along:
        ratio = w / plant.v_s
        excess = z - plant.z_k - (plant.z_s - plant.z_k) * math.exp(-ratio * ratio)
        return excess >= -2.0 * BAND * plant.z_k if branch.plastic else excess <= 0.0
    rising, margin = slope(work, Z, t), _MARGIN * abs(w)
    gained = w * alpha_deficit(z, plant.z_ba, branch.sine_start)
    damped = plant.sigma_1 * limit_and_slope(w, plant)[1]
    return -margin <= rising <= gained + margin and branch.mass + damped > 0.0


_end_of_branch = bisection(_holds)
