# SPDX-License-Identifier: Apache-2.0
"""SciJIT: LSODA in Fortran called from compiled code, with a compiled right-hand side."""

from __future__ import annotations

from functools import cache
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from stickslip_ros.benchmark.equations import Scaled, rates
from stickslip_ros.benchmark.method import LADDER, RELATIVE, STEPS, Drive, General, peer


class SciJIT(General):
    """Its ``odeint``: the same LSODA as behind its ``solve_ivp``, with less around it."""

    settings = (*LADDER, 1e-8, 1e-9)  # an order that varies needs smaller tolerances

    def __init__(self) -> None:
        """Load SciJIT; raise MissingPeer."""
        self._integrate = peer("scijit.integrate", "scijit")

    def drive(self, scaled: Scaled, setting: float) -> Drive:
        """Return what runs cycles of this plant."""
        driver = _driver(self._integrate)
        constants = np.array(scaled.constants)

        def drive(start: NDArray[np.float64], count: int) -> NDArray[np.float64]:
            end: NDArray[np.float64] = driver(
                start, scaled.durations, scaled.jumps, count, RELATIVE * setting, setting, constants
            )
            return end

        return drive


@cache
def _driver(integrate: Any) -> Any:
    odeint = integrate.odeint

    @numba.njit  # type: ignore[untyped-decorator, unused-ignore]
    def slope(t: float, y: NDArray, c: NDArray) -> NDArray:
        dy = np.empty(3)
        dy[0], dy[1], dy[2] = rates(y[0], y[1], c[0], c[1], c[2], c[3], c[4])
        return dy

    @numba.njit  # type: ignore[untyped-decorator, unused-ignore]
    def cycles(
        start: NDArray,
        durations: NDArray,
        jumps: NDArray,
        count: int,
        relative: float,
        absolute: float,
        constants: NDArray,
    ) -> NDArray:
        y, t = start.copy(), np.zeros(2)
        for _ in range(count):
            for k in range(len(durations)):
                y[0] += jumps[k]
                t[1] = durations[k]
                found = odeint(
                    slope,
                    y,
                    t,
                    args=(constants,),
                    rtol=relative,
                    atol=absolute,
                    tfirst=True,
                    mxstep=STEPS,
                )
                y[:] = found[1]
        return y

    return cycles
