# SPDX-License-Identifier: Apache-2.0
"""The judge: a slow integration of its own kind, exact to rounding.

It shares no code with the kernel and none with a peer. Extrapolated midpoint steps (order 12,
Gragg, Bulirsch, Stoer) much shorter than the ringing and than the width of the regimes; each
regime is integrated with its own formula, which is smooth beyond its borders, and a step that
crosses a border is cut to end there. w = 0 is a border too, so that no peak of z lies inside a
step and none that grazes z_ba is missed.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model import DriveCycle, Plant
from stickslip_ros.solver import State
from validation.benchmark.cases import Constants, Problem, Scaled

#: Substeps of the midpoint rule: 2, 4 .. 2 COLUMNS; the order is 2 COLUMNS.
_COLUMNS = 6
#: Longest step, and longest path w h where the contact slides, both scaled.
_STEP, _PATH = 0.05, 0.02
_ELASTIC, _MIXED, _PLASTIC = 0, 1, 2

compiled = numba.njit(error_model="numpy", nogil=True, cache=True)


@compiled  # type: ignore[untyped-decorator, unused-ignore]
def _smooth(
    w: float, z: float, regime: int, side: float, constants: Constants
) -> tuple[float, float, float]:
    """Return (w', z', r') of one regime, continued beyond its borders; side is the sign of z."""
    damping, viscous, pull, z_ss, z_lim = constants
    alpha = 0.0
    if regime == _PLASTIC:
        alpha = 1.0
    elif regime == _MIXED:
        alpha = math.sin(0.5 * math.pi * (side * z - 1.0) / (z_ss - 1.0)) ** 2
    slide = alpha * w * side * z / z_lim
    bend = w - slide
    return pull - z - damping * bend - viscous * w, bend, slide


@compiled  # type: ignore[untyped-decorator, unused-ignore]
def _step(
    y: NDArray, h: float, regime: int, side: float, constants: Constants, table: NDArray
) -> NDArray:
    """Return the state h later; table (COLUMNS, 3) is scratch."""
    f0, f1, f2 = _smooth(y[0], y[1], regime, side, constants)
    for k in range(_COLUMNS):
        n = 2 * (k + 1)
        part = h / n
        a0, a1, a2 = y[0], y[1], y[2]
        b0, b1, b2 = a0 + part * f0, a1 + part * f1, a2 + part * f2
        for _ in range(1, n):
            g0, g1, g2 = _smooth(b0, b1, regime, side, constants)
            a0, b0 = b0, a0 + 2.0 * part * g0
            a1, b1 = b1, a1 + 2.0 * part * g1
            a2, b2 = b2, a2 + 2.0 * part * g2
        table[k, 0], table[k, 1], table[k, 2] = b0, b1, b2
        for j in range(k - 1, -1, -1):
            ratio = (k + 1) / (j + 1)
            for i in range(3):
                table[j, i] = table[j + 1, i] + (table[j + 1, i] - table[j, i]) / (ratio**2 - 1.0)
    return table[0].copy()


@compiled  # type: ignore[untyped-decorator, unused-ignore]
def _border(y: NDArray, which: int, z_ss: float) -> float:
    """Return how far the state is from a border: w = 0, |z| = z_ba, |z| = z_ss."""
    if which == 0:
        return y[0]
    if which == 1:
        return y[1] - 1.0
    if which == 2:
        return y[1] + 1.0
    if which == 3:
        return y[1] - z_ss
    return y[1] + z_ss


@compiled  # type: ignore[untyped-decorator, unused-ignore]
def _regime(y: NDArray, constants: Constants) -> tuple[int, float]:
    """Return the regime that begins here, on a border the one that is entered, and the side."""
    z_ss = constants[3]
    w, z = y[0], y[1]
    side = 1.0 if z > 0.0 else -1.0
    outward = side * w
    if w == 0.0:
        outward = side * _smooth(w, z, _ELASTIC, side, constants)[0]
    if not (outward > 0.0 and side * z >= 1.0):
        return _ELASTIC, side
    if side * z < z_ss:
        return _MIXED, side
    if side * z == z_ss and side * _smooth(w, z, _PLASTIC, side, constants)[1] < 0.0:
        return _MIXED, side
    return _PLASTIC, side


@compiled  # type: ignore[untyped-decorator, unused-ignore]
def _segment(y: NDArray, duration: float, fine: float, constants: Constants) -> NDArray:
    """Return the state at the end of a segment; steps are fine times the usual ones."""
    z_ss = constants[3]
    table = np.empty((_COLUMNS, 3))
    left = duration
    while left > 0.0:
        regime, side = _regime(y, constants)
        h = fine * _STEP
        if regime != _ELASTIC:
            h = min(h, fine * _PATH / max(abs(y[0]), 1e-3))
        last = h >= left
        h = min(h, left)
        end = _step(y, h, regime, side, constants, table)
        for which in range(5):
            before = _border(y, which, z_ss)
            if before * _border(end, which, z_ss) >= 0.0:
                continue
            low, high = 0.0, h  # bisection: slow, and never wrong
            for _ in range(60):
                middle = 0.5 * (low + high)
                trial = _step(y, middle, regime, side, constants, table)
                if before * _border(trial, which, z_ss) > 0.0:
                    low = middle
                else:
                    high = middle
            h, last = high, False
            end = _step(y, h, regime, side, constants, table)
            if which == 0:
                end[0] = 0.0
            else:
                end[1] = (1.0, -1.0, z_ss, -z_ss)[which - 1]
        left = 0.0 if last else left - h
        y = end
    return y


@compiled  # type: ignore[untyped-decorator, unused-ignore]
def _cycles(
    y: NDArray,
    durations: NDArray,
    jumps: NDArray,
    count: int,
    fine: float,
    constants: Constants,
) -> NDArray:
    y = y.copy()
    for _ in range(count):
        for k in range(len(durations)):
            y[0] += jumps[k]
            y = _segment(y, durations[k], fine, constants)
    return y


def displacement(problem: Problem, cycle: int, count: int, fine: float = 1.0) -> float:
    """Return the displacement (m) over count cycles from the start of a measured cycle.

    fine below 1 shortens the steps, which must not change the answer.
    """
    scaled = problem.scaled
    start = scaled.start(problem.starts[cycle])
    end = _cycles(start, scaled.durations, scaled.jumps, count, fine, scaled.constants)
    return scaled.displacement(start, end)


def displacement_from_rest(plant: Plant, drive_cycle: DriveCycle, count: int) -> float:
    """Return the displacement (m) over count cycles from rest."""
    scaled = Scaled.of(plant, drive_cycle)
    start = scaled.start(State(t=0.0, x=0.0, v=0.0, z=0.0, u=0.0, rate=0.0, force=0.0))
    end = _cycles(start, scaled.durations, scaled.jumps, count, 1.0, scaled.constants)
    return scaled.displacement(start, end)
