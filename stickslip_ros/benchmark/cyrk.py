# SPDX-License-Identifier: Apache-2.0
"""CyRK: solvers in C++ called from compiled code, with a right-hand side compiled by numba."""

from __future__ import annotations

from functools import cache
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from stickslip_ros.benchmark.equations import Constants, Scaled, rates
from stickslip_ros.benchmark.method import RELATIVE, STEPS, Drive, General, peer


class CyRK(General):
    """One of CyRK's methods by its name there."""

    def __init__(self, name: str) -> None:
        """Load CyRK; raise MissingPeer."""
        self._cyrk = peer("CyRK", "cyrk")
        self._name = name

    def drive(self, scaled: Scaled, setting: float) -> Drive:
        """Return what runs cycles of this plant."""
        driver, name = _driver(self._cyrk), self._name
        address = _right_hand_side(self._cyrk, scaled.constants).address
        relative, absolute = np.array([RELATIVE * setting]), np.array([setting])

        def drive(start: NDArray[np.float64], count: int) -> NDArray[np.float64]:
            end: NDArray[np.float64] = driver(
                name, address, start, scaled.durations, scaled.jumps, count, relative, absolute
            )
            return end

        return drive


@cache
def _right_hand_side(cyrk: Any, constants: Constants) -> Any:
    """Return a C function; the constants are compiled in."""
    damping, viscous, pull, z_ss, z_lim = constants

    def fill(dy: Any, t: float, y: Any, args: Any) -> None:
        dy[0], dy[1], dy[2] = rates(y[0], y[1], damping, viscous, pull, z_ss, z_lim)

    return cyrk.cyjit(fill)


@cache
def _driver(cyrk: Any) -> Any:
    solve = cyrk.nbsolve2_ivp

    @numba.njit(nogil=True)  # type: ignore[untyped-decorator, unused-ignore]
    def cycles(
        name: str,
        address: int,
        start: NDArray,
        durations: NDArray,
        jumps: NDArray,
        count: int,
        relative: NDArray,
        absolute: NDArray,
    ) -> NDArray:
        y = start.copy()
        for _ in range(count):
            for k in range(len(durations)):
                y[0] += jumps[k]
                solution = solve(
                    address,
                    (0.0, durations[k]),
                    y,
                    name,
                    rtols=relative,
                    atols=absolute,
                    max_num_steps=STEPS,
                    force_retain_solver=False,
                )
                if solution.success:
                    found = solution.y
                    last = found.shape[1] - 1
                    for i in range(3):
                        y[i] = found[i, last]
                else:
                    y[:] = np.nan
                solution.free()
        return y

    return cycles
