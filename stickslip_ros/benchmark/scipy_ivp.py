# SPDX-License-Identifier: Apache-2.0
"""SciPy: ``solve_ivp`` and ``odeint`` with a compiled right-hand side, called from Python."""

from __future__ import annotations

from functools import cache
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import odeint, solve_ivp

from stickslip_ros.benchmark.equations import Constants, Scaled, rates
from stickslip_ros.benchmark.method import RELATIVE, STEPS, Drive, General

#: Every second setting: these are slow, and their cost hardly changes from one to the next.
_SETTINGS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)


class SolveIvp(General):
    """``solve_ivp`` with one of its methods."""

    settings = _SETTINGS

    def __init__(self, name: str) -> None:
        """Take the method's name in SciPy."""
        self._name = name

    def drive(self, scaled: Scaled, setting: float) -> Drive:
        """Return what runs cycles of this plant."""
        slope = _slope(scaled.constants)

        def drive(start: NDArray[np.float64], count: int) -> NDArray[np.float64]:
            y = start.copy()
            for _ in range(count):
                for duration, jump in zip(scaled.durations, scaled.jumps, strict=True):
                    y[0] += jump
                    found = solve_ivp(
                        slope,
                        (0.0, duration),
                        y,
                        method=self._name,
                        rtol=RELATIVE * setting,
                        atol=setting,
                    )
                    y = found.y[:, -1] if found.success else np.full(3, np.nan)
            return y

        return drive


class Odeint(General):
    """``odeint``: LSODA as well, with the steps in compiled code."""

    settings = _SETTINGS

    def drive(self, scaled: Scaled, setting: float) -> Drive:
        """Return what runs cycles of this plant."""
        slope = _slope(scaled.constants)

        def drive(start: NDArray[np.float64], count: int) -> NDArray[np.float64]:
            y = start.copy()
            for _ in range(count):
                for duration, jump in zip(scaled.durations, scaled.jumps, strict=True):
                    y[0] += jump
                    y = odeint(
                        slope,
                        y,
                        (0.0, duration),
                        rtol=RELATIVE * setting,
                        atol=setting,
                        tfirst=True,
                        mxstep=STEPS,
                    )[1]
            return y

        return drive


@cache
def _slope(constants: Constants) -> Any:
    damping, viscous, pull, z_ss, z_lim = constants

    @numba.njit  # type: ignore[untyped-decorator, unused-ignore]
    def slope(t: float, y: NDArray) -> NDArray:
        dy = np.empty(3)
        dy[0], dy[1], dy[2] = rates(y[0], y[1], damping, viscous, pull, z_ss, z_lim)
        return dy

    return slope
