# SPDX-License-Identifier: Apache-2.0
"""scikit-SUNDAE: CVODE of SUNDIALS, with a compiled right-hand side that fills its arrays."""

from __future__ import annotations

from functools import cache
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from stickslip_ros.benchmark.equations import Constants, Scaled, rates
from stickslip_ros.benchmark.method import RELATIVE, STEPS, Drive, General, peer


class Cvode(General):
    """Adams methods: with kinks handled the problem is not stiff, and BDF takes longer."""

    settings = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)

    def __init__(self) -> None:
        """Load scikit-SUNDAE; raise MissingPeer."""
        self._cvode = peer("sksundae.cvode", "scikit-sundae")

    def drive(self, scaled: Scaled, setting: float) -> Drive:
        """Return what runs cycles of this plant."""
        solver = self._cvode.CVODE(
            _fill(scaled.constants),
            method="Adams",
            rtol=RELATIVE * setting,
            atol=setting,
            max_num_steps=STEPS,
        )

        def drive(start: NDArray[np.float64], count: int) -> NDArray[np.float64]:
            y = start.copy()
            for _ in range(count):
                for duration, jump in zip(scaled.durations, scaled.jumps, strict=True):
                    y[0] += jump
                    # Two calls instead of solve(): that one keeps what nobody asks for here.
                    solver.init_step(0.0, y)
                    found = solver.step(duration, tstop=duration)
                    y = np.array(found.y) if found.success else np.full(3, np.nan)
            return y

        return drive


@cache
def _fill(constants: Constants) -> Any:
    damping, viscous, pull, z_ss, z_lim = constants

    @numba.njit  # type: ignore[untyped-decorator, unused-ignore]
    def fill(t: float, y: NDArray, dy: NDArray) -> None:
        dy[0], dy[1], dy[2] = rates(y[0], y[1], damping, viscous, pull, z_ss, z_lim)

    return fill
