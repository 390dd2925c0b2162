# SPDX-License-Identifier: Apache-2.0
"""The equations once more, written down apart from the package and left to a general integrator.

Restarted at every kink of u(t); within a straight piece SciPy's DOP853 takes steps so short that
the switches of alpha cost less than the accuracy asked for.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from stickslip_ros.model import Contact, Pattern, Plant
from stickslip_ros.model.friction import ALWAYS_PLASTIC, ELASTOPLASTIC_CALC


def _alpha(z: float, w: float, c: Contact, z_lim: float) -> float:
    if c.kind == ALWAYS_PLASTIC:
        return 1.0
    z_ss = z_lim if c.kind == ELASTOPLASTIC_CALC else c.z_ss
    if math.copysign(1.0, z) != math.copysign(1.0, w) or abs(z) <= c.z_ba:
        return 0.0
    if abs(z) >= z_ss:
        return 1.0
    return 0.5 * math.sin(math.pi * (abs(z) - (z_ss + c.z_ba) / 2) / (z_ss - c.z_ba)) + 0.5


def integrate(
    plant: Plant, pattern: Pattern, cycles: int, longest: float = 2e-7, accuracy: float = 1e-11
) -> NDArray[np.float64]:
    """Return x (m) at the end of each cycle from rest; longest is the longest step (s)."""
    c = plant.contact
    unit = 1e-9  # states in nm and nm/us-like units, so that one absolute tolerance serves all

    def rates(_: float, y: NDArray[np.float64], u_rate: float) -> list[float]:
        x, v, z = y[0] * unit, y[1] * 1e-4, y[2] * unit
        w = v - u_rate
        z_lim = c.z_k + (c.z_s - c.z_k) * math.exp(-((w / c.v_s) ** 2))
        z_rate = w - _alpha(z, w, c, z_lim) * abs(w) / z_lim * z
        force = c.sigma_0 * z + c.sigma_1 * z_rate + c.sigma_2 * w
        a = (-force + plant.force - plant.spring * x) / plant.mass
        return [v / unit, a / 1e-4, z_rate / unit]

    y = np.zeros(3)
    ends = []
    for _ in range(cycles):
        for duration, rate in zip(pattern.durations, pattern.rates, strict=True):
            step = min(longest, duration / 20.0, abs(2e-9 / rate) if rate else longest)
            solution = solve_ivp(
                rates,
                (0.0, duration),
                y,
                method="DOP853",
                rtol=accuracy,
                atol=accuracy,
                max_step=step,
                args=(rate,),
            )
            assert solution.success
            y = solution.y[:, -1]
        ends.append(y[0] * unit)
    return np.array(ends)
