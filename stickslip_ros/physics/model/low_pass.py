# SPDX-License-Identifier: Apache-2.0
"""The low-pass of a sensor on even samples, exact for the cubics between them.

    first order:   y' = omega (x - y)
    second order:  y'' = omega^2 (x - y) - 2 zeta omega y'

All of it is computed in a fixed order of scalar operations, so the output has the same bits on
every processor with the same mathematical library. The state holds how far the output is from the
present sample: what rests keeps its value to the last bit, however slow the filter is.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.arrays import Array, add_up
from stickslip_ros.base.compiled import compiled
from stickslip_ros.physics.parameters import SensorParameters

Matrix = list[list[float]]
#: Value and derivatives at the start of the cubic between two samples, by rate at its start, rise
#: and rate at its end; time in samples
_HERMITE = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [-4.0, 6.0, -2.0], [6.0, -12.0, 6.0]]
#: Terms of the exponential's series, after the matrix was halved to at most this norm
_TERMS, _NORM = 18, 0.5


class LowPass:
    """The low-pass filter of a sensor on even samples."""

    def __init__(self, p: SensorParameters, dt: float, x: float) -> None:
        """Start settled at x (m); dt is the time (s) between samples."""
        order, damping = p.sensor_order, p.sensor_damping
        omega = 2.0 * math.pi * (p.sensor_bandwidth or 0.0) * dt
        # Taylor coefficients of the input follow the states of the filter.
        taylor = [[0.0] * (order + 4) for _ in range(order + 4)]
        taylor[0][0] = -omega
        if order == 2:
            taylor[0][:2], taylor[1][:2] = [0.0, omega], [-omega, -2.0 * damping * omega]
        taylor[order - 1][order] = omega
        for k in range(order, order + 3):
            taylor[k][k + 1] = 1.0
        end = exponential(taylor)[:order]
        self._coupling = np.array([row[:order] for row in end])
        self._input = np.array(product([row[order:] for row in end], _HERMITE))
        self._dt = dt
        self.settle(x)

    def settle(self, x: float) -> None:
        """Continue as after a long time at x (m)."""
        #: the last sample and its rate a sample; output and rate of the filter less the sample, m
        self._state = np.zeros(2 + len(self._coupling))
        self._state[0] = x

    def filter(self, x: Array, v: Array) -> Array:
        """Return the output (m) at the next samples x (m) with the rates v (m/s), (samples,)."""
        y = np.empty(len(x))
        positions, rates = np.ascontiguousarray(x, float), np.ascontiguousarray(v, float)
        _filter(self._coupling, self._input, self._state, (positions, rates, self._dt), y)
        return y


@compiled
def _filter(
    coupling: NDArray,
    inputs: NDArray,
    state: NDArray,
    samples: tuple[NDArray, NDArray, float],
    y: NDArray,
) -> None:
    """Write the output at samples (m), their rates (m/s) and the time (s) between them into y."""
    (x, v, dt), order = samples, len(coupling)
    after = np.empty(order)
    for k in range(len(x)):
        rise, rate = x[k] - state[0], v[k] * dt
        for i in range(order):
            after[i] = inputs[i, 0] * state[1] + inputs[i, 1] * rise + inputs[i, 2] * rate
            for j in range(order):
                after[i] += coupling[i, j] * state[2 + j]
        after[0] -= rise
        state[0], state[1] = x[k], rate
        state[2:] = after
        y[k] = x[k] + after[0]


def product(a: Matrix, b: Matrix) -> Matrix:
    """Return the matrix product of a (n, m) and b (m, l), summed up in the order of m."""
    columns = list(zip(*b, strict=True))
    return [
        [add_up(x * y for x, y in zip(row, column, strict=True)) for column in columns] for row in a
    ]


def exponential(matrix: Matrix) -> Matrix:
    """Return the exponential of a matrix (n, n), by its series after halving, and squaring."""
    norm, halvings = max(add_up(map(abs, row)) for row in matrix), 0
    while norm > _NORM:
        norm, halvings = 0.5 * norm, halvings + 1
    part = [[0.5**halvings * x for x in row] for row in matrix]
    out = term = [[float(i == j) for j in range(len(matrix))] for i in range(len(matrix))]
    for k in range(1, _TERMS + 1):
        term = [[x / k for x in row] for row in product(term, part)]
        out = [
            [x + y for x, y in zip(one, other, strict=True)]
            for one, other in zip(out, term, strict=True)
        ]
    for _ in range(halvings):
        out = product(out, out)
    return out
