# SPDX-License-Identifier: Apache-2.0
"""Arcs with alpha > 0: Taylor series of high order, their coefficients by recurrence.

The arc is mirrored so that w > 0 (all laws are odd). While w keeps its sign the equations

    z' = w (1 - alpha z / z_lim),   m w' = -sigma_0 z - sigma_1 z' - sigma_2 w + F_ext - k x

are smooth, and every coefficient follows from the lower ones. One step covers what a Runge-Kutta
method needs several for, and the polynomial also gives events and samples within the step.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled
from stickslip_ros.model.friction import ALWAYS_PLASTIC, ELASTOPLASTIC_CALC, Contact

#: Order of the polynomials
ORDER = 10
#: 1 / (n + 1)
_PER_NEXT = 1.0 / np.arange(1.0, ORDER + 2.0)
#: Rows of the workspace (ROWS, ORDER + 1)
Z, W, C, S, Q, P, G, Y, E, D = range(10)
ROWS = 10
#: Width, as a share of z_k, of the band below the speed-dependent z_ss in which an arc keeps its
#: branch: either serves there, and rounding cannot throw it to and fro
BAND = 1e-12


@compiled
def on_side(contact: Contact, mirror: float) -> Contact:
    """Return the contact that `expand` takes for an arc on the side of mirror, +1 or -1.

    Only of alpha as printed the sides differ: its sine is shifted where z < 0.
    """
    sigma_0, sigma_1, sigma_2, z_ba, z_ss, z_k, z_s, v_s, kind, printed = contact
    shifted = 1 if printed != 0 and mirror < 0.0 else 0
    return (sigma_0, sigma_1, sigma_2, z_ba, z_ss, z_k, z_s, v_s, kind, shifted)  # type: ignore[return-value]


@compiled
def expand(
    work: NDArray,
    contact: Contact,
    z: float,
    w: float,
    plastic: bool,
    pull: float,
    mass: float,
    spring: float,
    rate: float,
) -> None:
    """Fill rows Z (m) and W (m/s) of work with the coefficients of z(t), w(t); w >= 0.

    plastic says alpha = 1; pull is F_ext - k x (N) at the start, rate u' (m/s), all mirrored.
    """
    sigma_0, sigma_1, sigma_2, z_ba, z_ss, z_k, z_s, v_s, kind, shifted = contact
    work[Z, 0] = z
    work[W, 0] = w
    calc = kind == ELASTOPLASTIC_CALC and not plastic
    stribeck = z_s != z_k or calc  # alpha then needs row G, constant or not
    per_limit = 1.0 / z_k
    start = -z_ba if shifted else z_ba
    scale = math.pi / (z_ss - z_ba) if not plastic and not calc else 0.0
    per_mass = 1.0 / mass
    x = 0.0
    for n in range(ORDER):
        if stribeck:
            _limit_coefficient(work, n, z_k, z_s, v_s)
        # Q: coefficient n of alpha z
        if plastic:
            q = work[Z, n]
        else:
            if calc:
                _fraction_coefficient(work, n, z_ba, start)
            if n == 0:
                angle = work[D, 0] if calc else scale * (z - start)
                work[D, 0] = angle
                work[C, 0] = math.cos(angle)
                work[S, 0] = math.sin(angle)
            else:
                if not calc:
                    work[D, n] = scale * work[Z, n]
                c = 0.0
                s = 0.0
                for j in range(1, n + 1):
                    d = j * work[D, j]
                    c -= d * work[S, n - j]
                    s += d * work[C, n - j]
                work[C, n] = c * _PER_NEXT[n - 1]
                work[S, n] = s * _PER_NEXT[n - 1]
            # alpha = 1/2 - 1/2 cos: coefficients of 1 - cos, halved at the end
            q = work[Z, n]
            for j in range(n + 1):
                q -= work[C, j] * work[Z, n - j]
            q *= 0.5
        # P: coefficient n of 1 - alpha z / z_lim
        if stribeck:
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
        per_next = _PER_NEXT[n]
        work[Z, n + 1] = z_rate * per_next
        net = -sigma_0 * work[Z, n] - sigma_1 * z_rate - sigma_2 * work[W, n]
        if n == 0:
            net += pull
        elif spring != 0.0:
            x = (work[W, n - 1] + (rate if n == 1 else 0.0)) / n
            net -= spring * x
        work[W, n + 1] = net * per_mass * per_next


@compiled
def _limit_coefficient(work: NDArray, n: int, z_k: float, z_s: float, v_s: float) -> None:
    """Coefficient n of z_lim(w) = z_k + (z_s - z_k) exp(-(w / v_s)^2) into row G."""
    square = 0.0
    for j in range(n + 1):
        square += work[W, j] * work[W, n - j]
    work[Y, n] = -square / (v_s * v_s)
    if n == 0:
        work[E, 0] = math.exp(work[Y, 0])
        work[G, 0] = z_k + (z_s - z_k) * work[E, 0]
    else:
        e = 0.0
        for j in range(1, n + 1):
            e += j * work[Y, j] * work[E, n - j]
        work[E, n] = e / n
        work[G, n] = (z_s - z_k) * work[E, n]


@compiled
def _fraction_coefficient(work: NDArray, n: int, z_ba: float, start: float) -> None:
    """Coefficient n of pi (z - z_ba) / (z_lim - z_ba) into row D, Eq. 8."""
    if n == 0:
        work[D, 0] = math.pi * (work[Z, 0] - start) / (work[G, 0] - z_ba)
        return
    d = math.pi * work[Z, n]
    for j in range(1, n + 1):
        d -= work[G, j] * work[D, n - j]
    work[D, n] = d / (work[G, 0] - z_ba)


@compiled
def step_length(work: NDArray, tolerance: float, memory: float) -> float:
    """Return the step (s) whose truncation stays below tolerance (m); memory (s) weighs w.

    Judged by the last three terms: one or two of them may vanish by chance.
    """
    h = math.inf
    for n in range(ORDER, ORDER - 3, -1):
        size = max(abs(work[Z, n]), memory * abs(work[W, n]))
        if size > 0.0 and (h == math.inf or size * h**n > tolerance):
            h = (tolerance / size) ** (1.0 / n)
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
    value = work[row, ORDER] * _PER_NEXT[ORDER]
    for n in range(ORDER - 1, -1, -1):
        value = value * t + work[row, n] * _PER_NEXT[n]
    return value * t


@compiled
def path(work: NDArray, t: float) -> float:
    """Return the integral of w (m) from 0 to t (s)."""
    return integral(work, W, t)


@compiled
def moment(work: NDArray, t: float) -> float:
    """Return the integral of `path` (m s) from 0 to t (s)."""
    value = work[W, ORDER] / ((ORDER + 1) * (ORDER + 2))
    for n in range(ORDER - 1, -1, -1):
        value = value * t + work[W, n] / ((n + 1) * (n + 2))
    return value * t * t


@compiled
def reaches(work: NDArray, row: int, level: float, h: float) -> float:
    """Return the t between 0 and h (either sign) at which the row's polynomial passes level."""
    near, far = 0.0, h
    e0 = work[row, 0] - level
    e1 = polynomial(work, row, h) - level
    if e1 == 0.0:
        return h
    t = h * min(0.95, max(0.05, e0 / (e0 - e1)))
    for _ in range(80):
        e = polynomial(work, row, t) - level
        if e == 0.0:
            return t
        if (e > 0.0) == (e1 > 0.0):
            far = t
        else:
            near = t
        d = slope(work, row, t)
        step = e / d if d != 0.0 else math.inf
        if not min(near, far) < t - step < max(near, far):
            step = t - 0.5 * (near + far)
        if abs(step) <= 1e-14 * abs(h) or t - step == t:
            return t - step
        t -= step
    return t


