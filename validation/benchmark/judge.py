# SPDX-License-Identifier: Apache-2.0
"""The judge of benchmark and accuracy campaign: every law and load, integrated in its own way.

It shares no code with the kernel. Extrapolated midpoint steps (order 12, Gragg, Bulirsch, Stoer),
much shorter than the ringing, the width of the regimes and that of the Stribeck curve; each regime
is integrated with its own formula, which is smooth beyond its borders, and a step that crosses a
border is cut to end there. The state is (w, z, path, u) with x = path + u.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from stickslip_ros.laws.law import ALWAYS_PLASTIC, ELASTOPLASTIC_CALC
from stickslip_ros.model import DriveCycle, Plant
from validation.benchmark.cases import Problem

#: Substeps of the midpoint rule: 2, 4 .. 2 COLUMNS; the order is 2 COLUMNS.
_COLUMNS = 6
#: Longest step: in units of the ringing; and what w h is at most, in units of the shortest
#: deflection, and w' h in units of v_s.
_STEP, _PATH, _STRIBECK = 0.1, 0.04, 0.1
_ELASTIC, _MIXED, _PLASTIC = 0, 1, 2
#: So many steps in all, some seconds of work, and the judge gives no answer.
_MOST = 200_000
#: So often a step that crosses a border is halved to find the crossing.
_HALVINGS = 60

compiled = numba.njit(error_model="numpy", nogil=True, cache=True)


@compiled  # type: ignore[untyped-decorator, unused-ignore]
def _top(w: float, c: NDArray) -> float:
    """Return z_lim(w)."""
    ratio = w / c[7]
    return c[5] + (c[6] - c[5]) * math.exp(-ratio * ratio)


@compiled  # type: ignore[untyped-decorator, unused-ignore]
def _z_ss(w: float, c: NDArray) -> float:
    return _top(w, c) if c[8] == ELASTOPLASTIC_CALC else c[4]


@compiled  # type: ignore[untyped-decorator, unused-ignore]
def _smooth(y: NDArray, regime: int, side: float, rate: float, c: NDArray) -> NDArray:
    """Return the rates in one regime, continued beyond its borders; side is the sign of w."""
    w, z = y[0], y[1]
    alpha = 0.0
    if regime == _PLASTIC:
        alpha = 1.0
    elif regime == _MIXED:
        start = -c[3] if c[9] != 0.0 and side < 0.0 else c[3]
        alpha = math.sin(0.5 * math.pi * (side * z - start) / (_z_ss(w, c) - c[3])) ** 2
    bend = w - alpha * w * side * z / _top(w, c)
    x = y[2] + y[3]
    force = c[0] * z + c[1] * bend + c[2] * w
    return np.array([(c[11] - c[12] * x - force) / c[10], bend, w, rate])


@compiled  # type: ignore[untyped-decorator, unused-ignore]
def _step(y: NDArray, h: float, regime: int, side: float, rate: float, c: NDArray) -> NDArray:
    """Return the state h later."""
    table = np.empty((_COLUMNS, 4))
    start = _smooth(y, regime, side, rate, c)
    for k in range(_COLUMNS):
        n = 2 * (k + 1)
        part = h / n
        before, now = y.copy(), y + part * start
        for _ in range(1, n):
            before, now = now, before + 2.0 * part * _smooth(now, regime, side, rate, c)
        table[k] = now
        for j in range(k - 1, -1, -1):
            ratio = (k + 1) / (j + 1)
            table[j] = table[j + 1] + (table[j + 1] - table[j]) / (ratio**2 - 1.0)
    return table[0].copy()


@compiled  # type: ignore[untyped-decorator, unused-ignore]
def _border(y: NDArray, which: int, c: NDArray) -> float:
    """Return how far the state is from a border: w = 0, |z| = z_ba, |z| = z_ss."""
    if which == 0:
        return y[0]
    if which == 1:
        return y[1] - c[3]
    if which == 2:
        return y[1] + c[3]
    if which == 3:
        return y[1] - _z_ss(y[0], c)
    return y[1] + _z_ss(y[0], c)


@compiled  # type: ignore[untyped-decorator, unused-ignore]
def _regime(y: NDArray, last: int, rate: float, c: NDArray) -> tuple[int, float]:
    """Return the regime that begins here, after the border ``last``, and the sign of w."""
    w, z = y[0], y[1]
    side = 1.0 if w > 0.0 else -1.0
    if w == 0.0:
        side = 1.0 if _smooth(y, _ELASTIC, 1.0, rate, c)[0] > 0.0 else -1.0
    if c[8] == ALWAYS_PLASTIC:
        return _PLASTIC, side
    if side * z < c[3] or (last == 1 and side < 0.0) or (last == 2 and side > 0.0):
        return _ELASTIC, side
    excess = side * z - _z_ss(w, c)
    if last >= 3:  # on the border: where does it lead?
        after = _step(y, 1e-9 * math.sqrt(c[10] / c[0]), _PLASTIC, side, rate, c)
        excess = side * after[1] - _z_ss(after[0], c) + 1e-30
    return (_PLASTIC if excess >= 0.0 else _MIXED), side


@compiled  # type: ignore[untyped-decorator, unused-ignore]
def _segment(
    y: NDArray, duration: float, rate: float, fine: float, c: NDArray, most: int
) -> tuple[NDArray, int]:
    """Return the state at the end of a segment, and the steps taken; more than most end it.

    Steps are fine times the usual ones.
    """
    quick = math.sqrt(c[10] / (c[0] + c[12]))
    borders = 1 if c[8] == ALWAYS_PLASTIC else 5
    narrow = min(c[5], c[6])
    if c[8] != ALWAYS_PLASTIC:
        narrow = min(narrow, (narrow if c[8] == ELASTOPLASTIC_CALC else c[4]) - c[3])
    left, last, taken = duration, -1, 0
    while left > 0.0:
        taken += 1
        if taken > most:
            break
        regime, side = _regime(y, last, rate, c)
        damped = c[10] / (c[1] + c[2] + 1e-300)
        h = fine * min(_STEP * quick, _STEP * damped)
        if regime != _ELASTIC:
            h = min(h, fine * _PATH * narrow / max(abs(y[0]), 1e-3 * narrow / quick))
            if c[5] != c[6]:
                pull = abs(_smooth(y, regime, side, rate, c)[0])
                h = min(h, fine * _STRIBECK * c[7] / max(pull, 1e-30))
        h, whole = min(h, left), h >= left
        end = _step(y, h, regime, side, rate, c)
        found = -1
        for which in range(borders):
            before = _border(y, which, c)
            if which == last or before * _border(end, which, c) >= 0.0:
                continue
            low, high = 0.0, h  # bisection: slow, and never wrong
            taken += _HALVINGS
            for _ in range(_HALVINGS):
                middle = 0.5 * (low + high)
                trial = _step(y, middle, regime, side, rate, c)
                if before * _border(trial, which, c) > 0.0:
                    low = middle
                else:
                    high = middle
            h, whole, found = high, False, which
            end = _step(y, h, regime, side, rate, c)
        if found == 0:
            end[0] = 0.0
        elif found == 1 or found == 2:
            end[1] = c[3] if found == 1 else -c[3]
        last = found
        left = 0.0 if whole else left - h
        y = end
    return y, taken


@compiled  # type: ignore[untyped-decorator, unused-ignore]
def _cycles(
    y: NDArray, rate: float, drive: NDArray, count: int, fine: float, c: NDArray, most: int
) -> NDArray:
    """Return x (m) at the end of each cycle after a state and a rate (m/s) of the actuator."""
    y = y.copy()
    x = np.full(count, math.nan)
    left = most
    for cycle in range(count):
        for k in range(drive.shape[1]):
            y[0] += rate - drive[1, k]
            rate = drive[1, k]
            y, taken = _segment(y, drive[0, k], rate, fine, c, left)
            left -= taken
            if left < 0:
                return x
        x[cycle] = y[2] + y[3]
    return x


def positions(
    plant: Plant, drive_cycle: DriveCycle, count: int, fine: float = 1.0
) -> NDArray[np.float64]:
    """Return x (m) at the end of each of count cycles from rest, nan where it takes too long.

    fine below 1 shortens the steps, which must not change the answer.
    """
    return _positions(np.zeros(4), 0.0, plant, drive_cycle, count, fine, _MOST)


def displacement(problem: Problem, cycle: int, count: int, fine: float = 1.0) -> float:
    """Return the displacement (m) over count cycles from the start of a measured cycle."""
    start, drive = problem.starts[cycle], problem.drive_cycle
    rate = float(drive.rates[-1])
    y = np.array([start.v - rate, start.z, 0.0, 0.0])
    return float(_positions(y, rate, problem.plant, drive, count, fine, 10**12)[-1])


def _positions(
    y: NDArray[np.float64],
    rate: float,
    plant: Plant,
    drive_cycle: DriveCycle,
    count: int,
    fine: float,
    most: int,
) -> NDArray[np.float64]:
    drive = np.stack([drive_cycle.durations, drive_cycle.rates])
    numbers = np.array([*plant.contact, plant.mass, plant.force, plant.spring])
    found: NDArray[np.float64] = _cycles(y, rate, drive, count, fine, numbers, most)
    return found