@compiled
def series_end(
    work: NDArray, contact: Contact, plastic: bool, tolerance: float, memory: float, limit: float
) -> tuple[float, bool]:
    """Return (h, whether w turned): the step (s) up to its first event, at most limit."""
    _, _, _, _, z_ss, _, _, _, kind, _ = contact
    h = min(step_length(work, tolerance, memory), limit)
    turned = False
    w_end = polynomial(work, W, h)
    if w_end <= 0.0:
        if work[W, 0] > 0.0 or work[W, 1] > 0.0:
            turned = True
            h = _first_zero(work, h)
    elif work[W, 1] < 0.0 and slope(work, W, h) > 0.0:
        lowest = _lowest(work, h)
        if polynomial(work, W, lowest) < 0.0:
            turned = True
            h = _first_zero(work, lowest)
    if kind == ALWAYS_PLASTIC:
        return h, turned
    if kind == ELASTOPLASTIC_CALC:
        return _within_branch(work, contact, plastic, h, turned)
    z_end = polynomial(work, Z, h)
    crossed = z_end < z_ss < work[Z, 0] if plastic else z_end > z_ss > work[Z, 0]
    if crossed:
        return reaches(work, Z, z_ss, h), False
    return h, turned


@compiled
def _first_zero(work: NDArray, h: float) -> float:
    """Return the zero of w in (0, h]; from w = 0 rising, the later one."""
    if work[W, 0] == 0.0:
        # leave the zero at the start: halve until w is positive again
        t = h
        for _ in range(200):
            t *= 0.5
            if polynomial(work, W, t) > 0.0:
                break
        left, right = t, 2.0 * t
        for _ in range(200):
            middle = 0.5 * (left + right)
            if not left < middle < right:
                break
            if polynomial(work, W, middle) > 0.0:
                left = middle
            else:
                right = middle
        return right
    return reaches(work, W, 0.0, h)


@compiled
def _lowest(work: NDArray, h: float) -> float:
    """Return where w has its minimum in (0, h), by bisection of its slope."""
    left, right = 0.0, h
    for _ in range(60):
        middle = 0.5 * (left + right)
        if slope(work, W, middle) < 0.0:
            left = middle
        else:
            right = middle
    return 0.5 * (left + right)


@compiled
def _within_branch(
    work: NDArray, contact: Contact, plastic: bool, h: float, turned: bool
) -> tuple[float, bool]:
    """End the step where |z| passes the speed-dependent z_ss, by bisection (Eq. 8)."""
    _, _, _, _, _, z_k, z_s, v_s, _, _ = contact
    side, edge = (1.0, -2.0 * BAND * z_k) if plastic else (-1.0, 0.0)
    if side * (_excess(work, h, z_k, z_s, v_s) - edge) >= 0.0:
        return h, turned
    left, right = 0.0, h
    for _ in range(200):
        middle = 0.5 * (left + right)
        if not left < middle < right:
            break
        if side * (_excess(work, middle, z_k, z_s, v_s) - edge) >= 0.0:
            left = middle
        else:
            right = middle
    return right, False


@compiled
def _excess(work: NDArray, t: float, z_k: float, z_s: float, v_s: float) -> float:
    ratio = polynomial(work, W, t) / v_s
    return polynomial(work, Z, t) - z_k - (z_s - z_k) * math.exp(-ratio * ratio)
